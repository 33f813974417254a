"""Walls that frames may touch: surfaces that yield, with or without friction.

`machine.contact` has the forces. A shape is a class of `Wall`: keys of a scenario file, the figures
that array programs and records have of it, its surface, and a patch of that for drawings.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Annotated, Any, ClassVar, get_args

import numpy as np

from gibbs_codegen.arrays.evaluation import Evaluator
from gibbs_codegen.arrays.nodes import (
    Node,
    Program,
    absolute,
    choose,
    copysign,
    dot,
    join,
    maximum,
    reshaped,
    square_root,
    variable,
)
from gibbs_codegen.files.table import Kinds, Place, Table, key, listed, named, table
from gibbs_codegen.flight.attitude import rotation_matrix
from gibbs_codegen.flight.scenario.numbers import (
    LEAST,
    Angles,
    Direction,
    Names,
    NotNegative,
    Number,
    Positive,
    Vector,
)
from gibbs_codegen.flight.scenario.parts import FRAME
from gibbs_codegen.flight.scenario.paths import plane
from gibbs_codegen.flight.vectors import Array
from gibbs_codegen.machine import contact
from gibbs_codegen.machine.base import length
from gibbs_codegen.machine.contact import Contact

# Within which time a bristle without a load is lost, s, if nothing else is said.
_LOST_WITHIN = 0.01
# The square of a distance, m², that is none.
_NOTHING = 1e-30
# Points of a drawing around a cylinder or sphere, and of the latter from pole to pole.
_AROUND, _MERIDIAN = 37, 13


_Frames = Annotated[
    Names,
    key(f"the frame whose origin meets the wall, or a list of several, such as feet: {FRAME}"),
]
_Stiffness = Annotated[Positive, key("stiffness: force per depth, N/m")]
_Damping = Annotated[NotNegative, key("damping: force per speed into the wall, N s/m")]


@table
class _Wall(Table):
    """The common part of walls of all shapes."""

    frame: _Frames
    dissipation: NotNegative = named(
        "relative growth of the stiffness force per m/s of speed into the wall, s/m",
        default=0.0,
        kw_only=True,
    )
    friction: NotNegative = named("coefficient of friction; 0: none", default=0.0, kw_only=True)
    bristle_stiffness: Positive | None = named(
        "tangential stiffness of a sticking frame, N/m; default: the stiffness",
        default=None,
        kw_only=True,
    )
    bristle_damping: Positive | None = named(
        "tangential damping of a sticking frame, N s/m; default: 10 ms of bristle_stiffness",
        default=None,
        kw_only=True,
    )
    ball_radius: NotNegative = named(
        "radius of the ball about the origin of the frame that meets the wall, m; 0: a point",
        default=0.0,
        kw_only=True,
    )

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str | Place, str]]:
        """Faults of bristles without friction."""
        for entry in ("bristle_stiffness", "bristle_damping"):
            if entry in values and not values.get("friction"):
                yield entry, "needs a friction above 0 beside it"

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the frames that the wall may touch."""
        return (self.frame,) if isinstance(self.frame, str) else self.frame


@table
class Plane(_Wall):
    """A plane, with everything behind it."""

    kind: ClassVar[str] = "plane"

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

    surface = staticmethod(contact.plane)

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
class Floor(_Wall):
    """A level plane, to take off from and land on."""

    kind: ClassVar[str] = "floor"

    stiffness: _Stiffness
    damping: _Damping = 0.0
    height: Annotated[Number, key("the height of the floor, m")] = 0.0

    @property
    def figures(self) -> tuple[float, ...]:
        """Those of a plane."""
        return (0.0, 0.0, self.height, 0.0, 0.0, 1.0)

    surface, patch = staticmethod(Plane.surface), staticmethod(Plane.patch)


@table
class Cylinder(_Wall):
    """A cylinder without ends, such as a pipe or a tank."""

    kind: ClassVar[str] = "cylinder"

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


@table
class Sphere(_Wall):
    """A sphere."""

    kind: ClassVar[str] = "sphere"

    centre: Annotated[Vector, key("the centre, [x, y, z] in m")]
    radius: Annotated[Positive, key("the radius, m")]
    stiffness: _Stiffness
    damping: _Damping = 0.0

    @property
    def figures(self) -> tuple[float, ...]:
        """The centre (3) and the radius, m."""
        return (*self.centre, self.radius)

    @staticmethod
    def surface(figures: Node, place: Node) -> tuple[Node, Node]:
        """Depth, m, of a place (3) behind the surface, and the unit normal (3) out of it there."""
        away = place - figures[:3]
        distance = maximum(length(away), LEAST)
        return figures[3] - distance, away / distance

    @staticmethod
    def patch(figures: Array, middle: Array, half: float) -> Array:
        """A grid (from pole to pole, points around, 3), m, of all of it."""
        polar = np.linspace(0.0, math.pi, _MERIDIAN)[:, np.newaxis]
        around = np.linspace(0.0, 2.0 * math.pi, _AROUND)
        ring = np.sin(polar) * np.array([np.cos(around), np.sin(around)])[:, np.newaxis]
        height = np.broadcast_to(np.cos(polar), ring[0].shape)
        return figures[:3] + figures[3] * np.stack([*ring, height], axis=-1)


@table
class Box(_Wall):
    """A box, such as a table, a step or a beam."""

    kind: ClassVar[str] = "box"

    centre: Annotated[Vector, key("the centre, [x, y, z] in m")]
    size: Annotated[
        tuple[Positive, Positive, Positive], listed(3), key("lengths of the edges, [x, y, z] in m")
    ]
    stiffness: _Stiffness
    damping: _Damping = 0.0
    rpy: Annotated[
        Angles, key("orientation: R = R_z·R_y·R_x of these angles, degrees", "rpy_deg")
    ] = (0.0, 0.0, 0.0)

    @property
    def figures(self) -> tuple[float, ...]:
        """The centre (3), m, the rotation to world axes (3, 3), and half of the edges (3), m."""
        rotation = rotation_matrix("zyx", self.rpy[::-1])
        return (*self.centre, *rotation.ravel().tolist(), *(0.5 * edge for edge in self.size))

    @staticmethod
    def surface(figures: Node, place: Node) -> tuple[Node, Node]:
        """Depth, m, of a place (3) behind the surface, and the unit normal (3) out of it there.

        From inside that is the nearest face. From outside, where balls meet it, edges and corners
        are as far away as they are.
        """
        rotation, half = reshaped(figures[3:12], (3, 3)), figures[12:15]
        local = rotation.transposed @ (place - figures[:3])
        beyond = absolute(local) - half
        x, y, z = (beyond[k] for k in range(3))
        farthest = maximum(maximum(x, y), z)
        on_x = choose(farthest, x, 0.0, 1.0)
        on_y = (1.0 - on_x) * choose(farthest, y, 0.0, 1.0)
        outside = maximum(beyond, 0.0)
        distance = square_root(maximum(dot(outside, outside), _NOTHING))
        inner = join(on_x, on_y, 1.0 - on_x - on_y)
        normal = copysign(choose(farthest, 0.0, outside / distance, inner), local)
        return -choose(farthest, 0.0, distance, farthest), rotation @ normal

    @staticmethod
    def patch(figures: Array, middle: Array, half: float) -> Array:
        """A grid (4, 5, 3), m, of all of it: lower face, sides and upper face."""
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]], dtype=np.float64)
        rings = np.stack([0.0 * corners, corners, corners, 0.0 * corners])
        heights = np.broadcast_to([[-1.0], [-1.0], [1.0], [1.0]], rings.shape[:2])
        grid = np.concatenate([rings, heights[..., np.newaxis]], axis=-1) * figures[12:15]
        return figures[:3] + grid @ figures[3:12].reshape(3, 3).T


Wall = Plane | Floor | Cylinder | Sphere | Box
_SHAPES = get_args(Wall)
# Kinds of which the depth is linear in the place.
FLAT = (Plane.kind, Floor.kind)
AnyWall = Annotated[Wall, Kinds(_SHAPES, "the shape of the wall", Plane.kind, functions=False)]


def bristle(wall: Wall) -> tuple[float, float]:
    """Stiffness, N/m, and damping, N s/m, of what holds a frame that sticks to a wall."""
    stiffness = wall.bristle_stiffness or wall.stiffness
    return stiffness, wall.bristle_damping or _LOST_WITHIN * stiffness


def yielding(wall: Wall) -> tuple[float, ...]:
    """Figures of a wall before those of its shape, as `machine.contact` has them."""
    yields = wall.ball_radius, wall.stiffness, wall.damping, wall.dissipation, wall.friction
    return (*yields, *bristle(wall))


def contacts_of(walls: Sequence[Wall], frames: Sequence[str]) -> tuple[Contact, ...]:
    """Contacts of walls with frames of a robot, which are given by their names in its order."""
    return tuple(
        Contact(frames.index(frame), k, wall.surface, len(wall.figures), wall.friction > 0.0)
        for k, wall in enumerate(walls)
        for frame in wall.frames
    )


@lru_cache
def _surface(kind: str, count: int) -> Evaluator:
    """The evaluator of depth and normal of a kind of wall with a number of figures."""
    (shape,) = (kind_of_wall for kind_of_wall in _SHAPES if kind_of_wall.kind == kind)
    figures, place = variable("figures", count, uniform=True), variable("place", 3)
    depth, normal = shape.surface(figures, place)
    program = Program("surface", (figures, place), {"depth": depth, "normal": normal})
    return Evaluator(program, {})


def surface_at(kind: str, figures: Array, places: Array) -> tuple[Array, Array]:
    """Depths, m, of places (…, 3) behind a wall's surface, and unit normals (…, 3) out of it."""
    values = _surface(kind, len(figures))({"figures": figures, "place": places})
    normals = np.broadcast_to(values["normal"], places.shape)
    return np.broadcast_to(values["depth"], places.shape[:-1]), normals


def patches(kinds: Sequence[str], figures: Array, middle: Array, half: float) -> Iterator[Array]:
    """Patches (m, n, 3), m, of walls near a place (3); without kinds they are planes."""
    shapes = {shape.kind: shape for shape in _SHAPES}
    for kind, row in zip(kinds or [Plane.kind] * len(figures), figures, strict=True):
        yield shapes[kind].patch(row, middle, half)


def _unit(direction: Vector) -> tuple[float, ...]:
    size = math.hypot(*direction)
    return tuple(x / size for x in direction)
