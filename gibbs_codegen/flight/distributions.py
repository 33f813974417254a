"""What numbers vary by, in sweeps and from episode to episode: levels and distributions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from gibbs_codegen.errors import UsageError, written
from gibbs_codegen.files.toml import plain_value
from gibbs_codegen.flight.vectors import Array

Kind = Literal["uniform", "normal", "log_uniform"]


@dataclass(frozen=True)
class Draw:
    """A distribution by its two numbers: the ends, or mean and standard deviation."""

    kind: Kind
    first: float
    second: float

    def at(self, shares: Array) -> Array:
        """Numbers (s) below which shares (s) of the distribution lie, above 0 and below 1."""
        if self.kind == "normal":
            from scipy.special import ndtri  # Late, as SciPy takes long to import.

            return self.first + self.second * ndtri(shares)
        if self.kind == "log_uniform":
            return np.exp(math.log(self.first) + shares * math.log(self.second / self.first))
        return self.first + shares * (self.second - self.first)


@dataclass(frozen=True)
class Varied:
    """The values that a key takes on.

    These are `levels`, which cross with those of other keys, or what a distribution draws. They are
    factors of what robot or scenario says where they are `relative`. A key with * stands for all
    keys that match, each of which varies by itself, or all of them `together`.
    """

    levels: tuple[Any, ...] = ()
    draw: Draw | None = None
    relative: bool = False
    together: bool = False

    def ppf(self, shares: Array) -> Array:
        """Numbers (s) below which shares (s), 0 to 1, of all lie; levels are equally likely.

        It has the name that distributions of SciPy have for it.
        """
        if self.draw is not None:
            return self.draw.at(shares)
        levels = np.asarray(self.levels, dtype=np.float64)
        return levels[(shares * len(levels)).astype(np.int64)]


def uniform(low: float, high: float) -> Varied:
    """Uniformly distributed numbers.

    Args:
        low, high: The ends.

    Returns:
        What a key of `sweep`, or a number of an episode, takes on.

    Raises:
        UsageError: If `low` is not below `high`.
    """
    return _drawn("uniform", low, high, low < high, "the first number must be below the second")


def log_uniform(low: float, high: float) -> Varied:
    """Numbers with uniformly distributed logarithms, between two numbers above 0.

    Args:
        low, high: The ends.

    Returns:
        What a key of `sweep`, or a number of an episode, takes on.

    Raises:
        UsageError: If `low` is not above 0 and below `high`.
    """
    right = "the numbers must be above 0, and the first below the second"
    return _drawn("log_uniform", low, high, 0.0 < low < high, right)


def normal(mean: float, deviation: float) -> Varied:
    """Numbers of a normal distribution.

    Args:
        mean: Its mean.
        deviation: Its standard deviation, above 0.

    Returns:
        What a key of `sweep`, or a number of an episode, takes on.

    Raises:
        UsageError: If the standard deviation is not above 0.
    """
    right = "the second number, the standard deviation, must be above 0"
    return _drawn("normal", mean, deviation, deviation > 0.0, right)


def scaled(low: float | Varied | Sequence[float], high: float | None = None) -> Varied:
    """Factors of the value in robot or scenario: `scaled(0.8, 1.2)` is within 20 % of it.

    Args:
        low: The least factor; or without `high` a distribution of factors, or a list of them.
        high: The greatest factor.

    Returns:
        What a key of `sweep`, or a number of an episode, takes on.

    Raises:
        UsageError: If `low` is not below `high`.
    """
    if high is not None:
        return replace(uniform(low, high), relative=True)  # type: ignore[arg-type]
    return replace(varied(low), relative=True)


def together(values: Varied | Sequence[Any]) -> Varied:
    """One draw, or one value of a list, for all keys that match a key with `*`.

    Args:
        values: A distribution or a list.

    Returns:
        What a key of `sweep`, or a number of an episode, takes on.
    """
    return replace(varied(values), together=True)


def varied(values: Any) -> Varied:
    """The meaning of a value of `parameters` of `sweep`: a distribution, a list, or one value.

    Raises `UsageError` if the list is empty.
    """
    if isinstance(values, Varied):
        return values
    values = plain_value(values)
    listed = values if isinstance(values, list | tuple | range) else (values,)
    if not listed:
        raise UsageError("an empty list: give at least one value")
    return Varied(tuple(listed))


def _drawn(kind: Kind, first: float, second: float, right: bool, words: str) -> Varied:
    """A distribution; `UsageError` with what its numbers must be if these are not `right`."""
    numbers = (first, second)
    call = f"{kind}({', '.join(written(n, 40) for n in numbers)})"
    if not all(isinstance(n, float | int) and math.isfinite(n) for n in numbers):
        raise UsageError(f"{call}: two finite numbers are needed")
    if not right:
        raise UsageError(f"{call}: {words}")
    return Varied(draw=Draw(kind, float(first), float(second)))
