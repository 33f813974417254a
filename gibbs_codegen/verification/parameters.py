"""A robot's numbers under the names of its module's parameters, and a robot with other numbers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from gibbs_codegen.robot.model import Body, Link, Robot, Rod

_FACTORS = (0.8, 1.25)


def parameter_values(robot: Robot) -> dict[str, float]:
    """Every number of the robot that can be a parameter, zeros included."""
    base = robot.base
    values = {"gravity": robot.gravity}
    values |= {f"base_drag_{k}": drag for k, drag in enumerate(base.drag, start=1)}
    for k, arm in enumerate(base.arms, start=1):
        values |= _body_values("base_arm" if base.shares_one_arm else f"base_arm{k}", arm)
    for i, link in enumerate(robot.links, start=1):
        if link.a is not None:
            values[f"link{i}_a"] = link.a
        values[f"link{i}_d"] = link.d
        values |= _body_values(f"link{i}", link.body)
    return values


def _body_values(prefix: str, body: Body) -> Iterator[tuple[str, float]]:
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


def varied(robot: Robot, seed: int) -> Robot:
    """The robot with every number times a factor of its own between 0.8 and 1.25.

    Entries of one inertia share a factor, so that it stays one that a body can have; zeros stay.
    """
    rng = np.random.default_rng(seed)

    def factor() -> float:
        return float(rng.uniform(*_FACTORS))

    def of_body(body: Body) -> Body:
        length, mass, inertia = body.length * factor(), factor(), factor()
        if isinstance(body, Rod):
            x, y, z = body.section_inertia
            section = (x * inertia, y * inertia, z * inertia)
            return Rod(length, body.mass_per_length * mass, section)
        x, y, z = (entry * factor() for entry in body.com)
        xx, yy, zz, xy, xz, yz = (entry * inertia for entry in body.inertia)
        return replace(
            body,
            length=length,
            mass=body.mass * mass,
            com=(x, y, z),
            inertia=(xx, yy, zz, xy, xz, yz),
        )

    def of_link(link: Link) -> Link:
        a = None if link.a is None else link.a * factor()
        return replace(link, body=of_body(link.body), a=a, d=link.d * factor())

    base = replace(
        robot.base,
        arms=tuple(map(of_body, robot.base.arms)),
        drag=tuple(drag * factor() for drag in robot.base.drag),
    )
    links = tuple(map(of_link, robot.links))
    return replace(robot, base=base, links=links, gravity=robot.gravity * factor())
