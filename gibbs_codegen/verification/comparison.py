"""One thing compared with another, and how much they differed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from gibbs_codegen.errors import printable
from gibbs_codegen.verification.vectors import Array


@dataclass(frozen=True)
class Comparison:
    """What was compared with what over so many states, and the largest error relative to its size.

    `limit` is the largest error that passes; `fault` says what is wrong where there is more to it
    than a number.
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


def failed(what: str, against: str, fault: str | BaseException) -> Comparison:
    """A comparison that could not be made, or of something that is not a number."""
    text = str(fault) or type(fault).__name__
    return Comparison(what, against, 0, np.inf, 0.0, printable(text, 400))


def compared(
    what: str, against: str, ours: Array, theirs: Array, size: Array | float, limit: float
) -> Comparison:
    """Compare arrays, each with one entry for each state along its first axis.

    `size`, the natural sizes of the entries, broadcasts against them. What is not a number, or of
    another shape, is infinitely far off.
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


def merged(comparisons: Iterable[Comparison]) -> list[Comparison]:
    """The worst comparison of each two things, over the states of all that compare them."""
    groups: dict[tuple[str, str], list[Comparison]] = {}
    for comparison in comparisons:
        groups.setdefault((comparison.what, comparison.against), []).append(comparison)
    return [
        replace(
            max(same, key=lambda c: (not c.passed, c.error)), states=sum(c.states for c in same)
        )
        for same in groups.values()
    ]


def explained(comparisons: Iterable[Comparison], faults: Mapping[str, str]) -> list[Comparison]:
    """Comparisons with the reason, by function in `faults`, why there was nothing to compare."""
    return [
        comparison
        if comparison.passed
        else replace(comparison, fault=faults.get(comparison.what.split(".")[0], comparison.fault))
        for comparison in comparisons
    ]


def failure_text(comparison: Comparison) -> str:
    """What failed against what, and why."""
    against = f" against {comparison.against}" if comparison.against else ""
    text = f"{comparison.what}{against}: "
    if comparison.fault:
        return text + comparison.fault
    error, limit = shown(comparison)
    return text + f"error {error}, limit {limit}"


def shown(comparison: Comparison) -> tuple[str, str]:
    """Error and limit in as many digits as tell them apart, where one exceeds the other."""
    for digits in range(2, 18):
        error, limit = f"{comparison.error:.{digits - 1}e}", f"{comparison.limit:.{digits}g}"
        if comparison.passed or float(error) != float(limit):
            break
    return error, limit
