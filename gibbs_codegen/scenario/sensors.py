"""What sensors make of the state before a controller sees it, as plain data."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from numbers import Integral

from gibbs_codegen.scenario.checks import require


@dataclass(frozen=True)
class Sensors:
    """White noise, by its standard deviation in each direction, and delay of what is observed.

    - `position` (m) of the base and `attitude` (rad), a rotation vector; `joints` (rad or m)
    - `velocity` (m/s) and `angular_velocity` (rad/s) of the base; `joint_rates` (rad/s or m/s)
    - `delay` (s): how old the state is that is observed
    - `seed`: flights of the same seed have the same noise
    """

    position: float = 0.0
    attitude: float = 0.0
    joints: float = 0.0
    velocity: float = 0.0
    angular_velocity: float = 0.0
    joint_rates: float = 0.0
    delay: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            require(0.0 <= value < math.inf, f"sensors: {each.name}: 0 or more")
        require(isinstance(self.seed, Integral), "sensors: seed: an integer")
