"""Coordinates that move, by matrices: rates, displacements, and what leads from one to another.

With a quaternion a displacement of the base is the exponential of a 4×4 matrix.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gibbs_codegen.robot.layout import Entries
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.vectors import (
    Array,
    cross,
    quaternion_matrices,
    quaternions_of_matrices,
    times,
)

# With turns of at most 1/2, the first term of the series that is left out is below 1e-20.
_TERMS = 16


def displacement_rows(tree: Tree, states: States) -> Iterator[tuple[str, Array, Array]]:
    """Name, value and sizes of entries of what each function of displacements should return.

    The velocities of the states serve as displacements as well.
    """
    layout = tree.layout
    if layout.is_quaternion:
        rates, moved, apart = _free_base(layout.q, layout.v, states)
    else:
        rates, moved, apart = states.v, states.q + states.v, states.q1 - states.q0
    places, twists = _largest(layout.q, states.q), _largest(layout.v, states.v)
    yield "coordinate_rates", rates, twists[:, _kinds(layout.q)]
    yield "integrate", moved, (places + twists)[:, _kinds(layout.q)]
    yield "difference", apart, (places + places[:1])[:, _kinds(layout.v)]


def _kinds(entries: Entries) -> Array:
    """For each entry 0 if it is a length, else 1."""
    return np.array([int(unit[0] != "m") for unit in entries.units])


def _largest(entries: Entries, values: Array) -> Array:
    """The largest length of each state, and the largest of the other entries and 1, (s, 2)."""
    kinds = _kinds(entries)
    along, about = (np.abs(values[:, kinds == kind]).max(axis=-1) for kind in (0, 1))
    return np.stack([along, np.maximum(about, 1.0)], axis=-1)


def _free_base(q: Entries, v: Entries, states: States) -> tuple[Array, Array, Array]:
    """Rates and new coordinates (s, nq), and displacements (s, nv), of a base with a quaternion."""
    attitude, turn, step = states.q[:, q.attitude], states.v[:, v.attitude], states.v[:, v.position]
    rotation = quaternion_matrices(attitude)
    rates, moved = np.zeros_like(states.q), np.zeros_like(states.q)
    vector, scalar = attitude[:, :3], attitude[:, 3:]
    turning = scalar * turn + cross(vector, turn)
    falling = -np.sum(vector * turn, axis=-1, keepdims=True)
    rates[:, q.attitude] = 0.5 * np.concatenate([turning, falling], axis=-1)
    rates[:, q.position] = times(rotation, step)
    rates[:, q.joints] = states.v[:, v.joints]
    motions = _exponentials(turn, step)
    ends = quaternions_of_matrices(rotation @ motions[:, :3, :3])
    ends *= np.where(np.sum(ends * attitude, axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    moved[:, q.attitude] = ends
    moved[:, q.position] = states.q[:, q.position] + times(rotation, motions[:, :3, 3])
    moved[:, q.joints] = states.q[:, q.joints] + states.v[:, v.joints]
    return rates, moved, _apart(q, v, states)


def _apart(q: Entries, v: Entries, states: States) -> Array:
    """Displacements (s, nv) from each state to the first."""
    back = np.swapaxes(quaternion_matrices(states.q0[:, q.attitude]), -1, -2)
    there = quaternion_matrices(states.q1[:, q.attitude])
    way = times(back, states.q1[:, q.position] - states.q0[:, q.position])
    turns = _turns(quaternions_of_matrices(back @ there))
    # The linear part of a displacement is linear in the way.
    gains = _exponentials(turns[:, None], np.eye(3))[..., :3, 3]
    apart = np.zeros_like(states.v)
    apart[:, v.attitude] = turns
    apart[:, v.position] = np.linalg.solve(np.swapaxes(gains, -1, -2), way[..., None])[..., 0]
    apart[:, v.joints] = states.q1[:, q.joints] - states.q0[:, q.joints]
    return apart


def _turns(quaternions: Array) -> Array:
    """The shortest turns (…, 3) to the attitudes of quaternions (…, 4)."""
    vector, scalar = quaternions[..., :3], quaternions[..., 3:]
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    half = np.arctan2(length, np.abs(scalar))
    factor = np.where(length > 0.0, half / np.where(length > 0.0, length, 1.0), 1.0)
    turns: Array = 2.0 * np.copysign(factor, scalar) * vector
    return turns


def _exponentials(turn: Array, step: Array) -> Array:
    """The poses (…, 4, 4) after displacements by `turn` (…, 3) and `step` (…, 3), by their series.

    It is summed for a part of the displacement with turns of at most 1/2, and the pose there is
    squared until it is the whole.
    """
    halvings = max(int(np.frexp(np.abs(turn).max())[1]) + 1, 0)
    twist = np.zeros((*np.broadcast_shapes(turn.shape, step.shape)[:-1], 4, 4))
    # Rows of e × ω over the axes e are the matrix of ω×.
    twist[..., :3, :3] = cross(np.eye(3), turn[..., None, :])
    twist[..., :3, 3] = step
    twist /= 2.0**halvings
    poses = np.eye(4)
    for n in range(_TERMS, 0, -1):
        poses = np.eye(4) + twist @ poses / n
    for _ in range(halvings):
        poses = poses @ poses
    return poses
