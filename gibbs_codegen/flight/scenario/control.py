"""What commands the motors and joints of a flight, and how its motors answer, with their tables."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args

from pydantic import Field

from gibbs_codegen.files.table import Bounds, Place, Table, listed, needed
from gibbs_codegen.flight.scenario.numbers import NotNegative, Number, Positive, require

Law = Literal["tracking", "computed_torque", "geometric", "open_loop", "off"]
Thrusts = Annotated[
    tuple[Number, Number],
    listed(2),
    needed(lambda limits: limits[0] < limits[1], "the least thrust must be below the greatest"),
]
_Frequency = Annotated[Positive, Bounds(most=1e4)]


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


class ControlTable(Table):
    """The control law."""

    law: Law = Field(default=Control.law, description="what commands the motors and joints")
    frequency: _Frequency = Field(
        default=Control.frequency,
        description="natural frequency of the error dynamics of position and joints, rad/s",
    )
    damping_ratio: Annotated[NotNegative, Bounds(most=1e4)] = Field(
        default=Control.damping_ratio, description="damping ratio of the error dynamics"
    )
    attitude_frequency: _Frequency | None = Field(
        default=Control.attitude_frequency,
        description="natural frequency of the error dynamics of the attitude, rad/s; default: "
        "frequency under computed torque, four times frequency under the geometric law",
    )
    integral: Annotated[NotNegative, Bounds(most=1e4)] = Field(
        default=Control.integral,
        description="rate at which a constant disturbance is learned, 1/s; 0: not at all",
    )
    rate: Annotated[Number, Bounds(0.1), Bounds(most=1e6)] | None = Field(
        default=Control.rate,
        description="how often the law is evaluated, Hz; default: at all times",
    )
    delay: Annotated[NotNegative, Bounds(most=10.0, unit=" s")] = Field(
        default=Control.delay,
        description="how much later than the law is evaluated its inputs act, s; needs a rate",
    )

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str | Place, str]]:
        """The fault of a delay of a law that is evaluated at all times."""
        if values.get("delay") and "rate" not in values:
            yield "rate", "missing: a delay needs to know how often the law is evaluated, in Hz"

    def control(self) -> Control:
        """The control that the table describes."""
        return Control(**dict(self))


class MotorsTable(Table):
    """Limits and lag of every motor."""

    limits: Thrusts | None = Field(
        default=None, description="least and greatest thrust, N; default: those of the robot file"
    )
    time_constant: NotNegative | None = Field(
        default=None,
        description="time constant of the lag, s; 0: no lag; default: that of the robot file",
    )
    compensation: bool = Field(
        default=Motors.compensation,
        description="whether a law that has the means compensates the lag",
    )

    def motors(self) -> Motors:
        """The motors that the table describes."""
        return Motors(**dict(self))
