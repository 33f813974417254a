"""Values of environments that are drawn anew in every episode, each environment by itself."""

from __future__ import annotations

import math
from collections.abc import Mapping
from numbers import Real
from types import ModuleType
from typing import Any

import numpy as np

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.rollouts.problem import Array


class Draws:
    """What the values of some names are: numbers, or distributions that they are drawn from.

    A distribution is whatever has a method `ppf` as those of `scipy.stats` have: the value that a
    share between 0 and 1 of all values is below. If it is `relative`, as `scaled` makes it, values
    are factors of those `known`. Raises `UsageError`, which calls them `what`, for a name that is
    not known, and for what is no number and no distribution.
    """

    def __init__(self, values: Mapping[str, Any], known: Mapping[str, float], what: str) -> None:
        if not isinstance(values, Mapping):
            raise UsageError(f"{what}: values by name, not {printable(values)}")
        for name, value in values.items():
            if name not in known:
                raise UsageError(f"{what}: {printable(name)}: unknown; known: {', '.join(known)}")
            if not hasattr(value, "ppf") and not _is_number(value):
                raise UsageError(
                    f"{what}: {name}: a finite number or a distribution, such as "
                    f"uniform(0.8, 1.2), not {printable(value)}"
                )
            if getattr(value, "relative", False) and not known[name]:
                raise UsageError(f"{what}: {name}: factors of 0 are 0; give values")
        self.what = what
        self.factors = {
            name: known[name] if getattr(value, "relative", False) else 1.0
            for name, value in values.items()
        }
        self.values = dict(values)
        self.drawn = [name for name, value in values.items() if hasattr(value, "ppf")]

    def __call__(self, shares: Array) -> dict[str, Array]:
        """Values (m) by name, of shares (m, number of drawn values) between 0 and 1.

        Raises `UsageError` if a distribution gives what is not finite.
        """
        columns = dict(zip(self.drawn, shares.T, strict=True))
        found = {}
        for name, value in self.values.items():
            if name in columns:
                drawn = np.asarray(value.ppf(columns[name]), dtype=np.float64)
                found[name] = self.factors[name] * drawn
            else:
                found[name] = np.full(len(shares), float(value))
            if not np.all(np.isfinite(found[name])):
                raise UsageError(f"{self.what}: {name}: its distribution gives no finite number")
        return found


def episode_draws(
    module: ModuleType,
    offsets: Mapping[str, Any],
    rates: Mapping[str, Any],
    parameters: Mapping[str, Any],
) -> tuple[Draws, Draws, Draws]:
    """Offsets, rates and parameters that episodes draw, given as of `VectorEnv`."""
    zero = dict.fromkeys(module.VELOCITIES, 0.0)
    return (
        Draws(offsets, zero, "offsets"),
        Draws(rates, zero, "rates"),
        Draws(parameters, module.PARAMETERS, "parameters"),
    )


def _is_number(value: object) -> bool:
    """Whether a value is one finite real number."""
    return isinstance(value, Real) and math.isfinite(value)
