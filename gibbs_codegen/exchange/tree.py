"""The links of a file as a tree: checked, hung up by another link, with joints locked."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.exchange.placement import HERE, Placement, vector
from gibbs_codegen.exchange.source import Source, SourceJoint, SourceRotor, Told
from gibbs_codegen.robot.placement import turn_about

# How far a rotor may be from the axis of its joint and still be what spins there: m, and rad.
_ON_AXIS = 1e-6
_ANCHORS = ("world", "map", "odom")
_MOST_ANCHORS = 10


@dataclass(frozen=True, eq=False)
class SourceTree:
    """A file whose links are a tree that hangs on `root`."""

    source: Source
    root: str

    def joints_below(self, link: str) -> list[SourceJoint]:
        """The joints that a link carries, in the order of the file."""
        return [joint for joint in self.source.joints if joint.parent == link]


def tree_of(source: Source) -> SourceTree:
    """The tree of a file's links.

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
                f"{printable(carried[joint.child].name, 60)} already; closed loops are not imported"
            )
            raise source.refused(message, joint.line, where)
        carried[joint.child] = joint
    roots = [name for name in source.links if name not in carried]
    if not roots:
        message = "every link is carried by a joint, so that the joints form a closed loop"
        raise source.refused(message, source.joints[0].line)
    if len(roots) > 1:
        shown = ", ".join(printable(name, 60) for name in roots[:5])
        message = f"there are {len(roots)} links that no joint carries, {shown}; a robot has one"
        raise source.refused(message, source.links[roots[1]].line)
    tree = SourceTree(source, roots[0])
    if len(reached := _reached(tree)) < len(source.links):
        lost = next(name for name in source.links if name not in reached)
        message = f"link {printable(lost, 60)} is part of a closed loop of joints"
        raise source.refused(message, source.links[lost].line)
    return tree


def _reached(tree: SourceTree) -> set[str]:
    below: dict[str, list[str]] = {}
    for joint in tree.source.joints:
        below.setdefault(joint.parent, []).append(joint.child)
    found, left = {tree.root}, [tree.root]
    while left:
        fresh = below.get(left.pop(), [])
        found.update(fresh)
        left.extend(fresh)
    return found


def locked(tree: SourceTree, values: Mapping[str, float]) -> SourceTree:
    """Lock joints: those asked for, those of rotors, and those that have no range to move in.

    `values` has where the joints asked for are locked, rad or m, by name; raises `UsageError` if
    there is no joint of a name. Fixed joints are in their place.
    """
    source = tree.source
    known = {joint.name for joint in source.joints} | source.anchors
    for name in values:
        if name not in known:
            raise UsageError(f"--lock {printable(name, 60)}: no such joint{near(name, known)}")
    joints, told = [], list(source.told)
    for joint in source.joints:
        value, why = 0.0, ""
        low, high = joint.limits.low, joint.limits.high
        if joint.kind == "fixed":
            pass
        elif joint.name in values:
            value, why = values[joint.name], "as asked"
        elif joint.name in source.spinning or any(_spins(joint, rotor) for rotor in source.rotors):
            why = "lets a rotor spin"
        elif joint.kind in ("revolute", "prismatic") and low is not None and low == high:
            value, why = low, "its limits leave it no range"
        if why:
            told.append(Told("locked", joint.name, f"at {value:g}; {why}"))
            joint = _fixed(joint, value)
        joints.append(joint)
    return replace(tree, source=replace(source, joints=tuple(joints), told=tuple(told)))


def _fixed(joint: SourceJoint, value: float) -> SourceJoint:
    """The joint as a fixed one."""
    moved = HERE
    if value and joint.kind == "prismatic":
        moved = Placement(vector(value * np.array(joint.axis)))
    elif value and joint.kind == "revolute":
        moved = Placement.of_matrix((0.0, 0.0, 0.0), turn_about(np.array(joint.axis), value))
    pose = joint.pose @ moved @ joint.offset
    return replace(joint, kind="fixed", pose=pose, offset=HERE)


def _spins(joint: SourceJoint, rotor: SourceRotor) -> bool:
    """Whether a joint without limits turns about the line of thrust of a rotor it carries."""
    if joint.child != rotor.on or not joint.continuous:
        return False
    place = joint.offset.point(rotor.position)
    direction = joint.offset.matrix @ np.array(rotor.direction)
    beside = np.linalg.norm(np.cross(joint.axis, place))
    tilted = np.linalg.norm(np.cross(joint.axis, direction))
    return bool(beside <= _ON_AXIS and tilted <= _ON_AXIS)


def without_anchor(tree: SourceTree) -> SourceTree:
    """Leave out massless roots by which the file hangs the robot up in the world.

    These are a root that a floating joint leads from, and a link "world" that a fixed joint leads
    from.
    """
    for _ in range(_MOST_ANCHORS):
        source, root = tree.source, tree.root
        below, inertial = tree.joints_below(root), source.links[root].inertial
        carriers = {rotor.on for rotor in source.rotors} | {frame.on for frame in source.frames}
        empty = inertial.mass == 0.0 and not inertial.inertia.any() and root not in carriers
        if len(below) != 1 or not empty:
            break
        (joint,) = below
        is_anchor = joint.kind == "fixed" and root.lower() in _ANCHORS
        if not is_anchor and joint.kind not in ("floating", "planar"):
            break
        links = {name: link for name, link in source.links.items() if name != root}
        told = Told("left out", root, f"the link above {joint.child}: the robot flies")
        source = replace(
            source,
            links=links,
            joints=tuple(found for found in source.joints if found is not joint),
            anchors=source.anchors | {joint.name},
            told=(*source.told, told),
        )
        tree = SourceTree(source, joint.child)
    return tree


def check_kinds(tree: SourceTree) -> None:
    """Refuse floating and planar joints, which only a root may have.

    Joints are locked and anchors left out before.
    """
    for joint in tree.source.joints:
        if joint.kind in ("floating", "planar"):
            message = f"is {joint.kind}, which is possible at the root only; --lock holds it fast"
            where = f'<joint "{printable(joint.name, 60)}">'
            raise tree.source.refused(message, joint.line, where)


def rerooted(tree: SourceTree, link: str) -> SourceTree:
    """Hang the tree up by another link; the joints on the way to it are reversed.

    A reversed joint keeps its coordinate: the same value means the same configuration. The link it
    now carries gets its frame at the joint, and keeps its own frame as a frame. Raises `UsageError`
    if there is no such link.
    """
    source = tree.source
    if link not in source.links:
        hint = near(link, source.links)
        raise UsageError(f"--base {printable(link, 60)}: no such link{hint}")
    carried = {joint.child: joint for joint in source.joints}
    reverse = []
    on_the_way = link
    while on_the_way in carried:
        reverse.append(carried[on_the_way])
        on_the_way = carried[on_the_way].parent
    turned = {*reverse}
    others = [joint for joint in source.joints if joint not in turned]
    told = [*source.told]
    if reverse:
        told.append(Told("base", link, f"in place of {tree.root}"))
    joints = (*map(_reversed, reverse), *others)
    return SourceTree(replace(source, joints=joints, told=tuple(told)), link)


def _reversed(joint: SourceJoint) -> SourceJoint:
    # Child in parent: pose · motion(q) · offset. Parent in child: offset⁻¹ · motion(−q) · pose⁻¹.
    x, y, z = joint.axis
    return replace(
        joint,
        parent=joint.child,
        child=joint.parent,
        pose=joint.offset.inverse,
        axis=vector((-x, -y, -z)),
        offset=joint.pose.inverse,
    )


def near(name: str, known: Iterable[str]) -> str:
    """A hint at the known name that may have been meant, empty if none is near."""
    found = difflib.get_close_matches(name[:80], list(known)[:2000], n=1)
    return f"; did you mean {printable(found[0], 60)}?" if found else ""
