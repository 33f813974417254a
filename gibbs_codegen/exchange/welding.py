"""One body for each moving link, of which links behind fixed joints become parts.

Composites are computed here in plain numbers. Readers of other programs are not relied on: MuJoCo
up to 3.3.7 welds rotated bodies wrongly.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gibbs_codegen.errors import near
from gibbs_codegen.exchange.sources import (
    WORLD,
    Finding,
    Source,
    SourceFrame,
    SourceJoint,
    quiet,
    quiet_inertia,
    quiet_pose,
)
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import CONSTRAINT_TORQUES, identifier
from gibbs_codegen.robot.parts.base import FIXED, FREE, Attitude, Base, shown_motion
from gibbs_codegen.robot.parts.body import RigidBody, entries_of, inertia_fault, inertia_matrix
from gibbs_codegen.robot.parts.constraint import Constraint, ConstraintKind
from gibbs_codegen.robot.parts.frame import MAX_FRAMES, Frame
from gibbs_codegen.robot.parts.gear import Gear, gear_terms
from gibbs_codegen.robot.parts.link import MAX_LINKS, JointLimits
from gibbs_codegen.robot.parts.numbers import BASE, LEVEL, LONGEST_LABEL
from gibbs_codegen.robot.parts.part import taken
from gibbs_codegen.robot.parts.pose import HERE, Pose, vector
from gibbs_codegen.robot.parts.rotor import MAX_ROTORS, Rotor
from gibbs_codegen.robot.references import NamedKind, NameRegistry
from gibbs_codegen.robot.rotations import Array


@dataclass(eq=False)
class _Body:
    """A body of the robot: what moves it, and its parts with their frames in its own."""

    number: int
    name: str
    parent: int = BASE
    joint: SourceJoint | None = None
    pose: Pose = HERE
    parts: list[tuple[RigidBody, Pose]] = field(default_factory=list)


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
    links, moved = [], {body.joint.name: body for body in bodies if body.joint}

    def ratios_of(name: str) -> Mapping[str, float]:
        joint = moved[name].joint if name in moved else None
        return joint.gear.ratios if joint and joint.gear else {}

    def follows(joint: SourceJoint) -> bool:
        """True if a joint has a gear that leads to joints that move, and not back to itself."""
        ratios = ratios_of(joint.name)
        way = [*ratios]
        for mover in way:  # It grows meanwhile.
            way += [x for x in ratios_of(mover) if x not in way]
        return all(ratios.values()) and {*ratios} <= {*moved} and joint.name not in way

    for body, whole in zip(bodies[1:], rigid[1:], strict=True):
        joint = body.joint
        assert joint is not None  # noqa: S101 - only the base has none
        link = replace(
            joint.link,
            body=whole,
            joint="prismatic" if joint.kind == "prismatic" else "revolute",
            parent=None if body.parent == body.number - 1 else body.parent,
            pose=quiet_pose(body.pose, snap),
            name=namer.free(body.name, "link"),
            coordinate=namer.free(joint.name, "joint"),
        )
        if motor := link.motor:
            words = f"turns {motor.gear_ratio:.6g} times for each turn of the joint, its rotor with"
            words += f" {motor.rotor_inertia:.6g} kg m²"
            findings.append(Finding("motor", joint.name, words))
        if joint.gear:
            movers = joint.gear.words
            if follows(joint):
                gear = Gear.by(
                    {moved[mover].number: x for mover, x in joint.gear.ratios.items()},
                    joint.gear.offset,
                )
                findings.append(
                    Finding("gear", joint.name, f"moved by {movers}: {gear_terms(*joint.gear)}")
                )
                keys = ("limits", "servo", "friction")
                if idle := [x for x in keys if getattr(link, x) not in (None, JointLimits())]:
                    words = f"{' and '.join(idle)} of a joint that another moves"
                    findings.append(Finding("left out", joint.name, words))
                link = replace(link, gear=gear, limits=JointLimits(), coordinate=None)
                link = replace(link, servo=None, friction=None)
            else:
                do = "does" if len(joint.gear.ratios) == 1 else "do"
                words = f"its gear to {movers}, which {do} not move it"
                findings.append(Finding("left out", joint.name, words))
        links.append(link)
    # Frames of links that were welded or are not where their joint is, and those of the source.
    names = {body.name for body in bodies}
    seats = [
        place for name, place in places.items() if name not in names or not place.pose.is_identity
    ]
    seats += [_on_body(frame, places) for frame in source.frames if frame.link in places]
    frames = tuple(
        Frame(namer.free(seat.name, "frame"), seat.on, quiet_pose(seat.pose, snap))
        for seat in seats[:MAX_FRAMES]
    )
    constraints, frames, lost = _constraints(source, places, frames, snap, namer)
    base, words = _base(source, rigid[0], attitude, snap)
    findings += [Finding("base", source.root, words), *lost]
    robot = Robot(
        name,
        base,
        tuple(links),
        source.gravity,
        _rotors(source, places, snap, namer),
        frames,
        constraints=constraints,
    )
    findings += namer.findings
    findings += [
        Finding("snapped", body.name, "rounding in its centre of mass or inertia set to 0")
        for body, whole in zip(bodies, rigid, strict=True)
        if snap and whole != composite(body.parts, False)
    ]
    findings += [
        Finding("left out", seat.name, "one frame too many") for seat in seats[MAX_FRAMES:]
    ]
    impossible = [
        body.name
        for body, whole in zip(bodies, rigid, strict=True)
        if inertia_fault(whole.mass, whole.inertia)
    ]
    findings += [
        Finding("note", name, "has an inertia that is physically impossible") for name in impossible
    ]
    return replace(robot, allow_impossible_inertia=bool(impossible)), findings


def _bodies(source: Source) -> tuple[list[_Body], dict[str, Frame], list[Finding]]:
    """Bodies in the order of the tree, each arm to its end before the next, and frames of links."""
    bodies = [_Body(BASE, source.root)]
    places = {source.root: Frame(source.root)}
    findings = list[Finding]()
    root = source.links[source.root]
    bodies[BASE].parts.append((root.body, root.pose))
    left = source.below[source.root][::-1]
    while left:
        joint = left.pop()
        carrier = places[joint.parent]
        frame = carrier.pose @ joint.pose
        if joint.kind == "fixed":
            place = Frame(joint.child, carrier.on, frame @ joint.offset)
            findings.append(Finding("welded", joint.child, f"to {bodies[carrier.on].name}"))
        else:
            place = Frame(joint.child, len(bodies), joint.offset)
            bodies.append(_Body(place.on, joint.child, carrier.on, joint, frame))
        places[joint.child] = place
        link = source.links[joint.child]
        bodies[place.on].parts.append((link.body, place.pose @ link.pose))
        left += source.below[joint.child][::-1]
    return bodies, places, findings


def _base(source: Source, body: RigidBody, attitude: Attitude, snap: bool) -> tuple[Base, str]:
    """The base with its body, and how it moves in words; without mass and rotors it cannot fly."""
    motion, reason = source.motion, source.reason
    if motion is None and source.joints and not (body.weighs or source.rotors):
        motion, reason = FIXED, "it has no mass"
    if motion in (None, FREE):
        words = "the flying base" if source.rotors else "the base, which moves freely"
        words += "" if source.rotors or motion else "; --base fixed holds it to the world"
        return Base(attitude=attitude, origin="base", body=body), words
    base = Base(
        motion=motion,
        origin="base",
        body=body if body.weighs else None,
        pose=quiet_pose(source.pose, snap),
    )
    return base, f"its motion is {shown_motion(motion)}: {reason}; --base MOTION gives another"


def _on_body(frame: SourceFrame, places: Mapping[str, Frame]) -> Frame:
    """A frame on the body of its link; `places` are those of links."""
    seat = places[frame.link]
    return Frame(frame.name, seat.on, seat.pose @ frame.pose)


def composite(parts: Sequence[tuple[RigidBody, Pose]], snap: bool) -> RigidBody:
    """The composite of bodies at poses in its frame."""
    placed = [(part, frame) for part, frame in parts if part.weighs]
    mass = float(sum(part.mass for part, _ in placed))
    coms = [frame.point(part.com) for part, frame in placed]
    com: Array = np.zeros(3)
    if len(placed) == 1:
        (com,) = coms
    elif mass:
        com = np.array([part.mass for part, _ in placed]) @ np.array(coms) / mass
    inertia = np.zeros((3, 3))
    for (part, frame), place in zip(placed, coms, strict=True):
        turned = inertia_matrix(part.inertia)
        if any(frame.rpy_deg):
            turned = frame.matrix @ turned @ frame.matrix.T
        arm = place - com
        inertia = inertia + turned + part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    if mass == 0.0:
        com = np.zeros(3)
    if snap:
        com, inertia = np.array(quiet(vector(com))), quiet_inertia(inertia)
    return RigidBody(0.0, mass, vector(com), entries_of(inertia))


def _rotors(
    source: Source, places: Mapping[str, Frame], snap: bool, namer: Namer
) -> tuple[Rotor, ...]:
    """The rotors on bodies, in the order of the source; `places` are those of the tree's links.

    Raises `SourceFileError` if a rotor is on no link of the tree.
    """
    rotors = []
    for rotor in source.rotors:
        if (place := places.get(rotor.link)) is None:
            words = f"rotor {rotor.name} is on link {rotor.link}, which is missing"
            raise source.refused(words + near(rotor.link, places), rotor.line)
        direction = vector(place.pose.matrix @ np.array(rotor.direction))
        position = vector(place.pose.point(rotor.position))
        rotors.append(
            replace(
                taken(Rotor, rotor),
                position=quiet(position) if snap else position,
                direction=quiet(direction) if snap else direction,
                on=place.on,
                name=namer.free(rotor.name, "rotor"),
            )
        )
    return tuple(rotors)


def _constraints(
    source: Source,
    places: Mapping[str, Frame],
    frames: tuple[Frame, ...],
    snap: bool,
    namer: Namer,
) -> tuple[tuple[Constraint, ...], tuple[Frame, ...], list[Finding]]:
    """The constraints, the frames with those that they need, and what was left out."""
    constraints: list[Constraint] = []
    whole, findings = [*frames], []
    for loop in source.constraints:
        ends = [_on_body(end, places) for end in loop.ends if end.link != WORLD]
        reason = ""
        if not ends or (len(ends) == 2 and ends[0].on == ends[1].on):
            reason = "a constraint of a body, or of the world, with itself"
        elif len(ends) == 1 and loop.holds == "hinge":
            reason = "a hinge to the world; hold two points on its axis instead"
        elif len(constraints) == Constraint.most or len(whole) + len(ends) > MAX_FRAMES:
            reason = "one constraint, or frame for it, too many"
        if reason:
            findings.append(Finding("left out", loop.name, reason))
            continue
        names: list[str] = []
        for end in ends:
            pose = quiet_pose(end.pose, snap)
            at_pose = [frame.name for frame in whole if (frame.on, frame.pose) == (end.on, pose)]
            if (end.on, pose) == (BASE, HERE):
                at_pose = ["base"]
            if not at_pose:
                whole.append(Frame(namer.free(end.name, "frame"), end.on, pose))
            names += at_pose[:1] or [whole[-1].name]
        label, (held, *anchors) = namer.free(loop.name, "constraint"), names
        if anchors:
            part = replace(taken(Constraint, loop), name=label, frame=held, to=anchors[0])
        else:
            kind: ConstraintKind = "frame" if loop.holds == "frame" else "point"
            anchor = quiet_pose(loop.ends[1].pose, snap)
            turn = anchor.rpy_deg if kind == "frame" else LEVEL
            part = Constraint(label, kind, held, None, anchor.xyz, turn)
        constraints.append(part)
        words = f"{loop.holds} of {held} held to {[*anchors, 'the world'][0]}"
        findings.append(Finding("constraint", label, words))
    return tuple(constraints), tuple(whole), findings


class Namer:
    """Hands out names and remembers them; `findings` says which had to be changed."""

    def __init__(self) -> None:
        self.findings: list[Finding] = []
        self._registry = NameRegistry()
        # How many names each form has been made into, so that thousands of one form take no longer.
        self._made: dict[tuple[str, str], int] = {}

    def free(self, name: str, kind: NamedKind) -> str:
        """The name in the source, as long as it may be, or the name and a word or number."""
        stem = name or kind
        if kind == "joint" and identifier(stem).startswith(CONSTRAINT_TORQUES):
            stem = f"joint_{stem}"
        stem = stem[:LONGEST_LABEL]
        form = (kind, identifier(stem))
        for number in itertools.count(self._made.get(form, 0)):
            ending = f"_{number if number > 1 else kind}" if number else ""
            free = stem[: LONGEST_LABEL - len(ending)] + ending
            if not self._registry.fault(kind, free):
                break
        self._made[form] = number + 1
        self._registry.add(kind, free, kind)
        if free != name:
            self.findings.append(Finding("note", name or "without a name", f"{kind} called {free}"))
        return free
