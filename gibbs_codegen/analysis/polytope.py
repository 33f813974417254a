"""Vertices and half-spaces of a convex set that is known by its supports.

A support is the point farthest along a direction. The hull of some of them grows by the supports
along the normals of its facets, until none lies beyond.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from gibbs_codegen.simulator.plant.vehicle import Array

Support = Callable[[Array], Array]

# Share of the set's size below which points count as one.
_SAME = 1e-7


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
        """Whether a point (n) is inside, or outside by no more than a tolerance."""
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
    first, asked = points[0], set()
    while True:
        hull = ConvexHull((points - first) @ basis)
        # A facet comes once for each simplex that it is made of.
        facets = hull.equations[np.unique(hull.equations.round(9), axis=0, return_index=True)[1]]
        found = []
        for facet in facets:
            if (key := tuple(facet[:-1].round(9))) not in asked:
                asked.add(key)
                point = support(basis @ facet[:-1])
                beyond = facet[:-1] @ basis.T @ (point - first) + facet[-1]
                if beyond > _SAME * max(1.0, float(np.abs(points).max())):
                    found.append(point)
        if not found:
            normals = facets[:, :-1] @ basis.T
            return Polytope(points[hull.vertices], basis, normals, normals @ first - facets[:, -1])
        points = np.concatenate([points, found])
