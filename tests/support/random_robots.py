"""Random robots of every structure: by number, for a fixed set, as files, and for Hypothesis."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from gibbs_codegen.robot.model import (
    AXES,
    JOINT_KINDS,
    ORIGINS,
    SEQUENCES,
    Base,
    Body,
    Link,
    RigidBody,
    Robot,
    Rod,
    Vector3,
)
from gibbs_codegen.robot.text import robot_text

ANGLES = ("0", "0", "0", "90", "-90", "180", "30", "45", "37.25", "-120", "60")


def rod(rng: np.random.Generator) -> Rod:
    """A rod with a section inertia that a body can have."""
    x, y, z = map(float, rng.uniform(0.01, 0.02, 3))
    return Rod(float(rng.uniform(0.2, 1.5)), float(rng.uniform(0.3, 2.0)), (x, y, z))


def rigid_body(rng: np.random.Generator) -> RigidBody:
    """A body made of five random point masses, so that its inertia is one that a body can have."""
    points = rng.normal(size=(5, 3)) * 0.3
    masses = rng.uniform(0.1, 0.5, 5)
    com = masses @ points / masses.sum()
    inertia = sum(
        m * ((p - com) @ (p - com) * np.eye(3) - np.outer(p - com, p - com))
        for m, p in zip(masses, points, strict=True)
    )
    entries = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return RigidBody(
        float(rng.uniform(0.2, 1.0)),
        float(masses.sum()),
        tuple(map(float, com)),
        tuple(map(float, entries)),
    )


def body(rng: np.random.Generator) -> Body:
    """A rod or a rigid body."""
    return rod(rng) if rng.random() < 0.5 else rigid_body(rng)


def thrust(rng: np.random.Generator) -> Vector3:
    """An axis, or a tilted direction."""
    if rng.random() < 0.5:
        return AXES["xyz"[rng.integers(3)]]
    direction = rng.normal(size=3)
    x, y, z = map(float, direction / np.linalg.norm(direction))
    return (x, y, z)


def link(rng: np.random.Generator) -> Link:
    """A link with any joint and any Denavit–Hartenberg numbers."""
    return Link(
        body(rng),
        Fraction(ANGLES[rng.integers(len(ANGLES))]),
        (None, 0.0, 0.35)[rng.integers(3)],
        (0.0, 0.0, 0.2)[rng.integers(3)],
        Fraction(ANGLES[rng.integers(len(ANGLES))]),
        (*JOINT_KINDS, "revolute")[rng.integers(3)],
    )


def random_robot(seed: int, rotors: int, links: int) -> Robot:
    """The robot of a seed, with N = `rotors` and n = `links`."""
    rng = np.random.default_rng(seed)
    arms = tuple(body(rng) for _ in range(1 if rng.random() < 0.5 else rotors))
    drag = tuple(float(d) for d in rng.normal(size=rotors) * 0.1 * rng.integers(2))
    base = Base(
        rotors,
        arms,
        tuple(thrust(rng) for _ in range(rotors)),
        drag,
        SEQUENCES[rng.integers(len(SEQUENCES))],
        ORIGINS[rng.integers(len(ORIGINS))],
    )
    gravity = (9.81, 9.81, 0.0, 3.7)[rng.integers(4)]
    return Robot("random_robot", base, tuple(link(rng) for _ in range(links)), gravity)


def random_parents(seed: int, links: int) -> tuple[int, ...]:
    """For each link what it is on: 0 for the base, i for link i, so that links form a tree."""
    rng = np.random.default_rng(seed)
    return tuple(int(rng.integers(i + 1)) for i in range(links))


def write_random_robots(folder: Path, count: int) -> list[Path]:
    """Write the files of `count` robots of 2 … 8 rotors and 0 … 5 links.

    In each, motors push against an axis and in a tilted plane: versions of SymPy differ in whether
    1.0 equals 1.
    """
    paths = [folder / f"random_{seed}.toml" for seed in range(count)]
    for seed, path in enumerate(paths):
        robot = random_robot(seed, 2 + 5 * seed % 7, seed % 6)
        against = tuple(-entry for entry in AXES["xyz"[seed % 3]])
        directions = (against, (0.0, -0.6, 0.8), *robot.base.thrust[2:])
        robot = replace(robot, name=path.stem, base=replace(robot.base, thrust=directions))
        path.write_text(robot_text(robot), encoding="utf-8")
    return paths


@st.composite
def robots(draw: st.DrawFn, most_rotors: int = 12, most_links: int = 8) -> Robot:
    """Robots of 2 … `most_rotors` rotors and 0 … `most_links` links."""
    seed = draw(st.integers(0, 2**32 - 1))
    return random_robot(seed, draw(st.integers(2, most_rotors)), draw(st.integers(0, most_links)))
