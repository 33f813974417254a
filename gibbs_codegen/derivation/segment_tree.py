"""A tree of links on joints, and the frames in which the recursions along it compute.

Segment 0 is the root link (arm 1). Each further segment is a link with the joint that connects it
to its parent, and every parent comes before its children. Segments whose joints have parallel axes
form a *group* and share one *group frame*: the frame of the group before any of its joints turns
it. A segment of the group is turned against that frame, about z, by the sum of the joint angles
from the start of the group to the segment, so vectors along the group are never rotated from link
to link, and one sine–cosine pair a joint is enough.

What a segment computes, it computes in its *working frame*: the group frame, or its own frame if
further groups start at it, since all that passes through has to be turned once anyway. Therefore
either all children of a segment start groups of their own, or none does: where one child is
twisted, those with parallel axes start groups as well.

A group of parallel joints allows wrenches to be passed in at once, and inertia to be regrouped.
The lead of a group is its first segment; all share its group frame. What the joints on the way need
of a wrench is its component along them: of its moment, that about z alone. So that one is shifted
from joint to joint, and the other two once, to the lead, which saves their shift along the step
into the group as well.

A joint only feels part of the inertia of its link. The rest moves with the parent whatever the
joint does, so it is added to the parent once, in parameters alone, and what is left has zeros that
shorten every recursion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import groupby

import sympy as sp

from gibbs_codegen.derivation.inertia import ANGULAR, LINEAR, NO_INERTIA, Inertia
from gibbs_codegen.robot.parts.link import JointKind
from gibbs_codegen.symbolic.tape import Scalars, Stage, Vector, negated, plus, times
from gibbs_codegen.symbolic.vectors import (
    NO_ROTATION,
    ZERO,
    Moved,
    Rotation,
    Transform,
    Wrench,
    X,
    Y,
    Z,
    axis_vector,
    moved,
    radians,
)

# The first links are named where more of them have names of their own.
_MOST_NAMED = 4
# The parent of the root segment.
NO_PARENT = -1


@dataclass(frozen=True)
class Segment:
    """A link and its joint, placed much as modified Denavit–Hartenberg does it.

    From the parent's frame: `turn` about z, `step` (along x there), `twist` about x, `d` along z (a
    prismatic joint's travel included), then `rotation` about z, counted from the group frame;
    `offset` is the fixed part of the segment's own angle. `parent` is the index of the parent
    segment. `starts_group` marks a segment whose group frame is its own, before its joint turns it.
    `inertia` is about the joint, in the link's own frame. Comments call the link `name` and its
    joint `joint_name`.
    """

    inertia: Inertia
    rotation: Rotation
    parent: int = NO_PARENT
    joint: JointKind = "revolute"
    turn: Rotation = NO_ROTATION
    step: Vector = ZERO
    d: sp.Expr = sp.S.Zero
    twist: Rotation = NO_ROTATION
    offset: Rotation = NO_ROTATION
    starts_group: bool = True
    name: str = ""
    joint_name: str = ""

    @property
    def direction(self) -> int:
        """Component of (r̈, ω̇), or of a wrench, along the joint: a row of 0 … 5."""
        return ANGULAR + Z if self.joint == "revolute" else LINEAR + Z

    def row(self, wrench: Wrench) -> sp.Expr:
        """The component along the joint of a wrench about it, in the segment's group frame."""
        return wrench.entries[self.direction]


@dataclass(frozen=True)
class SegmentTree:
    """Segments, every parent before its children, the root first.

    Raises `ValueError` where that is not so, where a twisted segment does not start a group, or
    where some children of a segment start groups and others do not.
    """

    segments: tuple[Segment, ...]

    def __post_init__(self) -> None:
        for k, segment in enumerate(self.segments):
            if not (0 <= segment.parent < k or (k == 0 and segment.parent == NO_PARENT)):
                raise ValueError(f"segment {k}: its parent {segment.parent} does not come before")
            parallel = segment.twist.is_identity and segment.turn.is_identity
            if not (segment.starts_group or parallel):
                raise ValueError(f"segment {k} is twisted against the group that it belongs to")
        for k, children in enumerate(self.children):
            if len({self.segments[child].starts_group for child in children}) > 1:
                raise ValueError(
                    f"segment {k}: of its children {children} some start groups of their own and "
                    "others do not"
                )

    @property
    def joints(self) -> int:
        """Number of joints after the root."""
        return len(self.segments) - 1

    @cached_property
    def children(self) -> tuple[tuple[int, ...], ...]:
        """For each segment, the indices of its children, in ascending order."""
        children: list[list[int]] = [[] for _ in self.segments]
        for k, segment in enumerate(self.segments[1:], start=1):
            children[segment.parent].append(k)
        return tuple(map(tuple, children))

    def path(self, k: int) -> list[int]:
        """Indices from segment k to the root, both included."""
        path = [k]
        while path[-1] > 0:
            path.append(self.segments[path[-1]].parent)
        return path

    def lead(self, k: int) -> int:
        """Index of the segment that starts the group of segment k."""
        return next(j for j in self.path(k) if self.segments[j].starts_group)

    def subtree(self, k: int) -> list[int]:
        """Indices of segment k and all that it supports, in ascending order."""
        subtree = [k]
        for i in range(k + 1, len(self.segments)):
            if self.segments[i].parent in subtree:
                subtree.append(i)
        return subtree

    def subtree_words(self, k: int) -> str:
        """Segment k and all that it supports in words, such as "links 2, 4 and 5"."""
        if k > 0:
            return self._words(self.subtree(k))
        root, *rest = self.subtree(k)
        return " and ".join([self.segments[root].name] + ([self._words(rest)] if rest else []))

    def subtree_about_joint(self, k: int) -> str:
        """In words, such as "links 2, 4 and 5, about joint 8"."""
        joint = self.segments[k].joint_name
        return f"{self.subtree_words(k)}, about {joint}" if joint else self.subtree_words(k)

    def _words(self, links: Sequence[int]) -> str:
        names = [self.segments[k].name for k in links]
        if len(names) == 1:
            return names[0]
        if names == [f"link {k}" for k in links]:
            parts: list[str] = []
            for _, pairs in groupby(enumerate(links), key=lambda pair: pair[1] - pair[0]):
                run = [number for _, number in pairs]
                parts += [f"{run[0]} to {run[-1]}"] if len(run) > 2 else map(str, run)
            *before, last = parts
            return f"links {', '.join(before)} and {last}" if before else f"links {last}"
        if len(names) > _MOST_NAMED:
            return f"{names[0]} and the {len(names) - 1} links that it carries"
        return f"{', '.join(names[:-1])} and {names[-1]}"

    def works_in_own_frame(self, k: int) -> bool:
        """True if segment k works in its own, not its group's frame: its children start groups."""
        return any(self.segments[child].starts_group for child in self.children[k])

    def transform_in(self, tape: Scalars, k: int) -> Transform:
        """Transform of a wrench or an inertia about joint k ≥ 1 to the parent's joint.

        It is from the segment's group frame to the parent's working frame. Within a group parent
        and child share the group frame, and the parent's x axis is turned in it by the parent's
        rotation. Where a group starts, the parent works in its own frame.
        """
        segment = self.segments[k]
        parent = self.segments[segment.parent]
        offset = axis_vector(Z, segment.d)
        if segment.starts_group:
            return [offset, segment.twist, segment.step, segment.turn]
        with tape.group(f"step from {parent.name} to {segment.name}"):
            return [offset, parent.rotation.vector(tape, segment.step)]

    def step_in_group(self, tape: Scalars, k: int) -> Vector:
        """The step to joint k from the joint of its parent in the same group, in its frame (m)."""
        segment = self.segments[k]
        parent = self.segments[segment.parent]
        with tape.group(f"step from {parent.name} to {segment.name}"):
            step = parent.rotation.vector(tape, segment.step)
            return tape.add(step, axis_vector(Z, segment.d))

    def passed_in(self, tape: Scalars, k: int, item: Moved) -> Moved:
        """A wrench or an inertia about joint k ≥ 1, passed on to the joint of its parent.

        It is in the group frame of segment k, the result in the parent's working frame.
        """
        return moved(tape, item, self.transform_in(tape, k))

    def to_working_frame(self, tape: Scalars, k: int, item: Moved) -> Moved:
        """A wrench or an inertia about joint k, from the segment's own to its working frame."""
        if self.works_in_own_frame(k):
            return item
        return item.rotated(tape, self.segments[k].rotation)

    def to_own_frame(self, tape: Scalars, k: int, item: Moved) -> Moved:
        """A wrench or an inertia about joint k, from the segment's working to its own frame."""
        if self.works_in_own_frame(k):
            return item
        return item.rotated(tape, self.segments[k].rotation.inverse)

    def to_group_frame(self, tape: Scalars, k: int, item: Moved) -> Moved:
        """A wrench or an inertia about joint k, from the segment's working to its group frame."""
        if self.works_in_own_frame(k):
            return item.rotated(tape, self.segments[k].rotation)
        return item

    def working_inertia(self, tape: Scalars, k: int) -> Inertia:
        """Inertia of segment k by itself, about its joint in its working frame."""
        segment = self.segments[k]
        with tape.group(f"inertia of {segment.name}, turned by the joints"):
            return self.to_working_frame(tape, k, segment.inertia)


@dataclass(frozen=True)
class JointedLink:
    """A link in symbols, with its frame's z along its joint, placed on its parent.

    `parent` is the index of the parent segment: 0 for the root, i for the i-th link. From the
    parent's frame: a turn about z, `step`, a twist α about x, `d` along z, and a turn θ about z, as
    modified Denavit–Hartenberg has it with a step a along x. `inertia` is about the joint, in the
    link's own frame. `coordinate` is the angle or the travel of the joint, which adds to
    `theta_deg` or to `d`; it is zero for a joint that is held.
    """

    parent: int
    inertia: Inertia
    joint: JointKind
    coordinate: sp.Expr
    name: str
    joint_name: str
    turn_deg: Fraction = Fraction(0)
    step: Vector = ZERO
    alpha_deg: Fraction = Fraction(0)
    d: sp.Expr = sp.S.Zero
    theta_deg: Fraction = Fraction(0)


# Rotation about an axis by an angle in degrees, which the robot file fixes.
FixedRotation = Callable[[int, Fraction], Rotation]


def tree_of_links(
    tape: Scalars,
    root: Segment,
    root_angle: sp.Expr,
    links: Sequence[JointedLink],
    fixed_rotation: FixedRotation = Rotation.degrees,
) -> SegmentTree:
    """The tree of a root segment and of links, each after its parent, with their own inertias.

    `root_angle` is that of the root segment against its group frame (rad).
    """
    segments = [root]
    twisted = {link.parent for link in links if link.alpha_deg % 360 != 0}
    # For each segment the sums, since its group frame, of joint angles and of fixed angles.
    turns = [(root_angle, Fraction(0))]
    for link in links:
        starts_group = link.parent in twisted
        angle, fixed = (sp.S.Zero, Fraction(0)) if starts_group else turns[link.parent]
        fixed += link.theta_deg
        turn, travel = link.coordinate, sp.S.Zero
        if link.joint == "prismatic":
            turn, travel = travel, turn
        turns.append((angle + turn, fixed))
        with tape.group("inertias of the links", Stage.PARAMETER):
            inertia = link.inertia.mapped(tape.let)
        x, y, z = link.step
        with tape.group("angles and places of the joints", Stage.PARAMETER):
            segment = Segment(
                inertia=inertia,
                rotation=joint_rotation(tape, *turns[-1], fixed_rotation),
                parent=link.parent,
                joint=link.joint,
                turn=fixed_rotation(Z, link.turn_deg),
                step=(tape.let(x), tape.let(y), tape.let(z)),
                d=tape.let(link.d + travel),
                twist=fixed_rotation(X, link.alpha_deg),
                offset=fixed_rotation(Z, link.theta_deg),
                starts_group=starts_group,
                name=link.name,
                joint_name=link.joint_name,
            )
        segments.append(segment)
    return SegmentTree(tuple(segments))


def joint_rotation(
    tape: Scalars, angle: sp.Expr, fixed: Fraction, fixed_rotation: FixedRotation
) -> Rotation:
    """Rotation about z by an angle that varies (rad), or zero, and one that is fixed (degrees)."""
    if angle == 0:
        return fixed_rotation(Z, fixed)
    return Rotation.angle(tape, Z, angle + radians(fixed % 360))


@dataclass(frozen=True)
class GroupPassage:
    """The way of wrenches through a group to its lead, and into it where they come from another.

    `way` are the segments from the one at whose joint the wrenches come in to the lead, and `arms`
    the steps from each to the one before it, in the group frame (m). They come in by `outside`, by
    a shift along `entry` (m) of the moment about z alone, and by `inside`. Then `whole` is the step
    from the lead to what the moments about x and y are about, in the group frame (m).
    """

    way: tuple[int, ...]
    arms: tuple[Vector, ...]
    whole: Vector
    outside: Transform = ()
    entry: Vector = ZERO
    inside: Transform = ()

    @classmethod
    def of(cls, tape: Scalars, tree: SegmentTree, k: int, lead: int) -> GroupPassage:
        """The way of what begins at joint k through one of the groups that carry it, by its lead.

        It begins at joint k, or at the lead of the group before.
        """
        path = tree.path(k)
        carried = path[: path.index(lead)]
        before = [j for j in carried if tree.segments[j].starts_group]
        if before:
            return cls.entering(tape, tree, before[-1])
        return cls.starting(tape, tree, k)

    @classmethod
    def starting(cls, tape: Scalars, tree: SegmentTree, k: int) -> GroupPassage:
        """The way of wrenches about joint k of the group, in the group frame."""
        way, arms = [k], []
        while not (segment := tree.segments[way[-1]]).starts_group:
            arms.append(tree.step_in_group(tape, way[-1]))
            way.append(segment.parent)
        whole = ZERO
        for arm in reversed(arms):
            whole = tape.add(whole, arm)
        return cls(tuple(way), tuple(arms), whole)

    @classmethod
    def entering(cls, tape: Scalars, tree: SegmentTree, k: int) -> GroupPassage:
        """The way of wrenches about the lead k of a group that this one carries, in its frame."""
        segment = tree.segments[k]
        rotation = tree.segments[segment.parent].rotation
        way = cls.starting(tape, tree, segment.parent)
        if len(way.way) == 1:  # The lead itself, to which every moment has to be shifted now.
            return replace(way, outside=(*tree.transform_in(tape, k), rotation))
        with tape.group(f"step from {tree.segments[segment.parent].name} to {segment.name}"):
            offset = segment.twist.vector(tape, axis_vector(Z, segment.d))
            entry = tape.add(segment.step, offset)
            across = rotation.vector(tape, segment.turn.vector(tape, entry))
            whole = tape.add(way.whole, across)
        return replace(
            way, whole=whole, outside=(segment.twist,), entry=entry, inside=(segment.turn, rotation)
        )

    def turned(self, tape: Scalars, vector: Vector) -> Vector:
        """A vector where the way begins, in the group frame."""
        for step in (*self.outside, *self.inside):
            if isinstance(step, Rotation):
                vector = step.vector(tape, vector)
        return vector

    def passed_in(self, tape: Scalars, wrench: Wrench) -> tuple[list[Wrench], Wrench]:
        """Pass a wrench, where the way begins, in to the lead; results are in the group frame.

        The list has for each segment of the way the wrench whose force, and whose moment about z,
        are those about its joint; then comes the wrench about the lead.
        """
        wrench = moved(tape, wrench, self.outside)
        about_z = _moment(tape, wrench, Z, self.entry)
        wrench = moved(tape, _with_z(wrench, about_z), self.inside)
        along = [wrench]
        for arm in self.arms:
            along.append(_with_z(wrench, _moment(tape, along[-1], Z, arm)))
        x, y = (_moment(tape, wrench, axis, self.whole) for axis in (X, Y))
        return along, Wrench(wrench.force, (x, y, along[-1].moment[Z]))


def _with_z(wrench: Wrench, moment: sp.Expr) -> Wrench:
    x, y, _ = wrench.moment
    return Wrench(wrench.force, (x, y, moment))


def _moment(tape: Scalars, wrench: Wrench, axis: int, arm: Vector) -> sp.Expr:
    """One component of the moment about another point (N m); `arm`: the old from the new (m)."""
    p, q = (axis + 1) % 3, (axis + 2) % 3
    lever = times(arm[p], wrench.force[q]), negated(times(arm[q], wrench.force[p]))
    return tape.let(plus(wrench.moment[axis], *lever))


def regrouped(tape: Scalars, tree: SegmentTree) -> SegmentTree:
    """The tree with regrouped inertias, from the leaves to the root; it moves as before.

    Inertia passes between the links' own frames. What a revolute joint does not move is symmetric
    about its axis and need not be turned; what a prismatic joint does not move is turned by the
    fixed angle of the link.
    """
    segments = list(tree.segments)
    for k in range(len(segments) - 1, 0, -1):
        segment = segments[k]
        parent = segments[segment.parent]
        words = f"that of {segment.name} which {segment.joint_name} does not move"
        with tape.group(f"inertia of {parent.name}, with {words}", Stage.PARAMETER):
            if segment.joint == "revolute":
                felt, unmoved = split_revolute(segment.inertia)
                unmoved = unmoved.shifted(tape, axis_vector(2, segment.d))
            else:
                felt, unmoved = split_prismatic(segment.inertia)
                unmoved = unmoved.rotated(tape, segment.offset)
            unmoved = moved(tape, unmoved, [segment.twist, segment.step, segment.turn])
            segments[k] = replace(segment, inertia=felt)
            segments[segment.parent] = replace(parent, inertia=parent.inertia.plus(tape, unmoved))
    return SegmentTree(tuple(segments))


def split_revolute(inertia: Inertia) -> tuple[Inertia, Inertia]:
    """Inertia of a link that a revolute joint about z moves, and the rest, which its parent gets.

    The inertia is about the joint, in the link's own frame. Mass on the joint's axis does not
    notice the joint: the mass itself, the first moment along z and the second moment along z are
    the parent's.
    """
    (x, y, z), (xx, yy, zz, xy, xz, yz) = inertia.moment, inertia.second
    zero = sp.S.Zero
    felt = Inertia(zero, (x, y, zero), (xx, yy, zero, xy, xz, yz))
    unmoved = Inertia(inertia.mass, (zero, zero, z), (zero, zero, zz, zero, zero, zero))
    return felt, unmoved


def split_prismatic(inertia: Inertia) -> tuple[Inertia, Inertia]:
    """Inertia of a link that a prismatic joint moves, and the rest, which its parent gets.

    The link turns with its parent, so its second moments about the joint are the parent's.
    """
    felt = replace(inertia, second=NO_INERTIA.second)
    return felt, replace(NO_INERTIA, second=inertia.second)
