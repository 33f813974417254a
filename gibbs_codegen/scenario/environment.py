"""What acts on the robot from outside besides a push: payloads, wind and walls."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from gibbs_codegen.scenario.checks import require
from gibbs_codegen.scenario.paths import Vector


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
