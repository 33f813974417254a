"""Ties: parts between two frames, or a frame and the world, each kind an array of tables.

Names of ties, the frames that they refer to, prefixes and symbols of their parameters, texts of
robots, arms that bring them along, and what other formats leave out follow from this list.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain
from typing import Annotated, Any, TypeAlias

from gibbs_codegen.files.table import Tables
from gibbs_codegen.robot.parts.constraint import Constraint
from gibbs_codegen.robot.parts.part import Part, entry, taken
from gibbs_codegen.robot.parts.spring import Spring

Tie: TypeAlias = Constraint | Spring
TIES: tuple[type[Tie], ...] = (Constraint, Spring)


@dataclass(frozen=True, kw_only=True)
class Ties(Part):
    """The ties of a robot: fields are called as arrays of a file, in the plural."""

    constraints: Annotated[
        tuple[Constraint, ...], Tables(Constraint.array, Constraint.most, "constraints")
    ] = entry("what may hold frames, while it is active", (), key=Constraint.array)
    springs: Annotated[tuple[Spring, ...], Tables(Spring.array, Spring.most, "springs")] = entry(
        "springs and tendons between frames", (), key=Spring.array
    )

    @property
    def by_kind(self) -> dict[str, Any]:
        """Those of each kind, by the name of the field."""
        return vars(taken(Ties, self))

    def mapped(self, change: Callable[[Tie], Tie]) -> dict[str, Any]:
        """Each one changed, as of `by_kind`."""
        return {kind: tuple(map(change, several)) for kind, several in self.by_kind.items()}

    @property
    def ties(self) -> tuple[Tie, ...]:
        """All of them, in the order of `TIES`."""
        return tuple(chain(*self.by_kind.values()))
