"""What acts on the robot besides inputs and a push: payloads, wind and walls, with their tables."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Self

from pydantic import Field, model_validator

from gibbs_codegen.files.table import Table, Tables, needed, refusal
from gibbs_codegen.flight.scenario.numbers import (
    LEAST,
    NotNegative,
    Number,
    Positive,
    Vector,
    require,
)

MOST_PAYLOADS = MOST_WALLS = 20
_MOST_GUSTS = 1000
_FRAME = "a name in the module's FRAMES"
_DRAGS = Annotated[
    dict[str, NotNegative],
    needed(bool, "names no frame; give frames and their coefficients, such as base = 0.3"),
]


@dataclass(frozen=True)
class Payload:
    """A point mass, kg, that is fixed to the origin of a frame from time `begin` to `end`, s.

    `frame` is one of the FRAMES of the robot's module. The controller does not know of it.
    """

    frame: str
    mass: float
    begin: float = 0.0
    end: float = math.inf

    def __post_init__(self) -> None:
        require(0.0 <= self.mass < math.inf, f"payload: mass: 0 kg or more, not {self.mass}")
        require(self.begin < self.end, "payload: its end must be after its begin")


@dataclass(frozen=True)
class Gust:
    """Wind that rises and falls once: amplitude · (1 − cos 2πs) / 2, s from 0 to 1 in `duration` s.

    `amplitude` is in m/s, world axes; it is reached in the middle.
    """

    amplitude: Vector
    duration: float
    begin: float = 0.0

    def __post_init__(self) -> None:
        require(0.0 < self.duration < math.inf, "wind: a gust must last longer than 0 s")


@dataclass(frozen=True)
class Wind:
    """Steady wind and gusts, and the drag of the frames that they blow on.

    A frame is dragged by the force −c (v − w): its velocity is v, the wind's is w, both in world
    axes, m/s, and `drag` maps frames to c, N s/m. `rotational_drag` maps frames to the coefficient
    of a torque against their angular velocity, N m s/rad. `velocity` is that of the steady wind.
    """

    drag: Mapping[str, float]
    velocity: Vector = (0.0, 0.0, 0.0)
    gusts: tuple[Gust, ...] = ()
    rotational_drag: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for frame, drag in (*self.drag.items(), *self.rotational_drag.items()):
            require(0.0 <= drag < math.inf, f"wind: drag of {frame}: 0 or more, not {drag}")


@dataclass(frozen=True)
class Wall:
    """A plane that the origin of a frame may lean on: a spring and a damper, without friction.

    It is at `point`, m, and `normal` points out of it, both in world axes. At a depth of d behind
    the plane it pushes along the normal with stiffness · d + damping · ḋ, N, and never pulls.
    `stiffness` is in N/m, `damping` in N s/m.
    """

    frame: str
    point: Vector
    normal: Vector
    stiffness: float
    damping: float = 0.0

    def __post_init__(self) -> None:
        require(any(self.normal), "wall: its normal must not be zero")
        require(0.0 < self.stiffness < math.inf, "wall: its stiffness must be above 0 N/m")
        require(0.0 <= self.damping < math.inf, "wall: its damping must be 0 N s/m or more")


class PayloadTable(Table):
    """A point mass at a frame, for a time."""

    frame: str = Field(description=f"the frame at whose origin it is: {_FRAME}")
    mass: Positive = Field(description="the mass, kg")
    begin: NotNegative = Field(default=Payload.begin, description="when it is there first, s")
    end: Number | None = Field(
        default=None, description="when it is there no more, s; default: it stays"
    )

    @model_validator(mode="after")
    def _ends_after_begin(self) -> Self:
        if self.end is not None and self.end <= self.begin:
            raise refusal([(("end",), f"must be after begin, {self.begin:g} s")])
        return self

    def payload(self) -> Payload:
        """The payload that the table describes."""
        end = math.inf if self.end is None else self.end
        return Payload(self.frame, self.mass, self.begin, end)


class GustTable(Table):
    """Wind that rises and falls once, as 1 − cos."""

    amplitude: Vector = Field(description="greatest velocity of the gust, [x, y, z] in m/s")
    begin: NotNegative = Field(default=Gust.begin, description="when it begins, s")
    duration: Positive = Field(description="how long it lasts, s")

    def gust(self) -> Gust:
        """The gust that the table describes."""
        return Gust(self.amplitude, self.duration, self.begin)


class WindTable(Table):
    """Wind, and what it drags along."""

    velocity: Vector = Field(
        default=Wind.velocity, description="velocity of the steady wind, [x, y, z] in m/s"
    )
    gusts: Annotated[list[GustTable], Tables("wind.gusts", _MOST_GUSTS, "gusts")] = Field(
        default_factory=list, description="gusts on top of the steady wind"
    )
    drag: _DRAGS = Field(
        description="coefficients of drag, N s/m, by frame: base = 0.3, say, in [wind.drag]"
    )
    rotational_drag: dict[str, NotNegative] = Field(
        default_factory=dict,
        description="coefficients of drag against turning, N m s/rad, by frame",
    )

    def wind(self) -> Wind:
        """The wind that the table describes."""
        gusts = tuple(table.gust() for table in self.gusts)
        return Wind(self.drag, self.velocity, gusts, self.rotational_drag)


class WallTable(Table):
    """A plane that a frame may lean on, with a spring and a damper."""

    frame: str = Field(description=f"the frame whose origin meets the wall: {_FRAME}")
    point: Vector = Field(description="a point of the plane, [x, y, z] in m")
    normal: Annotated[
        Vector,
        needed(
            lambda vector: math.hypot(*vector) >= LEAST,
            "a direction of length zero; give at least one entry that is not 0",
        ),
    ] = Field(description="the direction in which the wall pushes, out of it, [x, y, z]")
    stiffness: Positive = Field(description="force for each metre of depth, N/m")
    damping: NotNegative = Field(
        default=Wall.damping, description="force for each m/s of speed into the wall, N s/m"
    )

    def wall(self) -> Wall:
        """The wall that the table describes."""
        return Wall(**dict(self))
