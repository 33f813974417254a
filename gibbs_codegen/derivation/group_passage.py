"""What a group of parallel joints allows: wrenches passed in at once, and inertia regrouped.

The lead of a group is its first segment; all share its group frame. What the joints on the way need
of a wrench is its component along them: of its moment, that about z alone. So that one is shifted
from joint to joint, and the other two once, to the lead, which saves their shift along the step
into the group as well.

A joint only feels part of the inertia of its link. The rest moves with the parent whatever the
joint does, so it is added to the parent once, in parameters alone, and what is left has zeros that
shorten every recursion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import sympy as sp

from gibbs_codegen.derivation.inertia import NO_INERTIA, Inertia
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.symbolic.tape import Scalars, Stage, times
from gibbs_codegen.symbolic.vectors import (
    ZERO,
    Rotation,
    Transform,
    Vector,
    Wrench,
    X,
    Y,
    Z,
    add,
    axis_vector,
    moved,
)


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
            whole = add(tape, whole, arm)
        return cls(tuple(way), tuple(arms), whole)

    @classmethod
    def entering(cls, tape: Scalars, tree: SegmentTree, k: int) -> GroupPassage:
        """The way of wrenches about the lead k of a group that this one carries, in its frame."""
        segment = tree.segments[k]
        rotation = tree.segments[segment.parent].rotation
        own = cls.starting(tape, tree, segment.parent)
        if len(own.way) == 1:  # The lead itself, to which every moment has to be shifted now.
            return replace(own, outside=(*tree.transform_in(tape, k), rotation))
        with tape.group(f"step from {tree.segments[segment.parent].name} to {segment.name}"):
            offset = segment.twist.vector(tape, axis_vector(Z, segment.d))
            entry = add(tape, segment.step, offset)
            across = rotation.vector(tape, segment.turn.vector(tape, entry))
            whole = add(tape, own.whole, across)
        return replace(
            own,
            whole=whole,
            outside=(segment.twist,),
            entry=entry,
            inside=(segment.turn, rotation),
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
    lever = times(arm[p], wrench.force[q]) - times(arm[q], wrench.force[p])
    return tape.let(wrench.moment[axis] + lever)


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
        unmoved = f"that of {segment.name} which {segment.joint_name} does not move"
        with tape.group(f"inertia of {parent.name}, with {unmoved}", Stage.PARAMETER):
            if segment.joint == "revolute":
                own, given = split_revolute(segment.inertia)
                given = given.shifted(tape, axis_vector(2, segment.d))
            else:
                own, given = split_prismatic(segment.inertia)
                given = given.rotated(tape, segment.offset)
            given = moved(tape, given, [segment.twist, segment.step, segment.turn])
            segments[k] = replace(segment, inertia=own)
            segments[segment.parent] = replace(parent, inertia=parent.inertia.plus(tape, given))
    return SegmentTree(tuple(segments))


def split_revolute(inertia: Inertia) -> tuple[Inertia, Inertia]:
    """What a revolute joint about z moves of a link, and what goes to its parent.

    The inertia is about the joint, in the link's own frame. Mass on the joint's axis does not
    notice the joint: the mass itself, the first moment along z and the second moment along z are
    the parent's.
    """
    (x, y, z), (xx, yy, zz, xy, xz, yz) = inertia.moment, inertia.second
    zero = sp.S.Zero
    own = Inertia(zero, (x, y, zero), (xx, yy, zero, xy, xz, yz))
    given = Inertia(inertia.mass, (zero, zero, z), (zero, zero, zz, zero, zero, zero))
    return own, given


def split_prismatic(inertia: Inertia) -> tuple[Inertia, Inertia]:
    """What a prismatic joint moves of a link, and what goes to its parent.

    The link turns with its parent, so its second moments about the joint are the parent's.
    """
    own = replace(inertia, second=NO_INERTIA.second)
    return own, replace(NO_INERTIA, second=inertia.second)
