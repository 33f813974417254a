"""A robot's numbers under the names of its module's parameters, and a robot with other numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import astuple, dataclass, replace
from types import ModuleType
from typing import Any, NamedTuple

from gibbs_codegen.robot.model import (
    Body,
    Link,
    Passive,
    Pose,
    RigidBody,
    Robot,
    Rod,
    Rotor,
    Vector3,
    as_rigid_body,
)
from gibbs_codegen.robot.names import frame_prefix, parameter_prefix, rotor_prefix


class Dimension(NamedTuple):
    """The powers of length, mass and time in a unit."""

    length: int = 0
    mass: int = 0
    time: int = 0

    def unit(self, length: float, mass: float, time: float) -> float:
        """The unit, in SI, that goes with units of length, mass and time in m, kg and s."""
        return float(length**self.length * mass**self.mass * time**self.time)


LENGTH, MASS, INERTIA = Dimension(1), Dimension(mass=1), Dimension(2, 1)
ACCELERATION, DENSITY = Dimension(1, time=-2), Dimension(-1, 1)
# Damping, armature, stiffness and rest of joints that turn; of those that slide with the next.
_PASSIVE = (Dimension(2, 1, -1), Dimension(2, 1), Dimension(2, 1, -2), Dimension())
_SLIDING = (Dimension(0, 1, -1), Dimension(0, 1), Dimension(0, 1, -2), Dimension(1))
# What becomes of a number of a robot, by its name, its value and its dimension; and of a body.
Change = Callable[[str, float, Dimension], float]
BodyChange = Callable[[Body], Body]


def mapped(robot: Robot, change: Change, of_body: BodyChange | None = None) -> Robot:
    """The robot with every number changed that can be a parameter, zeros included.

    `of_body` changes bodies as a whole; None changes their numbers as all others.
    """
    return _Mapping(change, of_body)(robot)


@dataclass(frozen=True)
class _Mapping:
    """What becomes of the numbers of a robot."""

    change: Change
    of_body: BodyChange | None

    def __call__(self, robot: Robot) -> Robot:
        """The robot with the changed numbers."""
        base, change = robot.base, self.change
        drags = enumerate(base.drag, start=1)
        return replace(
            robot,
            gravity=change("gravity", robot.gravity, ACCELERATION),
            base=replace(
                base,
                drag=tuple(change(f"base_drag_{k}", drag, LENGTH) for k, drag in drags),
                arms=tuple(self._body(prefix, arm) for prefix, arm in _arms(robot)),
                body=as_rigid_body(self._body("base", base.body)) if base.body else None,
            ),
            links=tuple(
                self._link(parameter_prefix(robot, i), link)
                for i, link in enumerate(robot.links, start=1)
            ),
            thrusters=tuple(
                self._rotor(rotor_prefix(robot, k), rotor)
                for k, rotor in enumerate(robot.thrusters, start=1)
            ),
            frames=tuple(
                replace(frame, pose=self._pose(frame_prefix(frame.name), frame.pose))
                for frame in robot.frames
            ),
        )

    def _vector(self, prefix: str, vector: Vector3) -> Vector3:
        pairs = zip("xyz", vector, strict=True)
        x, y, z = (self.change(f"{prefix}_{axis}", value, LENGTH) for axis, value in pairs)
        return x, y, z

    def _pose(self, prefix: str, pose: Pose) -> Pose:
        return replace(pose, xyz=self._vector(prefix, pose.xyz))

    def _rotor(self, prefix: str, rotor: Rotor) -> Rotor:
        drag = self.change(f"{prefix}_drag", rotor.drag, LENGTH)
        return replace(rotor, position=self._vector(prefix, rotor.position), drag=drag)

    def _link(self, prefix: str, link: Link) -> Link:
        link = replace(link, body=self._body(prefix, link.body))
        if link.pose is not None:
            link = replace(link, pose=self._pose(prefix, link.pose))
        else:
            a = None if link.a is None else self.change(f"{prefix}_a", link.a, LENGTH)
            link = replace(link, a=a, d=self.change(f"{prefix}_d", link.d, LENGTH))
        if not link.moves:
            return link
        dimensions = _PASSIVE if link.joint == "revolute" else _SLIDING
        names = ("damping", "armature", "stiffness", "rest")
        own = zip(names, astuple(link.passive), dimensions, strict=True)
        passive = [self.change(f"{prefix}_{name}", x, dimension) for name, x, dimension in own]
        return replace(link, passive=Passive(*passive))

    def _body(self, prefix: str, body: Body) -> Body:
        if self.of_body is not None:
            return self.of_body(body)
        return self._rod(prefix, body) if isinstance(body, Rod) else self._rigid_body(prefix, body)

    def _rod(self, prefix: str, rod: Rod) -> Rod:
        length = self.change(f"{prefix}_length", rod.length, LENGTH)
        density = self.change(f"{prefix}_mass_per_length", rod.mass_per_length, DENSITY)
        own = zip(("xx", "yy", "zz"), rod.section_inertia, strict=True)
        x, y, z = (self.change(f"{prefix}_section_inertia_{ij}", i, INERTIA) for ij, i in own)
        return Rod(length, density, (x, y, z))

    def _rigid_body(self, prefix: str, body: RigidBody) -> RigidBody:
        length = self.change(f"{prefix}_length", body.length, LENGTH)
        mass = self.change(f"{prefix}_mass", body.mass, MASS)
        com = self._vector(f"{prefix}_com", body.com)
        own = zip(("xx", "yy", "zz", "xy", "xz", "yz"), body.inertia, strict=True)
        xx, yy, zz, xy, xz, yz = (
            self.change(f"{prefix}_inertia_{ij}", i, INERTIA) for ij, i in own
        )
        return RigidBody(length, mass, com, (xx, yy, zz, xy, xz, yz))


def parameter_values(robot: Robot) -> dict[str, float]:
    """Every number of the robot that can be a parameter, zeros included, in SI units."""
    found: dict[str, float] = {}

    def note(name: str, value: float, _: Dimension) -> float:
        found[name] = value
        return value

    mapped(robot, note)
    return found


def prepared(module: ModuleType, robot: Robot) -> Any:
    """What a module's `prepare` returns for the numbers of a robot."""
    numbers = parameter_values(robot)
    return module.prepare({name: numbers[name] for name in module.PARAMETERS})


def with_values(robot: Robot, values: Mapping[str, float]) -> Robot:
    """The robot with other numbers, under names of `parameter_values`, where there are any."""
    return mapped(robot, lambda name, value, _: values.get(name, value))


def in_units(robot: Robot, length: float, mass: float, time: float) -> Robot:
    """The same robot, its numbers as multiples of units given in m, kg and s."""
    return mapped(robot, lambda _, value, dimension: value / dimension.unit(length, mass, time))


def bodies(robot: Robot) -> Iterator[tuple[str, Body]]:
    """Every body that has parameters of its own, after what the names of these begin with."""
    yield from _arms(robot)
    if robot.base.body:
        yield "base", robot.base.body
    for i, link in enumerate(robot.links, start=1):
        yield parameter_prefix(robot, i), link.body


def _arms(robot: Robot) -> Iterator[tuple[str, Body]]:
    for k, arm in enumerate(robot.base.arms, start=1):
        yield "base_arm" if robot.base.shares_one_arm else f"base_arm{k}", arm
