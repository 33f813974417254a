"""The machines that operation counts and times are quoted for.

The benchmark family: free base of six 0.5 m rods, position at its centre, attitude x-y-z; an arm of
n revolute joints at the centre: link 1 has no length and no mass and turns about the base normal,
links 2 … n are rods of 6/(n − 1) m and 1 kg/m with α = 90°, 0°, 90°, 0°, …

Besides, a rigid base with a quaternion, tilted rotors, and arms of seven joints side by side.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np

from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import Attitude, Base, Origin
from gibbs_codegen.robot.parts.body import RigidBody, Rod
from gibbs_codegen.robot.parts.link import Link
from gibbs_codegen.robot.parts.numbers import Vector3
from gibbs_codegen.robot.parts.pose import Pose
from gibbs_codegen.robot.parts.rotor import Rotor

# From joint to joint of a seven-joint arm: shoulder, elbow and wrist, with offsets of the elbow and
# the hand. Length in m and the twist about x in degrees, as in many arms on the market.
_OFFSETS: tuple[tuple[Vector3, int], ...] = (
    ((0.0, 0.0, 0.333), 0),
    ((0.0, 0.0, 0.0), -90),
    ((0.0, -0.316, 0.0), 90),
    ((0.0825, 0.0, 0.0), 90),
    ((-0.0825, 0.384, 0.0), -90),
    ((0.0, 0.0, 0.0), 90),
    ((0.088, 0.0, 0.0), 90),
)


def benchmark_robot(
    links: int, rotors: int = 6, origin: Origin = "centre", attitude: Attitude = "xyz"
) -> Robot:
    """Member of the family with n = `links` ≥ 2."""
    paper = paper_family(rotors, 2)
    section = paper.base.arm(1).section_inertia
    rod = Rod(length=6.0 / (links - 1), mass_per_length=1.0, section_inertia=section)
    arm = tuple(Link(rod, alpha_deg=Fraction(0 if i % 2 else 90)) for i in range(links - 1))
    name = f"benchmark_{rotors}_{links}"
    base = replace(paper.base, origin=origin, attitude=attitude)
    return Robot(name, base, (Link(Rod(length=0.0)), *arm))


def two_benchmark_arms(links: int = 7) -> Robot:
    """The benchmark's robot with a quaternion and its arm twice."""
    robot = benchmark_robot(links, attitude="quaternion")
    arm = robot.links
    second = (replace(arm[0], parent=0), *arm[1:])
    return replace(robot, name=f"two_benchmark_arms_{links}", links=(*arm, *second))


def two_arms(joints: int = 7) -> Robot:
    """A hexarotor whose rotors are tilted, with two arms of up to seven joints under it."""
    rng = np.random.default_rng(14)
    links = []
    for side in (-1.0, 1.0):
        for i, (step, twist) in enumerate(_OFFSETS[:joints]):
            place = (0.1, 0.2 * side, -0.05) if i == 0 else step
            turn = (Fraction(180 if i == 0 else twist), Fraction(0), Fraction(0))
            parent = 0 if i == 0 else None
            links.append(Link(_body(rng, 0.4), pose=Pose(place, turn), parent=parent))
    base = Base(attitude="quaternion", origin="base", body=_body(rng, 6.0))
    return Robot(f"two_arms_{joints}", base, tuple(links), thrusters=_tilted_rotors(6))


def _body(rng: np.random.Generator, mass: float) -> RigidBody:
    """A body with a general centre of mass and inertia, which a real body can have."""
    points = rng.uniform(-0.1, 0.1, (8, 3))
    com = points.mean(axis=0)
    moments = (points - com).T @ (points - com) * (mass / 8)
    inertia = np.trace(moments) * np.eye(3) - moments
    xx, yy, zz, xy, xz, yz = (
        float(inertia[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    )
    x, y, z = map(float, com)
    return RigidBody(0.0, mass, (x, y, z), (xx, yy, zz, xy, xz, yz))


def _tilted_rotors(number: int) -> tuple[Rotor, ...]:
    """Rotors around the base, each tilted about the rod that would carry it, to and fro."""
    rotors = []
    for k in range(number):
        angle, side = 2 * np.pi * k / number, (-1.0) ** k
        cos, sin = float(np.cos(angle)), float(np.sin(angle))
        direction = (-0.5 * side * sin, 0.5 * side * cos, 0.75**0.5)
        rotors.append(
            Rotor(position=(0.5 * cos, 0.5 * sin, 0.0), direction=direction, drag=0.016 * side)
        )
    return tuple(rotors)


def named_robot(name: str) -> Robot:
    """A machine of this module, a robot file or a robot that ships, without what acts in joints.

    Springs, dampers and armature are left out, since not every peer has them.
    """
    made = {"two_arms": two_arms, "two_benchmark_arms": two_benchmark_arms}
    robot = made[name]() if name in made else read_robot(name)[0]
    free = Link(Rod(length=0.0)).passive
    return replace(robot, links=tuple(replace(link, passive=free) for link in robot.links))
