"""Functions that no formulation computes, compared with themselves.

For one state they must return what they return for a batch, and in C what they return in NumPy,
with the default parameters and with others. Unless `derivatives` knows more of such a function,
nothing tells whether it is right.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np

from gibbs_codegen.verification.comparison import Comparison, compared, explained
from gibbs_codegen.verification.evaluation import Evaluation
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.vectors import Array

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
        arguments = evaluation.signatures[name].arguments
        limit = solved if "u" in arguments and "a" not in arguments else _LIMIT
        together = evaluation.results(name, states)
        alone = evaluation.results(name, states, singly=True)
        rows += _alike(alone, together, ONE_BY_ONE + circumstance, limit)
        if numpy is not None:
            there = numpy.results(name, states)
            rows += _alike(together, there, OTHER_BACK_END + circumstance, limit)
    return explained(rows, evaluation.faults)


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
