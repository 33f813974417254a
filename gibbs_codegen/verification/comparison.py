"""One thing compared with another, and how far apart they were."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gibbs_codegen.verification.tree import Array


@dataclass(frozen=True)
class Comparison:
    """What was compared with what: the largest error over `states` states, relative, and its limit.

    `fault` says in words what is wrong where there is more to it than a number.
    """

    what: str
    against: str
    states: int
    error: float
    limit: float
    fault: str = ""

    @property
    def passed(self) -> bool:
        """Whether the error is within its limit; what is not a number is not."""
        return self.error <= self.limit and not self.fault


def compared(
    what: str, against: str, ours: Array, theirs: Array, size: Array | float, limit: float
) -> Comparison:
    """Compare arrays of one state each along their first axis, relative to `size`.

    `size` broadcasts against them. What is not a number, or of another shape, is infinitely far.
    """
    ours, theirs = np.asarray(ours), np.asarray(theirs)
    if ours.shape != theirs.shape:
        fault = f"shape {ours.shape} instead of {theirs.shape}"
        return Comparison(what, against, len(theirs), np.inf, limit, fault)
    # What is zero by nature must be zero.
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = np.where(ours == theirs, 0.0, np.abs(ours - theirs) / size)
    error = np.inf if np.isnan(errors).any() else float(errors.max(initial=0.0))
    return Comparison(what, against, len(theirs), error, limit)


def worst(parts: Sequence[Sequence[Comparison]]) -> list[Comparison]:
    """Comparisons that were made in parts, of the same things in the same order, as one each."""
    merged = []
    for same in zip(*parts, strict=True):
        first = max(same, key=lambda c: (not c.passed, c.error))
        merged.append(replace(first, states=sum(c.states for c in same)))
    return merged


def explained(comparisons: list[Comparison], faults: dict[str, str]) -> list[Comparison]:
    """Comparisons with the reason why a function gave nothing."""
    return [
        comparison
        if comparison.passed
        else replace(comparison, fault=faults.get(comparison.what.split(".")[0], comparison.fault))
        for comparison in comparisons
    ]


def failure_text(comparison: Comparison) -> str:
    """One failure in words."""
    against = f" against {comparison.against}" if comparison.against else ""
    text = f"{comparison.what}{against}: "
    if comparison.fault:
        return text + comparison.fault
    return text + f"error {comparison.error:.2g}, limit {comparison.limit:.0e}"
