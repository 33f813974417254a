"""Bodies of a robot by the joints that carry them: links that are welded belong to others.

Which joints count is a choice: the reduced system has those that move, the hybrid one also those
that constraint torques hold. All other links are welded to the nearest one on the way to the base
that has a joint, or to the base.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import sympy as sp

from gibbs_codegen.derivation.inertia import NO_INERTIA, Inertia, total
from gibbs_codegen.derivation.link_frames import (
    BodyFrame,
    DenavitHartenberg,
    PlacedLink,
    framed,
)
from gibbs_codegen.derivation.parameters import LinkSymbols, Parameters
from gibbs_codegen.derivation.tree_builder import JointedLink
from gibbs_codegen.robot.model import BASE, Link, Robot
from gibbs_codegen.robot.names import identifier
from gibbs_codegen.symbolic.structural import turned_by_rpy
from gibbs_codegen.symbolic.tape import Scalars, Stage
from gibbs_codegen.symbolic.vectors import Vector


@dataclass(frozen=True)
class JointedBodies:
    """Links with joints, and what is welded to them.

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
) -> JointedBodies:
    """Bodies by the joints that carry them.

    `centre` is the base centre from the origin of the coordinates, in the base's axes; a coordinate
    is zero where the joint is held. `links` are the numbers of the links that there are, `massive`
    of those whose mass counts.
    """
    robot = parameters.robot
    # Each body's frame in the frame that the file gives the link which it belongs to.
    mounts = {BASE: BodyFrame(0)}
    numbers: list[int] = []
    placed: list[PlacedLink] = []
    belonging: list[list[Inertia]] = [[]]
    for i in sorted(links):
        link, symbols = robot.links[i - 1], parameters.link(i)
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
        replace(link, inertia=_together(tape, link.name, parts))
        for link, parts in zip(placed, belonging[1:], strict=True)
    ]
    base = BodyFrame(0, origin=centre)
    jointed, frames = framed(tape, heavy, base)
    with tape.group("places of links that are welded on", Stage.PARAMETER):
        bodies = {i: mount.within(tape, frames[mount.segment]) for i, mount in mounts.items()}
        on_base = [base.inertia(tape, part) for part in belonging[0]]
    return JointedBodies(
        tuple(numbers), tuple(jointed), bodies, _together(tape, "the base", on_base)
    )


def label(robot: Robot, i: int) -> str:
    """What comments call link i, from 1: its name as an identifier, or "link 2"."""
    name = robot.links[i - 1].name
    return identifier(name) if name else f"link {i}"


def _together(tape: Scalars, name: str, parts: list[Inertia]) -> Inertia:
    """Inertia about its joint, in its frame, of a link and of what is welded to it."""
    if len(parts) == 1:
        return parts[0]
    with tape.group(f"inertia of {name}, with what is welded to it", Stage.PARAMETER):
        return total(tape, parts) if parts else NO_INERTIA


def _placed(
    tape: Scalars,
    robot: Robot,
    i: int,
    symbols: LinkSymbols,
    mount: BodyFrame,
    coordinate: sp.Expr,
) -> PlacedLink:
    """Link i on the segment that carries it, without inertia.

    `mount` is the frame of the body that it is on, in the file's frame of the segment's link.
    """
    link = robot.links[i - 1]
    given = None
    if link.pose is None and mount == BodyFrame(mount.segment):
        given = DenavitHartenberg(link.alpha_deg, symbols.a, symbols.d, link.theta_deg)
    with tape.group("angles and places of the joints", Stage.PARAMETER):
        pose = _pose(link, symbols).within(tape, mount)
    name = link.name
    return PlacedLink(
        parent=mount.segment,
        inertia=NO_INERTIA,
        joint="prismatic" if link.joint == "prismatic" else "revolute",
        coordinate=coordinate,
        turn=pose.turn,
        step=pose.origin,
        axis=link.axis,
        parameters=given,
        name=label(robot, i),
        joint_name=f"the joint of {identifier(name)}" if name else f"joint {robot.rotors + i}",
    )


def _pose(link: Link, symbols: LinkSymbols) -> BodyFrame:
    """Where a link's frame is in that of the body that carries it, the joint at zero."""
    if link.pose is not None:
        return BodyFrame(0, turned_by_rpy(link.pose.rpy_deg), symbols.position)
    given = DenavitHartenberg(link.alpha_deg, symbols.a, symbols.d, link.theta_deg)
    return BodyFrame(0, given.turn, given.step)
