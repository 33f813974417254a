"""The tables of a scenario file that say what pushes the robot."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Self

from pydantic import Field, model_validator

from gibbs_codegen.files.faults import Place, refusal
from gibbs_codegen.files.table import Table
from gibbs_codegen.scenario.numbers import NotNegative, Number, Vector
from gibbs_codegen.scenario.scenario import Push


class TipForceTable(Table):
    """A force on the tip for a time: what `push` was before it had a frame and a torque."""

    force: Vector = Field(description="[x, y, z] in N, world axes")
    begin: NotNegative = Field(default=0.0, description="when it begins, s")
    end: Number = Field(default=Push.end, description="when it ends, s")

    @model_validator(mode="after")
    def _ends_after_begin(self) -> Self:
        if self.end <= self.begin:
            raise refusal([(("end",), f"must be after begin, {self.begin:g} s")])
        return self

    def push(self) -> Push:
        """The push that the table describes."""
        return Push(**dict(self))


class PushTable(TipForceTable):
    """A force and a torque at a frame for a time."""

    frame: str = Field(
        default=Push.frame,
        description="the frame at whose origin they act: a name in the module's FRAMES, such as "
        "base, tip, or that of a [[frame]] of the robot file",
    )
    force: Vector = Field(default=Push.force, description="[x, y, z] in N, world axes")
    torque: Vector = Field(default=Push.torque, description="[x, y, z] in N m, world axes")

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str | Place, str]]:
        """The fault of a push that pushes nothing."""
        if "force" not in values and "torque" not in values:
            yield "force", "missing: give a force, a torque, or both"
