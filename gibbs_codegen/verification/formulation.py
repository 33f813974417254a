"""What a formulation of the equations of motion gives, whichever way it finds it."""

from __future__ import annotations

from typing import Protocol

from gibbs_codegen.verification.tree import Array, Tree

EVERYTHING = frozenset(
    (
        "mass_matrix",
        "inverse_dynamics",
        "input_matrix",
        "positions",
        "tip_pose",
        "tip_jacobian",
        "tip_bias_acceleration",
        "kinetic_energy",
        "potential_energy",
    )
)


class NotApplicableError(Exception):
    """A formulation that cannot be made for a machine; the message says why."""


class Formulation(Protocol):
    """Equations of motion of a tree, for `s` states at a time.

    Arguments are in the reduced coordinates, (s, nq). Results are in those of all joints, free and
    held, in the order of the hybrid system: `size` of them. `gives` names the methods below that it
    has, `limit` is the largest error that its own arithmetic explains, which grows with the
    power `growth` of how unequal lengths are.
    """

    name: str
    gives: frozenset[str]
    limit: float
    growth: int
    tree: Tree

    def mass_matrix(self, q: Array) -> Array:
        """Mass matrix, (s, size, size)."""
        ...

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """M a − R, (s, size)."""
        ...

    def input_matrix(self, q: Array) -> Array:
        """Generalised forces of unit inputs, (s, size, nu)."""
        ...

    def positions(self, q: Array) -> Array:
        """World positions of the named points in m, (s, k, 3)."""
        ...

    def tip_pose(self, q: Array) -> Array:
        """Homogeneous transform of the tip, (s, 4, 4)."""
        ...

    def tip_jacobian(self, q: Array) -> Array:
        """World-axes Jacobian of the tip, linear rows first, (s, 6, size)."""
        ...

    def tip_bias_acceleration(self, q: Array, v: Array) -> Array:
        """World-axes acceleration of the tip at zero accelerations, (s, 6)."""
        ...

    def kinetic_energy(self, q: Array, v: Array) -> Array:
        """Kinetic energy in J, (s,)."""
        ...

    def potential_energy(self, q: Array) -> Array:
        """Potential energy in J, zero at world Z = 0, (s,)."""
        ...
