"""A robot's numbers under the names of its module's parameters, and a robot with other numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from types import ModuleType
from typing import Any

from gibbs_codegen.robot.model import Body, Link, RigidBody, Robot, Rod


def parameter_values(robot: Robot) -> dict[str, float]:
    """Every number of the robot that can be a parameter, zeros included.

    Args:
        robot: The robot.

    Returns:
        The numbers under the names of parameters, in SI units.
    """
    base = robot.base
    values = {"gravity": robot.gravity}
    values |= {f"base_drag_{k}": drag for k, drag in enumerate(base.drag, start=1)}
    for prefix, body in bodies(robot):
        values |= body_values(prefix, body)
    for i, link in enumerate(robot.links, start=1):
        if link.a is not None:
            values[f"link{i}_a"] = link.a
        values[f"link{i}_d"] = link.d
    return values


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


def body_values(prefix: str, body: Body) -> Iterator[tuple[str, float]]:
    """Numbers of a body.

    Args:
        prefix: What the names of its parameters begin with.
        body: The body.

    Yields:
        Names and numbers: length, mass, and the others in order.
    """
    yield f"{prefix}_length", body.length
    if isinstance(body, Rod):
        yield f"{prefix}_mass_per_length", body.mass_per_length
        names = [f"section_inertia_{axis}" for axis in ("xx", "yy", "zz")]
        entries: tuple[float, ...] = body.section_inertia
    else:
        yield f"{prefix}_mass", body.mass
        names = [f"com_{axis}" for axis in "xyz"]
        names += [f"inertia_{axes}" for axes in ("xx", "yy", "zz", "xy", "xz", "yz")]
        entries = (*body.com, *body.inertia)
    for name, value in zip(names, entries, strict=True):
        yield f"{prefix}_{name}", value


def with_values(robot: Robot, values: Mapping[str, float]) -> Robot:
    """The robot with other numbers.

    Args:
        robot: The robot.
        values: The other numbers, under names of `parameter_values`.

    Returns:
        The robot with these numbers, and its own for what has none there.
    """

    def of_body(prefix: str, body: Body) -> Body:
        own = body_values(prefix, body)
        length, mass, *rest = (values.get(name, value) for name, value in own)
        if isinstance(body, Rod):
            x, y, z = rest
            return Rod(length, mass, (x, y, z))
        x, y, z, xx, yy, zz, xy, xz, yz = rest
        return RigidBody(length, mass, (x, y, z), (xx, yy, zz, xy, xz, yz))

    def of_link(i: int, link: Link) -> Link:
        a = None if link.a is None else values.get(f"link{i}_a", link.a)
        body = of_body(f"link{i}", link.body)
        return replace(link, body=body, a=a, d=values.get(f"link{i}_d", link.d))

    base = robot.base
    drags = enumerate(base.drag, start=1)
    other = replace(
        base,
        arms=tuple(of_body(prefix, arm) for prefix, arm in _arms(robot)),
        drag=tuple(values.get(f"base_drag_{k}", drag) for k, drag in drags),
    )
    links = tuple(of_link(i, link) for i, link in enumerate(robot.links, start=1))
    return replace(robot, base=other, links=links, gravity=values.get("gravity", robot.gravity))


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

    def unit(name: str) -> float:
        if name == "gravity":
            return length / time**2
        if "inertia" in name:
            return mass * length**2
        if name.endswith("_mass_per_length"):
            return mass / length
        return mass if name.endswith("_mass") else length

    return with_values(robot, {n: x / unit(n) for n, x in parameter_values(robot).items()})


def bodies(robot: Robot) -> Iterator[tuple[str, Body]]:
    """Every body that has parameters of its own.

    Args:
        robot: The robot.

    Yields:
        What the names of its parameters begin with, and the body.
    """
    yield from _arms(robot)
    yield from ((f"link{i}", link.body) for i, link in enumerate(robot.links, start=1))


def _arms(robot: Robot) -> Iterator[tuple[str, Body]]:
    for k, arm in enumerate(robot.base.arms, start=1):
        yield "base_arm" if robot.base.shares_one_arm else f"base_arm{k}", arm
