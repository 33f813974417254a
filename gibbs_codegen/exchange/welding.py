"""One body for each moving link, of which links behind fixed joints become parts.

Composites are computed here in plain numbers. Readers of other programs are not relied on: MuJoCo
up to 3.3.7 welds rotated bodies wrongly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gibbs_codegen.exchange.names import Namer
from gibbs_codegen.exchange.placement import HERE, Array, Placement, vector
from gibbs_codegen.exchange.source import Inertial, SourceJoint, Told, quiet, quiet_inertia
from gibbs_codegen.exchange.tree import SourceTree
from gibbs_codegen.robot.model import (
    BASE,
    MAX_FRAMES,
    MAX_LINKS,
    MAX_ROTORS,
    Attitude,
    Base,
    Frame,
    Link,
    RigidBody,
    Robot,
    Rotor,
)
from gibbs_codegen.robot.rigid_body import inertia_fault


@dataclass(eq=False)
class _Body:
    """A body of the robot: what moves it, and its parts with their frames in its own."""

    number: int
    name: str
    parent: int = BASE
    joint: SourceJoint | None = None
    pose: Placement = HERE
    parts: list[tuple[Inertial, Placement]] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class _Place:
    """Where a link of the source is: the number of its body, and its frame in the body's."""

    body: int
    frame: Placement


def welded(tree: SourceTree, name: str, attitude: Attitude, snap: bool) -> tuple[Robot, list[Told]]:
    """The robot of a tree whose joints are revolute, prismatic or fixed, and what was done.

    `snap` is whether to set noise to zero. Raises `SourceFileError` if there are more links or
    rotors than a robot may have.
    """
    bodies, places, told = _bodies(tree)
    source = tree.source
    if len(bodies) - 1 > MAX_LINKS or len(source.rotors) > MAX_ROTORS:
        raise source.refused(
            f"{len(bodies) - 1} moving links and {len(source.rotors)} rotors; at most {MAX_LINKS} "
            f"and {MAX_ROTORS} are possible. --lock holds joints fast"
        )
    namer = Namer()
    links = tuple(_link(body, snap, namer) for body in bodies[1:])
    found = _frames(tree, places, bodies)
    frames = tuple(
        Frame(namer.frame(name), place.body, _placed(place.frame, snap).pose)
        for name, place in found[:MAX_FRAMES]
    )
    robot = Robot(
        name,
        Base(attitude=attitude, origin="base", body=_rigid(bodies[0].parts, snap)),
        links,
        source.gravity,
        _rotors(tree, places, snap, namer),
        frames,
    )
    told += namer.told
    told += [
        Told("snapped", body.name, "rounding in its centre of mass or inertia set to 0")
        for body in bodies
        if snap and _rigid(body.parts, snap) != _rigid(body.parts, False)
    ]
    told += [Told("left out", name, "one frame too many") for name, _ in found[MAX_FRAMES:]]
    impossible = [
        body.name
        for body, made in zip(
            bodies, [robot.base.body, *(link.body for link in links)], strict=True
        )
        if isinstance(made, RigidBody) and inertia_fault(made.mass, made.inertia)
    ]
    told += [Told("note", found, "has an inertia that no body has") for found in impossible]
    return replace(robot, allow_impossible_inertia=bool(impossible)), told


def _bodies(tree: SourceTree) -> tuple[list[_Body], dict[str, _Place], list[Told]]:
    """Bodies in the order of the tree, each arm to its end before the next, and where links are."""
    below: dict[str, list[SourceJoint]] = {}
    for joint in tree.source.joints:
        below.setdefault(joint.parent, []).append(joint)
    bodies = [_Body(BASE, tree.root)]
    places = {tree.root: _Place(BASE, HERE)}
    told = [Told("base", tree.root, "the flying base")]
    bodies[BASE].parts.append((tree.source.links[tree.root].inertial, HERE))
    left = below.get(tree.root, [])[::-1]
    while left:
        joint = left.pop()
        carrier = places[joint.parent]
        frame = carrier.frame @ joint.pose
        if joint.kind == "fixed":
            place = _Place(carrier.body, frame @ joint.offset)
            told.append(Told("welded", joint.child, f"to {bodies[carrier.body].name}"))
        else:
            place = _Place(len(bodies), joint.offset)
            bodies.append(_Body(place.body, joint.child, carrier.body, joint, frame))
        places[joint.child] = place
        bodies[place.body].parts.append((tree.source.links[joint.child].inertial, place.frame))
        left += below.get(joint.child, [])[::-1]
    return bodies, places, told


def _rigid(parts: Sequence[tuple[Inertial, Placement]], snap: bool) -> RigidBody:
    """The composite of parts, in the axes of their body."""
    placed = [(part, frame @ part.pose) for part, frame in parts if _weighs(part)]
    mass = float(sum(part.mass for part, _ in placed))
    coms = [np.array(frame.xyz) for _, frame in placed]
    com: Array = np.zeros(3)
    if len(placed) == 1:
        (com,) = coms
    elif mass:
        com = np.array([part.mass for part, _ in placed]) @ np.array(coms) / mass
    inertia = np.zeros((3, 3))
    for (part, frame), place in zip(placed, coms, strict=True):
        level = not any(frame.rpy_deg)
        own = part.inertia if level else frame.matrix @ part.inertia @ frame.matrix.T
        arm = place - com
        inertia = inertia + own + part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    if mass == 0.0:
        com = np.zeros(3)
    if snap:
        com, inertia = np.array(quiet(vector(com))), quiet_inertia(inertia)
    xx, xy, xz, _, yy, yz, _, _, zz = (float(entry) + 0.0 for entry in inertia.ravel())
    return RigidBody(0.0, mass, vector(com), (xx, yy, zz, xy, xz, yz))


def _weighs(part: Inertial) -> bool:
    return part.mass != 0.0 or bool(part.inertia.any())


def _link(body: _Body, snap: bool, namer: Namer) -> Link:
    """The link that a body becomes, which is not the base; `snap` as of `welded`."""
    joint = body.joint
    assert joint is not None  # noqa: S101 - only the base has none
    return Link(
        _rigid(body.parts, snap),
        joint="prismatic" if joint.kind == "prismatic" else "revolute",
        parent=None if body.parent == body.number - 1 else body.parent,
        pose=_placed(body.pose, snap).pose,
        axis=joint.axis,
        name=namer.body(body.name, "link"),
        coordinate=namer.coordinate(joint.name),
        passive=joint.passive,
        limits=joint.limits,
    )


def _rotors(
    tree: SourceTree, places: dict[str, _Place], snap: bool, namer: Namer
) -> tuple[Rotor, ...]:
    """The rotors on bodies, in the order of the source; `places` are those of the tree's links.

    Raises `SourceFileError` if a rotor is on no link of the tree.
    """
    rotors = []
    for rotor in tree.source.rotors:
        if (place := places.get(rotor.on)) is None:
            raise tree.source.refused(f"rotor {rotor.name} is on link {rotor.on}, which is missing")
        direction = vector(place.frame.matrix @ np.array(rotor.direction))
        position = vector(place.frame.point(rotor.position))
        rotors.append(
            Rotor(
                quiet(position) if snap else position,
                quiet(direction) if snap else direction,
                rotor.drag,
                place.body,
                namer.body(rotor.name, "rotor"),
                rotor.limits,
                rotor.time_constant,
            )
        )
    return tuple(rotors)


def _frames(
    tree: SourceTree, places: dict[str, _Place], bodies: list[_Body]
) -> list[tuple[str, _Place]]:
    """Frames of links that were welded or are not where their joint is, and those of the source."""
    own = {body.name for body in bodies}
    found = [
        (name, place)
        for name, place in places.items()
        if name not in own or not place.frame.is_identity
    ]
    for frame in tree.source.frames:
        if (place := places.get(frame.on)) is not None:
            found.append((frame.name, _Place(place.body, place.frame @ frame.pose)))
    return found


def _placed(pose: Placement, snap: bool) -> Placement:
    return Placement(quiet(pose.xyz), pose.rpy_deg) if snap else pose
