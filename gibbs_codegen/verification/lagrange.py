"""Lagrange's equations of the tree, by numerical differentiation of its energies.

Every body is replaced by seven point masses with its mass, centre of mass and inertia. Then
T = ½Σ m ṗ² and V = Σ m g p_z are written down from positions alone, and everything else is their
derivatives: by coordinates and rates in complex steps, which are exact to rounding (Squire and
Trapp, 1998), and once more by differences of eighth order.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gibbs_codegen.verification.formulation import Quantities
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Point, Tree
from gibbs_codegen.verification.vectors import COMPLEX_STEP, Array, times

# Step of differences of eighth order. Where values change by their size in a unit, rounding of
# 1e-16/h meets a truncation of some h⁸.
_STEP = 1e-2
_WEIGHTS = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))
# Point masses that a body is replaced by, at most.
MOST_POINTS = 7


class Lagrange:
    """A formulation (see `formulation`): d/dt ∂T/∂v − ∂T/∂q + ∂V/∂q."""

    name = "Lagrange"
    limit = 1e-7
    growth = 0

    def __init__(self, tree: Tree) -> None:
        self.tree = tree
        # On each principal axis of a body two point masses, and one where its centre of mass is.
        # The two stand one radius of gyration away: they have the second moment along their axis.
        self._points: list[Point] = []
        masses: list[float] = []
        for number, joint in enumerate(tree.joints):
            if joint.mass == 0.0 and not joint.inertia.any():
                continue
            second_moments = 0.5 * np.trace(joint.inertia) * np.eye(3) - joint.inertia
            moments, axes = np.linalg.eigh(second_moments)
            reach = 1.0  # A rotor has nothing but its inertia.
            if joint.mass > 0.0:
                reach = np.sqrt(max(abs(moments).max(), 1e-30) / joint.mass)
            shares = moments / (2 * reach**2)
            for share, axis in zip(shares, axes.T, strict=True):
                self._points += [Point(number, joint.com + reach * axis)]
                self._points += [Point(number, joint.com - reach * axis)]
                masses += [share, share]
            self._points.append(Point(number, joint.com))
            masses.append(joint.mass - 2 * sum(shares))
        self._masses = np.array(masses)

    def at(self, states: States) -> Quantities:
        """Everything that the formulation computes."""
        tree, masses = self.tree, self._masses
        q, v, a = tree.motion(states)
        by_q = self._place_gradients(q)
        rows, columns = (x.reshape(*x.shape[:2], -1) for x in (by_q * masses[:, None], by_q))
        matrix = rows @ np.swapaxes(columns, -1, -2)
        weight = tree.gravity * (by_q[..., 2] @ masses)
        places, velocity = self._mass_places(q), _along(self._mass_places, q, v)

        def momentum(q: Array, v: Array) -> Array:  # ∂T/∂v
            moving = _along(self._mass_places, q, v)
            return np.einsum("sipk,p,spk->si", self._place_gradients(q), masses, moving)

        # ∂T/∂q is what the change of ∂p/∂q along the motion adds.
        changing = self._change(lambda x, _: self._place_gradients(x), q, v)
        by_coordinates = np.einsum("sipk,spk->si", changing, velocity * masses[:, None])
        residual = by_coordinates - weight - self._change(momentum, q, v)
        shares = masses / masses.sum()
        centre, linear = shares @ places, masses @ velocity
        angular = np.cross(places - centre[:, None], velocity * masses[:, None]).sum(axis=1)
        twists = self._twists(q[:, None], np.eye(tree.size), tree.seats)

        return Quantities(
            mass_matrix=matrix,
            residual=residual,
            inverse_dynamics=times(matrix, a) - residual,
            poses=tree.poses(tree.frames(q)),
            jacobians=np.moveaxis(twists, 1, -1),
            kinetic_energy=0.5 * np.sum(velocity**2, axis=-1) @ masses,
            potential_energy=tree.gravity * (places[..., 2] @ masses),
            positions=self._places(q, tree.points),
            bias_accelerations=self._change(lambda q, v: self._twists(q, v, tree.named), q, v),
            centre_of_mass=centre,
            centre_jacobian=np.swapaxes(np.einsum("p,sipk->sik", shares, by_q), -1, -2),
            momentum=np.concatenate([linear, angular], axis=-1),
            gravity_forces=-weight,
        )

    def _place_gradients(self, q: Array) -> Array:
        """∂p/∂q of the point masses, (s, size, points, 3)."""
        return _along(self._mass_places, q[:, None], np.eye(self.tree.size))

    def _mass_places(self, q: Array) -> Array:
        return self._places(q, self._points)

    def _places(self, q: Array, points: list[Point]) -> Array:
        return self.tree.positions(self.tree.frames(q), points)

    def _twists(self, q: Array, v: Array, points: list[Point]) -> Array:
        """Velocities (…, points, 6) of points and of their frames, linear first, in m/s and rad/s.

        The latter are ω = ½Σ e × ė over a frame's axes e, whose ends stand the robot's reach away.
        """
        ends = [
            Point(point.joint, point.local + step)
            for point in points
            for step in self.tree.reach * np.concatenate([np.zeros((1, 3)), np.eye(3)])
        ]
        places = self._places(q, ends)
        moving = _along(lambda x: self._places(x, ends), q, v)
        places, moving = (x.reshape(*x.shape[:-2], len(points), 4, 3) for x in (places, moving))
        axes = places[..., 1:, :] - places[..., :1, :]
        turning = moving[..., 1:, :] - moving[..., :1, :]
        angular = 0.5 * np.sum(np.cross(axes, turning), axis=-2) / self.tree.reach**2
        return np.concatenate([moving[..., 0, :], angular], axis=-1)

    def _change(self, function: Callable[[Array, Array], Array], q: Array, v: Array) -> Array:
        """Rate of change (s, …) of a function of coordinates and rates at constant rates."""
        # In that time no frame turns, or moves by its size, by more than the step.
        rate = np.abs(v / self.tree.scales).sum(axis=-1)
        steps = _STEP / np.where(rate > 0.0, rate, self.tree.tempo)
        total: Array = np.zeros(())
        for number, weight in _WEIGHTS:
            moves = number * steps[:, None] * v
            total = total + weight * (function(q + moves, v) - function(q - moves, v))
        return total / steps.reshape(-1, *[1] * (total.ndim - 1))


def _along(function: Callable[[Array], Array], q: Array, direction: Array) -> Array:
    """Derivative of a function along rates (…, size) of its coordinates, which may be complex."""
    return np.imag(function(q + 1j * COMPLEX_STEP * direction)) / COMPLEX_STEP
