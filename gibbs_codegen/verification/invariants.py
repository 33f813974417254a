"""What holds for any robot: a module's functions compared with each other, and with themselves.

They are compared by algebra, by differences that are exact because a function is quadratic, and
otherwise by differences of fourth order. What follows within rounding from the comparison with
Newton and Euler's equations, such as J̇ v of the tip, is not compared again.

With constants of each state, all functions must return what they return for one state after the
other. Functions that no formulation computes must return for one state what they return for a
batch, and in C what they return in NumPy, with the default parameters and with others. Unless
`derivatives` knows more of such a function, nothing tells whether it is right.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import numpy as np

from gibbs_codegen.interface import Signature
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.verification.comparison import (
    Comparison,
    Evaluation,
    compared,
    explained,
    failed,
)
from gibbs_codegen.verification.differences import STEP, derivative
from gibbs_codegen.verification.equations import Values
from gibbs_codegen.verification.parameters import parameter_values, prepared
from gibbs_codegen.verification.states import Sizes, States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.vectors import Array, times

EXACT, BY_DIFFERENCES = 1e-10, 1e-7
# Of one coordinate, in which the potential energy is linear or has a period of a whole turn.
_ANGLE = 2e-2
# A few units in the last place.
_ROUNDING = 1e-15


def compare_invariants(
    evaluation: Evaluation, values: Values, states: States, sizes: Sizes, tree: Tree
) -> list[Comparison]:
    """Compare a module's functions with each other, by their results `values` at the states.

    Of the tree only the layout, the places of free and constrained joints, and the damping count.
    """
    held = _Invariants(evaluation, values, states, sizes, tree)
    return [
        *held.mass_matrix(),
        held.hybrid(),
        *held.gradients(),
        held.power(),
    ]


@dataclass(frozen=True)
class _Invariants:
    """A module's functions and what they return at some states."""

    evaluation: Evaluation
    values: Values
    states: States
    sizes: Sizes
    tree: Tree

    def mass_matrix(self) -> Iterator[Comparison]:
        """Symmetric, the same everywhere, and positive definite."""
        what, matrix = "mass_matrix", self.values["mass_matrix"]
        transposed = np.swapaxes(matrix, -1, -2)
        yield compared(what, "its transpose, bit for bit", matrix, transposed, 1.0, 0.0)
        elsewhere = self.states.q.copy()
        elsewhere[:, self.tree.layout.q.position] += 1.0
        moved = self.evaluation(what, elsewhere)
        yield compared(what, "itself elsewhere, bit for bit", moved, matrix, 1.0, 0.0)
        scaled = matrix / self.sizes.free_matrix
        lowest = np.linalg.eigvalsh(scaled).min() if np.isfinite(scaled).all() else -np.inf
        fault = "" if lowest > 0.0 else f"an eigenvalue is {lowest:.2g}"
        # How far below zero: no error where it is not.
        error = max(0.0, -float(lowest))
        yield Comparison(what, "positive definite", len(matrix), error, 0.0, fault)

    def hybrid(self) -> Comparison:
        """The reduced system's accelerations and constraint torques solve the hybrid system."""
        states, values, sizes, tree = self.states, self.values, self.sizes, self.tree
        accelerations = values["forward_dynamics"]
        torques = self.evaluation("constraint_torques", states.q, states.v, accelerations, states.u)
        solution = np.concatenate([tree.spread(accelerations), torques], axis=-1)
        driven = times(values["hybrid_input_matrix"], states.u)
        right = values["hybrid_residual"] + driven
        left = times(values["hybrid_mass_matrix"], solution)
        size = np.ones_like(right)
        inertial = sizes.units * sizes.largest(accelerations)
        size[:, : tree.size] = sizes.effort + inertial + sizes.driven
        against = "I_H a_H = R_H + B_H u of the reduced"
        return compared("hybrid_mass_matrix", against, left, right, size, EXACT)

    def gradients(self) -> Iterator[Comparison]:
        """Derivatives of the Gibbs function and of the energies."""
        states, sizes, call = self.states, self.sizes, self.evaluation
        q, v, a = (x[:, None] for x in (states.q, states.v, states.a))
        units = np.eye(states.v.shape[-1])

        def quadratic(name: str, *before: Array, at: Array, steps: Array) -> Array:
            """Gradient by central differences, exact for what is quadratic at any `steps`."""
            moves = steps[:, :, None] * units
            ahead, behind = (call(name, *before, at + move) for move in (moves, -moves))
            gradient: Array = (ahead - behind) / (2 * steps)
            return gradient

        # Steps that change the functions by as much as they are leave them most digits.
        size = sizes.free_inertial_effort
        by_a = quadratic("gibbs", q, v, at=a, steps=size / sizes.free_units**2)
        inverse = self.values["inverse_dynamics"]
        yield compared("gibbs", "∂S/∂a = M a − R", by_a, inverse, size, EXACT)
        momentum = times(self.values["mass_matrix"], states.v)
        size = sizes.free_units * sizes.largest(states.v)
        by_v = quadratic("kinetic_energy", q, at=v, steps=size / sizes.free_units**2)
        yield compared("kinetic_energy", "∂T/∂v = M v", by_v, momentum, size, EXACT)
        steps = np.full(len(states), _ANGLE)
        moves = units * sizes.scales

        def weight(time: Array) -> Array:
            return call("potential_energy", call("integrate", q, time[:, None] * moves))

        by_q = derivative(weight, steps)
        resting = call("residual", states.q, 0.0 * states.v)
        # Of the whole robot's energy rounding takes this much, however light a link is.
        lost = sizes.potential[:, None] * _ROUNDING / _ANGLE / BY_DIFFERENCES
        size = sizes.free_effort + lost / sizes.scales
        against, falling = "−∂V/∂q = R at rest", -by_q / sizes.scales
        yield compared("potential_energy", against, falling, resting, size, BY_DIFFERENCES)

    def power(self) -> Comparison:
        """The energy changes at the rate vᵀB u, less what dampers take."""
        states, sizes, call = self.states, self.sizes, self.evaluation
        a = self.values["forward_dynamics"]
        # Small against the time in which rates or coordinates change by their own size.
        gain = np.abs(a / sizes.scales).sum(axis=-1)
        rapid = sizes.rate + np.sqrt(gain) + gain / sizes.rate

        def energy(time: Array) -> Array:
            v = states.v + time * a
            q = call("integrate", states.q, time * (states.v + 0.5 * time * a))
            return call("kinetic_energy", q, v) + call("potential_energy", q)

        rate = derivative(energy, STEP / rapid)
        damping = self.tree.passive.damping[self.tree.free]
        driven = times(self.values["input_matrix"], states.u)
        power = np.sum(states.v * (driven - damping * states.v), axis=-1)
        size = (sizes.kinetic + sizes.potential) * rapid
        against = "power balance, Ė = vᵀB u"
        return compared("forward_dynamics", against, rate, power, size, BY_DIFFERENCES)


OF_EACH = "constants of each state"
ONE_BY_ONE, OTHER_BACK_END = "itself, one state at a time", "the NumPy back end"
_NO_FORMULATION = (
    "no formulation gives this function, so its values may be wrong; it was only compared with "
    "itself, one state with a batch and one back end with the other"
)
# Two ways of computing the same, relative to the largest entry: a few digits more are lost at most.
_LIMIT = 1e-10
# Solving for accelerations loses the digits of the mass matrix's condition number, and a few more.
_ROUNDING_OF_SOLUTIONS = 100.0 * float(np.finfo(float).eps)


def without_formulation(
    functions: Collection[str], comparisons: Sequence[Comparison], formulation: str
) -> list[str]:
    """Functions of a module that were not compared with a formulation, the one that gives most."""
    known = {c.what.split(".")[0] for c in comparisons if c.against == formulation}
    return [name for name in functions if name not in known]


def compared_with_themselves(comparisons: Sequence[Comparison]) -> dict[str, str]:
    """Why functions were compared with themselves only, by function."""
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

    `numpy` is the NumPy back end with the same parameters, where `evaluation` is of another, and
    `circumstance` is added to the names of what is compared with.
    """
    rows: list[Comparison] = []
    solved = max(_LIMIT, _ROUNDING_OF_SOLUTIONS * _condition(evaluation, states))
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

    There are as many robots, the module's with other parameters, as states. Returns the comparisons
    that fail, of one array each; where none does, the worst stands for all.
    """
    numbers = [parameter_values(robot) for robot in robots]
    values = {name: np.array([n[name] for n in numbers]) for name in module.PARAMETERS}
    try:
        together = Evaluation(module, module.prepare(values), (len(robots),))
        alone = _OneByOne(module, [prepared(module, robot) for robot in robots])
    except (Exception, SystemExit) as error:  # Whatever was done to the module.
        return [failed("prepare", OF_EACH, f"{type(error).__name__}: {error}")]
    solved = max(_LIMIT, _ROUNDING_OF_SOLUTIONS * _condition(alone, states))
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
    """Compare the arrays of a function with `theirs`, errors relative to the largest entry."""
    for what, array in theirs.items():
        size = np.abs(array).max(initial=0.0)
        yield compared(what, against, ours[what], array, size, limit)
