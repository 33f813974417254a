"""Everything that a module computes, compared with a formulation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from gibbs_codegen.verification.comparison import Comparison, Evaluation, compared, explained
from gibbs_codegen.verification.displacements import displacement_rows
from gibbs_codegen.verification.formulation import Formulation, Quantities
from gibbs_codegen.verification.frame_rows import Row, frame_rows, mass_rows, wrench_forces
from gibbs_codegen.verification.states import Sizes, States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.vectors import Array, times

# A few units in the last place.
_ROUNDING = 1e-15
# Of single precision: as many may come together for each joint.
_ROUNDINGS = 4

Values = Mapping[str, Array]


class Expected:
    """What a formulation gives for all functions at some states, and the natural `sizes` there."""

    def __init__(self, formulation: Formulation, states: States, single: bool = False) -> None:
        """Compute what is expected; `single` is whether the module computes in single precision."""
        tree = formulation.tree
        found = formulation.at(states).with_passive(tree, states)
        self.sizes = Sizes(tree, states)
        self._name = formulation.name
        self._limit = max(formulation.limit, _ROUNDING * self.sizes.disparity**formulation.growth)
        self._rounding = float(np.finfo(np.float32 if single else np.float64).eps)
        if single:
            self._limit = _ROUNDINGS * self._rounding * tree.size
        inputs = input_matrix(tree, found)
        self._matrix = found.mass_matrix[:, tree.free][:, :, tree.free]
        driven = times(inputs, states.u)[:, tree.free]
        pushed = driven + wrench_forces(tree, found, states)
        # With the sizes of what is added to those that `Sizes.balance` knows.
        self._driven = {
            "forward_dynamics": (driven, 0.0 * driven),
            "forward_dynamics_with_wrenches": (pushed, self.sizes.free_pushed),
        }
        residual = found.residual[:, tree.free]
        rows = [
            *((what, residual + by, size) for what, (by, size) in self._driven.items()),
            *_system(tree, found, inputs, states, self.sizes),
            *_hybrid(tree, found, inputs, self.sizes),
            *frame_rows(tree, found, states, self.sizes),
            *mass_rows(tree, found, states, self.sizes),
            *displacement_rows(tree, states),
        ]
        self._rows = {what: (theirs, size) for what, theirs, size in rows}

    def compare_functions(
        self, evaluation: Evaluation, states: States, against: str, singly: bool = False
    ) -> list[Comparison]:
        """Compare all functions of a module with what is expected, at the same states or the first.

        `against` replaces the formulation's name; `singly` is whether to compute state by state. A
        function that returned nothing fails with the reason.
        """
        rows = self.compare(evaluation.all(states, singly), against)
        return explained(rows, evaluation.faults)

    def compare(self, values: Values, against: str = "") -> list[Comparison]:
        """Compare results, under the names of `Evaluation.results`, with what is expected.

        There may be fewer or more states at the end; errors are relative to the natural sizes.
        """
        count = min(len(values["mass_matrix"]), len(self._matrix))
        # Where angles are large, rounding their sums is what limits the rest.
        angles = np.maximum(1.0, self._rounding * self.sizes.angles[:count] / self._limit)
        comparisons = []
        for what in filter(self._rows.__contains__, values):
            ours, (theirs, size) = values[what][:count], self._rows[what]
            if what in self._driven:  # Unlike the accelerations, M a is well-conditioned.
                size = self.sizes.balance(ours) + size[:count]
                with np.errstate(invalid="ignore"):  # Infinite ones are infinitely far off.
                    ours = times(self._matrix[:count], ours)
            size = size[:count] * angles.reshape(-1, *[1] * (size.ndim - 1))
            comparisons.append(
                compared(what, against or self._name, ours, theirs[:count], size, self._limit)
            )
        return comparisons


def input_matrix(tree: Tree, found: Quantities) -> Array:
    """Generalised forces (s, size, nu) of unit inputs, thrusts and then the arm's own efforts."""
    rotors = len(tree.motors)
    directions = np.array([motor.direction for motor in tree.motors]).reshape(-1, 3)
    thrusts = times(found.poses[:, :rotors, :3, :3], directions)
    drags = np.array([motor.drag for motor in tree.motors])[:, None] * thrusts
    wrenches = np.concatenate([thrusts, drags], axis=-1)
    driven = np.einsum("skij,ski->sjk", found.jacobians[:, :rotors], wrenches)
    arm = np.broadcast_to(np.eye(tree.size)[:, tree.arm], (len(driven), tree.size, len(tree.arm)))
    return np.concatenate([driven, arm], axis=-1)


def _system(
    tree: Tree, found: Quantities, inputs: Array, states: States, sizes: Sizes
) -> Iterator[Row]:
    """The equations of motion M a = R + B u, the torques of the constraints, and the energies.

    Each array that a function returns has its name, its value, and the sizes of its entries.
    """
    free, constrained = tree.free, tree.constrained
    matrix = found.mass_matrix[:, free][:, :, free]
    residual = found.residual[:, free]
    inverse = found.inverse_dynamics
    driven = times(inputs, states.u)
    yield "mass_matrix", matrix, sizes.free_matrix
    yield "mass_matrix_and_residual.mass_matrix", matrix, sizes.free_matrix
    yield "residual", residual, sizes.free_effort
    yield "mass_matrix_and_residual.residual", residual, sizes.free_effort
    yield "input_matrix", inputs[:, free], sizes.inputs[:, free]
    yield "inverse_dynamics", inverse[:, free], sizes.free_inertial_effort
    effort = sizes.inertial_effort + sizes.driven
    yield "constraint_torques", (inverse - driven)[:, constrained], effort[:, constrained]
    by_parts = np.sum(states.a * (0.5 * times(matrix, states.a) - residual), axis=-1)
    yield "gibbs", by_parts, sizes.gibbs
    yield "kinetic_energy", found.kinetic_energy, sizes.kinetic
    yield "potential_energy", found.potential_energy, sizes.potential


def _hybrid(tree: Tree, found: Quantities, inputs: Array, sizes: Sizes) -> Iterator[Row]:
    """The hybrid system: all joints, the torques of the constraints, and θ̈ = 0 for those."""
    more = (0, len(tree.constrained))
    row, square = ((0, 0), more), ((0, 0), more, more)
    torques = tree.size + np.arange(len(tree.constrained))
    matrix = np.pad(found.mass_matrix, square)
    matrix[:, tree.constrained, torques] = -1.0
    matrix[:, torques, tree.constrained] = 1.0
    yield "hybrid_mass_matrix", matrix, np.pad(sizes.matrix, square, constant_values=1.0)
    size = np.pad(sizes.effort, row, constant_values=1.0)
    yield "hybrid_residual", np.pad(found.residual, row), size
    columns = ((0, 0), more, (0, 0))
    size = np.pad(sizes.inputs, columns, constant_values=1.0)
    yield "hybrid_input_matrix", np.pad(inputs, columns), size
