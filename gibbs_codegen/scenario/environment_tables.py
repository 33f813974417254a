"""The tables of a scenario file that say what payloads, wind and walls the robot meets."""

from __future__ import annotations

import math
from typing import Annotated, Self

from pydantic import Field, model_validator

from gibbs_codegen.files.faults import refusal
from gibbs_codegen.files.fields import Tables, needed
from gibbs_codegen.files.table import Table
from gibbs_codegen.scenario.environment import Gust, Payload, Wall, Wind
from gibbs_codegen.scenario.numbers import LEAST, NotNegative, Number, Positive, Vector

MOST_PAYLOADS = MOST_WALLS = 20
_MOST_GUSTS = 1000
_FRAME = "a name in the module's FRAMES"
_DRAGS = Annotated[
    dict[str, NotNegative],
    needed(bool, "names no frame; give frames and their coefficients, such as base = 0.3"),
]


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
