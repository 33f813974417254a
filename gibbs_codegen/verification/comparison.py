"""One thing compared with another, and how far apart they were."""

from __future__ import annotations

from dataclasses import dataclass

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
