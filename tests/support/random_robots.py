"""Random robots of every structure: by number, for a fixed set, as files, and for Hypothesis."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import (
    ATTITUDES,
    FREE,
    LEVEL_MOTIONS,
    ROD_ORIGINS,
    TRAVELS,
    TURNS,
    Base,
)
from gibbs_codegen.robot.parts.body import Body, RigidBody, Rod
from gibbs_codegen.robot.parts.frame import Frame
from gibbs_codegen.robot.parts.gear import Gear
from gibbs_codegen.robot.parts.link import JOINT_KINDS, LINK_KINDS, JointLimits, Link, Passive
from gibbs_codegen.robot.parts.motor import Motor
from gibbs_codegen.robot.parts.numbers import AXES, BASE, Vector3
from gibbs_codegen.robot.parts.pose import Pose
from gibbs_codegen.robot.parts.rotor import Rotor
from gibbs_codegen.robot.parts.spring import Spring
from gibbs_codegen.robot.parts.wheel import WheelTable
from gibbs_codegen.robot.text import robot_text

# The intrinsic sequences of Tait–Bryan angles.
SEQUENCES = ATTITUDES[:-1]
ANGLES = ("0", "0", "0", "90", "-90", "180", "30", "45", "37.25", "-120", "60")


def rod(rng: np.random.Generator) -> Rod:
    """A rod with a section inertia that a body can have."""
    x, y, z = map(float, rng.uniform(0.01, 0.02, 3))
    return Rod(
        length=float(rng.uniform(0.2, 1.5)),
        mass_per_length=float(rng.uniform(0.3, 2.0)),
        section_inertia=(x, y, z),
    )


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
        alpha_deg=Fraction(ANGLES[rng.integers(len(ANGLES))]),
        a=(None, 0.0, 0.35)[rng.integers(3)],
        d=(0.0, 0.0, 0.2)[rng.integers(3)],
        theta_deg=Fraction(ANGLES[rng.integers(len(ANGLES))]),
        joint=(*JOINT_KINDS, "revolute")[rng.integers(3)],
    )


def random_robot(seed: int, rotors: int, links: int) -> Robot:
    """The robot of a seed, with N = `rotors` and n = `links`."""
    rng = np.random.default_rng(seed)
    arms = tuple(body(rng) for _ in range(1 if rng.random() < 0.5 else rotors))
    drag = tuple(float(d) for d in rng.normal(size=rotors) * 0.1 * rng.integers(2))
    base = Base(
        rotors=rotors,
        arms=arms,
        thrust=tuple(thrust(rng) for _ in range(rotors)),
        drag=drag,
        attitude=SEQUENCES[rng.integers(len(SEQUENCES))],
        origin=ROD_ORIGINS[rng.integers(len(ROD_ORIGINS))],
    )
    gravity = (9.81, 9.81, 0.0, 3.7)[rng.integers(4)]
    return Robot("random_robot", base, tuple(link(rng) for _ in range(links)), gravity)


NAMES = (None, "arm {}.{}", "Arm-{}/{}", "link_{}_{}")


def random_pose(rng: np.random.Generator) -> Pose:
    """A place nearby, half the time with angles that are not multiples of 90°."""
    x, y, z = (float(value) for value in rng.choice((0.0, 0.1, -0.25, 0.3), 3))
    angles = [Fraction(ANGLES[rng.integers(len(ANGLES))]) for _ in range(3)]
    return Pose((x, y, z), (angles[0], angles[1], angles[2]))


def passive(rng: np.random.Generator) -> Passive:
    """Some of damping, armature and a spring, or none."""
    damping, armature, stiffness, rest = (
        float(value) for value in rng.uniform(0.05, 0.5, 4) * rng.integers(0, 2, 4)
    )
    return Passive(
        damping=damping, armature=armature, stiffness=stiffness, rest=rest if stiffness else 0.0
    )


def tree_link(rng: np.random.Generator) -> Link:
    """A link that is welded, held or moves, placed by a pose or by Denavit–Hartenberg numbers."""
    kind = ("revolute", *LINK_KINDS, "revolute", "prismatic")[rng.integers(6)]
    found = replace(link(rng), body=rigid_body(rng), joint=kind)
    if rng.random() < 0.75:
        x, y, z = thrust(rng)
        axis = (0.0 - x, 0.0 - y, 0.0 - z) if rng.random() < 0.5 else (x, y, z)
        found = Link(found.body, joint=kind, pose=random_pose(rng), axis=axis)
    if not found.moves:
        return replace(found, constrained=bool(rng.random() < 0.5))
    low, high = sorted(float(value) for value in rng.uniform(-2.0, 2.0, 2))
    bounds = (JointLimits(), JointLimits(low, high, 5.0, 2.5), JointLimits(None, high))
    return replace(found, passive=passive(rng), limits=bounds[rng.integers(3)])


def random_tree(seed: int, attitude: str = "") -> Robot:
    """A robot with one to three arms that branch, of a seed.

    Half of them have a central body with placed rotors, some on links; the others have rods, some
    at unequal azimuths. Attitude is "tait_bryan" or "quaternion"; where it is not given, odd seeds
    have a quaternion. Masses and inertias are those of bodies, and well conditioned.
    """
    rng = np.random.default_rng(seed)
    arms, pattern = int(rng.integers(1, 4)), NAMES[rng.integers(len(NAMES))]
    links: list[Link] = []
    for arm in range(1, arms + 1):
        first = len(links) + 1
        for place in range(1, int(rng.integers(1, 4)) + 1):
            before = len(links)
            on = (
                0
                if place == 1
                else before
                if rng.random() < 0.7
                else int(rng.integers(first, before + 1))
            )
            name = pattern.format(arm, place) if pattern else None
            coordinate = f"q{arm}.{place}" if rng.random() < 0.2 else None
            parent = None if on == before else on
            new = replace(tree_link(rng), name=name, parent=parent)
            named = new.moves or new.constrained
            links.append(replace(new, coordinate=coordinate if named else None))
    frames = tuple(
        Frame(f"frame {k}", int(rng.integers(len(links) + 1)), random_pose(rng))
        for k in range(int(rng.integers(4)))
    )
    base, rotors = _tree_base(rng, links)
    if attitude == "quaternion" or (not attitude and seed % 2):
        base = replace(base, attitude="quaternion")
    gravity = (9.81, 9.81, 3.7)[rng.integers(3)]
    return Robot(f"tree_{seed}", base, tuple(links), gravity, rotors, frames)


def _tree_base(rng: np.random.Generator, links: list[Link]) -> tuple[Base, tuple[Rotor, ...]]:
    """A central body and rotors on it and on links, or rods, with or without a body."""
    attitude = SEQUENCES[rng.integers(len(SEQUENCES))]
    if rng.random() < 0.5:
        # Without rotors the joint of a link without a name would be called theta_1, as the base's.
        count = int(rng.integers(0 if links[0].name else 1, 7))
        return Base(attitude=attitude, origin="base", body=_central_body(rng)), tuple(
            _rotor(rng, len(links), k) for k in range(count)
        )
    whole = random_robot(int(rng.integers(2**31)), int(rng.integers(2, 6)), 0).base
    azimuths = sorted(
        int(angle) for angle in rng.choice(np.arange(-180, 180, 15), whole.rotors, False)
    )
    base = replace(whole, attitude=attitude)
    if rng.random() < 0.6:
        base = replace(base, azimuth_deg=tuple(map(Fraction, azimuths)))
    return replace(base, body=_central_body(rng) if rng.random() < 0.4 else None), ()


def _central_body(rng: np.random.Generator) -> RigidBody:
    return replace(rigid_body(rng), length=0.0)


def _rotor(rng: np.random.Generator, links: int, k: int) -> Rotor:
    x, y, z = (float(value) for value in rng.uniform(-0.4, 0.4, 3))
    return Rotor(
        position=(x, y, z),
        direction=thrust(rng),
        drag=float(rng.choice((0.0, 0.016, -0.016))),
        on=int(rng.integers(links + 1)) if rng.random() < 0.4 else 0,
        name=f"rotor {k}" if rng.random() < 0.5 else None,
        limits=(0.0, 15.0) if rng.random() < 0.5 else None,
        time_constant=0.02 if rng.random() < 0.3 else None,
    )


def sprung_robot(seed: int, attitude: str = "") -> Robot:
    """The tree of a seed with one or two springs between its bodies, if any of its joints moves."""
    rng, robot = np.random.default_rng([seed, 3]), random_tree(seed, attitude)
    bodies = [BASE, *robot.moving, *robot.constrained]
    frames = tuple(Frame(f"end {body}", body, random_pose(rng)) for body in bodies)
    robot = replace(robot, name=f"sprung_{seed}", frames=(*robot.frames, *frames))
    springs = []
    for k in range(int(rng.integers(1, 3)) if robot.moving else 0):
        on = rng.permutation(robot.moving)[0]
        others = [body for body in bodies if robot.rigid[body] != robot.rigid[on]]
        stiffness, length, damping = map(float, rng.uniform(0.2, 1.0, 3) * rng.integers(0, 2, 3))
        springs.append(
            Spring(
                f"spring {k}",
                f"end {on}",
                f"end {others[rng.integers(len(others))]}",
                stiffness=stiffness or 0.5,
                length=length,
                damping=damping,
            )
        )
    return replace(robot, springs=tuple(springs))


def geared_robot(seed: int, attitude: str = "") -> Robot:
    """The tree of a seed, with springs, in which gears move about half of the joints.

    Some are gears of gears; a joint may be moved by one of another branch, or of another kind.
    """
    number = seed
    while len((robot := sprung_robot(number, attitude)).moving) < 2:
        number += 1000
    rng, links = np.random.default_rng([seed, 4]), [*robot.links]
    first, *others = map(int, rng.permutation(robot.moving))
    before = [first]
    for k, i in enumerate(others):
        if k == 0 or rng.random() < 0.5:
            ratio = float(rng.choice((-1.0, 1.0, 0.35, -2.5)))
            offset = float(rng.choice((0.0, 0.0, 0.4)))
            gear = Gear(of=before[rng.integers(len(before))], ratio=ratio, offset=offset)
            links[i - 1] = replace(links[i - 1], gear=gear, limits=JointLimits(), coordinate=None)
        before.append(i)
    return replace(robot, name=f"geared_{seed}", links=tuple(links))


def random_motion(rng: np.random.Generator) -> Any:
    """How a base moves: freely, in a way that has a name, or by a list."""
    if rng.random() < 0.6:
        return (FREE, *LEVEL_MOTIONS)[rng.integers(1 + len(LEVEL_MOTIONS))]
    kinds = [rng.permutation(names)[: rng.integers(4)] for names in ([*TRAVELS], [*TURNS])]
    return tuple(str(name) for kind in kinds for name in kind) or ("pitch",)


def on_base(robot: Robot, motion: Any, seed: int) -> Robot:
    """The same on a central body that moves in another way than freely, from a random pose."""
    rng = np.random.default_rng([seed, 9])
    base = Base(motion=motion, origin="base", body=_central_body(rng), pose=random_pose(rng))
    return replace(robot, base=base)


def motored_robot(seed: int, attitude: str = "") -> Robot:
    """The geared robot of a seed with motors behind gears at most of the joints that turn."""
    robot, rng = geared_robot(seed, attitude), np.random.default_rng([seed, 5])
    motors = (
        Motor(
            rotor_inertia=float(rng.uniform(1e-3, 1e-2)),
            gear_ratio=float(rng.choice((-30.0, 50.0, 1.0, 7.5))),
        )
        for _ in robot.links
    )
    links = (
        replace(link, motor=motor if link.joint == "revolute" and rng.random() < 0.8 else None)
        for link, motor in zip(robot.links, motors, strict=True)
    )
    return replace(robot, name=f"motored_{seed}", links=tuple(links))


def rolling_robot(seed: int) -> Robot:
    """The geared tree of a seed on wheels and a caster, with a frame on a rim.

    Even seeds have a drive; the others roll on wheels that slide along their axes.
    """
    robot, rng = geared_robot(seed), np.random.default_rng([seed, 5])
    drive = None if seed % 2 else "differential"
    wheels = []
    for k in range(2 if drive else 3):
        x, y, _ = map(float, 0.3 * rng.normal(size=3))
        angle = np.deg2rad(float(rng.integers(-180, 180)))
        radius = float(rng.uniform(0.05, 0.4))
        wheel = WheelTable(
            name=f"wheel {k}",
            joint=f"turn {k}",
            radius=radius,
            xyz=(0.0, (1.0, -1.0)[k] * abs(y), radius) if drive else (x, y, radius),
            axis=(0.0, (1.0, -1.0)[k], 0.0)
            if drive
            else (float(np.cos(angle)), float(np.sin(angle)), 0.0),
            mass=float(rng.uniform(0.1, 1.0)),
            inertia=float(rng.uniform(0.001, 0.05)),
            damping=0.1 * k,
        )
        wheels.append(wheel.link())
    wheels.append(WheelTable(name="caster", radius=0.03, xyz=(0.2, 0.1, 0.03), mass=0.3).link())
    rim = Frame("rim", len(robot.links) + 1, Pose((0.1, 0.02, 0.03)))
    body = replace(rigid_body(rng), length=0.0)
    pose = Pose((0.0, 0.0, 0.2))
    return replace(
        robot,
        name=f"rolling_{seed}",
        base=Base(motion="planar", drive=drive, origin="base", body=body, pose=pose),
        links=(*robot.links, *wheels),
        frames=(*robot.frames, rim),
    )


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


def trees() -> st.SearchStrategy[Robot]:
    """Robots with one to three arms that branch."""
    return st.builds(random_tree, st.integers(0, 2**32 - 1))
