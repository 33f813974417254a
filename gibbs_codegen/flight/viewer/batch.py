"""Many copies of one shape in a scene, which are moved, turned, stretched and coloured together."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.flight.record.series import Array

Bytes = NDArray[np.uint8]
Floats = NDArray[np.float32]

_SIDES = 16
# Of an arrow of unit length and width: where its head begins, and how thick its shaft is.
_NECK, _SHAFT = 0.7, 0.4
# What is smaller nobody sees, and without it a file is half as long: steps of components of
# quaternions, and of lengths in units of the scene's grain.
_TURN = 2.0**-12
_UP = np.array([0.0, 0.0, 1.0])


class Batch:
    """Copies of a shape, as a node of viser's scene.

    `shape` is "rod" or "arrow", which start at the origin and end at 1 on z, or "ball"; with radius
    1. Lengths are rounded to multiples of `grain`, m; `look` has further options of the node.
    """

    def __init__(
        self, scene: Any, name: str, shape: str, count: int, colour: str, grain: float, **look: Any
    ) -> None:
        mesh = _mesh(shape)
        self._grain = grain
        self.node = scene.add_batched_meshes_simple(
            name,
            mesh.vertices,
            mesh.faces,
            np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
            np.zeros((count, 3)),
            batched_scales=np.zeros((count, 3)),
            batched_colors=np.tile(rgb(colour), (count, 1)),
            lod="off",
            **look,
        )

    def span(self, starts: Array, ends: Array, width: float) -> None:
        """Make each copy, of radius `width`, reach from one place (n, 3) to another, in m.

        No longer than wide, it is thinner too.
        """
        along = ends - starts
        length = np.linalg.norm(along, axis=1)
        thick = np.minimum(width, length)
        scales = np.stack([thick, thick, length], axis=1)
        directions = along / np.maximum(length, 1e-12)[:, np.newaxis]
        self.put(starts, turned_to(directions), scales)

    def put(self, places: Array, turns: Floats, scales: Array) -> None:
        """Put the copies' origins at places (n, 3), m, turned and scaled.

        `scales` (n, 3) are factors along the shape's axes, and `turns` quaternions (n, 4), real
        part first.
        """
        self.node.batched_positions = self._rounded(places)
        self.node.batched_wxyzs = turns
        self.node.batched_scales = self._rounded(scales)

    def colour(self, colours: Bytes) -> None:
        """Colour each copy, red, green and blue (n, 3), 0 to 255."""
        self.node.batched_colors = colours

    def _rounded(self, lengths: Array) -> Floats:
        rounded: Floats = (np.round(lengths / self._grain) * self._grain).astype(np.float32)
        return rounded


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255, of a colour #rrggbb."""
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue


def _mesh(shape: str) -> Any:
    """The shape of that name."""
    from trimesh import creation, util

    if shape == "ball":
        return creation.icosphere(subdivisions=2, radius=1.0)
    length, radius = (1.0, 1.0) if shape == "rod" else (_NECK, _SHAFT)
    shaft = creation.cylinder(radius, segment=_UP * [[0.0], [length]], sections=_SIDES)
    if shape == "rod":
        return shaft
    head = creation.cone(radius=1.0, height=1.0 - _NECK, sections=_SIDES)
    head.apply_translation(_NECK * _UP)
    return util.concatenate([shaft, head])


def turned_to(directions: Array) -> Floats:
    """Quaternions (n, 4), real part first, that turn z to unit vectors (n, 3)."""
    x, y, z = directions.T
    turns = np.stack([1.0 + z, -y, x, np.zeros_like(x)], axis=1)
    # Half a turn, about any axis across.
    turns[z < -1.0 + 1e-9] = [0.0, 1.0, 0.0, 0.0]
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    rounded: Floats = (np.round(turns / _TURN) * _TURN).astype(np.float32)
    return rounded
