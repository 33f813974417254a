"""The table of a scenario file that says how fast its paths are flown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import Field

from gibbs_codegen.files.faults import Place
from gibbs_codegen.files.table import Table
from gibbs_codegen.scenario.arm_table import JointName
from gibbs_codegen.scenario.control_table import Thrusts
from gibbs_codegen.scenario.numbers import Positive
from gibbs_codegen.scenario.timing import Timing, TimingLaw


class TimingTable(Table):
    """When the paths are flown: as they say, or as fast as limits allow."""

    law: TimingLaw = Field(
        default=Timing.law,
        description="uniform: the paths at their times; fastest: as fast as limits allow",
    )
    limits: Thrusts | None = Field(
        default=None,
        description="least and greatest thrust of the desired motion, N; default: of the motors",
    )
    thrust_rate: Positive | None = Field(
        default=None, description="greatest rate of every thrust, N/s; default: no limit"
    )
    effort: dict[JointName, Positive] = Field(
        default_factory=dict,
        description="greatest torque or force of joints, N m or N; default: of the arm",
    )
    velocity: dict[JointName, Positive] = Field(
        default_factory=dict,
        description="greatest desired rate of joints, rad/s or m/s; default: of the arm",
    )

    @classmethod
    def synonyms(cls) -> Mapping[str, str]:
        """Shorter names."""
        return {"rate": "thrust_rate", "thrust": "limits", "torque": "effort"}

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str | Place, str]]:
        """Faults of limits that nothing would keep."""
        if values.get("law", Timing.law) == "uniform":
            for key in ("limits", "thrust_rate", "effort", "velocity"):
                if key in values:
                    yield key, 'is a limit of the law "fastest"; with "uniform" leave it out'

    def timing(self) -> Timing:
        """The timing that the table describes."""
        return Timing(**dict(self))
