"""Distances of links from discs of rotors, and of both from walls; links are lines between points.

Discs and walls are convex, so that the distance along a link has one minimum, which is found by
cutting off thirds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.flight.scenario.walls import FLAT, surface_at
from gibbs_codegen.flight.vectors import Array

# Thirds that are cut off: what is left of a link is 1e-6 of its length; samples that are looked at
# at once, which bounds the memory.
_CUTS, _SAMPLES = 34, 4096
# Points of a rim: between two of them it is within a hundredth of the radius.
_RIM = 24
Parents = NDArray[np.int_]


def disc_distances(
    positions: Array, parents: Parents, discs: Sequence[int], axes: Array, radii: Array
) -> Array:
    """Distances (s, N), m, of discs of rotors from the nearest of the links that do not carry them.

    Points are at `positions` (s, k, 3), joined to their `parents` (k); `discs` (N) are numbers of
    those of the rotors, `axes` (s, N, 3) their unit normals, `radii` (N), m, 0 where unknown, and
    then distances are NaN. Where a link goes through a disc, the distance is less than 0 by how far
    inside the rim it does.
    """
    distances = np.full((len(positions), len(radii)), np.nan)
    for k, (point, radius) in enumerate(zip(discs, radii.tolist(), strict=True)):
        links = [m for m in _links(parents, parents[point]) if m not in discs]
        if radius == 0.0 or not links:
            continue
        for first in range(0, len(distances), _SAMPLES):
            rows = slice(first, first + _SAMPLES)
            begin, end = positions[rows, parents[links]], positions[rows, links]
            disc = positions[rows, [point]], axes[rows, [k]], radius
            distances[rows, k] = _to_disc(begin, end, disc).min(axis=1)
    return distances


def wall_distances(
    positions: Array, parents: Parents, kind: str, figures: Array, touching: Sequence[int]
) -> Array:
    """Distances (s), m, of a wall from the nearest link, less than 0 by how far one is behind it.

    Ends of links that are `touching` points, which are there to touch the wall, do not count, nor
    what is between them and the other end.
    """
    links = _links(parents, -1)
    ends = [[x for x in (m, parents[m]) if x not in touching] for m in links]
    pairs = np.array([(end[0], end[-1]) for end in ends if end], dtype=int).reshape(-1, 2)
    if not len(pairs):
        return np.full(len(positions), np.nan)

    def distance(place: Array) -> Array:
        return -surface_at(kind, figures, place)[0]

    distances = np.empty(len(positions))
    for first in range(0, len(distances), _SAMPLES):
        rows = slice(first, first + _SAMPLES)
        begin, end = positions[rows, pairs[:, 0]], positions[rows, pairs[:, 1]]
        if kind in FLAT:  # Ends are nearest, or farthest behind.
            least = np.minimum(distance(begin), distance(end))
        else:
            least = _least(begin, end, distance)
        distances[rows] = least.min(axis=1)
    return distances


def rim_distances(centres: Array, axes: Array, radii: Array, kind: str, figures: Array) -> Array:
    """Distances (s), m, of a wall from the nearest rim of rotors' discs, NaN where none is known.

    Centres and unit normals are (s, N, 3), radii (N), m, 0 where unknown.
    """
    has_radius = radii > 0.0
    if not has_radius.any():
        return np.full(len(centres), np.nan)
    distances = np.empty((_RIM, len(centres)))
    normals = axes[:, has_radius]
    across = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=-1)])
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    for k, angle in enumerate(2.0 * np.pi / _RIM * np.arange(_RIM)):
        out = np.cos(angle) * across + np.sin(angle) * np.cross(normals, across)
        rim = centres[:, has_radius] + radii[has_radius, np.newaxis] * out
        distances[k] = -surface_at(kind, figures, rim)[0].max(axis=-1)
    return distances.min(axis=0)


def _links(parents: Parents, carrier: int) -> list[int]:
    """Numbers of the points at the ends of links, but of those that begin at a point."""
    return np.flatnonzero((parents >= 0) & (parents != carrier)).tolist()


def _least(begin: Array, end: Array, distance: Callable[[Array], Array]) -> Array:
    """The least distance (…), m, along lines between places (…, 3), given that of places (…, 3)."""
    low, high = np.zeros(begin.shape[:-1]), np.ones(begin.shape[:-1])

    def at(share: Array) -> Array:
        return distance(begin + share[..., np.newaxis] * (end - begin))

    for _ in range(_CUTS):
        third = (high - low) / 3.0
        falls = at(low + third) > at(high - third)
        low, high = np.where(falls, low + third, low), np.where(falls, high, high - third)
    return np.min([at(low), at(high), distance(begin), distance(end)], axis=0)


def _to_disc(begin: Array, end: Array, disc: tuple[Array, Array, float]) -> Array:
    """Distances (…), m, of lines between places (…, 3) from a disc.

    That has a centre (…, 3), a unit normal (…, 3) and a radius, m.
    """
    centre, normal, radius = disc

    def parts(place: Array) -> tuple[Array, Array]:
        """Height over the disc, and distance from its axis."""
        away = place - centre
        height = np.sum(away * normal, axis=-1)
        return height, np.linalg.norm(away - height[..., np.newaxis] * normal, axis=-1)

    def distance(place: Array) -> Array:
        height, out = parts(place)
        return np.hypot(height, np.maximum(out - radius, 0.0))

    before, after = parts(begin)[0], parts(end)[0]
    crosses = before * after <= 0.0
    share = np.where(crosses, before / np.where(before == after, 1.0, before - after), 0.0)
    inside = radius - parts(begin + share[..., np.newaxis] * (end - begin))[1]
    return np.where(crosses & (inside > 0.0), -inside, _least(begin, end, distance))
