"""When the paths of a scenario are flown: as they say, or as fast as limits allow."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from gibbs_codegen.flight.scenario.numbers import require

TimingLaw = Literal["uniform", "fastest"]


@dataclass(frozen=True)
class Timing:
    """The law of timing, and limits that the motion is to keep beside those of the robot.

    "uniform" flies the paths at their times, "fastest" as fast as these limits allow:

    - `limits`: least and greatest thrust of every motor, N; None stands for those of the motors
    - `thrust_rate`: greatest rate of every thrust, N/s; None for no limit
    - `effort`: greatest torque or force of joints, N m or N; `velocity`: greatest rate, rad/s or
      m/s; joints that are left out have those of the arm
    """

    law: TimingLaw = "uniform"
    limits: tuple[float, float] | None = None
    thrust_rate: float | None = None
    effort: Mapping[str, float] = field(default_factory=dict)
    velocity: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        laws = get_args(TimingLaw)
        require(self.law in laws, f"timing: law {self.law!r}: one of {', '.join(laws)}")
        is_limited = bool(
            self.limits is not None or self.thrust_rate or self.effort or self.velocity
        )
        require(
            self.law == "fastest" or not is_limited,
            'timing: limits are for the law "fastest"; with "uniform" leave them out',
        )
        if self.limits is not None:
            require(len(self.limits) == 2, "timing: limits: a least and a greatest thrust")
            least, most = self.limits
            require(least < most, "timing: the least thrust must be below the greatest")
        if self.thrust_rate is not None:
            require(0.0 < self.thrust_rate < math.inf, "timing: thrust rate: above 0 N/s")
        for key in ("effort", "velocity"):
            for joint, most in getattr(self, key).items():
                require(most > 0.0, f"timing: {key} of {joint}: must be above 0")
