"""Coordinates that move, by matrices: rates, displacements, and what leads from one to another.

With a quaternion a displacement of the base is the exponential of a 4×4 matrix.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from gibbs_codegen.robot.layout import Entries
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.vectors import Array, cross, quaternion_matrices, times


def displacement_rows(tree: Tree, states: States) -> Iterator[tuple[str, Array, Array]]:
    """What the functions of displacements should return.

    Args:
        tree: The tree of the robot.
        states: The states, whose velocities are displacements as well.

    Yields:
        For each function its name, its value, and the sizes of its entries.
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
    """The three functions of a base with a quaternion.

    Args:
        q, v: Entries of coordinates and velocities.
        states: The states.

    Returns:
        Rates and new coordinates (s, nq), and displacements (s, nv).
    """
    attitude, turn, step = states.q[:, q.attitude], states.v[:, v.attitude], states.v[:, v.position]
    rotation = quaternion_matrices(attitude)
    rates, moved = np.zeros_like(states.q), np.zeros_like(states.q)
    vector, scalar = attitude[:, :3], attitude[:, 3:]
    turning = scalar * turn + cross(vector, turn)
    falling = -np.sum(vector * turn, axis=-1, keepdims=True)
    rates[:, q.attitude] = 0.5 * np.concatenate([turning, falling], axis=-1)
    rates[:, q.position] = times(rotation, step)
    rates[:, q.joints] = states.v[:, v.joints]
    motions = np.array([_exponential(a, b) for a, b in zip(turn, step, strict=True)])
    ends = Rotation.from_matrix(rotation @ motions[:, :3, :3]).as_quat()
    ends *= np.where(np.sum(ends * attitude, axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    moved[:, q.attitude] = ends
    moved[:, q.position] = states.q[:, q.position] + times(rotation, motions[:, :3, 3])
    moved[:, q.joints] = states.q[:, q.joints] + states.v[:, v.joints]
    return rates, moved, _apart(q, v, states)


def _apart(q: Entries, v: Entries, states: States) -> Array:
    """The displacement from each state to the first.

    Args:
        q, v: Entries of coordinates and velocities.
        states: The states.

    Returns:
        The displacements (s, nv).
    """
    back = np.swapaxes(quaternion_matrices(states.q0[:, q.attitude]), -1, -2)
    there = quaternion_matrices(states.q1[:, q.attitude])
    way = times(back, states.q1[:, q.position] - states.q0[:, q.position])
    turns = Rotation.from_matrix(back @ there).as_rotvec()
    # The linear part of a displacement is linear in the way.
    units = np.eye(3)
    gains = np.array([[_exponential(turn, unit)[:3, 3] for unit in units] for turn in turns])
    apart = np.zeros_like(states.v)
    apart[:, v.attitude] = turns
    apart[:, v.position] = np.linalg.solve(np.swapaxes(gains, -1, -2), way[..., None])[..., 0]
    apart[:, v.joints] = states.q1[:, q.joints] - states.q0[:, q.joints]
    return apart


def _exponential(turn: Array, step: Array) -> Array:
    """The pose (4, 4) after a displacement by `turn` (3,) and `step` (3,)."""
    twist = np.zeros((4, 4))
    twist[:3, :3] = cross(turn, np.eye(3)).T
    twist[:3, 3] = step
    pose: Array = expm(twist)
    return pose
