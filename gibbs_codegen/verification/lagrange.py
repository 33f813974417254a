"""Lagrange's equations of the tree, by numerical differentiation of its energies.

Every body is replaced by seven point masses with its mass, centre of mass and inertia. Then
T = ½Σ m ṗ² and V = Σ m g p_z are written down from positions alone, and everything else is their
derivatives: by coordinates and rates in complex steps, which are exact to rounding (Squire and
Trapp, 1998), and once more by differences of fourth order.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gibbs_codegen.verification.differences import STEP, derivative
from gibbs_codegen.verification.formulation import EVERYTHING
from gibbs_codegen.verification.tree import Array, Point, Tree

_COMPLEX_STEP = 1e-40


class Lagrange:
    """A formulation (see `formulation`): d/dt ∂T/∂v − ∂T/∂q + ∂V/∂q."""

    name = "Lagrange"
    gives = EVERYTHING
    limit = 1e-7
    growth = 0

    def __init__(self, tree: Tree) -> None:
        self.tree = tree
        self._points, self._masses = _point_masses(tree)

    @property
    def points(self) -> int:
        """Number of point masses."""
        return len(self._points)

    def mass_matrix(self, q: Array) -> Array:
        """∂²T/∂v²."""
        return self._mass_matrix(self.tree.spread(q))

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """Lagrange's equations for a motion."""
        q, v, a = map(self.tree.spread, (q, v, a))
        change = self._change(self._momentum, q, v)
        inertial = np.einsum("sij,sj->si", self._mass_matrix(q), a)
        forces: Array = inertial + change - self._by_coordinates(q, v)
        return forces + self._along(self._potential, q[:, None], np.eye(self.tree.size))

    def input_matrix(self, q: Array) -> Array:
        """Virtual work of thrusts and drag torques."""
        tree = self.tree
        every = tree.spread(q)
        rotations = tree.frames(every).rotations
        seats = [motor.seat for motor in tree.motors]
        linear, angular = self._velocities(every[:, None], np.eye(tree.size), seats)
        columns = []
        for k, motor in enumerate(tree.motors):
            thrust = (rotations[motor.seat.joint] @ motor.direction)[:, None]
            work = (linear[..., k, :] + motor.drag * angular[..., k, :]) * thrust
            columns.append(work.sum(axis=-1))
        for place in tree.arm:
            columns.append(np.broadcast_to(np.eye(tree.size)[place], (len(q), tree.size)))
        return np.stack(columns, axis=-1)

    def positions(self, q: Array) -> Array:
        """World positions of the named points."""
        return self._places(self.tree.spread(q), self.tree.points)

    def tip_pose(self, q: Array) -> Array:
        """Homogeneous transform of the tip, from where points of its axes are."""
        tip = self.tree.tip
        ends = [Point(tip.joint, tip.local + step) for step in self.tree.reach * np.eye(3)]
        places = self._places(self.tree.spread(q), [tip, *ends])
        pose = np.zeros((len(q), 4, 4))
        pose[:, :3, 3] = places[:, 0]
        axes = (places[:, 1:] - places[:, :1]) / self.tree.reach
        pose[:, :3, :3] = np.swapaxes(axes, -1, -2)
        pose[:, 3, 3] = 1.0
        return pose

    def tip_jacobian(self, q: Array) -> Array:
        """Derivatives of the tip's position and axes by the coordinates."""
        every = self.tree.spread(q)
        units = np.eye(self.tree.size)
        linear, angular = self._velocities(every[:, None], units, [self.tree.tip])
        return np.swapaxes(np.concatenate([linear, angular], axis=-1)[..., 0, :], -1, -2)

    def tip_bias_acceleration(self, q: Array, v: Array) -> Array:
        """How fast the tip's velocity changes along unchanging rates."""
        q, v = self.tree.spread(q), self.tree.spread(v)

        def velocity(q: Array, v: Array) -> Array:
            return np.concatenate(self._velocities(q, v, [self.tree.tip]), axis=-1)[..., 0, :]

        return self._change(velocity, q, v)

    def kinetic_energy(self, q: Array, v: Array) -> Array:
        """½Σ m ṗ²."""
        velocity = self._along(self._mass_places, self.tree.spread(q), self.tree.spread(v))
        energy: Array = 0.5 * np.sum(velocity**2, axis=-1) @ self._masses
        return energy

    def potential_energy(self, q: Array) -> Array:
        """Σ m g p_z."""
        return self._potential(self.tree.spread(q))

    def _mass_matrix(self, q: Array) -> Array:
        by_q = self._place_gradients(q)
        weighted = by_q * self._masses[:, None]
        rows, columns = (x.reshape(*x.shape[:2], -1) for x in (weighted, by_q))
        matrix: Array = rows @ np.swapaxes(columns, -1, -2)
        return matrix

    def _momentum(self, q: Array, v: Array) -> Array:
        """∂T/∂v at all states, (s, size)."""
        by_q = self._place_gradients(q)
        velocity = self._along(self._mass_places, q, v)
        momentum: Array = np.einsum("sipk,p,spk->si", by_q, self._masses, velocity)
        return momentum

    def _by_coordinates(self, q: Array, v: Array) -> Array:
        """∂T/∂q, (s, size).

        ∂ṗ/∂q is the rate of ∂p/∂q, which is as small as what a coordinate moves is short or light:
        so it keeps its digits beside all the rest.
        """
        changing = self._change(lambda x, _: self._place_gradients(x), q, v)
        velocity = self._along(self._mass_places, q, v)
        weighted = velocity * self._masses[:, None]
        by_q: Array = np.einsum("sipk,spk->si", changing, weighted)
        return by_q

    def _place_gradients(self, q: Array) -> Array:
        """∂p/∂q of the point masses, (s, size, points, 3)."""
        return self._along(self._mass_places, q[:, None], np.eye(self.tree.size))

    def _potential(self, q: Array) -> Array:
        energy: Array = self.tree.gravity * (self._mass_places(q)[..., 2] @ self._masses)
        return energy

    def _mass_places(self, q: Array) -> Array:
        return self._places(q, self._points)

    def _places(self, q: Array, points: list[Point]) -> Array:
        """World positions of points, (…, points, 3)."""
        rotations, positions, _ = self.tree.frames(q)
        return np.stack(
            [positions[p.joint] + rotations[p.joint] @ p.local for p in points], axis=-2
        )

    def _velocities(self, q: Array, v: Array, points: list[Point]) -> tuple[Array, Array]:
        """Velocities of points and angular velocities of their frames, each (…, points, 3).

        ω = ½Σ e × ė over a frame's axes e, whose ends stand the machine's reach away.
        """
        ends = [
            Point(point.joint, point.local + step)
            for point in points
            for step in self.tree.reach * np.concatenate([np.zeros((1, 3)), np.eye(3)])
        ]
        places = self._places(q, ends)
        moving = self._along(lambda x: self._places(x, ends), q, v)
        places, moving = (x.reshape(*x.shape[:-2], len(points), 4, 3) for x in (places, moving))
        axes = places[..., 1:, :] - places[..., :1, :]
        turning = moving[..., 1:, :] - moving[..., :1, :]
        angular = 0.5 * np.sum(np.cross(axes, turning), axis=-2) / self.tree.reach**2
        return moving[..., 0, :], angular

    def _change(self, function: Callable[[Array, Array], Array], q: Array, v: Array) -> Array:
        """How fast a vector function of the state changes along unchanging rates, (s, …)."""
        # In that time no frame turns, or moves by its size, by more than the step.
        rate = np.abs(v / self.tree.scales).sum(axis=-1)
        steps = STEP / np.where(rate > 0.0, rate, self.tree.tempo)
        return derivative(lambda time: function(q + time * v, v), steps)

    @staticmethod
    def _along(function: Callable[[Array], Array], q: Array, direction: Array) -> Array:
        """Derivative of a function of the coordinates along a direction."""
        return np.imag(function(q + 1j * _COMPLEX_STEP * direction)) / _COMPLEX_STEP


def _point_masses(tree: Tree) -> tuple[list[Point], Array]:
    """Points and their masses: on each principal axis of a body two, and one where its com is.

    The two stand one radius of gyration away, so that they have the second moment along their axis.
    """
    points: list[Point] = []
    masses: list[float] = []
    for number, joint in enumerate(tree.joints):
        if joint.mass == 0.0:
            continue
        second_moments = 0.5 * np.trace(joint.inertia) * np.eye(3) - joint.inertia
        moments, axes = np.linalg.eigh(second_moments)
        reach = np.sqrt(max(abs(moments).max(), 1e-30) / joint.mass)
        shares = moments / (2 * reach**2)
        for share, axis in zip(shares, axes.T, strict=True):
            points += [Point(number, joint.com + reach * axis)]
            points += [Point(number, joint.com - reach * axis)]
            masses += [share, share]
        points.append(Point(number, joint.com))
        masses.append(joint.mass - 2 * sum(shares))
    return points, np.array(masses)
