"""Frames that links are derived in: an arm given by poses costs no more than by parameters."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import sympy as sp
from support.random_robots import rigid_body

from gibbs_codegen.derivation.inertia import NO_INERTIA
from gibbs_codegen.derivation.jointed_bodies import BodyFrame, PlacedLink, framed
from gibbs_codegen.derivation.segment_tree import JointedLink
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import Base
from gibbs_codegen.robot.parts.body import RigidBody
from gibbs_codegen.robot.parts.link import Link
from gibbs_codegen.robot.parts.numbers import AXES, Vector3
from gibbs_codegen.robot.parts.pose import Pose
from gibbs_codegen.robot.parts.rotor import Rotor
from gibbs_codegen.symbolic.structural import NO_TURN, Turn, turn_about, turned_by_rpy
from gibbs_codegen.symbolic.tape import InlineTape
from gibbs_codegen.symbolic.vectors import ZERO, X, Z, cos_sin_deg

FUNCTIONS = ("mass_matrix_and_residual", "forward_dynamics", "inverse_dynamics", "mass_matrix")
NONE = Fraction(0)
LENGTH, WIDTH, HEIGHT = sp.symbols("l w h")


def placed(
    turn: Turn, step: tuple[sp.Expr, ...], axis: Vector3 = AXES["z"], parent: int = 0
) -> PlacedLink:
    x, y, z = map(sp.sympify, step)
    link = JointedLink(parent, NO_INERTIA, "revolute", sp.Symbol("q"), "", "")
    return PlacedLink(link, BodyFrame(parent, turn, (x, y, z)), axis, by_parameters=False)


def frames_of(*links: PlacedLink) -> tuple[list[JointedLink], list[BodyFrame]]:
    return framed(InlineTape(), links, BodyFrame(0))


def test_parameters_keep_the_frame_of_the_file() -> None:
    given = placed(NO_TURN, ZERO)
    step, zero = (LENGTH, sp.S.Zero, sp.S.Zero), Fraction(0)
    by_parameters = replace(given.link, step=step, d=HEIGHT, theta_deg=Fraction(20))
    (link,), (_, frame) = frames_of(replace(given, link=by_parameters, by_parameters=True))
    assert (link.turn_deg, link.step, link.d, link.theta_deg) == (zero, step, HEIGHT, 20)
    assert frame == BodyFrame(1)


def test_what_lies_along_the_axis_is_left_to_the_link() -> None:
    """On a parallel axis the frame slides along it, level with the parent's."""
    (link,), (_, frame) = frames_of(placed(NO_TURN, (LENGTH, WIDTH, HEIGHT)))
    assert (link.turn_deg, link.alpha_deg, link.theta_deg) == (0, 0, 0)
    assert link.step == (LENGTH, WIDTH, 0)
    assert frame.origin == (0, 0, HEIGHT)


def test_a_frame_slides_to_where_a_twisted_axis_comes_nearest() -> None:
    """The axis is −y of the parent: what the step has along y is left to the link."""
    turn = turn_about(X, Fraction(90))
    (link,), (_, frame) = frames_of(placed(turn, (LENGTH, WIDTH, HEIGHT)))
    assert (link.turn_deg, link.alpha_deg, link.theta_deg) == (0, 90, 0)
    assert link.step == (LENGTH, 0, HEIGHT)
    assert frame.origin == (0, 0, -WIDTH)


def test_a_frame_turns_towards_the_next_axis() -> None:
    """The second axis is x of the first link: x of its frame turns, so that a twist leads there."""
    first = placed(NO_TURN, ZERO)
    second = placed(turned_by_rpy((Fraction(0), Fraction(90), Fraction(0))), ZERO, parent=1)
    links, (_, frame, _) = frames_of(first, second)
    assert [link.turn_deg for link in links] == [0, 0]
    assert [link.alpha_deg for link in links] == [0, 90]
    assert links[0].theta_deg == 90
    assert frame.turn == turn_about(Z, Fraction(-90))


def test_an_axis_of_the_link_becomes_its_z() -> None:
    (link,), (_, frame) = frames_of(placed(NO_TURN, ZERO, AXES["x"]))
    assert (link.turn_deg, link.alpha_deg) == (90, 90)
    assert frame.direction((sp.S.One, sp.S.Zero, sp.S.Zero)) == (0, 0, 1)


def by_parameters() -> Robot:
    """An arm of four joints, by Denavit–Hartenberg parameters without θ."""
    rng = np.random.default_rng(1)
    twists, offsets = (90, 0, -90, 180), (0.0, 0.1, 0.2, 0.0)
    links = tuple(
        Link(rigid_body(rng), alpha_deg=Fraction(alpha), a=0.3, d=d, joint=kind)
        for alpha, d, kind in zip(
            twists, offsets, ("revolute", "revolute", "prismatic", "revolute"), strict=True
        )
    )
    base = Base(attitude="quaternion", origin="base", body=rigid_body(rng))
    return Robot("arm", base, links, thrusters=(Rotor(),))


def by_poses(robot: Robot) -> Robot:
    """The same arm, each joint by its pose in the parent's frame."""
    links = []
    for link in robot.links:
        cos, sin = (round(float(part)) for part in cos_sin_deg(link.alpha_deg))
        pose = Pose((link.a or 0.0, -sin * link.d, cos * link.d), (link.alpha_deg, NONE, NONE))
        links.append(Link(link.body, joint=link.joint, pose=pose))
    return replace(robot, links=tuple(links))


def turned(robot: Robot) -> Robot:
    """The same arm by poses, with the frame of each link turned by −90° about x: joints about −y.

    Seen from there (x, y, z) is (x, −z, y).
    """
    links = []
    for i, link in enumerate(by_poses(robot).links):
        body, pose = link.body, link.pose
        assert isinstance(body, RigidBody)
        assert pose is not None
        x, y, z = body.com
        xx, yy, zz, xy, xz, yz = body.inertia
        body = replace(body, com=(x, -z, y), inertia=(xx, zz, yy, -xz, xy, -yz))
        (a, b, c), (roll, _, _) = pose.xyz, pose.rpy_deg
        pose = Pose((a, -c, b), (roll, NONE, NONE))
        if i == 0:  # The base is not turned.
            pose = Pose((a, b, c), (roll - 90, NONE, NONE))
        links.append(replace(link, body=body, pose=pose, axis=(0.0, -1.0, 0.0)))
    return replace(robot, links=tuple(links))
