"""What differs from episode to episode of environments: numbers that each draws anew."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from numbers import Real
from typing import Any

import numpy as np

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.flight.plant.vehicle import Flags
from gibbs_codegen.runtime.rollouts import Array

Generators = Sequence[np.random.Generator]
Named = Mapping[str, float]
Part = tuple[Mapping[str, Any], Named]


class EpisodeDistributions:
    """Values by name: numbers, or distributions that they are drawn from.

    A distribution is whatever has a method `ppf` as those of `scipy.stats` have: the value that a
    share between 0 and 1 of all values is below. If it is `relative`, as `scaled` makes it, values
    are factors of the `usual` ones, and all are the `least` or more. Raises `UsageError`, which
    calls them `part`, for a name without a usual value, and for what is no number and no
    distribution.
    """

    def __init__(self, part: str, values: Mapping[str, Any], usual: Named, least: Named) -> None:
        if not isinstance(values, Mapping):
            raise UsageError(f"{part}: values by name, not {printable(values)}")
        self.part, self.values, self.least = part, dict(values), least
        self.drawn = [name for name, value in values.items() if hasattr(value, "ppf")]
        self.factors = dict.fromkeys(values, 1.0)
        for name, value in values.items():
            if name not in usual:
                raise UsageError(f"{part}: {printable(name)}: unknown; known: {', '.join(usual)}")
            if name not in self.drawn and not (isinstance(value, Real) and math.isfinite(value)):
                raise UsageError(
                    f"{part}: {name}: a finite number or a distribution, such as "
                    f"uniform(0.8, 1.2), not {printable(value)}"
                )
            if getattr(value, "relative", False):
                self.factors[name] = usual[name]
                if not usual[name]:
                    raise UsageError(
                        f"{part}: {name}: the value is 0, and so are all its multiples; give values"
                    )

    def __call__(self, shares: Array) -> dict[str, Array]:
        """Values (m) by name, of shares (m, number of drawn values) between 0 and 1.

        Raises `UsageError` if a distribution gives what is not finite, and for what is too small.
        """
        columns, values = dict(zip(self.drawn, shares.T, strict=True)), {}
        for name, value in self.values.items():
            one = value.ppf(columns[name]) if name in columns else np.full(len(shares), value)
            values[name] = self.factors[name] * np.asarray(one, dtype=np.float64)
            if not np.all(np.isfinite(values[name])):
                raise UsageError(
                    f"{self.part}: {name}: its distribution gives a number that is not finite"
                )
            if np.any(values[name] < (least := self.least.get(name, -math.inf))):
                raise UsageError(f"{self.part}: {name}: must be {least:g} or more")
        return values


class Episodes:
    """Values (n) of the episodes that are under way: by what they are of, and by names.

    A part has values, and the usual ones of all names. No value but of parameters is below the
    `least` of its name. Each environment draws from its own random numbers, in the order of the
    parts.
    """

    def __init__(self, count: int, parts: Mapping[str, Part], least: Named) -> None:
        self._count = count
        self._distributions = {
            part: EpisodeDistributions(part, values, usual, least if part != "parameters" else {})
            for part, (values, usual) in parts.items()
        }
        self.values = {
            part: {name: np.zeros(count) for name in distributions.values}
            for part, distributions in self._distributions.items()
        }

    def draw(self, rows: Flags, generators: Generators) -> dict[str, dict[str, Array]]:
        """Draw values (m) of some environments (n) anew, and return them."""
        ends = np.cumsum([len(distribution.drawn) for distribution in self._distributions.values()])
        chosen = itertools.compress(generators, rows)
        shares = np.array([generator.random(ends[-1]) for generator in chosen])
        columns = np.split(shares, ends[:-1], axis=1)
        drawn = {}
        for (part, distributions), column in zip(self._distributions.items(), columns, strict=True):
            drawn[part] = distributions(column)
            for name, values in drawn[part].items():
                self.values[part][name][rows] = values
        return drawn

    def table(self, part: str, names: Sequence[str]) -> Array:
        """Values (n, names) of a part, 0 of names that it has not."""
        values, zero = self.values[part], np.zeros(self._count)
        return np.column_stack([values.get(name, zero) for name in names])
