"""Random robots: structure drawn by Hypothesis, numbers by a seeded generator."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from hypothesis import strategies as st

from gibbs_codegen.robot import (
    ATTITUDES,
    AXES,
    JOINT_KINDS,
    ORIGINS,
    Base,
    Body,
    Link,
    RigidBody,
    Robot,
    Rod,
)

ANGLES = [0, 0, 0, 90, -90, 180, 30, 45, 37.25, -120, 60]


def rod(rng: np.random.Generator) -> Rod:
    """A rod with a section inertia that a body can have."""
    moments = rng.uniform(0.01, 0.02, 3)
    return Rod(float(rng.uniform(0.2, 1.5)), float(rng.uniform(0.3, 2.0)), tuple(moments))


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
        float(rng.uniform(0.2, 1.0)), float(masses.sum()), tuple(com), tuple(map(float, entries))
    )


def body(kind: str, rng: np.random.Generator) -> Body:
    """A rod or a rigid body."""
    return rod(rng) if kind == "rod" else rigid_body(rng)


@st.composite
def robots(draw: st.DrawFn, most_rotors: int = 12, most_links: int = 8) -> Robot:
    """Robots of 2 … `most_rotors` rotors and 0 … `most_links` links, of every structure."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    rotors = draw(st.integers(2, most_rotors))
    n = draw(st.integers(0, most_links))
    kinds = st.sampled_from(["rod", "rigid"])
    shared = draw(st.booleans())
    arms = tuple(body(draw(kinds), rng) for _ in range(1 if shared else rotors))
    thrust = []
    for _ in range(rotors):
        if draw(st.booleans()):
            thrust.append(AXES[draw(st.sampled_from("xyz"))])
        else:
            direction = rng.normal(size=3)
            thrust.append(tuple(map(float, direction / np.linalg.norm(direction))))
    drag = tuple(float(d) for d in rng.normal(size=rotors) * 0.1 * draw(st.booleans()))
    base = Base(
        rotors,
        arms,
        tuple(thrust),
        drag,
        draw(st.sampled_from(ATTITUDES)),
        draw(st.sampled_from(ORIGINS)),
    )
    links = tuple(
        Link(
            body(draw(kinds), rng),
            Fraction(str(draw(st.sampled_from(ANGLES)))),
            draw(st.sampled_from([None, 0.0, 0.35])),
            draw(st.sampled_from([0.0, 0.0, 0.2])),
            Fraction(str(draw(st.sampled_from(ANGLES)))),
            draw(st.sampled_from([*JOINT_KINDS, "revolute"])),
        )
        for _ in range(n)
    )
    return Robot("random_robot", base, links, draw(st.sampled_from([9.81, 0.0, 3.7])))
