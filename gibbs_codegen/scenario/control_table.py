"""The tables of a scenario file that say what commands the motors, and how those answer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any

from pydantic import Field

from gibbs_codegen.files.faults import Place
from gibbs_codegen.files.fields import Bounds, listed, needed
from gibbs_codegen.files.table import Table
from gibbs_codegen.scenario.control import Control, Law, Motors
from gibbs_codegen.scenario.numbers import NotNegative, Number, Positive

Thrusts = Annotated[
    tuple[Number, Number],
    listed(2),
    needed(lambda limits: limits[0] < limits[1], "the least thrust must be below the greatest"),
]
_Frequency = Annotated[Positive, Bounds(most=1e4)]


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
