"""Everything that a module computes, compared with a formulation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from gibbs_codegen.verification.comparison import Comparison, compared
from gibbs_codegen.verification.formulation import Formulation
from gibbs_codegen.verification.states import Sizes, States
from gibbs_codegen.verification.tree import Array, times

# A few units in the last place.
_ROUNDING = 1e-15
# Of single precision: as many may come together for each joint.
_ROUNDINGS = 4

Values = Mapping[str, Array]


Row = tuple[str, Array, Array]


class Expected:
    """What a formulation gives for all functions at some states, and the sizes of errors there."""

    def __init__(self, formulation: Formulation, states: States, sizes: Sizes) -> None:
        self._name = formulation.name
        self._limit = max(formulation.limit, _ROUNDING * sizes.disparity**formulation.growth)
        self._sizes = sizes
        self._places = formulation.tree.size
        free = formulation.tree.free
        every = formulation.mass_matrix(states.q)
        inputs = formulation.input_matrix(states.q)
        self._matrix = every[:, free][:, :, free]
        self._driven = times(inputs, states.u)[:, free]
        rows = [
            *_system(formulation, states, sizes, every, inputs),
            *_geometry(formulation, states, sizes),
            *_energies(formulation, states, sizes),
        ]
        self._rows = {what: (theirs, size) for what, theirs, size in rows}

    def compare(self, values: Values, against: str = "", single: bool = False) -> list[Comparison]:
        """Compare the `values` of a module's functions, by name, with what is expected.

        `values` has each function's results for all states, or for the first of them, under the
        names of `Evaluation.results`. Errors are relative to the natural sizes. `against` takes the
        place of the formulation's name; `single` says that the module computes in single precision.
        """
        count = len(values["mass_matrix"])
        rounding = float(np.finfo(np.float32 if single else np.float64).eps)
        limit = _ROUNDINGS * rounding * self._places if single else self._limit
        # Where angles are large, rounding their sums is what limits the rest.
        angles = np.maximum(1.0, rounding * self._sizes.angles[:count] / limit)
        comparisons = []
        for what, (theirs, size) in self._rows.items():
            ours = values[what]
            if what == "forward_dynamics":  # Unlike the accelerations, M a is well-conditioned.
                size = self._sizes.balance(ours, self._driven[:count])
                ours = times(self._matrix[:count], ours)
            size = size[:count] * angles.reshape(-1, *[1] * (size.ndim - 1))
            comparisons.append(
                compared(what, against or self._name, ours, theirs[:count], size, limit)
            )
        return comparisons


def _system(
    formulation: Formulation, states: States, sizes: Sizes, every: Array, inputs: Array
) -> Iterator[Row]:
    tree = formulation.tree
    free, held = tree.free, tree.held
    q, v, a, u = states.q, states.v, states.a, states.u
    matrix = every[:, free][:, :, free]
    residual = -formulation.inverse_dynamics(q, v, np.zeros_like(a))
    inverse = formulation.inverse_dynamics(q, v, a)
    driven = times(inputs, u)
    yield "mass_matrix", matrix, sizes.free_matrix
    yield "mass_matrix_and_residual.mass_matrix", matrix, sizes.free_matrix
    yield "residual", residual[:, free], sizes.free_effort
    yield "mass_matrix_and_residual.residual", residual[:, free], sizes.free_effort
    yield "input_matrix", inputs[:, free], _levers(inputs, sizes)[:, free]
    yield "inverse_dynamics", inverse[:, free], sizes.free_inertial_effort
    yield "forward_dynamics", (residual + driven)[:, free], sizes.free_effort
    yield from _hybrid(every, residual, inputs, held, sizes)
    effort = sizes.inertial_effort + sizes.spread(driven, sizes.units)
    yield "constraint_torques", (inverse - driven)[:, held], effort[:, held]
    by_parts = np.sum(a * (0.5 * times(matrix, a) - residual[:, free]), axis=-1)
    yield "gibbs", by_parts, sizes.gibbs


def _hybrid(
    every: Array, residual: Array, inputs: Array, held: list[int], sizes: Sizes
) -> Iterator[Row]:
    """The hybrid system: all joints, the torques that hold some, and θ̈ = 0 for those."""
    states, size = residual.shape
    torques = size + np.arange(len(held))
    whole = size + len(held)
    matrix = np.zeros((states, whole, whole))
    matrix[:, :size, :size] = every
    matrix[:, held, torques] = -1.0
    matrix[:, torques, held] = 1.0
    natural = np.ones_like(matrix)
    natural[:, :size, :size] = sizes.matrix
    yield "hybrid_mass_matrix", matrix, natural
    padded = np.zeros((states, whole))
    padded[:, :size] = residual
    natural = np.ones_like(padded)
    natural[:, :size] = sizes.effort
    yield "hybrid_residual", padded, natural
    columns = np.zeros((states, whole, inputs.shape[-1]))
    columns[:, :size] = inputs
    natural = np.ones_like(columns)
    natural[:, :size] = _levers(inputs, sizes)
    yield "hybrid_input_matrix", columns, natural


def _levers(inputs: Array, sizes: Sizes) -> Array:
    """Sizes of the entries of an input matrix: by column, of the largest in the rows' units."""
    units = sizes.units[:, :, None]
    size: Array = units * (np.abs(inputs) / units).max(axis=1, keepdims=True)
    return size


def _geometry(formulation: Formulation, states: States, sizes: Sizes) -> Iterator[Row]:
    reach = sizes.reach[:, None, None]
    gives, free = formulation.gives, formulation.tree.free
    if "positions" in gives:
        positions = formulation.positions(states.q)
        yield "positions", positions, reach
    if "tip_pose" in gives:
        size = np.ones((len(states), 4, 4))
        size[:, :3, 3:] = reach
        yield "tip_pose", formulation.tip_pose(states.q), size
    if "tip_jacobian" in gives:
        size = np.ones((len(states), 6, len(free)))
        size[:, :3] = sizes.length / sizes.scales
        yield "tip_jacobian", formulation.tip_jacobian(states.q)[:, :, free], size
    if "tip_bias_acceleration" in gives:
        size = np.ones((len(states), 6)) * sizes.rate[:, None] ** 2
        size[:, :3] *= sizes.length
        bias = formulation.tip_bias_acceleration(states.q, states.v)
        yield "tip_bias_acceleration", bias, size


def _energies(formulation: Formulation, states: States, sizes: Sizes) -> Iterator[Row]:
    kinetic = formulation.kinetic_energy(states.q, states.v)
    yield "kinetic_energy", kinetic, sizes.kinetic
    yield "potential_energy", formulation.potential_energy(states.q), sizes.potential
