"""The links of a file as a tree: checked, hung up by another link, with joints locked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from gibbs_codegen.errors import UsageError, near, printable
from gibbs_codegen.exchange.sources import (
    WORLD,
    Finding,
    Source,
    SourceConstraint,
    SourceJoint,
    SourceRotor,
)
from gibbs_codegen.robot.parts.pose import HERE, Pose, vector
from gibbs_codegen.robot.rotations import turn_about

# How far a rotor may be from the axis of its joint and still be what spins there: m, and rad. On
# what carries the joint it must be at the joint, too, within so many metres.
_ON_AXIS = 1e-6
_AT_JOINT = 0.01
_ANCHORS = ("world", "map", "odom")
_MOST_ANCHORS = 10


def with_root(source: Source) -> Source:
    """The file with its root, once its links are known to be a tree.

    Raises `SourceFileError` if a link is unknown, has two parents or is its own ancestor, or there
    is more than one root.
    """
    carried: dict[str, SourceJoint] = {}
    for joint in source.joints:
        where = f'<joint "{printable(joint.name, 60)}">'
        for end in (joint.parent, joint.child):
            if end not in source.links:
                message = f"there is no link {printable(end, 60)}{near(end, source.links)}"
                raise source.refused(message, joint.line, where)
        if joint.child in carried:
            message = (
                f"link {printable(joint.child, 60)} is carried by joint "
                f"{printable(carried[joint.child].name, 60)} already; a <constraint> closes loops"
            )
            raise source.refused(message, joint.line, where)
        carried[joint.child] = joint
    for loop in source.constraints:
        for link in (end.link for end in loop.ends):
            if link not in source.links and link != WORLD:
                message = f"there is no link {printable(link, 60)}{near(link, source.links)}"
                raise source.refused(message, where=f'<constraint "{printable(loop.name, 60)}">')
    roots = [name for name in source.links if name not in carried]
    if not roots:
        message = "every link is carried by a joint, so that the joints form a closed loop"
        raise source.refused(message, source.joints[0].line)
    if len(roots) > 1:
        shown = ", ".join(printable(name, 60) for name in roots[:5])
        message = f"there are {len(roots)} links that no joint carries, {shown}; a robot has one"
        raise source.refused(message, source.links[roots[1]].line)
    reached = [roots[0]]
    for link in reached:  # It grows meanwhile.
        reached += [joint.child for joint in source.below[link]]
    if lost := [name for name in source.links if name not in {*reached}]:
        message = f"link {printable(lost[0], 60)} is part of a closed loop of joints"
        raise source.refused(message, source.links[lost[0]].line)
    return replace(source, root=roots[0])


def locked(source: Source, values: Mapping[str, float]) -> Source:
    """Lock joints: those asked for, those of rotors, and those that have no range to move in.

    `values` has where the joints asked for are locked, rad or m, by name; raises `UsageError` if
    there is no joint of a name. Fixed joints are in their place.
    """
    names = {joint.name for joint in source.joints} | source.anchors
    for name in values:
        if name not in names:
            raise UsageError(f"--lock {printable(name, 60)}: no such joint{near(name, names)}")
    joints, findings, seats = [], [], _seats(source)
    for joint in source.joints:
        value, why = 0.0, ""
        low, high = joint.link.limits.low, joint.link.limits.high
        if joint.kind == "fixed":
            pass
        elif joint.name in values:
            value, why = values[joint.name], "as asked"
        elif joint.name in source.spinning or any(
            _spins(joint, rotor, seats) for rotor in source.rotors
        ):
            why = "lets a rotor spin"
        elif joint.gear and joint.gear.mover in names:
            pass
        elif joint.kind in ("revolute", "prismatic") and low is not None and low == high:
            value, why = low, "its limits leave it no range"
        if why:
            findings.append(Finding("locked", joint.name, f"at {value:g}; {why}"))
            moved = HERE
            if value and joint.kind == "prismatic":
                moved = Pose(vector(value * np.array(joint.link.axis)))
            elif value and joint.kind == "revolute":
                turn = turn_about(np.array(joint.link.axis), value)
                moved = Pose.of_matrix((0.0, 0.0, 0.0), turn)
            pose = joint.pose @ moved @ joint.offset
            joint = replace(joint, kind="fixed", pose=pose, offset=HERE)
        joints.append(joint)
    return source.reported(*findings, joints=tuple(joints))


def _seats(source: Source) -> dict[str, tuple[str, Pose]]:
    """The first of the links that fixed joints hold together, and where each link is in it."""
    seats, way = {source.root: (source.root, HERE)}, [source.root]
    for link in way:  # It grows meanwhile.
        for joint in source.below[link]:
            on, place = seats[link]
            inner = place @ joint.pose @ joint.offset
            seats[joint.child] = (on, inner) if joint.kind == "fixed" else (joint.child, HERE)
            way.append(joint.child)
    return seats


def _spins(joint: SourceJoint, rotor: SourceRotor, seats: Mapping[str, tuple[str, Pose]]) -> bool:
    """True if a joint without limits turns about the line of thrust of a rotor it carries.

    It does, too, if what carries the joint has the rotor where the joint is.
    """
    if not joint.continuous or rotor.link not in seats:
        return False
    (body, seat), (carrier, at) = seats[rotor.link], seats[joint.parent]
    carried = body == joint.child
    frame = (joint.offset if carried else (at @ joint.pose).inverse) @ seat
    place = frame.point(rotor.position)
    direction = frame.matrix @ np.array(rotor.direction)
    beside = np.linalg.norm(np.cross(joint.link.axis, place))
    tilted = np.linalg.norm(np.cross(joint.link.axis, direction))
    near_by = carried or (body == carrier and np.linalg.norm(place) <= _AT_JOINT)
    return bool(near_by and beside <= _ON_AXIS and tilted <= _ON_AXIS)


def without_anchor(source: Source) -> Source:
    """Leave out massless roots by which the file hangs the robot up in the world.

    These are a root that a floating joint leads from, and a link "world" that a fixed joint leads
    from.
    """
    for _ in range(_MOST_ANCHORS):
        root = source.root
        below, body = source.below[root], source.links[root].body
        carriers = {rotor.link for rotor in source.rotors} | {frame.link for frame in source.frames}
        if len(below) != 1 or body.weighs or root in carriers:
            break
        (joint,) = below
        is_anchor = joint.kind == "fixed" and root.lower() in _ANCHORS
        if not is_anchor and joint.kind not in ("floating", "planar"):
            break
        source = source.reported(
            Finding("left out", root, f"the link above {joint.child}: the robot flies"),
            root=joint.child,
            links={name: link for name, link in source.links.items() if name != root},
            joints=tuple(other for other in source.joints if other is not joint),
            constraints=tuple(_to_world(loop, root) for loop in source.constraints),
            anchors=source.anchors | {joint.name},
        )
    return source


def _to_world(loop: SourceConstraint, link: str) -> SourceConstraint:
    """A loop in which a link that is left out is the world."""
    first, second = (replace(e, link=WORLD) if e.link == link else e for e in loop.ends)
    return replace(loop, ends=(second, first) if first.link == WORLD else (first, second))


def check_kinds(source: Source) -> None:
    """Refuse floating and planar joints, which only a root may have.

    Joints are locked and anchors left out before.
    """
    for joint in source.joints:
        if joint.kind in ("floating", "planar"):
            message = f"is {joint.kind}, which is possible at the root only; --lock holds it fast"
            where = f'<joint "{printable(joint.name, 60)}">'
            raise source.refused(message, joint.line, where)


def rerooted(source: Source, link: str) -> Source:
    """Hang the tree up by another link; the joints on the way to it are reversed.

    A reversed joint keeps its coordinate: the same value means the same configuration. The link it
    now carries gets its frame at the joint, and keeps its own frame as a frame. Raises `UsageError`
    if there is no such link.
    """
    if link not in source.links:
        hint = near(link, source.links)
        raise UsageError(f"--base {printable(link, 60)}: no such link{hint}")
    carried = {joint.child: joint for joint in source.joints}
    reverse = []
    on_the_way = link
    while on_the_way in carried:
        reverse.append(carried[on_the_way])
        on_the_way = carried[on_the_way].parent
    if not reverse:
        return source
    turned = {*reverse}
    others = [joint for joint in source.joints if joint not in turned]
    # Child in parent: pose · motion(q) · offset. Parent in child: offset⁻¹ · motion(−q) · pose⁻¹.
    backwards = [
        replace(
            joint,
            parent=joint.child,
            child=joint.parent,
            pose=joint.offset.inverse,
            link=replace(joint.link, axis=vector([-entry for entry in joint.link.axis])),
            offset=joint.pose.inverse,
        )
        for joint in reverse
    ]
    joints = (*backwards, *others)
    finding = Finding("base", link, f"in place of {source.root}")
    return source.reported(finding, joints=joints, root=link)
