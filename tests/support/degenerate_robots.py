"""Robots on the edge of what has an answer: by number, for soaks, and as a Hypothesis strategy.

Each has several of these at once: links without mass or length, points, needles and flat bodies,
joints that coincide or are collinear, masses and lengths of very different sizes, tips that nothing
keeps from spinning, bases without mass. Some are singular, and are to be refused.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
from hypothesis import strategies as st

from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.body import Body, RigidBody, Rod
from gibbs_codegen.robot.parts.link import Link
from support.random_robots import ANGLES, link, random_robot, rigid_body, rod

# Rarely more than one of them in one robot, so that about half of the robots are regular.
RARE, OFTEN = 0.12, 0.3


def massless(rng: np.random.Generator) -> Body:
    """Nothing but a length, which may be none."""
    length = (0.0, 0.4)[rng.integers(2)]
    return Rod(length=length) if rng.random() < 0.5 else RigidBody(length, 0.0)


def point_mass(rng: np.random.Generator) -> Body:
    """A point: on the joint, at the end of the link, or anywhere."""
    length = float(rng.uniform(0.2, 1.0))
    place = ((0.0, 0.0, 0.0), (length, 0.0, 0.0), tuple(map(float, rng.normal(size=3))))
    return RigidBody(length, float(rng.uniform(0.3, 2.0)), place[rng.integers(3)])


def needle(rng: np.random.Generator) -> Body:
    """A body without thickness: a rod, one along the joint's axis, or in any direction."""
    length, mass = map(float, rng.uniform(0.3, 1.5, 2))
    kind = rng.integers(3)
    if kind == 0:
        return Rod(length=length, mass_per_length=mass)
    if kind == 1:
        return RigidBody(length, mass, (0.0, 0.0, 0.3), (0.1, 0.1, 0.0, 0.0, 0.0, 0.0))
    x, y, z = map(float, (d := rng.normal(size=3)) / np.linalg.norm(d))
    entries = (1 - x * x, 1 - y * y, 1 - z * z, -x * y, -x * z, -y * z)
    com = tuple(map(float, rng.normal(size=3)))
    return RigidBody(length, mass, com, tuple(0.1 * entry for entry in entries))


def flat(rng: np.random.Generator) -> Body:
    """A plate: on the edge of the triangle inequality."""
    a, b = map(float, rng.uniform(0.01, 0.2, 2))
    moments = ((a, b, a + b), (a + b, b, a), (a, a + b, b))[rng.integers(3)]
    return RigidBody(float(rng.uniform(0.2, 1)), 1.0, (0.3, 0.0, 0.0), (*moments, 0.0, 0.0, 0.0))


def sized(body: Body, weight: float, size: float) -> Body:
    """The body, so many times as heavy and as large."""
    if isinstance(body, Rod):
        density = body.mass_per_length * weight / size
        x, y, z = (entry * weight * size**2 for entry in body.section_inertia)
        return Rod(length=body.length * size, mass_per_length=density, section_inertia=(x, y, z))
    return RigidBody(
        body.length * size,
        body.mass * weight,
        tuple(entry * size for entry in body.com),
        tuple(entry * weight * size**2 for entry in body.inertia),
    )


def some_body(rng: np.random.Generator, weights: tuple[float, ...], sizes: tuple[float, ...]):
    """A body of any kind, without length now and then."""
    kinds = (massless, point_mass, needle, flat, rod, rigid_body)
    body = kinds[rng.choice(6, p=(0.12, 0.1, 0.18, 0.15, 0.2, 0.25))](rng)
    if rng.random() < RARE:
        body = replace(body, length=0.0)
    if isinstance(body, Rod) and body.total_mass == 0.0:
        body = Rod(length=body.length)  # Section inertia without mass is refused.
    return sized(body, weights[rng.integers(len(weights))], sizes[rng.integers(len(sizes))])


def some_link(rng: np.random.Generator, body: Body) -> Link:
    """A link whose joint may coincide with the one before, or be collinear to it."""
    if rng.random() < OFTEN:
        alpha = Fraction((0, 0, 90, -90, 180)[rng.integers(5)])
        kind = "prismatic" if rng.random() < OFTEN else "revolute"
        return Link(
            body,
            alpha_deg=alpha,
            a=0.0,
            d=(0.0, 0.3)[rng.integers(2)],
            theta_deg=Fraction(0),
            joint=kind,
        )
    return replace(link(rng), body=body, theta_deg=Fraction(ANGLES[rng.integers(len(ANGLES))]))


def degenerate_robot(seed: int, rotors: int, links: int) -> Robot:
    """The robot of a seed, with N = `rotors` and n = `links`; it has a mass."""
    rng = np.random.default_rng((seed, 1))
    base = random_robot(seed, rotors, 0).base
    most = (0, 0, 3, 6, 9)[rng.integers(5)]
    weights = (1.0, 1.0, 10.0**most, 10.0**-most)[: int(rng.integers(2, 5))]
    sizes = ((1.0,), (1.0,), (1.0, 1e-3), (1.0, 1e3))[rng.integers(4)]
    if rng.random() < RARE:
        base = replace(base, arms=(massless(rng),))
    elif rng.random() < 2 * OFTEN:
        base = replace(base, arms=tuple(some_body(rng, weights, sizes) for _ in base.arms))
    arm = [some_link(rng, some_body(rng, weights, sizes)) for _ in range(links)]
    if arm and rng.random() < OFTEN:
        arm[0] = replace(arm[0], joint="prismatic")
    if links > 1 and rng.random() < RARE:  # Two collinear sliding joints.
        k = int(rng.integers(1, links))
        arm[k - 1] = replace(arm[k - 1], joint="prismatic")
        arm[k] = replace(arm[k], joint="prismatic", alpha_deg=Fraction(0))
    if arm and rng.random() < RARE:
        arm[-1] = replace(arm[-1], body=needle(rng))
    gravity = (9.81, 0.0)[int(rng.random() < RARE)]
    robot = Robot("degenerate_robot", base, tuple(arm), gravity)
    return robot if robot.total_mass > 0 else replace(robot, base=replace(base, arms=(rod(rng),)))


@st.composite
def degenerate_robots(draw: st.DrawFn, most_rotors: int = 12, most_links: int = 8) -> Robot:
    """Degenerate robots of 2 … `most_rotors` rotors and 0 … `most_links` links."""
    seed = draw(st.integers(0, 2**32 - 1))
    rotors, links = draw(st.integers(2, most_rotors)), draw(st.integers(0, most_links))
    return degenerate_robot(seed, rotors, links)
