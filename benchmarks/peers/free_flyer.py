"""The project's coordinates as those of a Pinocchio free-flyer, for many states at once.

A free-flyer's configuration is position, quaternion (x, y, z, w) and joint angles; its velocity is
that of the base in the base's axes, linear before angular, then the joint rates. The velocity is
J(q) v, its derivative J(q) a + b(q, v).
"""

from __future__ import annotations

import numpy as np
from peers.contender import Array, Results, States


def configuration(q: Array) -> Array:
    """Position, quaternion, joint angles."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(q[:, :3].T / 2), np.sin(q[:, :3].T / 2)
    quaternion = [
        sx * cy * cz + cx * sy * sz,
        cx * sy * cz - sx * cy * sz,
        cx * cy * sz + sx * sy * cz,
        cx * cy * cz - sx * sy * sz,
    ]
    return np.concatenate([q[:, -3:], np.array(quaternion).T, q[:, 3:-3]], axis=1)


def world_to_base(q: Array) -> Array:
    """Rotation matrix that takes world axes to the base's."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(q[:, :3].T), np.sin(q[:, :3].T)
    return _stacked(
        [cy * cz, cx * sz + sx * sy * cz, sx * sz - cx * sy * cz],
        [-cy * sz, cx * cz - sx * sy * sz, sx * cz + cx * sy * sz],
        [sy, -sx * cy, cx * cy],
    )


def rates_to_spin(q: Array) -> Array:
    """Matrix that takes the attitude's rates to the base's angular velocity, in its axes."""
    (_, cy, cz), (_, sy, sz) = np.cos(q[:, :3].T), np.sin(q[:, :3].T)
    none, one = np.zeros_like(cy), np.ones_like(cy)
    return _stacked([cy * cz, sz, none], [-cy * sz, cz, none], [sy, none, one])


def jacobian(q: Array) -> Array:
    """J(q), one matrix a state."""
    count, size = q.shape
    result = np.zeros((count, size, size))
    result[:, :3, -3:] = world_to_base(q)
    result[:, 3:6, :3] = rates_to_spin(q)
    result[:, 6:, 3:-3] = np.eye(size - 6)
    return result


def bias(q: Array, v: Array) -> Array:
    """b(q, v), the free-flyer's acceleration while v does not change."""
    (_, cy, cz), (_, sy, sz) = np.cos(q[:, :3].T), np.sin(q[:, :3].T)
    roll, pitch, yaw = v[:, :3].T
    spin = applied(rates_to_spin(q), v[:, :3])
    linear = -np.cross(spin, applied(world_to_base(q), v[:, -3:]))
    turning = [
        (-sy * cz * pitch - cy * sz * yaw) * roll + cz * yaw * pitch,
        (sy * sz * pitch - cy * cz * yaw) * roll - sz * yaw * pitch,
        cy * pitch * roll,
    ]
    joints = np.zeros((len(q), q.shape[1] - 6))
    return np.concatenate([linear, np.array(turning).T, joints], axis=1)


def inputs(states: States) -> States:
    """Configuration, velocity and generalised forces of the free-flyer."""
    q, v, tau = states
    at = jacobian(q)
    forces = np.linalg.solve(at.transpose(0, 2, 1), tau[..., None])[..., 0]
    return configuration(q), applied(at, v), forces


def matrix_and_residual(states: States, first: Array, second: Array) -> Results:
    """M and R of the free-flyer's mass matrix and nonlinear effects."""
    q, v, _ = states
    at = jacobian(q)
    across = at.transpose(0, 2, 1)
    matrices = first.reshape(at.shape)
    return across @ matrices @ at, -applied(across, second + applied(matrices, bias(q, v)))


def accelerations(states: States, first: Array, second: Array) -> Results:
    """Accelerations of the project's coordinates."""
    q, v, _ = states
    theirs = first[:, : q.shape[1]] - bias(q, v)
    return (np.linalg.solve(jacobian(q), theirs[..., None])[..., 0],)


def applied(matrices: Array, vectors: Array) -> Array:
    """Each matrix times its vector."""
    return (matrices @ vectors[..., None])[..., 0]


def _stacked(*rows: list[Array]) -> Array:
    return np.array(rows).transpose(2, 0, 1)
