"""Dry friction of joints."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from gibbs_codegen.files.table import Place
from gibbs_codegen.robot.parts.numbers import NotNegative, Positive
from gibbs_codegen.robot.parts.part import Part, number, sized


@dataclass(frozen=True)
class Friction(Part):
    """Dry friction of a joint, smooth about rest."""

    # Between `static` and `coulomb` it falls with (rate/`velocity`)², as Stribeck's curve does.
    coulomb: NotNegative = number("friction at speed, {N m or N}", ...)
    static: NotNegative = number("friction about rest, {N m or N}; default: coulomb", unsaid=None)
    velocity: Positive = sized(
        "rate at which it has fallen half of the way from static to coulomb, {rad/s or m/s}; "
        "below a tenth of it friction is smooth",
        0.1,
    )

    def _faults(self) -> Iterator[tuple[Place, str]]:
        """The fault of a joint that would be harder to move than to set in motion."""
        if self.static is not None and self.static < self.coulomb:
            yield (
                ("static",),
                f"must be at least coulomb, {self.coulomb:g}, because friction is greatest near "
                "rest; leave it out if both are equal",
            )

    def _completed(self) -> Friction:
        return self if self.static is not None else replace(self, static=self.coulomb)
