"""Walls that frames may lean on: a spring and a damper behind a surface, without friction.

At a depth of d behind the surface a wall pushes out of it with stiffness · d + damping · ḋ, and
never pulls. A shape is a class of `Wall`: keys of a scenario file, the figures that array
programs and records have of it, its surface, and a patch of that for drawings.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Annotated, ClassVar, get_args

import numpy as np

from gibbs_codegen.arrays.base import length
from gibbs_codegen.arrays.nodes import Node, dot, maximum
from gibbs_codegen.files.table import Kinds, Table, key, table
from gibbs_codegen.flight.scenario.numbers import (
    LEAST,
    Direction,
    NotNegative,
    Positive,
    Vector,
)
from gibbs_codegen.flight.scenario.parts import FRAME
from gibbs_codegen.flight.scenario.paths import plane
from gibbs_codegen.flight.vectors import Array

_Frame = Annotated[str, key(f"the frame whose origin meets the wall: {FRAME}")]
_Stiffness = Annotated[Positive, key("force for each metre of depth, N/m")]
_Damping = Annotated[NotNegative, key("force for each m/s of speed into the wall, N s/m")]
# Points of a drawing around a cylinder.
_AROUND = 37


@table
class Plane(Table):
    """A plane, with everything behind it."""

    kind: ClassVar[str] = "plane"

    frame: _Frame
    point: Annotated[Vector, key("a point of the plane, [x, y, z] in m")]
    normal: Annotated[
        Direction, key("the direction in which the wall pushes, out of it, [x, y, z]")
    ]
    stiffness: _Stiffness
    damping: _Damping = 0.0

    @property
    def figures(self) -> tuple[float, ...]:
        """A point (3), m, and the unit normal (3)."""
        return (*self.point, *_unit(self.normal))

    @staticmethod
    def surface(figures: Node, place: Node) -> tuple[Node, Node]:
        """Depth, m, of a place (3) behind the plane, and the unit normal (3) out of it there."""
        normal = figures[3:6]
        return dot(normal, figures[:3] - place), normal

    @staticmethod
    def patch(figures: Array, middle: Array, half: float) -> Array:
        """A grid (2, 2, 3) of corners, m, `half` to each side of where `middle` (3) is nearest."""
        point, normal = figures[:3], figures[3:6]
        foot = middle - normal * ((middle - point) @ normal) / (normal @ normal)
        first, second = plane(normal)
        ends = half * np.array([-1.0, 1.0])
        return (
            foot + np.multiply.outer(ends, first)[:, np.newaxis] + np.multiply.outer(ends, second)
        )


@table
class Cylinder(Table):
    """A cylinder without ends, such as a pipe or a tank."""

    kind: ClassVar[str] = "cylinder"

    frame: _Frame
    point: Annotated[Vector, key("a point of the axis, [x, y, z] in m")]
    axis: Annotated[Direction, key("the direction of the axis, [x, y, z]")]
    radius: Annotated[Positive, key("the radius, m")]
    stiffness: _Stiffness
    damping: _Damping = 0.0

    @property
    def figures(self) -> tuple[float, ...]:
        """A point (3), m, and the direction (3) of the axis, and the radius, m."""
        return (*self.point, *_unit(self.axis), self.radius)

    @staticmethod
    def surface(figures: Node, place: Node) -> tuple[Node, Node]:
        """Depth, m, of a place (3) behind the surface, and the unit normal (3) out of it there."""
        axis, away = figures[3:6], place - figures[:3]
        across = away - dot(away, axis) * axis
        distance = maximum(length(across), LEAST)
        return figures[6] - distance, across / distance

    @staticmethod
    def patch(figures: Array, middle: Array, half: float) -> Array:
        """A grid (2, points around, 3), m, `half` to each side of where `middle` (3) is nearest."""
        point, axis, radius = figures[:3], figures[3:6], figures[6]
        foot = point + axis * ((middle - point) @ axis)
        angles = np.linspace(0.0, 2.0 * math.pi, _AROUND)
        ring = radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1) @ np.array(plane(axis))
        return foot + np.multiply.outer(half * np.array([-1.0, 1.0]), axis)[:, np.newaxis] + ring


Wall = Plane | Cylinder
_SHAPES = get_args(Wall)
AnyWall = Annotated[Wall, Kinds(_SHAPES, "the shape of the wall", Plane.kind, functions=False)]


def patches(kinds: Sequence[str], figures: Array, middle: Array, half: float) -> Iterator[Array]:
    """Patches (m, n, 3), m, of walls near a place (3); without kinds they are planes."""
    shapes = {shape.kind: shape for shape in _SHAPES}
    for kind, row in zip(kinds or [Plane.kind] * len(figures), figures, strict=True):
        yield shapes[kind].patch(row, middle, half)


def _unit(direction: Vector) -> tuple[float, ...]:
    size = math.hypot(*direction)
    return tuple(x / size for x in direction)
