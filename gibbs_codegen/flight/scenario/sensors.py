"""What sensors make of the state before a controller sees it, as plain data, with its table."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from numbers import Integral
from typing import Annotated

from pydantic import Field

from gibbs_codegen.files.table import Bounds, Table
from gibbs_codegen.flight.scenario.numbers import NotNegative, require


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


class SensorsTable(Table):
    """White noise and delay of what a sampled law of control observes."""

    position: NotNegative = Field(
        default=Sensors.position, description="standard deviation of each coordinate of the base, m"
    )
    attitude_deg: Annotated[NotNegative, Bounds(most=90.0, unit="°")] = Field(
        default=0.0,
        description="standard deviation of the attitude about each axis, degrees",
    )
    joints: NotNegative = Field(
        default=Sensors.joints, description="standard deviation of each joint, rad or m"
    )
    velocity: NotNegative = Field(
        default=Sensors.velocity,
        description="standard deviation of the base's velocity along each axis, m/s",
    )
    angular_velocity: NotNegative = Field(
        default=Sensors.angular_velocity,
        description="standard deviation of the base's angular velocity about each axis, rad/s",
    )
    joint_rates: NotNegative = Field(
        default=Sensors.joint_rates,
        description="standard deviation of the rate of each joint, rad/s or m/s",
    )
    delay: Annotated[NotNegative, Bounds(most=10.0, unit=" s")] = Field(
        default=Sensors.delay, description="how old the state is that is observed, s"
    )
    seed: Annotated[int, Bounds(0, 2**63 - 1)] = Field(
        default=Sensors.seed, description="flights of the same seed have the same noise"
    )

    @classmethod
    def synonyms(cls) -> Mapping[str, str]:
        """Shorter names."""
        return {"pos": "position", "vel": "velocity", "gyro": "angular_velocity"}

    def sensors(self) -> Sensors:
        """The sensors that the table describes."""
        values = dict(self)
        return Sensors(attitude=math.radians(values.pop("attitude_deg")), **values)
