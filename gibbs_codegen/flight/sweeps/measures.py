"""Measures of a flight: numbers of its time series by name, such as "tip_error.max", or functions.

Functions go to other processes by cloudpickle, which takes lambdas and what a notebook defines.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from typing import Any

import cloudpickle
import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import GibbsCodegenError, UsageError, near, printable
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.record.series import NO_SERIES

Measure = str | Callable[[Flight], float]

STATISTICS: dict[str, Callable[[NDArray[np.float64]], Any]] = {
    "max": np.max,
    "min": np.min,
    "mean": np.mean,
    "rms": lambda values: np.sqrt(np.mean(np.square(values))),
    "greatest": lambda values: np.max(np.abs(values)),
    "last": lambda values: values[-1],
}


def default(tip: bool) -> dict[str, Measure]:
    """Measures where none are given; `tip` is whether all robots have one."""
    points = ("centre", "tip") if tip else ("centre",)
    kinds = {"worst": "max", "last": "last"}
    return {f"{k} {p} error [m]": f"{p}_error.{s}" for p in points for k, s in kinds.items()}


def check(measures: Mapping[str, Measure], columns: Sequence[str]) -> None:
    """Refuse measures that mean nothing.

    That is one that is neither a function nor the name of a series and a statistic, or that has the
    name of another column.
    """
    if not measures:
        raise UsageError('measure: give at least one, such as {"worst": "tip_error.max"}')
    for name, measure in measures.items():
        if not isinstance(name, str) or not name.isprintable() or not name.strip():
            raise UsageError(
                f"measure {printable(repr(name))}: its name must be a text on one line"
            )
        if name in columns:
            raise UsageError(f"measure {printable(name)}: a column of the table has that name")
        if callable(measure):
            continue
        if not isinstance(measure, str):
            raise UsageError(
                f"measure {printable(name)}: must be a function of a flight, or a text such as "
                f"tip_error.max, not {printable(repr(measure), 60)}"
            )
        series, _, statistic = measure.partition(".")
        words = f"measure {printable(name)}: {printable(measure, 60)}"
        if statistic not in STATISTICS:
            choices = ", ".join(STATISTICS)
            raise UsageError(f"{words}: after a series and a dot must come one of {choices}")
        # The series of a flight with a row for each sample.
        named = {field.name for field in fields(Flight) if field.type == "Array"} - NO_SERIES
        known_series = sorted({*named, "errors", "centre_error", "tip_error", "energy_error"})
        if series not in known_series:
            hint = near(series, known_series) or "."
            there = ", ".join(known_series)
            raise UsageError(f"{words}: a flight has no such series{hint} There are {there}")


def of_flight(measures: Mapping[str, Measure], flight: Flight) -> tuple[list[float], str]:
    """Measures of a flight, NaN of those that fail, and why the first fails; "" if none does."""
    values, why = [], ""
    for name, measure in measures.items():
        try:
            values.append(_number(measure, flight))
        except (Exception, SystemExit) as error:  # A user's function concerns its flight only.
            values.append(math.nan)
            why = why or f"measure {printable(name)}: {printable(words_of(error))}"
    return values, why


def words_of(error: BaseException) -> str:
    """The error of a flight in words; with its type if it is not of this package."""
    is_ours = isinstance(error, GibbsCodegenError)
    return str(error) if is_ours else f"{type(error).__name__}: {error}"


def _number(measure: Measure, flight: Flight) -> float:
    """One measure of a flight."""
    if callable(measure):
        return float(measure(flight))
    series, _, statistic = measure.partition(".")
    values = np.asarray(getattr(flight, series))
    if not values.size:
        raise UsageError(f"this robot has no {series}")
    number = np.asarray(STATISTICS[statistic](values))
    if number.size != 1:
        raise UsageError(f"{series} has {number.size} columns, so its last value is not one number")
    return float(number.reshape(()))


def packed(measures: Mapping[str, Measure]) -> bytes:
    """Measures in a form that another process unpacks.

    Raises `UsageError` if a function cannot be taken there with what it takes.
    """
    try:
        return cloudpickle.dumps(dict(measures))
    except Exception as error:  # Whatever a function may hold.
        raise UsageError(
            f"measure: a value in a function cannot be sent to another process: {printable(error)}"
        ) from None
