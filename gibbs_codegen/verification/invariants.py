"""Identities of any robot: a module's functions compared with each other, and with themselves.

They are compared by algebra, and by complex steps of the NumPy kernels. What follows within
rounding from the comparison with Newton and Euler's equations, such as J̇ v of the tip, is not
compared again.

With constants of each state, all functions must return what they return for one state after the
other. Functions that no formulation computes must return for one state what they return for a
batch, and in C what they return in NumPy, with the default parameters and with others. Unless
`derivatives` knows more of such a function, nothing tells whether it is right.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import numpy as np

from gibbs_codegen.interface import Signature
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.verification.comparison import (
    Comparison,
    Results,
    compared,
    explained,
    failed,
)
from gibbs_codegen.verification.complex_steps import ComplexSteps
from gibbs_codegen.verification.derivatives import constraint_sizes
from gibbs_codegen.verification.equations import Values
from gibbs_codegen.verification.parameters import parameter_values, prepared
from gibbs_codegen.verification.states import Sizes, States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.vectors import Array, times

EXACT = 1e-10


@dataclass(frozen=True)
class Invariants:
    """A module's functions, compared with each other by their results `values` at some states.

    `steps` differentiates them as its NumPy back end has them.
    Only the layout, the places of free and constrained joints, and the damping of the tree count.
    """

    evaluation: Results
    steps: ComplexSteps
    values: Values
    states: States
    sizes: Sizes
    tree: Tree

    def comparisons(self) -> list[Comparison]:
        """All that there are, given the module's functions."""
        return [*self.mass_matrix(), *self.hybrid(), *self.gradients()]

    def mass_matrix(self) -> Iterator[Comparison]:
        """Symmetric, the same everywhere, and positive definite."""
        name = "mass_matrix"
        if not self.evaluation.has(name):
            return
        matrix = self.values[name]
        transposed = np.swapaxes(matrix, -1, -2)
        yield compared(name, "its transpose, bit for bit", matrix, transposed, 1.0, 0.0)
        elsewhere = self.states.q.copy()
        elsewhere[:, self.tree.layout.q.position] += 1.0
        moved = self.evaluation(name, elsewhere)
        yield compared(name, "itself elsewhere, bit for bit", moved, matrix, 1.0, 0.0)
        scaled = matrix / self.sizes.free_matrix
        lowest = np.linalg.eigvalsh(scaled).min() if np.isfinite(scaled).all() else -np.inf
        fault = "" if lowest > 0.0 else f"an eigenvalue is {lowest:.2g}"
        # How far below zero: no error where it is not.
        error = max(0.0, -float(lowest))
        yield Comparison(name, "positive definite", len(matrix), error, 0.0, fault)

    def hybrid(self) -> Iterator[Comparison]:
        """The reduced system's accelerations and constraint torques solve the hybrid system."""
        states, values, sizes, tree = self.states, self.values, self.sizes, self.tree
        needed = "hybrid_mass_matrix", "hybrid_residual", "hybrid_input_matrix"
        if not self.evaluation.has(*needed, "forward_dynamics", "constraint_torques"):
            return
        accelerations = values["forward_dynamics"]
        torques = self.evaluation("constraint_torques", states.q, states.v, accelerations, states.u)
        solution = np.concatenate([tree.spread(accelerations)[:, : tree.count], torques], axis=-1)
        driven = times(values["hybrid_input_matrix"], states.u)
        right = values["hybrid_residual"] + driven
        left = times(values["hybrid_mass_matrix"], solution)
        size = np.ones_like(right)
        inertial = sizes.units * sizes.largest(accelerations)
        size[:, : tree.count] = (sizes.effort + inertial + sizes.driven)[:, : tree.count]
        against = "I_H a_H = R_H + B_H u of the reduced"
        yield compared("hybrid_mass_matrix", against, left, right, size, EXACT)

    def gradients(self) -> Iterator[Comparison]:
        """Derivatives of the Gibbs function and of the energies, and the rate of the energy."""
        states, values, sizes = self.states, self.values, self.sizes
        q, v = states.q, states.v

        def by(name: str, *letters: str) -> Array:
            """Derivatives by the last argument."""
            at = {letter: getattr(states, letter) for letter in letters}
            slopes = self.steps.jacobian(lambda **x: self.steps(name, *x.values()), at)
            return slopes[:, -v.shape[-1] :]

        has = self.evaluation.has
        if has("gibbs", "inverse_dynamics"):
            size = sizes.free_inertial_effort
            by_a, inverse = by("gibbs", "q", "v", "a"), values["inverse_dynamics"]
            yield compared("gibbs", "∂S/∂a = M a − R", by_a, inverse, size, EXACT)
        if has("kinetic_energy", "mass_matrix"):
            momentum, by_v = times(values["mass_matrix"], v), by("kinetic_energy", "q", "v")
            size = sizes.free_units * sizes.largest(v)
            yield compared("kinetic_energy", "∂T/∂v = M v", by_v, momentum, size, EXACT)
        if has("potential_energy", "residual"):
            resting, by_q = self.evaluation("residual", q, 0.0 * v), by("potential_energy", "q")
            size = sizes.free_effort
            yield compared("potential_energy", "−∂V/∂q = R at rest", -by_q, resting, size, EXACT)
        if has("kinetic_energy", "potential_energy", "forward_dynamics", "input_matrix"):
            a, tree = values["forward_dynamics"], self.tree

            def energy(q: Array, v: Array) -> Array:
                return self.steps("kinetic_energy", q, v) + self.steps("potential_energy", q)

            slopes = self.steps.jacobian(energy, {"q": q, "v": v})
            rate = np.sum(slopes * np.concatenate([v, a], axis=-1), axis=-1)
            damped = tree.passive.damped(tree.at_joints(q), tree.spread(v))[..., tree.free]
            power = np.sum(v * (times(values["input_matrix"], states.u) - damped), axis=-1)
            # Rates or coordinates change by their own size in the inverse of this.
            gain = np.abs(a / sizes.scales).sum(axis=-1)
            size = sizes.kinetic + sizes.potential
            size = size * (sizes.rate + np.sqrt(gain) + gain / sizes.rate)
            law = "power balance, Ė = vᵀB u"
            yield compared("forward_dynamics", law, rate, power, size, EXACT)


OF_EACH = "constants of each state"
ONE_BY_ONE, OTHER_BACK_END = "itself singly", "NumPy back end"
_NO_FORMULATION = (
    "no independent formulation of this function exists, so its values may be wrong; it was "
    "only compared with itself, a state with a batch and a back end with the other"
)
_UNCLEAR = (
    "rounding decides which constraints are redundant there, so functions of constraints are "
    "not compared in such states; this one has most of them"
)
# Two ways of computing the same, relative to the largest entry: a few digits more are lost at most.
_LIMIT = 1e-10
# The condition where there is no mass matrix to tell it.
_UNKNOWN_CONDITION = 1e6
# Solving for accelerations loses the digits of the mass matrix's condition number, and a few more.
_ROUNDING_OF_SOLUTIONS = 100.0 * float(np.finfo(float).eps)


def without_formulation(
    functions: Collection[str], comparisons: Sequence[Comparison], formulation: str
) -> list[str]:
    """Functions of a module that were not compared with a formulation, the one that gives most."""
    covered = {c.what.split(".")[0] for c in comparisons if c.against == formulation}
    return [name for name in functions if name not in covered]


def compared_with_themselves(comparisons: Sequence[Comparison]) -> dict[str, str]:
    """Why functions were compared with themselves only, by function."""
    against = (ONE_BY_ONE, OTHER_BACK_END)
    itself = {c.against for c in comparisons if c.against.startswith(against)}
    functions = {c.what.split(".")[0] for c in comparisons if c.against == ONE_BY_ONE}
    functions -= {c.what.split(".")[0] for c in comparisons if c.against not in itself}
    return {f"{name} with a formulation": _NO_FORMULATION for name in sorted(functions)}


def unclear(comparisons: Sequence[Comparison]) -> dict[str, str]:
    """In how many states something is not compared, if in any, and why."""
    most = max(comparisons, key=lambda c: c.unclear)
    where = f"{most.what} in {most.unclear} of {most.states + most.unclear} states"
    return {where: _UNCLEAR} if most.unclear else {}


def compare_with_itself(
    evaluation: Results,
    numpy: Results | None,
    robot: Robot,
    functions: Sequence[str],
    states: States,
    circumstance: str = "",
) -> list[Comparison]:
    """Compare functions for a batch with the same one by one, and with those of another back end.

    `numpy` is the NumPy back end, where `evaluation` is of another, both with the parameters of
    `robot`; `circumstance` is added to the names of what is compared with.
    """
    rows: list[Comparison] = []
    solved = max(_LIMIT, _ROUNDING_OF_SOLUTIONS * _condition(evaluation, states))
    for name in functions:
        limit = _limit(evaluation.signatures[name], solved)
        batched = evaluation.results(name, states)
        alone = evaluation.results(name, states, singly=True)
        sizes = constraint_sizes([robot], states, name, batched)
        rows += _alike(alone, batched, ONE_BY_ONE + circumstance, limit, sizes)
        if numpy is not None:
            there = numpy.results(name, states)
            rows += _alike(batched, there, OTHER_BACK_END + circumstance, limit, sizes)
    return explained(rows, evaluation.faults)


def compare_constants_of_each(
    module: ModuleType, robots: Sequence[Robot], states: States
) -> list[Comparison]:
    """Compare all functions for states that have constants each with the same one by one.

    There are as many robots, the module's with other parameters, as states. Returns the comparisons
    that fail, of one array each; where none does, the worst stands for all.
    """
    numbers = [parameter_values(robot) for robot in robots]
    values = {name: np.array([n[name] for n in numbers]) for name in module.PARAMETERS}
    try:
        batched = Results(module, module.prepare(values), (len(robots),))
        alone = _OneByOne(module, [prepared(module, robot) for robot in robots])
    except (Exception, SystemExit) as error:  # Whatever was done to the module.
        return [failed("prepare", OF_EACH, f"{type(error).__name__}: {error}")]
    solved = max(_LIMIT, _ROUNDING_OF_SOLUTIONS * _condition(alone, states))
    rows: list[Comparison] = []
    for name, signature in batched.signatures.items():
        limit = _limit(signature, solved)
        expected = alone.results(name, states)
        sizes = constraint_sizes(robots, states, name, expected)
        rows += _alike(batched.results(name, states), expected, OF_EACH, limit, sizes)
    failing = [c for c in explained(rows, batched.faults) if not c.passed]
    worst = max(rows, key=lambda c: c.error / c.limit)
    return failing or [replace(worst, what="functions")]


class _OneByOne(Results):
    """A module with constants of each state, which computes each state by itself."""

    def __init__(self, module: ModuleType, constants: Sequence[Any]) -> None:
        super().__init__(module, None, (len(constants),))
        self._constants = constants

    def _computed(self, name: str, arguments: Sequence[Array]) -> Any:
        results = []
        for i, constants in enumerate(self._constants):
            self._keywords = {"constants": constants}
            results.append(super()._computed(name, [x[i] for x in arguments]))
        return [np.array(arrays) for arrays in zip(*results, strict=True)]


def _limit(signature: Signature, solved: float) -> float:
    """The largest error of a function, given that of accelerations that are solved for."""
    arguments = signature.arguments
    return solved if "u" in arguments and "a" not in arguments else _LIMIT


def _condition(evaluation: Results, states: States) -> float:
    """The largest condition number of mass matrices that are scaled to a diagonal of ones."""
    if not evaluation.has("mass_matrix"):
        return _UNKNOWN_CONDITION
    matrices = evaluation.results("mass_matrix", states)["mass_matrix"]
    with np.errstate(all="ignore"):
        units = np.sqrt(np.diagonal(matrices, axis1=1, axis2=2))
        scaled = matrices / units[:, :, None] / units[:, None, :]
        whole = np.isfinite(scaled).all(axis=(1, 2))
        return float(np.linalg.cond(scaled[whole]).max(initial=1.0))


def _alike(
    ours: Values, theirs: Values, against: str, limit: float, sizes: Values
) -> Iterator[Comparison]:
    """Compare the arrays of a function with `theirs`, errors relative to sizes or largest entry."""
    for name, array in theirs.items():
        size = sizes.get(name, np.abs(array).max(initial=0.0))
        yield compared(name, against, ours[name], array, size, limit)
