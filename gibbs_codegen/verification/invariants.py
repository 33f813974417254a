"""What holds for any robot: a module's functions compared with each other.

They are compared by algebra, by differences that are exact because a function is quadratic, and
otherwise by differences of fourth order. What follows within rounding from the comparison with
Newton and Euler's equations, such as J̇ v of the tip, is not compared again.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gibbs_codegen.verification.comparison import Comparison, compared
from gibbs_codegen.verification.differences import STEP, derivative
from gibbs_codegen.verification.equations import Values
from gibbs_codegen.verification.evaluation import Evaluation
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
