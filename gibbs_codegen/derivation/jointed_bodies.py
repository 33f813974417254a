"""Bodies of a robot by the joints that carry them, and the frames that they are derived in.

Which joints count is a choice: the reduced system has those that move, the hybrid one also those
that constraint torques hold. All other links are welded to the nearest one on the way to the base
that has a joint, or to the base.

A robot file places a link's joint anywhere on its parent, and its axis anywhere in the link. How
one joint axis lies against the one before is a turn γ about the parent's axis, a step, and a twist
α about x; what is left, a turn β about the link's own axis, adds to the joint's angle:

    R = R_z(γ)·R_x(α)·R_z(β)

A link's frame may be turned about its axis, which makes γ of its first child zero, and slid along
it, which makes one component of the step zero: so an arm that a file gives by poses costs what it
costs by Denavit–Hartenberg parameters.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import sympy as sp

from gibbs_codegen.derivation.inertia import NO_INERTIA, Inertia, about_z, total
from gibbs_codegen.derivation.parameters import LinkSymbols, Parameters
from gibbs_codegen.derivation.segment_tree import JointedLink
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import identifier
from gibbs_codegen.robot.parts.base import TRAVELS, TURNS
from gibbs_codegen.robot.parts.link import Link
from gibbs_codegen.robot.parts.numbers import AXES, BASE, Vector3
from gibbs_codegen.symbolic.structural import (
    NO_TURN,
    Turn,
    applied,
    back,
    elementary,
    euler_zxz,
    product,
    turn_about,
    turned_by_rpy,
    z_onto,
)
from gibbs_codegen.symbolic.tape import Scalars, Stage, Vector
from gibbs_codegen.symbolic.vectors import ZERO, Rotation, X, Z, axis_vector, cos_sin_deg

# Sliding along an axis that is nearly parallel to the one before would go very far.
_LEAST_SINE = 0.1


@dataclass(frozen=True)
class BodyFrame:
    """Pose, in a segment's own frame, of the frame that the robot file gives a body."""

    segment: int
    turn: Turn = NO_TURN
    origin: Vector = ZERO

    def direction(self, vector: Vector) -> Vector:
        """A direction of the body, in the segment's own frame."""
        return vector if self.turn == NO_TURN else applied(self.turn, vector)

    def point(self, tape: Scalars, vector: Vector) -> Vector:
        """A point of the body, from the segment's joint in its own frame (m), named on the tape."""
        x, y, z = self.direction(vector)
        a, b, c = self.origin
        return (tape.let(a + x), tape.let(b + y), tape.let(c + z))

    def inertia(self, tape: Scalars, inertia: Inertia) -> Inertia:
        """An inertia about the origin of the body's frame, about the joint in the segment's own."""
        for rotation in elementary(self.turn):
            inertia = inertia.rotated(tape, rotation)
        return inertia.shifted(tape, self.origin)

    def within(self, tape: Scalars, outer: BodyFrame) -> BodyFrame:
        """The frame, given in `outer`, as seen in what `outer` lies in."""
        turn = product(outer.turn, self.turn)
        return BodyFrame(outer.segment, turn, outer.point(tape, self.origin))


@dataclass(frozen=True)
class PlacedLink:
    """A link in symbols, where the robot file places it.

    `pose` is that of the joint in the parent's frame, and `axis` that of the joint in the link's.
    `link` has its inertia about the joint, in the link's frame; if Denavit–Hartenberg parameters
    place it on a segment, `by_parameters`, it has these as well, and keeps the file's frame where
    its parent does.
    """

    link: JointedLink
    pose: BodyFrame
    axis: Vector3
    by_parameters: bool


def framed(
    tape: Scalars, links: Sequence[PlacedLink], base: BodyFrame
) -> tuple[list[JointedLink], list[BodyFrame]]:
    """Choose the frames that links are derived in; every parent stands before its children.

    `base` says where the robot file's frame of the base is in that of the root segment. The second
    list says for the base and each link where the robot file's frame is.
    """
    frames = [base]
    jointed = []
    for k, (placed, turn) in enumerate(zip(links, _turns(links, base), strict=True), start=1):
        link, parent, frame = placed.link, frames[placed.link.parent], BodyFrame(k)
        if turn is None:  # The parent's frame is not turned either.
            x, y, z = parent.origin
            link = replace(link, step=(link.step[0] + x, y, z))
        else:
            with tape.group("angles and places of the joints", Stage.PARAMETER):
                gamma, alpha, beta = euler_zxz(
                    product(parent.turn, product(placed.pose.turn, turn))
                )
                x, y, z = applied(turn_about(Z, -gamma), parent.point(tape, placed.pose.origin))
                cos, sin = cos_sin_deg(alpha)
                slide = sp.S.Zero
                if sin == 0:
                    slide, z = -cos * z, sp.S.Zero
                elif y != 0 and abs(sin) > _LEAST_SINE:
                    slide, y, z = y / sin, sp.S.Zero, z + y * cos / sin
                frame = BodyFrame(k, back(turn), axis_vector(Z, -tape.let(slide)))
                link = replace(
                    link,
                    inertia=frame.inertia(tape, link.inertia),
                    turn_deg=gamma,
                    step=(x, y, z),
                    d=sp.S.Zero,
                    alpha_deg=alpha,
                    theta_deg=beta,
                )
        jointed.append(link)
        frames.append(frame)
    return jointed, frames


def _turns(links: Sequence[PlacedLink], base: BodyFrame) -> list[Turn | None]:
    """For each link its own axes in the robot file's, or None where it keeps the file's frame."""
    kept = [base.turn == NO_TURN]
    for placed in links:
        kept.append(placed.by_parameters and kept[placed.link.parent])
    turns: list[Turn | None] = []
    for k, placed in enumerate(links, start=1):
        if kept[k]:
            turns.append(None)
            continue
        turn = z_onto(placed.axis)
        first = next((child for child in links[k:] if child.link.parent == k), None)
        if first is not None:
            gamma, alpha, _ = euler_zxz(
                product(back(turn), product(first.pose.turn, z_onto(first.axis)))
            )
            if alpha % 180 == 0:
                x, y, _ = applied(back(turn), first.pose.origin)
                gamma = Fraction(90 if x == 0 and y != 0 else 0)
            turn = product(turn, turn_about(Z, gamma))
        turns.append(turn)
    return turns


@dataclass(frozen=True)
class JointedBodies:
    """Links with joints, and the links welded to them.

    Link `numbers[k − 1]` is segment k. `frames` says for the base, number 0, and every link where
    the frame is that the robot file gives it. `on_base` is what is welded to the base, about the
    origin of the coordinates, in the base's axes.
    """

    numbers: tuple[int, ...]
    links: tuple[JointedLink, ...]
    frames: dict[int, BodyFrame]
    on_base: Inertia


def jointed_bodies(
    tape: Scalars,
    parameters: Parameters,
    centre: Vector,
    coordinates: Mapping[int, sp.Expr],
    links: Collection[int],
    massive: Collection[int],
    core: Inertia,
) -> JointedBodies:
    """Bodies by the joints that carry them.

    `centre` is the base centre from the origin of the coordinates, in the base's axes; a coordinate
    is zero where the joint is held. `links` are the numbers of the links that there are, `massive`
    of those whose mass counts. `core` is the inertia of the base in its frame, if it is not the
    root itself: virtual links, −1, −2 …, or the root alone carry it in its pose.
    """
    robot = parameters.robot
    # Each body's frame in the frame that the file gives the link which it belongs to.
    mounts = {BASE: BodyFrame(0)}
    numbers: list[int] = []
    placed: list[PlacedLink] = []
    belonging: list[list[Inertia]] = [[]]
    for k, motion in enumerate(robot.base.virtual_joints):
        placed.append(_virtual(k, motion, coordinates[-1 - k]))
        numbers.append(-1 - k)
        belonging.append([])
    base = BodyFrame(0, origin=centre)
    if not robot.base.moves_freely:
        turn = turned_by_rpy(robot.base.pose.rpy_deg)
        base = BodyFrame(len(numbers), turn)
        if numbers:
            mounts[BASE], base = base, mounts[BASE]
        with tape.group("inertia of the base, where it is", Stage.PARAMETER):
            belonging[-1].append(mounts[BASE].inertia(tape, core))
    for i in sorted(links):
        link, symbols = robot.links[i - 1], parameters.links[i]
        mount = mounts[robot.parents[i - 1]]
        inertia = symbols.body.inertia if i in massive else NO_INERTIA
        if i in coordinates:
            numbers.append(i)
            placed.append(_placed(tape, robot, i, symbols, mount, coordinates[i]))
            mounts[i] = BodyFrame(len(numbers))
            belonging.append([inertia])
        else:
            with tape.group(f"place and inertia of {label(robot, i)}", Stage.PARAMETER):
                mounts[i] = _pose(link, symbols).within(tape, mount)
                belonging[mount.segment].append(mounts[i].inertia(tape, inertia))
    heavy = [
        replace(joint, link=replace(link, inertia=_inertia_with_welded(tape, link.name, parts)))
        for joint, parts in zip(placed, belonging[1:], strict=True)
        for link in [joint.link]
    ]
    jointed, frames = framed(tape, heavy, base)
    with tape.group("places of links that are welded on", Stage.PARAMETER):
        bodies = {i: mount.within(tape, frames[mount.segment]) for i, mount in mounts.items()}
        on_base = [base.inertia(tape, part) for part in belonging[0]]
    for k, i in enumerate(numbers):
        if (geared := parameters.links[i].geared) == 0 or i not in massive:
            continue
        turned = jointed[k]
        with tape.group("inertias of rotors behind gears", Stage.PARAMETER):
            jointed[k] = replace(turned, inertia=turned.inertia.plus(tape, about_z(geared)))
            opposite = about_z(-geared)
            for axis, degrees in ((X, turned.alpha_deg), (Z, turned.turn_deg)):
                opposite = opposite.rotated(tape, Rotation.degrees(axis, degrees))
            if turned.parent:
                carrier = jointed[turned.parent - 1]
                carrier = replace(carrier, inertia=carrier.inertia.plus(tape, opposite))
                jointed[turned.parent - 1] = carrier
            else:
                on_base.append(opposite)
    return JointedBodies(
        tuple(numbers), tuple(jointed), bodies, _inertia_with_welded(tape, "the base", on_base)
    )


def _virtual(parent: int, motion: str, coordinate: sp.Expr) -> PlacedLink:
    """A link without length and mass that moves the base along or about an axis of the world."""
    link = JointedLink(
        parent=parent,
        inertia=NO_INERTIA,
        joint="prismatic" if motion in TRAVELS else "revolute",
        coordinate=coordinate,
        name=f"the virtual link of {motion}",
        joint_name=motion,
    )
    return PlacedLink(link, BodyFrame(parent), AXES["xyz"[(TRAVELS | TURNS)[motion]]], False)


def label(robot: Robot, i: int) -> str:
    """Name of link i, from 1, in comments: its name as an identifier, or "link 2"."""
    name = robot.links[i - 1].name
    return identifier(name) if name else f"link {i}"


def _inertia_with_welded(tape: Scalars, name: str, parts: list[Inertia]) -> Inertia:
    """Inertia about its joint, in its frame, of a link and of links welded to it."""
    if len(parts) == 1:
        return parts[0]
    with tape.group(f"inertia of {name}, with what is welded to it", Stage.PARAMETER):
        return total(tape, parts) if parts else NO_INERTIA


def _placed(
    tape: Scalars, robot: Robot, i: int, symbols: LinkSymbols, mount: BodyFrame, coordinate: sp.Expr
) -> PlacedLink:
    """Link i on the segment that carries it, without inertia.

    `mount` is the frame of the body that it is on, in the file's frame of the segment's link.
    """
    link = robot.links[i - 1]
    with tape.group("angles and places of the joints", Stage.PARAMETER):
        pose = _pose(link, symbols).within(tape, mount)
    name = link.name
    made = JointedLink(
        parent=mount.segment,
        inertia=NO_INERTIA,
        joint="prismatic" if link.joint == "prismatic" else "revolute",
        coordinate=coordinate,
        name=label(robot, i),
        joint_name=f"the joint of {identifier(name)}" if name else f"joint {robot.rotors + i}",
    )
    by_parameters = link.pose is None and mount == BodyFrame(mount.segment)
    if by_parameters:
        made = replace(
            made,
            step=(symbols.a, sp.S.Zero, sp.S.Zero),
            alpha_deg=link.alpha_deg,
            d=symbols.d,
            theta_deg=link.theta_deg,
        )
    return PlacedLink(made, pose, link.axis, by_parameters)


def _pose(link: Link, symbols: LinkSymbols) -> BodyFrame:
    """Pose of a link's frame in that of the body that carries it, the joint at zero."""
    if link.pose is not None:
        return BodyFrame(0, turned_by_rpy(link.pose.rpy_deg), symbols.position)
    cos, sin = cos_sin_deg(link.alpha_deg)
    turn = product(turn_about(X, link.alpha_deg), turn_about(Z, link.theta_deg))
    return BodyFrame(0, turn, (symbols.a, -sin * symbols.d, cos * symbols.d))
