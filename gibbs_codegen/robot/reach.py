"""Reachable wrenches: what the rotors can produce within their limits, and add to hovering.

They are a convex set that is known by its supports, the points farthest along a direction. The hull
of some of them grows by the supports along the normals of its facets, until none lies beyond.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from gibbs_codegen.errors import UsageError
from gibbs_codegen.robot.rotations import Array
from gibbs_codegen.robot.wrenches import RANK, farthest, null_space

Support = Callable[[Array], Array]

# Share of the set's size below which points count as one.
_SAME = 1e-7
CENTRE_OF_MASS = "the centre of mass"
_FORCE, _TORQUE = slice(0, 3), slice(3, 6)


@dataclass(frozen=True, eq=False)
class Polytope:
    """A bounded polytope, which may be flat.

    - `vertices` (k, n)
    - `basis` (n, r): orthonormal columns along which it extends
    - `normals` (m, n), `offsets` (m): its points x from a vertex along the basis are those with
      normals x ≤ offsets
    """

    vertices: Array
    basis: Array
    normals: Array
    offsets: Array

    def contains(self, point: Array, tolerance: float = 1e-9) -> bool:
        """True if a point (n) is inside, or outside by no more than a tolerance."""
        away = point - self.vertices[0]
        off = away - self.basis @ (self.basis.T @ away)
        beyond = self.normals @ point - self.offsets
        return bool(np.abs(off).max() <= tolerance and np.all(beyond <= tolerance))


def polytope(support: Support, size: int) -> Polytope:
    """The polytope of a support: the point (n) of a set that is farthest along a direction (n)."""
    points, basis = _spanning(support, size)
    rank = basis.shape[1]
    if rank == 0:
        return Polytope(points, basis, np.zeros((0, size)), np.zeros(0))
    if rank == 1:
        ends = np.array([support(basis[:, 0]), support(-basis[:, 0])])
        normals = np.array([basis[:, 0], -basis[:, 0]])
        return Polytope(ends, basis, normals, np.sum(normals * ends, axis=1))
    return _grown(support, points, basis)


def _spanning(support: Support, size: int) -> tuple[Array, Array]:
    """Supports (r + 1, n) that span all that a set spans, and orthonormal columns (n, r)."""
    points, basis = [support(np.eye(size)[0])], np.zeros((size, 0))
    while True:
        left = np.linalg.svd(basis)[0][:, basis.shape[1] :]
        for direction in (*left.T, *-left.T):
            point = support(direction)
            away = left @ (left.T @ (point - points[0]))
            if np.linalg.norm(away) > _SAME * max(1.0, float(np.abs(points).max())):
                points.append(point)
                basis = np.column_stack([basis, away / np.linalg.norm(away)])
                break
        else:
            return np.array(points), basis


def _grown(support: Support, points: Array, basis: Array) -> Polytope:
    """The polytope that spans at least a plane, from supports (r + 1, n) that span it.

    It extends along the orthonormal columns of `basis` (n, r).
    """
    from scipy.spatial import ConvexHull  # Late, as SciPy takes long to import.

    first, asked = points[0], set()
    while True:
        hull = ConvexHull((points - first) @ basis)
        # A facet comes once for each simplex that it is made of.
        facets = hull.equations[np.unique(hull.equations.round(9), axis=0, return_index=True)[1]]
        beyond_hull = []
        for facet in facets:
            if (key := tuple(facet[:-1].round(9))) not in asked:
                asked.add(key)
                point = support(basis @ facet[:-1])
                beyond = facet[:-1] @ basis.T @ (point - first) + facet[-1]
                if beyond > _SAME * max(1.0, float(np.abs(points).max())):
                    beyond_hull.append(point)
        if not beyond_hull:
            normals = facets[:, :-1] @ basis.T
            return Polytope(points[hull.vertices], basis, normals, normals @ first - facets[:, -1])
        points = np.concatenate([points, beyond_hull])


class _NoHoverError(UsageError):
    """No thrusts within the limits hover."""


@dataclass(frozen=True, eq=False)
class ReachableWrenches:
    """The wrenches that rotors can produce, about a point that moves with the base, in its axes.

    Wrenches have force, N, before torque, N m.

    - `robot`, `about`: what they are of, and the point
    - `columns` (6, N): those of unit thrusts
    - `limits` (2, N): least and greatest thrusts, N
    - `thrusts` (N): thrusts that hover, N
    """

    robot: str
    about: str
    columns: Array
    limits: Array
    thrusts: Array

    @property
    def hover(self) -> Array:
        """The wrench of hovering (6)."""
        return self.columns @ self.thrusts

    @cached_property
    def margins(self) -> Array | None:
        """The margins, down and up, of each component of hovering, (6, 2).

        The other components keep their values. None where no thrusts within the limits hover.
        """
        try:
            margins = [[self._margin(sign * axis) for sign in (-1.0, 1.0)] for axis in np.eye(6)]
        except _NoHoverError:
            return None
        return np.array(margins)

    @cached_property
    def wrenches(self) -> Polytope:
        """All wrenches, (…, 6); the work grows fast with the number of rotors."""
        low, high = self.limits

        def support(direction: Array) -> Array:
            return self.columns @ np.where(direction @ self.columns > 0.0, high, low)

        return polytope(support, 6)

    @cached_property
    def forces(self) -> Polytope:
        """The forces (…, 3) with the torque of hovering."""
        return self._slice(_FORCE, _TORQUE)

    @cached_property
    def torques(self) -> Polytope:
        """The torques (…, 3) with the force of hovering."""
        return self._slice(_TORQUE, _FORCE)

    def __str__(self) -> str:
        if self.margins is None:
            return f"{self.robot}: no thrusts within the limits hover"
        return "\n".join([f"{self.robot}:", *margin_lines(self.margins, self.about)])

    def _margin(self, direction: Array) -> float:
        """The reach of wrenches from hovering along a direction (6)."""
        step = np.linalg.pinv(self.columns, rcond=RANK) @ direction
        produced = float(np.abs(self.columns @ step - direction).max() <= RANK)
        ways = np.column_stack([produced * step, null_space(self.columns)])
        steps = self._farthest(ways, produced * np.eye(ways.shape[1])[0])
        return produced * max(float(steps[0]), 0.0)

    def _slice(self, kept: slice, held: slice) -> Polytope:
        """The polytope, in 3 dimensions, of `kept` components, with those `held` as at hover."""
        ways = null_space(self.columns[held])

        def support(direction: Array) -> Array:
            step = ways @ self._farthest(ways, direction @ self.columns[kept] @ ways)
            return self.columns[kept] @ (self.thrusts + step)

        return polytope(support, 3)

    def _farthest(self, ways: Array, value: Array) -> Array:
        """The steps z (k) for which thrusts + ways z are within limits and value · z is greatest.

        `ways` are thrusts (N, k). Raises `UsageError` if there are none, so no thrusts within the
        limits hover; or SciPy fails.
        """
        steps = farthest(ways, self.limits - self.thrusts, value)
        if steps is None:
            raise _NoHoverError(f"{self.robot}: no thrusts within the limits hover")
        return steps


def margin_lines(margins: ArrayLike, point: str) -> list[str]:
    """Margins (6, 2) of hovering, down and up, about a point, in words.

    A heading, and a line each for forces and torques.
    """
    named = zip("xyzxyz", np.asarray(margins), strict=True)
    ranges = [f"{axis} {-low + 0.0:.3g} … {high:.3g}" for axis, (low, high) in named]
    return [
        f"wrench margins at hover, each by itself, about {point}, in the base's axes:",
        f"  force: {', '.join(ranges[:3])} N",
        f"  torque: {', '.join(ranges[3:])} N m",
    ]


def about(wrenches: Array, point: Array) -> Array:
    """Wrenches (6, N) about another point (3), m, from the one that they are about."""
    moved = wrenches.copy()
    moved[_TORQUE] -= np.cross(point, wrenches[_FORCE], axisb=0, axisc=0)
    return moved
