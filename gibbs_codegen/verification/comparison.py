"""One thing compared with another, how much they differ, and results of a module's functions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import numpy as np

from gibbs_codegen.errors import printable
from gibbs_codegen.interface import FUNCTIONS, module_signatures
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.vectors import Array

# The size of what rounding decides, of which no error counts.
UNKNOWN = 1e200


@dataclass(frozen=True)
class Comparison:
    """One comparison over a number of states: the largest error of a quantity relative to its size.

    `limit` is the largest error that passes; `fault` says what is wrong where there is more to it
    than a number. In `unclear` states besides rounding decides, and nothing was compared.
    """

    what: str
    against: str
    states: int
    error: float
    limit: float
    fault: str = ""
    unclear: int = 0

    @property
    def passed(self) -> bool:
        """True if the error is within its limit; NaN is not."""
        return self.error <= self.limit and not self.fault


def failed(subject: str, against: str, fault: str | BaseException) -> Comparison:
    """A comparison that could not be made, or of something that is not a number."""
    text = str(fault) or type(fault).__name__
    return Comparison(subject, against, 0, np.inf, 0.0, printable(text, 400))


def compared(
    subject: str, against: str, ours: Array, theirs: Array, size: Array | float, limit: float
) -> Comparison:
    """Compare arrays, each with one entry for each state along its first axis.

    `size`, the natural sizes of the entries, broadcasts against them. What is not a number, or of
    another shape, is infinitely far off.
    """
    ours, theirs = np.asarray(ours), np.asarray(theirs)
    if ours.shape != theirs.shape:
        fault = f"shape {ours.shape} instead of {theirs.shape}"
        return Comparison(subject, against, len(theirs), np.inf, limit, fault)
    # Entries that are zero by nature must be zero.
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = np.where(ours == theirs, 0.0, np.abs(ours - theirs) / size)
    error = np.inf if np.isnan(errors).any() else float(errors.max(initial=0.0))
    # Some are multiplied by what is less than 1.
    unknown = np.broadcast_to(size, theirs.shape) > 1e-100 * UNKNOWN
    unclear = int(unknown.any(axis=tuple(range(1, theirs.ndim))).sum())
    return Comparison(subject, against, len(theirs) - unclear, error, limit, unclear=unclear)


def merged(comparisons: Iterable[Comparison]) -> list[Comparison]:
    """The worst comparison of each two things, over the states of all that compare them."""
    groups: dict[tuple[str, str], list[Comparison]] = {}
    for comparison in comparisons:
        groups.setdefault((comparison.what, comparison.against), []).append(comparison)
    return [
        replace(
            max(same, key=lambda c: (not c.passed, c.error)),
            states=sum(c.states for c in same),
            unclear=sum(c.unclear for c in same),
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
    """One line of text: the quantity that failed, its counterpart, and the reason."""
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


class Results:
    """A module with the constants that it is to use, and the results of its functions by name.

    For a function that fails, or does not return an array of its shape, the results are NaN: no
    comparison passes then, and `faults` has the reason.
    """

    def __init__(
        self, module: ModuleType, constants: Any = None, batch: tuple[int, ...] = ()
    ) -> None:
        """Take a module with constants of its `prepare`, or its default ones, of such a batch."""
        self.module = module
        self._leading = batch
        self.faults: dict[str, str] = {}
        self._keywords = {} if constants is None else {"constants": constants}
        self.signatures = {s.name: s for s in module_signatures(module)}

    def all(self, states: States, singly: bool = False) -> dict[str, Array]:
        """Results of all functions by name, as of `results`, in a batch or state by state.

        `gibbs` is counted from its value at rest, since it is determined up to that.
        """
        values: dict[str, Array] = {}
        for name in self.signatures:
            values |= self.results(name, states, singly)
        if "gibbs" in values:
            resting = self.results("gibbs", replace(states, a=0.0 * states.a), singly)
            values["gibbs"] = values["gibbs"] - resting["gibbs"]
        return values

    def has(self, *names: str) -> bool:
        """True if the module has all of these functions."""
        return self.signatures.keys() >= {*names}

    def results(self, name: str, states: States, singly: bool = False) -> dict[str, Array]:
        """Results of one function: one under its name; several under that, a point, and theirs."""
        letters = self.signatures[name].arguments
        if "h" in letters:
            states = self.stepping(states)
        arguments = [getattr(states, letter) for letter in letters]
        if singly or not (arguments or self._leading):
            calls = [self._arrays(name, [x[i] for x in arguments]) for i in range(len(states))]
            arrays = [np.array(array) for array in zip(*calls, strict=True)]
        else:
            arrays = self._arrays(name, arguments)
        outputs = FUNCTIONS[name].outputs
        names = [name] if len(outputs) == 1 else [f"{name}.{output.name}" for output in outputs]
        return dict(zip(names, arrays, strict=True))

    def stepping(self, states: States) -> States:
        """States with the accelerations that fit their inputs, so that steps are short beside them.

        Light links with dampers may have accelerations far larger than random ones, and then longer
        steps would amplify rounding.
        """
        return replace(states, a=self("forward_dynamics", states.q, states.v, states.u))

    def __call__(self, name: str, *arguments: Array) -> Array:
        """The result of a function that has one, for any batch."""
        (array,) = self._arrays(name, arguments)
        return array

    def _arrays(self, name: str, arguments: Sequence[Array]) -> list[Array]:
        shapes = self.signatures[name].shapes
        pairs = zip(arguments, self.signatures[name].argument_shapes, strict=True)
        leading = [a.shape[: a.ndim - len(shape)] for a, shape in pairs]
        batch = np.broadcast_shapes(self._leading, *leading)
        try:
            with np.errstate(all="ignore"):
                results = self._computed(name, arguments)
        except (Exception, SystemExit) as error:  # Whatever was done to the module.
            self.faults[name] = f"{type(error).__name__}: {error}"
            results = ()
        arrays = []
        for place, shape in enumerate(shapes):
            expected = (*batch, *shape)
            try:
                array = np.asarray(results[place], dtype=float)
            except (IndexError, TypeError, ValueError):
                array = np.empty(0)
            if array.shape != expected:
                self.faults.setdefault(name, f"returns shape {array.shape}, not {expected}")
                array = np.full(expected, np.nan)
            arrays.append(array)
        return arrays

    def _computed(self, name: str, arguments: Sequence[Array]) -> Any:
        """Results of a function, as a sequence of its outputs."""
        results = getattr(self.module, name)(*arguments, **self._keywords)
        return (results,) if len(self.signatures[name].shapes) == 1 else results
