"""Functions compared with themselves.

With constants of each state, all functions must return what they return for one state after the
other. Functions that no formulation computes must return for one state what they return for a
batch, and in C what they return in NumPy, with the default parameters and with others. Unless
`derivatives` knows more of such a function, nothing tells whether it is right.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np

from gibbs_codegen.interface import Signature
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.verification.comparison import Comparison, compared, explained, failed
from gibbs_codegen.verification.evaluation import Evaluation
from gibbs_codegen.verification.parameters import parameter_values, prepared
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.vectors import Array

OF_EACH = "constants of each state"
ONE_BY_ONE, OTHER_BACK_END = "itself, one state at a time", "the NumPy back end"
_NO_FORMULATION = (
    "no formulation gives this function, so its values may be wrong; it was only compared with "
    "itself, one state with a batch and one back end with the other"
)
# Two ways of computing the same, relative to the largest entry: a few digits more are lost at most.
_LIMIT = 1e-10
# Solving for accelerations loses the digits of the mass matrix's condition number, and a few more.
_ROUNDING = 100.0 * float(np.finfo(float).eps)


def without_formulation(
    functions: Collection[str], comparisons: Sequence[Comparison], formulation: str
) -> list[str]:
    """Functions of a module that no formulation gives.

    Args:
        functions: Names of the module's functions.
        comparisons: The comparisons that were made.
        formulation: Name of the formulation that all functions are compared with if they can be.

    Returns:
        Names of the functions that were not compared with it.
    """
    known = {c.what.split(".")[0] for c in comparisons if c.against == formulation}
    return [name for name in functions if name not in known]


def compared_with_themselves(comparisons: Sequence[Comparison]) -> dict[str, str]:
    """What was compared with itself only, and why.

    Args:
        comparisons: The comparisons that were made.

    Returns:
        The reason, for each function that was compared as in this module.
    """
    against = (ONE_BY_ONE, OTHER_BACK_END)
    itself = {c.against for c in comparisons if c.against.startswith(against)}
    functions = {c.what.split(".")[0] for c in comparisons if c.against == ONE_BY_ONE}
    functions -= {c.what.split(".")[0] for c in comparisons if c.against not in itself}
    return {f"{name} with a formulation": _NO_FORMULATION for name in sorted(functions)}


def compare_with_itself(
    evaluation: Evaluation,
    numpy: Evaluation | None,
    functions: Sequence[str],
    states: States,
    circumstance: str = "",
) -> list[Comparison]:
    """Compare functions for a batch with the same one by one, and with those of another back end.

    Args:
        evaluation: The back end to verify, with the constants of some parameters.
        numpy: The NumPy back end with the same parameters, where `evaluation` is of another.
        functions: Names of functions, by the table.
        states: The states to compare at.
        circumstance: What to add to the names of what is compared with.

    Returns:
        A comparison of each array that they return with each other way of computing it.
    """
    rows: list[Comparison] = []
    solved = max(_LIMIT, _ROUNDING * _condition(evaluation, states))
    for name in functions:
        limit = _limit(evaluation.signatures[name], solved)
        together = evaluation.results(name, states)
        alone = evaluation.results(name, states, singly=True)
        rows += _alike(alone, together, ONE_BY_ONE + circumstance, limit)
        if numpy is not None:
            there = numpy.results(name, states)
            rows += _alike(together, there, OTHER_BACK_END + circumstance, limit)
    return explained(rows, evaluation.faults)


def compare_constants_of_each(
    module: ModuleType, robots: Sequence[Robot], states: States
) -> list[Comparison]:
    """Compare all functions for states that have constants each with the same one by one.

    Args:
        module: The back end.
        robots: The robot of each state: the module's, with other parameters.
        states: As many states.

    Returns:
        The comparisons that fail, of one array each; where none does, the worst stands for all.
    """
    numbers = [parameter_values(robot) for robot in robots]
    values = {name: np.array([n[name] for n in numbers]) for name in module.PARAMETERS}
    try:
        together = Evaluation(module, module.prepare(values), (len(robots),))
        alone = _OneByOne(module, [prepared(module, robot) for robot in robots])
    except (Exception, SystemExit) as error:  # Whatever was done to the module.
        return [failed("prepare", OF_EACH, f"{type(error).__name__}: {error}")]
    solved = max(_LIMIT, _ROUNDING * _condition(alone, states))
    rows: list[Comparison] = []
    for name, signature in together.signatures.items():
        limit = _limit(signature, solved)
        expected = alone.results(name, states)
        rows += _alike(together.results(name, states), expected, OF_EACH, limit)
    failing = [c for c in explained(rows, together.faults) if not c.passed]
    worst = max(rows, key=lambda c: c.error / c.limit)
    return failing or [replace(worst, what="functions")]


class _OneByOne(Evaluation):
    """A module with constants of each state, of which each is computed by itself."""

    def __init__(self, module: ModuleType, constants: Sequence[Any]) -> None:
        super().__init__(module, None, (len(constants),))
        self._each = constants

    def _computed(self, name: str, arguments: Sequence[Array]) -> Any:
        every = []
        for i, constants in enumerate(self._each):
            self._given = {"constants": constants}
            every.append(super()._computed(name, [x[i] for x in arguments]))
        return [np.array(arrays) for arrays in zip(*every, strict=True)]


def _limit(signature: Signature, solved: float) -> float:
    """The largest error of a function, given that of accelerations that are solved for."""
    arguments = signature.arguments
    return solved if "u" in arguments and "a" not in arguments else _LIMIT


def _condition(evaluation: Evaluation, states: States) -> float:
    """The largest condition number of mass matrices that are scaled to a diagonal of ones."""
    matrices = evaluation.results("mass_matrix", states)["mass_matrix"]
    with np.errstate(all="ignore"):
        units = np.sqrt(np.diagonal(matrices, axis1=1, axis2=2))
        scaled = matrices / units[:, :, None] / units[:, None, :]
        whole = np.isfinite(scaled).all(axis=(1, 2))
        return float(np.linalg.cond(scaled[whole]).max(initial=1.0))


def _alike(
    ours: Mapping[str, Array], theirs: Mapping[str, Array], against: str, limit: float
) -> Iterator[Comparison]:
    """Compare the arrays that a function returns.

    Args:
        ours: The arrays to check.
        theirs: The same arrays, computed in another way.
        against: What to call that way.
        limit: The largest error, relative to the largest entry.

    Yields:
        A comparison of each array.
    """
    for what, array in theirs.items():
        size = np.abs(array).max(initial=0.0)
        yield compared(what, against, ours[what], array, size, limit)
