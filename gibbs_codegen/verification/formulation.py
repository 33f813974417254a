"""Formulations of the equations of motion: the quantities that they compute, and their interface.

Formulations know trees of joints only. For a base with velocities in its own frame, as with a
quaternion, the tree is placed, at every state, where the base is. There the base's own joints are
at zero, and stand for a small motion from it: along and about the axes of the base. So their rates
are the velocities of the base in its own frame; their accelerations differ from the rates of these
velocities by terms of the velocities alone, since the axes turn with the base.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from typing import NamedTuple, Protocol

import numpy as np

from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.vectors import Array, Sized, times


class NotApplicableError(Exception):
    """A formulation that cannot represent a robot; the message says why."""


class Quantities(NamedTuple):
    """Everything that a formulation computes at `s` states, of the bodies alone.

    Generalised forces and columns of Jacobians are those of all joints, free and constrained, in
    the order of the hybrid system: `size` of them. Axes are the world's; linear entries come before
    angular ones. What is None was not computed.

    - `mass_matrix` (s, size, size); `residual`, R of M a = R + B u, and `inverse_dynamics`, M a −
      R, (s, size); `gravity_forces`, gravity's part of R.
    - `poses` (s, seats, 4, 4), in m, and `jacobians` (s, seats, 6, size) of the tree's seats:
      motors, then the named frames.
    - `kinetic_energy` and `potential_energy` (s,), in J, the latter zero at world Z = 0.
    - `positions` (s, points, 3) of the tree's points, in m; `bias_accelerations` (s, frames, 6) of
      the named frames where a is zero.
    - `centre_of_mass` (s, 3), in m, and `centre_jacobian` (s, 3, size); `momentum` (s, 6), the
      angular one about the centre of mass, in kg m/s and kg m²/s.
    - `joint_wrenches` (s, bodies, 6), in the order of a module's BODIES: what carries a body does
      to it, force and moment at the origin and in the axes of its frame, in N and N m; and
      `loaded_joint_wrenches`, with wrenches on the frames; only by Newton and Euler.
    - `actuators`: what their functions return, by names; None where u is commanded, and only by
      Newton and Euler.
    """

    mass_matrix: Array
    residual: Array
    inverse_dynamics: Array
    poses: Array
    jacobians: Array
    kinetic_energy: Array
    potential_energy: Array
    positions: Array | None = None
    bias_accelerations: Array | None = None
    centre_of_mass: Array | None = None
    centre_jacobian: Array | None = None
    momentum: Array | None = None
    gravity_forces: Array | None = None
    joint_wrenches: Array | None = None
    loaded_joint_wrenches: Array | None = None
    actuators: Mapping[str, Sized] | None = None

    def with_passive(self, tree: Tree, states: States) -> Quantities:
        """The same with armature, dampers and springs, which formulations leave out.

        What gears do to joints is added to what is done to those that move them.
        """
        passive, q = tree.passive, tree.at_joints(states.q)
        v, a = tree.spread(states.v), tree.spread(states.a)
        forces = passive.forces(q, v)
        kinetic, potential = passive.energies(q, v)
        matrix, fold = tree.folded(self.mass_matrix + np.diag(passive.armature)), tree.folded
        columns = self.centre_jacobian, self.gravity_forces
        centre_jacobian, gravity_forces = (None if x is None else fold(x) for x in columns)
        return self._replace(
            mass_matrix=np.swapaxes(fold(np.swapaxes(matrix, -1, -2)), -1, -2),
            residual=fold(self.residual + forces),
            inverse_dynamics=fold(self.inverse_dynamics + passive.armature * a - forces),
            jacobians=fold(self.jacobians),
            centre_jacobian=centre_jacobian,
            gravity_forces=gravity_forces,
            kinetic_energy=self.kinetic_energy + kinetic,
            potential_energy=self.potential_energy + potential,
        )


class Formulation(Protocol):
    """Equations of motion of a tree.

    `limit` is the largest error that the formulation's own arithmetic explains; it grows with the
    power `growth` of the ratio of the robot's largest length to its smallest.
    """

    name: str
    limit: float
    growth: int
    tree: Tree

    def at(self, states: States) -> Quantities:
        """Everything that the formulation computes at the states."""
        ...


def state_by_state(
    at: Callable[[Array, Array, Array, Array, Array], Quantities],
    tree: Tree,
    states: States,
    places: Array,
) -> Quantities:
    """Quantities by a library that takes one state at a time, with joints in an order of its own.

    `at` takes coordinates, rates and accelerations of all joints, (size,) each in its order, and
    the rotation (3, 3) and position (3,) at which the first joint begins. `places` has for each
    joint of the library its place among the tree's coordinates; the result is in the tree's order.
    """
    motions = (x[:, places] for x in tree.motion(states))
    placement = (np.broadcast_to(x, (len(states), *x.shape[1:])) for x in tree.placement)
    singles = [at(*motion) for motion in zip(*motions, *placement, strict=True)]
    arrays = (None if x[0] is None else np.array(x) for x in zip(*singles, strict=True))
    quantities = Quantities._make(arrays)
    order = np.argsort(places)
    return quantities._replace(
        mass_matrix=quantities.mass_matrix[:, order][:, :, order],
        residual=quantities.residual[:, order],
        inverse_dynamics=quantities.inverse_dynamics[:, order],
        jacobians=quantities.jacobians[..., order],
        centre_jacobian=_ordered(quantities.centre_jacobian, order),
        gravity_forces=_ordered(quantities.gravity_forces, order),
    )


def _ordered(values: Array | None, order: Array) -> Array | None:
    return None if values is None else values[..., order]


class PlacedBase:
    """A formulation of a base with velocities in its own frame, by one of its placed tree."""

    def __init__(self, inner: Formulation) -> None:
        self.tree = inner.tree
        self.name, self.limit, self.growth = inner.name, inner.limit, inner.growth
        self._inner = inner

    def at(self, states: States) -> Quantities:
        """Quantities at the placed states, for velocities of the base in its own frame."""
        inner = copy.copy(self._inner)
        inner.tree, moved = states.placed(self.tree)
        quantities = inner.at(moved)
        dragged = -inner.tree.dragged
        bias = quantities.bias_accelerations
        if bias is not None:
            frames = quantities.jacobians[:, len(self.tree.motors) :]
            bias = bias - times(frames, dragged[:, None])
        residual = quantities.residual + times(quantities.mass_matrix, dragged)
        return quantities._replace(residual=residual, bias_accelerations=bias)


def formulated(inner: Formulation) -> Formulation:
    """A formulation of a robot's tree, placed where velocities of the base are in its own frame."""
    return PlacedBase(inner) if inner.tree.layout.turns_with_base else inner
