"""A robot's numbers under the names of its module's parameters, and a robot with other numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import astuple, replace
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
)
from gibbs_codegen.robot.names import identifier, parameter_prefix, rotor_prefix


class Dimension(NamedTuple):
    """The powers of length, mass and time in a unit."""

    length: int = 0
    mass: int = 0
    time: int = 0

    def unit(self, length: float, mass: float, time: float) -> float:
        """The unit of this dimension among coherent units.

        Args:
            length, mass, time: Units of those, in m, kg and s.

        Returns:
            In SI units.
        """
        return float(length**self.length * mass**self.mass * time**self.time)


LENGTH, MASS, INERTIA = Dimension(1), Dimension(mass=1), Dimension(2, 1)
ACCELERATION, DENSITY = Dimension(1, time=-2), Dimension(-1, 1)
# Damping, armature, stiffness and rest of joints that turn; of those that slide with the next.
_PASSIVE = (Dimension(2, 1, -1), Dimension(2, 1), Dimension(2, 1, -2), Dimension())
_SLIDING = (Dimension(0, 1, -1), Dimension(0, 1), Dimension(0, 1, -2), Dimension(1))
# What becomes of a number of a robot, by its name, its value and its dimension.
Change = Callable[[str, float, Dimension], float]


def mapped(robot: Robot, change: Change) -> Robot:
    """The robot with every number changed that can be a parameter, zeros included.

    Args:
        robot: The robot.
        change: What becomes of a number.

    Returns:
        The robot with the changed numbers.
    """
    base = robot.base
    drags = enumerate(base.drag, start=1)
    gravity = change("gravity", robot.gravity, ACCELERATION)
    drag = tuple(change(f"base_drag_{k}", drag, LENGTH) for k, drag in drags)
    arms = tuple(_of_body(prefix, arm, change) for prefix, arm in _arms(robot))
    body = _of_rigid_body("base", base.body, change) if base.body else None
    links = tuple(
        _of_link(parameter_prefix(robot, i), link, change)
        for i, link in enumerate(robot.links, start=1)
    )
    return replace(
        robot,
        base=replace(base, arms=arms, drag=drag, body=body),
        links=links,
        gravity=gravity,
        thrusters=tuple(
            _of_rotor(rotor_prefix(robot, k), rotor, change)
            for k, rotor in enumerate(robot.thrusters, start=1)
        ),
        frames=tuple(
            replace(frame, pose=_of_pose(f"frame_{identifier(frame.name)}", frame.pose, change))
            for frame in robot.frames
        ),
    )


def _of_vector(prefix: str, vector: Vector3, change: Change) -> Vector3:
    """A vector with changed components.

    Args:
        prefix: What the names of its parameters begin with.
        vector: The components (m).
        change: Gives a parameter's value from its name, its own value and its dimension.

    Returns:
        The new components (m).
    """
    x, y, z = (
        change(f"{prefix}_{a}", value, LENGTH) for a, value in zip("xyz", vector, strict=True)
    )
    return x, y, z


def _of_pose(prefix: str, pose: Pose, change: Change) -> Pose:
    """A pose at a changed place.

    Args:
        prefix: What the names of its parameters begin with.
        pose: The pose.
        change: Gives a parameter's value from its name, its own value and its dimension.

    Returns:
        The new pose, turned as before.
    """
    return replace(pose, xyz=_of_vector(prefix, pose.xyz, change))


def _of_rotor(prefix: str, rotor: Rotor, change: Change) -> Rotor:
    """A rotor with changed numbers.

    Args:
        prefix: What the names of its parameters begin with.
        rotor: The rotor.
        change: Gives a parameter's value from its name, its own value and its dimension.

    Returns:
        The new rotor.
    """
    position = _of_vector(prefix, rotor.position, change)
    return replace(rotor, position=position, drag=change(f"{prefix}_drag", rotor.drag, LENGTH))


def _of_link(prefix: str, link: Link, change: Change) -> Link:
    """A link with changed numbers.

    Args:
        prefix: What the names of its parameters begin with.
        link: The link.
        change: Gives a parameter's value from its name, its own value and its dimension.

    Returns:
        The new link.
    """
    link = replace(link, body=_of_body(prefix, link.body, change))
    if link.pose is not None:
        link = replace(link, pose=_of_pose(prefix, link.pose, change))
    else:
        a = None if link.a is None else change(f"{prefix}_a", link.a, LENGTH)
        link = replace(link, a=a, d=change(f"{prefix}_d", link.d, LENGTH))
    if not link.moves:
        return link
    dimensions = _PASSIVE if link.joint == "revolute" else _SLIDING
    names = ("damping", "armature", "stiffness", "rest")
    own = zip(names, astuple(link.passive), dimensions, strict=True)
    passive = Passive(*(change(f"{prefix}_{name}", value, unit) for name, value, unit in own))
    return replace(link, passive=passive)


def _of_body(prefix: str, body: Body, change: Change) -> Body:
    """A rod or a rigid body with changed numbers.

    Args:
        prefix: What the names of its parameters begin with.
        body: The body.
        change: Gives a parameter's value from its name, its own value and its dimension.

    Returns:
        The new body, of the same kind.
    """
    if isinstance(body, Rod):
        return _of_rod(prefix, body, change)
    return _of_rigid_body(prefix, body, change)


def _of_rod(prefix: str, rod: Rod, change: Change) -> Rod:
    """A rod with changed numbers.

    Args:
        prefix: What the names of its parameters begin with.
        rod: The rod.
        change: Gives a parameter's value from its name, its own value and its dimension.

    Returns:
        The new rod.
    """
    length = change(f"{prefix}_length", rod.length, LENGTH)
    density = change(f"{prefix}_mass_per_length", rod.mass_per_length, DENSITY)
    own = zip(("xx", "yy", "zz"), rod.section_inertia, strict=True)
    x, y, z = (change(f"{prefix}_section_inertia_{axes}", i, INERTIA) for axes, i in own)
    return Rod(length, density, (x, y, z))


def _of_rigid_body(prefix: str, body: RigidBody, change: Change) -> RigidBody:
    """A rigid body with changed numbers.

    Args:
        prefix: What the names of its parameters begin with.
        body: The body.
        change: Gives a parameter's value from its name, its own value and its dimension.

    Returns:
        The new body.
    """
    length = change(f"{prefix}_length", body.length, LENGTH)
    mass = change(f"{prefix}_mass", body.mass, MASS)
    com = _of_vector(f"{prefix}_com", body.com, change)
    own = zip(("xx", "yy", "zz", "xy", "xz", "yz"), body.inertia, strict=True)
    xx, yy, zz, xy, xz, yz = (change(f"{prefix}_inertia_{axes}", i, INERTIA) for axes, i in own)
    return RigidBody(length, mass, com, (xx, yy, zz, xy, xz, yz))


class _Numbers(dict[str, float]):
    """Numbers by the names of their parameters, as they are come by."""

    def note(self, name: str, value: float, _: Dimension) -> float:
        """Note a number, which stays the same.

        Args:
            name: Of its parameter.
            value: The number.
            _: Its dimension.

        Returns:
            The number.
        """
        self[name] = value
        return value


def parameter_values(robot: Robot) -> dict[str, float]:
    """Every number of the robot that can be a parameter, zeros included.

    Args:
        robot: The robot.

    Returns:
        The numbers under the names of parameters, in SI units.
    """
    found = _Numbers()
    mapped(robot, found.note)
    return found


def body_values(prefix: str, body: Body) -> dict[str, float]:
    """Numbers of a body.

    Args:
        prefix: What the names of its parameters begin with.
        body: The body.

    Returns:
        The numbers by name.
    """
    found = _Numbers()
    _of_body(prefix, body, found.note)
    return found


def prepared(module: ModuleType, robot: Robot) -> Any:
    """Constants of a module for the numbers of a robot.

    Args:
        module: The module.
        robot: The robot that has these numbers.

    Returns:
        What the module's `prepare` returns.
    """
    numbers = parameter_values(robot)
    return module.prepare({name: numbers[name] for name in module.PARAMETERS})


def with_values(robot: Robot, values: Mapping[str, float]) -> Robot:
    """The robot with other numbers.

    Args:
        robot: The robot.
        values: The other numbers, under names of `parameter_values`.

    Returns:
        The robot with these numbers, and its own for what has none there.
    """
    return mapped(robot, lambda name, value, _: values.get(name, value))


def in_units(robot: Robot, length: float, mass: float, time: float) -> Robot:
    """The same robot, its numbers in other units.

    Args:
        robot: The robot, in SI units.
        length: Unit of length, in m.
        mass: Unit of mass, in kg.
        time: Unit of time, in s.

    Returns:
        The robot whose numbers are multiples of those units.
    """
    return mapped(robot, lambda _, value, dimension: value / dimension.unit(length, mass, time))


def bodies(robot: Robot) -> Iterator[tuple[str, Body]]:
    """Every body that has parameters of its own.

    Args:
        robot: The robot.

    Yields:
        What the names of its parameters begin with, and the body.
    """
    yield from _arms(robot)
    if robot.base.body:
        yield "base", robot.base.body
    for i, link in enumerate(robot.links, start=1):
        yield parameter_prefix(robot, i), link.body


def _arms(robot: Robot) -> Iterator[tuple[str, Body]]:
    for k, arm in enumerate(robot.base.arms, start=1):
        yield "base_arm" if robot.base.shares_one_arm else f"base_arm{k}", arm
