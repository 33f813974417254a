"""What functions of frames, of wrenches on them, and of the robot's mass should return."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gibbs_codegen.verification.formulation import Quantities
from gibbs_codegen.verification.newton_euler import wrench_sizes
from gibbs_codegen.verification.states import Sizes, States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.vectors import Array, times

# Name of an array that a function returns, its value, and the sizes of its entries.
Row = tuple[str, Array, Array]


def frame_rows(tree: Tree, found: Quantities, states: States, sizes: Sizes) -> Iterator[Row]:
    """Points, the motion of the named frames, and what wrenches on these do.

    Each array that a function returns has its name, its value, and the sizes of its entries.
    """
    rotors = len(tree.motors)
    poses, jacobians = found.poses[:, rotors:], found.jacobians[:, rotors:][..., tree.free]
    reach = sizes.reach[:, None, None]
    if found.positions is not None:
        yield "positions", found.positions, reach
    size = np.ones_like(poses)
    size[..., :3, 3:] = reach[..., None]
    yield from _of_frames(tree, "pose", poses, size)
    size = np.ones_like(jacobians)
    size[..., :3, :] = sizes.length / sizes.scales
    yield from _of_frames(tree, "jacobian", jacobians, size)
    rate, twist = sizes.rate[:, None, None], np.repeat([sizes.length, 1.0], 3)
    velocities = times(jacobians, states.v[:, None])
    size = rate * np.broadcast_to(twist, velocities.shape)
    yield "frame_velocities", velocities, size
    yield "wrench_forces", wrench_forces(tree, found, states), sizes.free_pushed
    if found.bias_accelerations is not None:
        yield from _of_frames(tree, "bias_acceleration", found.bias_accelerations, rate * size)


def _of_frames(tree: Tree, what: str, values: Array, size: Array) -> Iterator[Row]:
    """Rows of the functions of all frames, `values` (s, frames, …), and of the tip by itself."""
    yield f"frame_{what}s", values, size
    if tree.tip is not None:
        yield f"tip_{what}", values[:, tree.tip], size[:, tree.tip]


def wrench_forces(tree: Tree, found: Quantities, states: States) -> Array:
    """Generalised forces (s, nv), N m and N, of the wrenches on the named frames."""
    jacobians = found.jacobians[:, len(tree.motors) :][..., tree.free]
    forces: Array = np.einsum("sfij,sfi->sj", jacobians, states.W)
    return forces


def mass_rows(tree: Tree, found: Quantities, states: States, sizes: Sizes) -> Iterator[Row]:
    """The centre of mass, momentum, gravity, and the wrenches that joints pass on."""
    if found.centre_of_mass is not None:
        reach = sizes.reach[:, None] + sizes.length
        yield "centre_of_mass", found.centre_of_mass, np.repeat(reach, 3, axis=-1)
    if found.centre_jacobian is not None:
        jacobian = found.centre_jacobian[..., tree.free]
        size = np.broadcast_to(sizes.length / sizes.scales, jacobian.shape)
        yield "centre_of_mass_jacobian", jacobian, size
    if found.momentum is not None:
        turning = (sizes.units[:, tree.turns] ** 2).max(axis=-1)
        size = np.stack([np.full_like(turning, tree.mass * sizes.length), turning], axis=-1)
        size = np.repeat(size * sizes.rate[:, None], 3, axis=-1)
        yield "centroidal_momentum", found.momentum, size
    if found.gravity_forces is not None:
        weight = abs(tree.gravity) * np.sqrt(tree.mass)
        yield "gravity_forces", found.gravity_forces[:, tree.free], sizes.free_units * weight
    if found.joint_wrenches is not None:
        spin = sizes.rate**2 + np.abs(states.a / sizes.scales).sum(axis=-1)
        acceleration = abs(tree.gravity) + sizes.length * spin
        size = wrench_sizes(tree, acceleration, spin, states.u)
        yield "joint_wrenches", found.joint_wrenches, size
