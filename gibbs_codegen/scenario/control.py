"""What commands the motors and joints of a flight, and how its motors answer."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

from gibbs_codegen.scenario.checks import require

Law = Literal["tracking", "computed_torque", "geometric", "open_loop", "off"]


@dataclass(frozen=True)
class Control:
    """The control law, and for laws that correct errors how the errors are to decay.

    "tracking" is computed torque where the rotors command all six directions of a wrench, and the
    geometric law where they command the force along one axis and three moments.

    - `frequency` (rad/s) and `damping_ratio`: of the errors of position and joints, and with
      `attitude_frequency` (rad/s) those of the attitude; None stands for `frequency` under computed
      torque, and for four times as much under the geometric law
    - `integral` (1/s): how fast the law learns a constant disturbance; 0: not at all
    - `rate` (Hz): how often the law is evaluated, its inputs held in between; None: at all times
    - `delay` (s): how much later than the law is evaluated its inputs act
    """

    law: Law = "tracking"
    frequency: float = 5.0
    damping_ratio: float = 1.0
    attitude_frequency: float | None = None
    integral: float = 0.0
    rate: float | None = None
    delay: float = 0.0

    def __post_init__(self) -> None:
        laws = get_args(Law)
        require(self.law in laws, f"control: law {self.law!r}: one of {', '.join(laws)}")
        require(0.0 < self.frequency < math.inf, "control: the frequency must be above 0 rad/s")
        require(0.0 <= self.damping_ratio < math.inf, "control: damping ratio: 0 or more")
        if self.attitude_frequency is not None:
            positive = 0.0 < self.attitude_frequency < math.inf
            require(positive, "control: the attitude frequency must be above 0 rad/s")
        require(0.0 <= self.integral < math.inf, "control: integral: 0 1/s or more")
        if self.rate is not None:
            require(0.0 < self.rate < math.inf, "control: the rate must be above 0 Hz")
        require(0.0 <= self.delay < math.inf, "control: delay: 0 s or more")
        sampled = self.rate is not None or self.delay == 0.0
        require(sampled, "control: a delay needs a rate, at which the law is evaluated")


@dataclass(frozen=True)
class Motors:
    """Least and greatest thrust of every motor, N, and the time constant of its lag, s; 0: none.

    None stands for what the robot file says of each rotor. With `compensation` a law of control
    that has the means commands what makes lagging thrusts be as it wants them.
    """

    limits: tuple[float, float] | None = None
    time_constant: float | None = None
    compensation: bool = True

    def __post_init__(self) -> None:
        if self.limits is not None:
            least, most = self.limits
            require(least < most, "motors: the least thrust must be below the greatest")
        lag = self.time_constant or 0.0
        require(0.0 <= lag < math.inf, "motors: time constant: 0 s or more")
