"""The links of a file as a tree: checked, hung up by another link, with joints locked."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from gibbs_codegen.errors import UsageError, near, printable
from gibbs_codegen.exchange.sources import (
    IDLE_LINK,
    NO_LINK,
    SNAP,
    WORLD,
    Finding,
    Source,
    SourceConstraint,
    SourceGear,
    SourceJoint,
    SourceRotor,
)
from gibbs_codegen.robot.parts.base import FIXED, FREE, LEVEL_MOTIONS, TRAVELS, TURNS, Motion
from gibbs_codegen.robot.parts.pose import HERE, Pose, vector
from gibbs_codegen.robot.rotations import turn_about

# How far a rotor may be from the axis of its joint and still be what spins there: m, and rad. On
# what carries the joint it must be at the joint, too, within so many metres.
_ON_AXIS = 1e-6
_AT_JOINT = 0.01
_ANCHORS = ("world", "map", "odom")
_SINGLE = ("revolute", "prismatic")


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
        message = (
            "every link is the child of a joint, so the joints form a closed loop; remove one joint"
        )
        raise source.refused(message, source.joints[0].line)
    if len(roots) > 1:
        shown = ", ".join(printable(name, 60) for name in roots[:5])
        message = f"{len(roots)} links are not the child of a joint: {shown}; leave one of them"
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
    words = "leads to the base and cannot be locked; give the motion of the base with --base MOTION"
    findings = [Finding("note", name, words) for name in values if name in source.anchors]
    joints, seats = [], _seats(source)
    places: dict[str, tuple[float, str]] = {}
    for joint in source.joints:
        low, high = joint.link.limits.low, joint.link.limits.high
        if joint.kind == "fixed":
            pass
        elif joint.name in values:
            places[joint.name] = values[joint.name], "as asked"
        elif joint.name in source.spinning or any(
            _spins(joint, rotor, seats) for rotor in source.rotors
        ):
            places[joint.name] = 0.0, "lets a rotor spin"
        elif joint.gear and names.issuperset(joint.gear.ratios):
            pass
        elif joint.kind in ("revolute", "prismatic") and low is not None and low == high:
            places[joint.name] = low, "its limits leave it no range"
    following = {x.name: x.gear for x in source.joints if x.gear and x.name not in places}
    movers = {name: gear.words for name, gear in following.items()}
    for _ in range(len(following)):  # Joints that follow may move others.
        for name in [name for name in following if name not in places]:
            gear = following[name]
            free = {mover: x for mover, x in gear.ratios.items() if mover not in places}
            locked_at = sum(x * places[m][0] for m, x in gear.ratios.items() if m not in free)
            following[name] = SourceGear(free, gear.offset + locked_at)
            if not free:
                places[name] = gear.offset + locked_at, f"follows {movers[name]}"
    for joint in source.joints:
        if joint.name in following:
            joint = replace(joint, gear=following[joint.name])
        if joint.name in places:
            value, why = places[joint.name]
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


def anchored(source: Source, motion: Motion | None, base: str | None) -> Source:
    """Leave the world out: what hangs on it is the root, of which this says how it moves and where.

    The world is a massless root above a floating or planar joint, or with a name of the world's.
    `motion` is what is to move in place of what the file lets move, if it is not None; `base` is
    the link that is to be the base, if it is not the root.
    """
    way = _way_from_world(source, base)
    kinds = {joint.kind: k for k, joint in enumerate(way)}
    moved = [joint for joint in way if joint.kind in _SINGLE]
    names, chosen, reason = _virtual(source, way), source.motion, source.reason
    if "floating" in kinds:
        chosen, reason = FREE, f"joint {way[kinds['floating']].name} is floating"
    elif "planar" in kinds:
        chosen = motion or _plane(source, way[: kinds["planar"] + 1])
        reason = f"joint {way[kinds['planar']].name} is planar"
    elif names:
        chosen, reason = names, f"joints {', '.join(names)} lead from the world to it"
    elif _is_world(source, source.root):
        chosen, reason = FIXED, f"it hangs on link {source.root}"
    if moved and not names:
        if base or motion not in (None, FIXED):
            chosen = FREE
        else:
            way, moved = way[: way.index(moved[0])], []
    if motion is not None:
        chosen, reason = motion, "asked for"
    above, root = {joint.parent for joint in way}, way[-1].child if way else source.root
    words = f"a joint between the world and {root}"
    return source.reported(
        *(Finding("left out", joint.name, words) for joint in moved if chosen != names),
        root=root,
        links={name: link for name, link in source.links.items() if name not in above},
        joints=tuple(joint for joint in source.joints if joint not in way),
        constraints=tuple(_to_world(loop, above) for loop in source.constraints),
        anchors=source.anchors | {joint.name for joint in way},
        motion=chosen,
        reason=reason,
        pose=HERE if chosen == FREE else _placed_at_zero(source, way)[-1][1],
    )


def _is_world(source: Source, link: str) -> bool:
    return link.lower() in _ANCHORS and not source.links[link].weighs


def _way_from_world(source: Source, base: str | None) -> list[SourceJoint]:
    """Single joints from the world to the root, or to link `base`, over massless links.

    Those that hold it or let it move as a whole are before those of one degree of freedom each, and
    a fixed one may be behind these.
    """
    ends = {end.link for loop in source.constraints for end in loop.ends}
    stops = {base, *(ends - {source.root})}
    stops |= {rotor.link for rotor in source.rotors} | {frame.link for frame in source.frames}
    way, link, known = list[SourceJoint](), source.root, True
    while link not in stops and not source.links[link].weighs and len(source.below[link]) == 1:
        (joint,) = source.below[link]
        single = any(before.kind in _SINGLE for before in way)
        if joint.kind == "fixed":
            known = single or _is_world(source, link)
        else:
            known = _is_world(source, source.root) if joint.kind in _SINGLE else not single
        if not known:
            break
        way.append(joint)
        link = joint.child
        if single and joint.kind == "fixed":
            break
    return way


def _placed_at_zero(source: Source, way: Iterable[SourceJoint]) -> list[tuple[Pose, Pose]]:
    """Poses in the world, where nothing moves, of joints and what they carry; the root's first."""
    poses = [(source.pose, source.pose)]
    for joint in way:
        frame = poses[-1][1] @ joint.pose
        poses.append((frame, frame @ joint.offset))
    return poses


def _plane(source: Source, way: Sequence[SourceJoint]) -> Motion:
    """What moves where the last joint of a way is planar."""
    frame, _ = _placed_at_zero(source, way)[-1]
    normal = np.abs(frame.matrix @ np.array(way[-1].link.axis))
    if sum(normal > SNAP) > 1:
        message = (
            "moves in a plane that is not normal to an axis of the world; give the motion with "
            "--base"
        )
        where = f'<joint "{printable(way[-1].name, 60)}">'
        raise source.refused(message, way[-1].line, where)
    return (("y", "z", "roll"), ("x", "z", "pitch"), "planar")[int(np.argmax(normal))]


def _virtual(source: Source, way: Sequence[SourceJoint]) -> tuple[str, ...]:
    """Names of the joints of a way if they move a base along axes of the world and about its place.

    It is empty if there are none, or others, or anything acts on them: then they are links.
    """
    names, poses = list[str](), _placed_at_zero(source, way)
    base = np.array(poses[-1][1].xyz)
    for joint, (frame, _) in zip(way, poses[1:], strict=True):
        if joint.kind == "fixed":
            continue
        parts = TRAVELS if joint.kind == "prismatic" else TURNS
        axis = np.eye(3)[parts.get(joint.name, 0)]
        off = [frame.matrix @ np.array(joint.link.axis) - axis]
        if parts is TURNS:
            off.append(np.cross(axis, base - frame.xyz))
        plain = replace(joint.link, axis=NO_LINK.axis) in (NO_LINK, IDLE_LINK)
        ordered = parts is TURNS or not {*names} & {*TURNS}
        acting = joint.driven or joint.gear or not plain
        if joint.name not in parts or np.abs(off).max() > _ON_AXIS or acting or not ordered:
            return ()
        names.append(joint.name)
    return tuple(names)


def _to_world(loop: SourceConstraint, links: Container[str]) -> SourceConstraint:
    """A loop in which links that are left out are the world."""
    first, second = (replace(e, link=WORLD) if e.link in links else e for e in loop.ends)
    return replace(loop, ends=(second, first) if first.link == WORLD else (first, second))


def check_kinds(source: Source) -> None:
    """Refuse floating and planar joints, which only a root may have.

    Joints are locked and anchors left out before.
    """
    for joint in source.joints:
        if joint.kind in ("floating", "planar"):
            message = f"is {joint.kind}, which only a joint at the root may be; fix it with --lock"
            where = f'<joint "{printable(joint.name, 60)}">'
            raise source.refused(message, joint.line, where)


def rerooted(source: Source, link: str, asked: bool) -> Source:
    """Hang the tree up by another link; the joints on the way to it are reversed.

    `asked` is whether its motion was asked for; else it moves freely, unless the root carries it.

    A reversed joint keeps its coordinate: the same value means the same configuration. The link it
    now carries gets its frame at the joint, and keeps its own frame as a frame. Raises `UsageError`
    if there is no such link.
    """
    if link not in source.links:
        hint = near(link, [x for x in (*source.links, FREE, *LEVEL_MOTIONS) if x != link])
        raise UsageError(f"--base {printable(link, 60)}: no such link or motion{hint}")
    carried = {joint.child: joint for joint in source.joints}
    reverse = []
    on_the_way = link
    while on_the_way in carried:
        reverse.append(carried[on_the_way])
        on_the_way = carried[on_the_way].parent
    if not reverse:
        return source
    motion, pose = source.motion, _placed_at_zero(source, reverse[::-1])[-1][1]
    if not asked and any(joint.kind != "fixed" for joint in reverse):
        motion = None
    turned = {*reverse}
    others = [joint for joint in source.joints if joint not in turned]
    # Child in parent: pose · motion(q) · offset. Parent in child: offset⁻¹ · motion(−q) · pose⁻¹.
    backwards = [
        replace(
            joint,
            parent=joint.child,
            child=joint.parent,
            pose=joint.offset.inverse,
            # The rotor stays where it is, which is beyond the joint now.
            link=replace(
                joint.link, axis=vector([-entry for entry in joint.link.axis]), motor=None
            ),
            offset=joint.pose.inverse,
        )
        for joint in reverse
    ]
    joints = (*backwards, *others)
    words = "its motor, which the child link now carries"
    findings = [Finding("left out", joint.name, words) for joint in reverse if joint.link.motor]
    findings.insert(0, Finding("base", link, f"in place of {source.root}"))
    return source.reported(*findings, joints=joints, root=link, motion=motion, pose=pose)
