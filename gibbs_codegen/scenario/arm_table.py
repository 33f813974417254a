"""The table of a scenario file that says what the arm is to do, with its tables by joint."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Self

from pydantic import AfterValidator, Field, WithJsonSchema, model_validator

from gibbs_codegen.files.faults import IN_NAME, fault, refusal
from gibbs_codegen.files.fields import listed, needed
from gibbs_codegen.files.table import Table
from gibbs_codegen.robot.layout import joint_kind, joint_pattern
from gibbs_codegen.robot.model import JointKind
from gibbs_codegen.robot.names import JOINT_LETTERS
from gibbs_codegen.scenario.numbers import Number
from gibbs_codegen.scenario.path_tables import PathTable
from gibbs_codegen.scenario.paths import Path, Sum
from gibbs_codegen.scenario.scenario import ArmTask


def _joint_name(kind: JointKind) -> AfterValidator:
    def check(name: str) -> str:
        if joint_kind(name) == kind:
            return name
        other, where = "prismatic", "without _deg"
        if kind == "prismatic":
            other, where = "revolute", "that ends in _deg"
        raise fault(
            f"must be the name of a {kind} joint, {JOINT_LETTERS[kind]}_…; {other} joints "
            f"belong in the table {where}",
            IN_NAME,
        )

    return AfterValidator(check)


def _schema_of_name(kind: JointKind) -> WithJsonSchema:
    return WithJsonSchema({"type": "string", "pattern": f"^{joint_pattern(kind)}$"})


Limits = Annotated[
    tuple[Number, Number],
    listed(2),
    # In radians, too: what is next to nothing may become nothing there.
    needed(
        lambda limits: math.radians(limits[0]) < math.radians(limits[1]),
        "the lower limit must be below the upper",
    ),
]
Prismatic = Annotated[str, _joint_name("prismatic"), _schema_of_name("prismatic")]
Revolute = Annotated[str, _joint_name("revolute"), _schema_of_name("revolute")]


class ArmTable(Table):
    """What the arm is to do: bring the tip along a path, or keep a posture.

    Names of joints are those of their coordinates, such as theta_7 and d_8.
    """

    tip: PathTable | None = Field(default=None, description="desired path of the tip in the world")
    tip_beside_base: PathTable | None = Field(
        default=None, description="desired path of the tip from the base centre, world axes"
    )
    posture: dict[Prismatic, Number] | None = Field(
        default=None,
        description="travel that prismatic joints hold without a tip path, m; default 0",
    )
    posture_deg: dict[Revolute, Number] | None = Field(
        default=None,
        description="angle that revolute joints hold without a tip path, degrees; default 0",
    )
    guess: dict[Prismatic, Number] | None = Field(
        default=None,
        description="travel of prismatic joints where the search for a tip path begins, m",
    )
    guess_deg: dict[Revolute, Number] | None = Field(
        default=None,
        description="angle of revolute joints where the search for a tip path begins, degrees",
    )
    limits: dict[Prismatic, Limits] = Field(
        default_factory=dict, description="least and greatest travel of prismatic joints, m"
    )
    limits_deg: dict[Revolute, Limits] = Field(
        default_factory=dict, description="least and greatest angle of revolute joints, degrees"
    )

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of keys that say twice what the arm does, and of a guess without a tip path.

        Args:
            values: The table as it stands in the file.

        Yields:
            Key and words of each fault.
        """
        tips = [key for key in ("tip", "tip_beside_base") if key in values]
        postures = [key for key in ("posture", "posture_deg") if key in values]
        if tips and (others := [*tips[1:], *postures]):
            yield others[0], f"{tips[0]} already says what the arm does; give one of them"
        for key in ("guess", "guess_deg"):
            if key in values and not tips:
                yield key, "is where the search for a tip path begins; give a tip"

    @model_validator(mode="after")
    def _is_within_limits(self) -> Self:
        faults = []
        for key in ("posture", "posture_deg"):
            limits = self.limits if key == "posture" else self.limits_deg
            for joint, value in (getattr(self, key) or {}).items():
                low, high = limits.get(joint, (-math.inf, math.inf))
                if not low <= value <= high:
                    words = f"must be within its limits, {low:g} to {high:g}, not {value:g}"
                    faults.append(((key, joint), words))
        if faults:
            raise refusal(faults)
        return self

    def task(self, base: Path) -> ArmTask:
        """The task that the table describes.

        Args:
            base: Desired path of the base centre.

        Returns:
            The task, its angles in rad.
        """
        tip = self.tip.path() if self.tip else None
        if self.tip_beside_base:
            tip = Sum((base, self.tip_beside_base.path()))
        limits = {
            joint: (math.radians(low), math.radians(high))
            for joint, (low, high) in self.limits_deg.items()
        }
        return ArmTask(
            tip,
            _joint_values(self.posture, self.posture_deg),
            _joint_values(self.guess, self.guess_deg),
            self.limits | limits,
        )


def _joint_values(
    travels: Mapping[str, float] | None, angles_deg: Mapping[str, float] | None
) -> dict[str, float] | None:
    """Values of joints in m and rad; None where there is neither table."""
    if travels is None and angles_deg is None:
        return None
    angles = {joint: math.radians(angle) for joint, angle in (angles_deg or {}).items()}
    return {**(travels or {}), **angles}
