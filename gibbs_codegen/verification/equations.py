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

Values = Mapping[str, Array]


def compare_equations(
    values: Values, formulation: Formulation, states: States, sizes: Sizes
) -> list[Comparison]:
    """Compare the `values` of a module's functions, by name, with what a formulation gives.

    `values` has each function's results for all states; the two of `mass_matrix_and_residual` are
    under "mass_matrix_and_residual.M" and ".R". Errors are relative to `sizes`.
    """
    rows = [
        *_system(values, formulation, states, sizes),
        *_geometry(values, formulation, states, sizes),
        *_energies(values, formulation, states, sizes),
    ]
    name = formulation.name
    limit = max(formulation.limit, _ROUNDING * sizes.disparity**formulation.growth)
    return [
        compared(what, name, values[what] if ours is None else ours, theirs, size, limit)
        for what, ours, theirs, size in rows
    ]


Row = tuple[str, Array | None, Array, Array | float]


def _system(
    values: Values, formulation: Formulation, states: States, sizes: Sizes
) -> Iterator[Row]:
    tree = formulation.tree
    free, held = tree.free, tree.held
    q, v, a, u = states.q, states.v, states.a, states.u
    every = formulation.mass_matrix(q)
    matrix = every[:, free][:, :, free]
    inputs = formulation.input_matrix(q)
    residual = -formulation.inverse_dynamics(q, v, np.zeros_like(a))
    inverse = formulation.inverse_dynamics(q, v, a)
    yield "mass_matrix", None, matrix, sizes.free_matrix
    yield "mass_matrix_and_residual.M", None, matrix, sizes.free_matrix
    yield "residual", None, residual[:, free], sizes.free_effort
    yield "mass_matrix_and_residual.R", None, residual[:, free], sizes.free_effort
    yield "input_matrix", None, inputs[:, free], _levers(inputs, sizes)[:, free]
    yield "inverse_dynamics", None, inverse[:, free], sizes.free_inertial_effort
    driven = times(inputs, u)
    solution = values["forward_dynamics"]
    size = sizes.balance(solution, driven[:, free])
    yield "forward_dynamics", times(matrix, solution), (residual + driven)[:, free], size
    yield from _hybrid(every, residual, inputs, held, sizes)
    effort = sizes.inertial_effort + sizes.spread(driven, sizes.units)
    yield "constraint_torques", None, (inverse - driven)[:, held], effort[:, held]
    by_parts = np.sum(a * (0.5 * times(matrix, a) - residual[:, free]), axis=-1)
    yield "gibbs", None, by_parts, sizes.gibbs


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
    yield "hybrid_mass_matrix", None, matrix, natural
    padded = np.zeros((states, whole))
    padded[:, :size] = residual
    natural = np.ones_like(padded)
    natural[:, :size] = sizes.effort
    yield "hybrid_residual", None, padded, natural
    columns = np.zeros((states, whole, inputs.shape[-1]))
    columns[:, :size] = inputs
    natural = np.ones_like(columns)
    natural[:, :size] = _levers(inputs, sizes)
    yield "hybrid_input_matrix", None, columns, natural


def _levers(inputs: Array, sizes: Sizes) -> Array:
    """Sizes of the entries of an input matrix: by column, of the largest in the rows' units."""
    units = sizes.units[:, :, None]
    size: Array = units * (np.abs(inputs) / units).max(axis=1, keepdims=True)
    return size


def _geometry(
    values: Values, formulation: Formulation, states: States, sizes: Sizes
) -> Iterator[Row]:
    reach = sizes.reach[:, None, None]
    gives, free = formulation.gives, formulation.tree.free
    if "positions" in gives:
        yield "positions", None, formulation.positions(states.q), reach
    if "tip_pose" in gives:
        size = np.ones((len(states), 4, 4))
        size[:, :3, 3:] = reach
        yield "tip_pose", None, formulation.tip_pose(states.q), size
    if "tip_jacobian" in gives:
        size = np.ones((len(states), 6, len(free)))
        size[:, :3] = sizes.length / sizes.scales
        yield "tip_jacobian", None, formulation.tip_jacobian(states.q)[:, :, free], size
    if "tip_bias_acceleration" in gives:
        size = np.ones((len(states), 6)) * sizes.rate[:, None] ** 2
        size[:, :3] *= sizes.length
        bias = formulation.tip_bias_acceleration(states.q, states.v)
        yield "tip_bias_acceleration", None, bias, size


def _energies(
    values: Values, formulation: Formulation, states: States, sizes: Sizes
) -> Iterator[Row]:
    kinetic = formulation.kinetic_energy(states.q, states.v)
    yield "kinetic_energy", None, kinetic, sizes.kinetic
    yield "potential_energy", None, formulation.potential_energy(states.q), sizes.potential
