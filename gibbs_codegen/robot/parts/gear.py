"""Gears, by which one coordinate moves several joints."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

from pydantic import GetPydanticSchema

from gibbs_codegen.files.table import Place
from gibbs_codegen.robot.parts.numbers import Label, Size
from gibbs_codegen.robot.parts.part import Part, entry


@dataclass(frozen=True, kw_only=True)
class Gear(Part):
    """The gear of a joint, whose coordinate is ratio·(that of another joint) + offset.

    Both numbers are structural, as twists are: teeth are counted, and a ratio of −1 is a sign.
    """

    # A file names the link; once the robot is whole, it is its number.
    of: Annotated[int, GetPydanticSchema(lambda _, handler: handler.generate_schema(Label))] = (
        entry("name of the link whose joint moves this one", ...)
    )
    ratio: Size = entry(
        "what this joint moves for each rad or m of the other, rad or m; below 0 the other way", ...
    )
    offset: Size = entry("coordinate of this joint where that of the other is 0, rad or m", 0.0)

    def _faults(self) -> Iterator[tuple[Place, str]]:
        """The fault of a joint that would not move."""
        if self.ratio == 0.0:
            yield (
                ("ratio",),
                'must not be 0, with which the joint would not move: give joint = "fixed"',
            )

    def after(self, first: Gear) -> Gear:
        """The two gears as one, of which `first` moves the joint that this one is of."""
        offset = self.ratio * first.offset + self.offset
        return Gear(of=first.of, ratio=self.ratio * first.ratio, offset=offset)
