"""What holds for any machine, asked of a module's functions alone.

The functions are held against each other: by algebra, by differences that are exact because a
function is quadratic, and else by differences of fourth order.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from gibbs_codegen.verification.comparison import Comparison, compared
from gibbs_codegen.verification.differences import STEP, derivative
from gibbs_codegen.verification.evaluation import Evaluation
from gibbs_codegen.verification.states import Sizes, States
from gibbs_codegen.verification.tree import Array, Tree, times

EXACT, BY_DIFFERENCES = 1e-10, 1e-7
# Of one coordinate, in which the potential energy is linear or has a period of a whole turn.
_ANGLE = 2e-2
# A few units in the last place.
_ROUNDING = 1e-15

Values = Mapping[str, Array]


def compare_invariants(
    evaluation: Evaluation, values: Values, states: States, sizes: Sizes, tree: Tree
) -> list[Comparison]:
    """All invariants for a module whose `values` at the states are known.

    Of the tree only the layout and the places of the free and the held joints are used.
    """
    return [
        *_mass_matrix(evaluation, values, states, sizes, tree),
        *_algebra(values, states, sizes),
        _hybrid(evaluation, values, states, sizes, tree),
        *_gradients(evaluation, values, states, sizes),
        *_rates(evaluation, values, states, sizes),
    ]


def _mass_matrix(
    evaluation: Evaluation, values: Values, states: States, sizes: Sizes, tree: Tree
) -> Iterator[Comparison]:
    what, matrix = "mass_matrix", values["mass_matrix"]
    transposed = np.swapaxes(matrix, -1, -2)
    yield compared(what, "its transpose, bit for bit", matrix, transposed, 1.0, 0.0)
    elsewhere = states.q.copy()
    elsewhere[:, tree.layout.position] += 1.0
    moved = evaluation(what, elsewhere)
    yield compared(what, "itself elsewhere, bit for bit", moved, matrix, 1.0, 0.0)
    scaled = matrix / sizes.free_matrix
    lowest = np.linalg.eigvalsh(scaled).min() if np.isfinite(scaled).all() else -np.inf
    fault = "" if lowest > 0.0 else f"an eigenvalue is {lowest:.2g}"
    # How far below zero: no error where it is not.
    error = max(0.0, -float(lowest))
    yield Comparison(what, "positive definite", len(states), error, 0.0, fault)


def _algebra(values: Values, states: States, sizes: Sizes) -> Iterator[Comparison]:
    matrix, residual = values["mass_matrix"], values["residual"]
    pairs: list[tuple[str, str, Array, Array, Array | float]] = []
    for name, alone, size in (
        ("mass_matrix", matrix, sizes.free_matrix),
        ("residual", residual, sizes.free_effort),
    ):
        in_one = f"mass_matrix_and_residual.{name}"
        pairs.append((in_one, name, values[in_one], alone, size))
    needed = times(matrix, states.a) - residual
    inverse = values["inverse_dynamics"]
    pairs.append(("inverse_dynamics", "M a − R", inverse, needed, sizes.free_inertial_effort))
    driven = times(values["input_matrix"], states.u)
    solution = values["forward_dynamics"]
    size = sizes.balance(solution, driven)
    moved = times(matrix, solution)
    pairs.append(("forward_dynamics", "M a = R + B u", moved, residual + driven, size))
    kinetic = 0.5 * np.sum(states.v * times(matrix, states.v), axis=-1)
    pairs.append(("kinetic_energy", "½ vᵀM v", values["kinetic_energy"], kinetic, sizes.kinetic))
    pose, tip = values["tip_pose"], values["positions"][:, -1]
    pairs.append(("tip_pose", "positions", pose[:, :3, 3], tip, sizes.reach[:, None]))
    axes = pose[:, :3, :3]
    cosines = axes @ np.swapaxes(axes, -1, -2)
    identity = np.broadcast_to(np.eye(3), cosines.shape)
    pairs.append(("tip_pose", "a rotation", cosines, identity, 1.0))
    for pair in pairs:
        yield compared(*pair, EXACT)


def _hybrid(
    evaluation: Evaluation, values: Values, states: States, sizes: Sizes, tree: Tree
) -> Comparison:
    """The reduced system's accelerations and their constraint torques solve the hybrid system."""
    accelerations = values["forward_dynamics"]
    torques = evaluation("constraint_torques", states.q, states.v, accelerations, states.u)
    solution = np.concatenate([tree.spread(accelerations), torques], axis=-1)
    driven = times(values["hybrid_input_matrix"], states.u)
    right = values["hybrid_residual"] + driven
    left = times(values["hybrid_mass_matrix"], solution)
    size = np.ones_like(right)
    inertial = sizes.units * sizes.largest(accelerations)
    driving = sizes.spread(driven[:, : tree.size], sizes.units)
    size[:, : tree.size] = sizes.effort + inertial + driving
    against = "I_H a_H = R_H + B_H u of the reduced"
    return compared("hybrid_mass_matrix", against, left, right, size, EXACT)


def _gradients(
    evaluation: Evaluation, values: Values, states: States, sizes: Sizes
) -> Iterator[Comparison]:
    q, v, a = (x[:, None] for x in (states.q, states.v, states.a))
    units = np.eye(states.q.shape[-1])

    def quadratic(name: str, *before: Array, at: Array, steps: Array) -> Array:
        """Gradient by central differences, exact for what is quadratic whatever the `steps`."""
        moves = steps[:, :, None] * units
        ahead, behind = (evaluation(name, *before, at + move) for move in (moves, -moves))
        gradient: Array = (ahead - behind) / (2 * steps)
        return gradient

    # Steps that change the functions by as much as they are leave them most digits.
    size = sizes.free_inertial_effort
    by_a = quadratic("gibbs", q, v, at=a, steps=size / sizes.free_units**2)
    yield compared("gibbs", "∂S/∂a = M a − R", by_a, values["inverse_dynamics"], size, EXACT)
    momentum = times(values["mass_matrix"], states.v)
    size = sizes.free_units * sizes.largest(states.v)
    by_v = quadratic("kinetic_energy", q, at=v, steps=size / sizes.free_units**2)
    yield compared("kinetic_energy", "∂T/∂v = M v", by_v, momentum, size, EXACT)
    steps = np.full(len(states), _ANGLE)
    moves = units * sizes.scales
    by_q = derivative(lambda time: evaluation("potential_energy", q + time[:, None] * moves), steps)
    resting = evaluation("residual", states.q, 0.0 * states.v)
    # Of the whole machine's energy rounding takes this much, however light a link is.
    lost = sizes.potential[:, None] * _ROUNDING / _ANGLE / BY_DIFFERENCES
    size = sizes.free_effort + lost / sizes.scales
    against, falling = "−∂V/∂q = R at rest", -by_q / sizes.scales
    yield compared("potential_energy", against, falling, resting, size, BY_DIFFERENCES)


def _rates(
    evaluation: Evaluation, values: Values, states: States, sizes: Sizes
) -> Iterator[Comparison]:
    q, v = states.q, states.v
    speed = sizes.rate
    steps = STEP / speed

    def tip_velocity(time: Array) -> Array:
        return times(evaluation("tip_jacobian", q + time * v), v)

    pose_rate = derivative(lambda time: evaluation("tip_pose", q + time * v), steps)
    axes = values["tip_pose"][:, :3, :3]
    # ω = ½Σ e × ė over the frame's axes, which are columns.
    turning = 0.5 * np.sum(np.cross(axes, pose_rate[:, :3, :3], axis=1), axis=-1)
    moving = np.concatenate([pose_rate[:, :3, 3], turning], axis=-1)
    size = speed[:, None] * np.repeat([sizes.length, 1.0], 3)
    velocity = tip_velocity(np.zeros((len(states), 1)))
    against = "J v, the rate of the pose"
    yield compared("tip_jacobian", against, velocity, moving, size, BY_DIFFERENCES)
    bias = values["tip_bias_acceleration"]
    size = size * speed[:, None]
    changing = derivative(tip_velocity, steps)
    yield compared("tip_bias_acceleration", "rate of J v", bias, changing, size, BY_DIFFERENCES)
    yield _power(evaluation, values, states, sizes)


def _power(evaluation: Evaluation, values: Values, states: States, sizes: Sizes) -> Comparison:
    """The energy changes at the rate vᵀB u."""
    a = values["forward_dynamics"]
    # Small against the time in which rates or coordinates change by their own size.
    gain = np.abs(a / sizes.scales).sum(axis=-1)
    rapid = sizes.rate + np.sqrt(gain) + gain / sizes.rate
    steps = STEP / rapid

    def energy(time: Array) -> Array:
        q, v = states.q + time * (states.v + 0.5 * time * a), states.v + time * a
        total: Array = evaluation("kinetic_energy", q, v) + evaluation("potential_energy", q)
        return total

    rate = derivative(energy, steps)
    power = np.sum(states.v * times(values["input_matrix"], states.u), axis=-1)
    size = (sizes.kinetic + sizes.potential) * rapid
    return compared(
        "forward_dynamics", "power balance, Ė = vᵀB u", rate, power, size, BY_DIFFERENCES
    )
