"""One body for each moving link, of which links behind fixed joints become parts.

Composites are computed here in plain numbers. Readers of other programs are not relied on: MuJoCo
up to 3.3.7 welds rotated bodies wrongly.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gibbs_codegen.errors import near
from gibbs_codegen.exchange.placement import HERE, Placement, vector
from gibbs_codegen.exchange.sources import (
    WORLD,
    Finding,
    Inertial,
    Joint,
    Source,
    quiet,
    quiet_inertia,
)
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import CONSTRAINT_TORQUES, identifier
from gibbs_codegen.robot.parts.base import Attitude, Base
from gibbs_codegen.robot.parts.body import RigidBody, inertia_fault
from gibbs_codegen.robot.parts.constraint import (
    MAX_CONSTRAINTS,
    Constraint,
    ConstraintKind,
    LoopJoint,
)
from gibbs_codegen.robot.parts.frame import MAX_FRAMES, Frame
from gibbs_codegen.robot.parts.link import MAX_LINKS, Link
from gibbs_codegen.robot.parts.numbers import BASE, LONGEST_LABEL
from gibbs_codegen.robot.parts.part import taken
from gibbs_codegen.robot.parts.pose import Pose
from gibbs_codegen.robot.parts.rotor import MAX_ROTORS, Rotor
from gibbs_codegen.robot.placement import Array
from gibbs_codegen.robot.references import NamedKind, NameRegistry


@dataclass(eq=False)
class _Body:
    """A body of the robot: what moves it, and its parts with their frames in its own."""

    number: int
    name: str
    parent: int = BASE
    joint: Joint | None = None
    pose: Placement = HERE
    parts: list[tuple[Inertial, Placement]] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class _Place:
    """Where a link of the source is: the number of its body, and its frame in the body's."""

    body: int
    frame: Placement


def welded(
    source: Source, name: str, attitude: Attitude, snap: bool
) -> tuple[Robot, list[Finding]]:
    """The robot of a tree whose joints are revolute, prismatic or fixed, and what was done.

    `snap` is whether to set noise to zero. Raises `SourceFileError` if there are more links or
    rotors than a robot may have.
    """
    bodies, places, findings = _bodies(source)
    if len(bodies) - 1 > MAX_LINKS or len(source.rotors) > MAX_ROTORS:
        raise source.refused(
            f"{len(bodies) - 1} moving links and {len(source.rotors)} rotors; at most "
            f"{MAX_LINKS} and {MAX_ROTORS} are possible. --lock holds joints fast"
        )
    namer = Namer()
    rigid = [composite(body.parts, snap) for body in bodies]
    links = []
    for body, own in zip(bodies[1:], rigid[1:], strict=True):
        joint = body.joint
        assert joint is not None  # noqa: S101 - only the base has none
        link = Link(
            own,
            joint="prismatic" if joint.kind == "prismatic" else "revolute",
            parent=None if body.parent == body.number - 1 else body.parent,
            pose=quiet_placement(body.pose, snap).pose,
            axis=joint.axis,
            name=namer.free(body.name, "link"),
            coordinate=namer.free(joint.name, "joint"),
            passive=joint.passive,
            limits=joint.limits,
            friction=joint.friction,
        )
        links.append(link)
    # Frames of links that were welded or are not where their joint is, and those of the source.
    names = {body.name for body in bodies}
    found = [
        (name, place)
        for name, place in places.items()
        if name not in names or not place.frame.is_identity
    ]
    for frame in source.frames:
        if (seat := places.get(frame.on)) is not None:
            found.append((frame.name, _Place(seat.body, seat.frame @ frame.pose)))
    frames = tuple(
        Frame(namer.free(name, "frame"), place.body, quiet_placement(place.frame, snap).pose)
        for name, place in found[:MAX_FRAMES]
    )
    constraints, frames, lost = _constraints(source, places, frames, snap, namer)
    findings += lost
    robot = Robot(
        name,
        Base(attitude=attitude, origin="base", body=rigid[0]),
        tuple(links),
        source.gravity,
        _rotors(source, places, snap, namer),
        frames,
        constraints=constraints,
    )
    findings += namer.findings
    findings += [
        Finding("snapped", body.name, "rounding in its centre of mass or inertia set to 0")
        for body, own in zip(bodies, rigid, strict=True)
        if snap and own != composite(body.parts, False)
    ]
    findings += [Finding("left out", name, "one frame too many") for name, _ in found[MAX_FRAMES:]]
    impossible = [
        body.name
        for body, own in zip(bodies, rigid, strict=True)
        if inertia_fault(own.mass, own.inertia)
    ]
    findings += [Finding("note", found, "has an inertia that no body has") for found in impossible]
    return replace(robot, allow_impossible_inertia=bool(impossible)), findings


def _bodies(source: Source) -> tuple[list[_Body], dict[str, _Place], list[Finding]]:
    """Bodies in the order of the tree, each arm to its end before the next, and where links are."""
    bodies = [_Body(BASE, source.root)]
    places = {source.root: _Place(BASE, HERE)}
    findings = [Finding("base", source.root, "the flying base")]
    bodies[BASE].parts.append((source.links[source.root].inertial, HERE))
    left = source.below[source.root][::-1]
    while left:
        joint = left.pop()
        carrier = places[joint.parent]
        frame = carrier.frame @ joint.pose
        if joint.kind == "fixed":
            place = _Place(carrier.body, frame @ joint.offset)
            findings.append(Finding("welded", joint.child, f"to {bodies[carrier.body].name}"))
        else:
            place = _Place(len(bodies), joint.offset)
            bodies.append(_Body(place.body, joint.child, carrier.body, joint, frame))
        places[joint.child] = place
        bodies[place.body].parts.append((source.links[joint.child].inertial, place.frame))
        left += source.below[joint.child][::-1]
    return bodies, places, findings


def composite(parts: Sequence[tuple[Inertial, Placement]], snap: bool) -> RigidBody:
    """The composite of parts, in the axes of their body."""
    placed = [(part, frame @ part.pose) for part, frame in parts if part.weighs]
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


def _rotors(
    source: Source, places: dict[str, _Place], snap: bool, namer: Namer
) -> tuple[Rotor, ...]:
    """The rotors on bodies, in the order of the source; `places` are those of the tree's links.

    Raises `SourceFileError` if a rotor is on no link of the tree.
    """
    rotors = []
    for rotor in source.rotors:
        if (place := places.get(rotor.link)) is None:
            words = f"rotor {rotor.name} is on link {rotor.link}, which is missing"
            raise source.refused(words + near(rotor.link, places), rotor.line)
        direction = vector(place.frame.matrix @ np.array(rotor.direction))
        position = vector(place.frame.point(rotor.position))
        rotors.append(
            replace(
                taken(Rotor, rotor),
                position=quiet(position) if snap else position,
                direction=quiet(direction) if snap else direction,
                on=place.body,
                name=namer.free(rotor.name, "rotor"),
            )
        )
    return tuple(rotors)


_KINDS: dict[str, tuple[ConstraintKind, LoopJoint]] = {
    "point": ("point", "spherical"),
    "frame": ("frame", "fixed"),
    "hinge": ("loop", "revolute"),
}


def _constraints(
    source: Source,
    places: dict[str, _Place],
    frames: tuple[Frame, ...],
    snap: bool,
    namer: Namer,
) -> tuple[tuple[Constraint, ...], tuple[Frame, ...], list[Finding]]:
    """The constraints, the frames with those that they need, and what was left out."""
    found: list[Constraint] = []
    made, lost = [*frames], []
    for each in source.constraints:
        bodies = [places[frame.on].body for frame in each.frames if frame.on != WORLD]
        reason = ""
        if not bodies or (len(bodies) == 2 and bodies[0] == bodies[1]):
            reason = "a constraint of one body, or the world, with itself"
        elif len(bodies) == 1 and each.holds == "hinge":
            reason = "a hinge to the world; hold two points of its axis instead"
        elif len(found) == MAX_CONSTRAINTS or len(made) + len(bodies) > MAX_FRAMES:
            reason = "one constraint, or frame for it, too many"
        if reason:
            lost.append(Finding("left out", each.name, reason))
            continue
        names: list[str] = []
        for frame in each.frames[: len(bodies)]:
            seat = places[frame.on]
            pose = quiet_placement(seat.frame @ frame.pose, snap).pose
            same = [old.name for old in made if (old.on, old.pose) == (seat.body, pose)]
            if (seat.body, pose) == (BASE, Pose()):
                same = ["base"]
            if not same:
                made.append(Frame(namer.free(frame.name, "frame"), seat.body, pose))
            names += same[:1] or [made[-1].name]
        alone, between = _KINDS[each.holds]
        label = namer.free(each.name, "constraint")
        if len(names) == 1:
            anchor = quiet_placement(each.to.pose, snap).pose
            anchor = anchor if each.holds == "frame" else Pose(anchor.xyz)
            found.append(Constraint(label, alone, names[0], None, **vars(anchor)))
        else:
            loop = Constraint(label, "loop", names[0], names[1], joint=between, axis=each.axis)
            found.append(loop)
        what = f"{each.holds} of {names[0]} held to {(*names, 'the world')[1]}"
        lost.append(Finding("constraint", label, what))
    return tuple(found), tuple(made), lost


def quiet_placement(pose: Placement, snap: bool) -> Placement:
    """The placement, with noise in its origin set to zero if so asked."""
    return Placement(quiet(pose.xyz), pose.rpy_deg) if snap else pose


class Namer:
    """Hands out names and remembers them; `findings` says which had to be changed."""

    def __init__(self) -> None:
        self.findings: list[Finding] = []
        self._registry = NameRegistry()
        # How many names each form has been made into, so that thousands of one form take no longer.
        self._made: dict[tuple[str, str], int] = {}

    def free(self, name: str, what: NamedKind) -> str:
        """The name in the source, as long as it may be, or the name and a word or number."""
        stem = name or what
        if what == "joint" and identifier(stem).startswith(CONSTRAINT_TORQUES):
            stem = f"joint_{stem}"
        stem = stem[:LONGEST_LABEL]
        form = (what, identifier(stem))
        for number in itertools.count(self._made.get(form, 0)):
            ending = f"_{number if number > 1 else what}" if number else ""
            free = stem[: LONGEST_LABEL - len(ending)] + ending
            if not self._registry.fault(what, free):
                break
        self._made[form] = number + 1
        self._registry.add(what, free, what)
        if free != name:
            self.findings.append(Finding("note", name or "without a name", f"{what} called {free}"))
        return free
