"""A formulation that computes in the machine's own units.

Libraries have numbers of their own that are no part of mechanics: Pinocchio adds 2e-16 kg to the
mass it divides by, MuJoCo takes a body below 1e-15 kg or kg m² for one without. So they are given
the machine with lengths and times of the order of 1 and no mass below that, and their results are
turned back. The units are powers of two, which takes no digit from any number.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gibbs_codegen.verification.formulation import Formulation
from gibbs_codegen.verification.tree import Array, Tree


class InOwnUnits:
    """A formulation (see `formulation`) of a kind, of the tree in its own units."""

    def __init__(self, kind: Callable[[Tree], Formulation], tree: Tree) -> None:
        self.tree = tree
        self._length = _power_of_two(tree.reach)
        self._mass = _power_of_two(_lightest(tree))
        self._time = _power_of_two(1.0 / tree.tempo)
        self._inner = kind(tree.in_units(self._length, self._mass, self._time))
        self.name, self.gives = self._inner.name, self._inner.gives
        self.limit, self.growth = self._inner.limit, self._inner.growth
        self._units = np.where(tree.turns, 1.0, self._length)
        self._energy = self._mass * (self._length / self._time) ** 2
        self._efforts = self._energy / self._units

    def mass_matrix(self, q: Array) -> Array:
        """Mass matrix, (s, size, size)."""
        inertias = self._mass * self._length**2 / np.outer(self._units, self._units)
        matrix: Array = self._inner.mass_matrix(self._in_own(q)) * inertias
        return matrix

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """M a − R, (s, size)."""
        motion = self._in_own(q), self._in_own(v, 1), self._in_own(a, 2)
        return self._inner.inverse_dynamics(*motion) * self._efforts

    def input_matrix(self, q: Array) -> Array:
        """Generalised forces of unit inputs, (s, size, nu)."""
        thrust = self._energy / self._length
        inputs = [thrust] * len(self.tree.motors) + [self._efforts[i] for i in self.tree.arm]
        factors = self._efforts[:, None] / np.array(inputs)
        matrix: Array = self._inner.input_matrix(self._in_own(q)) * factors
        return matrix

    def positions(self, q: Array) -> Array:
        """World positions of the named points in m, (s, k, 3)."""
        return self._inner.positions(self._in_own(q)) * self._length

    def tip_pose(self, q: Array) -> Array:
        """Homogeneous transform of the tip, (s, 4, 4)."""
        pose = self._inner.tip_pose(self._in_own(q))
        pose[:, :3, 3] *= self._length
        return pose

    def tip_jacobian(self, q: Array) -> Array:
        """World-axes Jacobian of the tip, (s, 6, size)."""
        return self._inner.tip_jacobian(self._in_own(q)) * self._motion[:, None] / self._units

    def tip_bias_acceleration(self, q: Array, v: Array) -> Array:
        """World-axes acceleration of the tip at zero accelerations, (s, 6)."""
        bias = self._inner.tip_bias_acceleration(self._in_own(q), self._in_own(v, 1))
        return bias * self._motion / self._time**2

    def kinetic_energy(self, q: Array, v: Array) -> Array:
        """Kinetic energy in J, (s,)."""
        return self._inner.kinetic_energy(self._in_own(q), self._in_own(v, 1)) * self._energy

    def potential_energy(self, q: Array) -> Array:
        """Potential energy in J, (s,)."""
        return self._inner.potential_energy(self._in_own(q)) * self._energy

    @property
    def _motion(self) -> Array:
        """Units of linear and angular motion of the tip."""
        return np.repeat([self._length, 1.0], 3)

    def _in_own(self, values: Array, rate: int = 0) -> Array:
        """Coordinates, their rates or accelerations in the machine's units."""
        own: Array = values / self._units[self.tree.free] * self._time**rate
        return own


def _lightest(tree: Tree) -> float:
    """The smallest mass, or moment of inertia over the square of the reach, but zero."""
    masses = np.array([joint.mass for joint in tree.joints])
    moments = np.array([np.diagonal(joint.inertia) for joint in tree.joints]) / tree.reach**2
    every = np.concatenate([masses, moments.ravel()])
    return float(every[every > 0.0].min())


def _power_of_two(value: float) -> float:
    return float(2.0 ** np.round(np.log2(value)))
