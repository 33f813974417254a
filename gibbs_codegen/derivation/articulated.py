"""Forward dynamics by articulated bodies, in O(n), from the Gibbs function.

∂S/∂θ̈ = τ (eqs. 4–6) is solved joint by joint from the leaves inwards. The subtree of a segment has
the Gibbs function ½aᵀÂa − aᵀp in the segment's acceleration a = (r̈, ω̇), counted from the motion
that the rates alone would make. The joint's own equation gives its own component of a by the
others; with that put in, the rest is added to the parent. The root's system is solved, and then
outwards each joint's. It is the recursion of Featherstone, Rigid Body Dynamics Algorithms, ch. 7.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import sympy as sp

from gibbs_codegen.derivation.inertia import NO_ARTICULATED_INERTIA, ArticulatedInertia
from gibbs_codegen.derivation.motion import Acceleration, Motion
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.derivation.tree_dynamics import link_wrench
from gibbs_codegen.symbolic.ldlt import ZeroPivotError, minimum_degree, solve_symmetric
from gibbs_codegen.symbolic.tape import Scalars, Values, Vector, times
from gibbs_codegen.symbolic.vectors import (
    NO_ROTATION,
    NO_WRENCH,
    ZERO,
    Rotation,
    Transform,
    Wrench,
    Z,
    moved,
)


@dataclass(frozen=True)
class ArticulatedBody:
    """Â and p of ½aᵀÂa − aᵀp: a link, or the subtree of a segment."""

    inertia: ArticulatedInertia
    load: Wrench

    def plus(self, tape: Scalars, other: ArticulatedBody) -> ArticulatedBody:
        """The sum of two bodies about one point, in one frame."""
        inertia = self.inertia.plus(tape, other.inertia)
        return ArticulatedBody(inertia, self.load.plus(tape, other.load))

    def rotated(self, tape: Scalars, rotation: Rotation) -> ArticulatedBody:
        """The same in another frame; `rotation` takes components in this one to those there."""
        inertia = self.inertia.rotated(tape, rotation)
        return ArticulatedBody(inertia, self.load.rotated(tape, rotation))

    def shifted(self, tape: Scalars, arm: Vector) -> ArticulatedBody:
        """The same about another point; `arm` is the old point from the new one (m)."""
        return ArticulatedBody(self.inertia.shifted(tape, arm), self.load.shifted(tape, arm))


@dataclass(frozen=True)
class SolvedJoint:
    """A joint's equation, solved for its own component of a: a_d = share − Σ ratios·(the rest).

    Where the joint has armature, which the parent does not turn, it is solved for θ̈: share −
    Σ ratios·a, with a that of the parent. `lightness` is what a unit of effort adds to the share;
    `armature` is zero where there is none.
    """

    direction: int
    ratios: tuple[sp.Expr, ...]
    share: sp.Expr
    lightness: sp.Expr
    armature: sp.Expr

    def accelerated(self, tape: Scalars, parent: Acceleration) -> tuple[sp.Expr, Acceleration]:
        """θ̈ and the segment's acceleration, from the parent's at the joint; in working frames."""
        entries = parent.entries
        if self.armature != 0:
            pairs = zip(self.ratios, entries, strict=True)
            carried = sp.Add(*(tape.let(ratio * entry) for ratio, entry in pairs))
            relative = tape.let(self.share - carried)
            entries[self.direction] = tape.let(entries[self.direction] + relative)
            return relative, Acceleration.of(entries)
        rest = [
            tape.let(times(ratio, entry))
            for i, (ratio, entry) in enumerate(zip(self.ratios, entries, strict=True))
            if i != self.direction
        ]
        along = tape.less(self.share, *rest)
        relative = tape.let(along - entries[self.direction])
        entries[self.direction] = along
        return relative, Acceleration.of(entries)


@dataclass(frozen=True)
class Articulation:
    """A tree with every joint's equation solved, and the rest for the root.

    Entry k − 1 of a list is that of joint k: `transforms` take what is in the segment's working
    frame to its parent's, or to the frame in which the root's system is solved; `joints` are the
    equations; `felt` is what the parent feels of the subtree, in the segment's working frame.
    `root` is the whole tree in the frame in which the root's system is solved. The world holds the
    root's a but for the components `free`, so that it is at rest: `upward` (m/s²) against free
    fall.
    """

    tree: SegmentTree
    transforms: list[Transform]
    joints: list[SolvedJoint]
    felt: list[ArticulatedBody]
    root: ArticulatedBody
    free: tuple[int, ...]
    upward: sp.Expr

    @property
    def free_rows(self) -> list[list[sp.Expr]]:
        """The root's inertia, of the components of a that the world does not hold."""
        rows = self.root.inertia.rows
        return [[rows[i][j] for j in self.free] for i in self.free]

    @property
    def lift(self) -> sp.Expr:
        """The root's upward acceleration against free fall where the world holds it, else zero."""
        return sp.S.Zero if Z in self.free else self.upward

    def driving_load(self, tape: Scalars) -> list[sp.Expr]:
        """The root's load (6) less what the held acceleration takes."""
        if self.lift == 0:
            return self.root.load.entries
        pairs = zip(self.root.load.entries, self.root.inertia.rows, strict=True)
        return [tape.less(entry, tape.let(times(row[Z], self.lift))) for entry, row in pairs]

    def root_responses(self, tape: Scalars, loads: Sequence[Values]) -> list[list[sp.Expr]]:
        """The root's a (6), from Âa = p, for each p, with zeros for what the world holds.

        Raises `ZeroPivotError` where inertia is lacking.
        """
        rows = self.free_rows
        order, responses = minimum_degree(rows), []
        try:
            for load in loads:
                moved = solve_symmetric(tape, rows, [load[i] for i in self.free], order)
                by_component = dict(zip(self.free, moved, strict=True))
                responses.append([by_component.get(i, sp.S.Zero) for i in range(6)])
        except ZeroPivotError as error:
            unknown = (self.free[error.unknown] + 3) % 6
            raise ZeroPivotError(self.tree.joints + unknown) from None
        return responses

    def root_acceleration(self, tape: Scalars) -> Acceleration:
        """The root's a, with what the world holds; raises as `root_responses` does."""
        (entries,) = self.root_responses(tape, [self.driving_load(tape)])
        return Acceleration.of([*entries[:Z], tape.let(entries[Z] + self.lift), *entries[Z + 1 :]])

    @property
    def root_turns(self) -> list[Rotation]:
        """Rotations from the frame in which the root's system is solved to its group frame."""
        root = self.tree.segments[0]
        return [root_turn(self.tree), *([root.rotation] if self.tree.works_in_own_frame(0) else [])]


@dataclass(frozen=True)
class JointAcceleration:
    """θ̈ of a joint, with the accelerations of its segment without θ̈ and with it."""

    relative: sp.Expr
    carried: Acceleration
    acceleration: Acceleration


def articulated(
    tape: Scalars,
    tree: SegmentTree,
    motions: Sequence[Motion],
    thrust: Wrench,
    efforts: Values,
    armatures: Values,
    loads: Mapping[int, Wrench] = MappingProxyType({}),
    free: Sequence[int] = range(6),
    upward: sp.Expr = sp.S.Zero,
) -> Articulation:
    """Solve every joint's equation, from the leaves inwards.

    `motions` are what the rates alone make of the segments, in their working frames; `thrust` is
    about the root in its own frame (N, N m), `efforts` are of the joints (N m or N), `armatures` of
    what turns with each joint alone (kg m² or kg), and `loads` act on segments after the root, by
    their index, about the joint in the segment's own frame. `free` and `upward` are as of
    `Articulation`. Raises `ZeroPivotError` where one joint has no inertia to it.
    """
    transforms: list[Transform] = []
    for k, segment in enumerate(tree.segments[1:], start=1):
        turned = segment.parent == 0 and not root_turn(tree).is_identity
        rotations = [segment.rotation] if tree.works_in_own_frame(k) and not turned else []
        transforms.append([*rotations, *tree.transform_in(tape, k)])
    joints: list[SolvedJoint] = []
    felt: list[ArticulatedBody] = []
    received = [ArticulatedBody(NO_ARTICULATED_INERTIA, NO_WRENCH) for _ in tree.segments]
    for k in range(tree.joints, 0, -1):
        segment = tree.segments[k]
        with tape.group(f"articulated inertia and load of {tree.subtree_about_joint(k)}"):
            load = tree.to_working_frame(tape, k, loads[k]) if k in loads else NO_WRENCH
            body = received[k].plus(tape, _link(tape, tree, k, motions[k], load))
        with tape.group(f"equation of {segment.joint_name}, its acceleration eliminated"):
            joint, freed = _freed(tape, tree, k, body, efforts[k - 1], armatures[k - 1])
        joints.insert(0, joint)
        felt.insert(0, freed)
        parent = segment.parent
        with tape.group(f"articulated inertia and load of {tree.subtree_about_joint(parent)}"):
            freed = moved(tape, freed, transforms[k - 1])
            received[parent] = received[parent].plus(tape, freed)
    with tape.group(f"articulated inertia and load of {tree.subtree_words(0)}"):
        if not tree.works_in_own_frame(0):
            thrust = thrust.rotated(tape, tree.segments[0].rotation)
        base = _link(tape, tree, 0, motions[0], thrust)
        base = base.rotated(tape, root_turn(tree).inverse).plus(tape, received[0])
    return Articulation(tree, transforms, joints, felt, base, tuple(free), upward)


def accelerations_outward(
    tape: Scalars, articulation: Articulation
) -> tuple[Acceleration, list[JointAcceleration]]:
    """Acceleration of the root where its system is solved, and those of each joint outwards.

    The joints' are in the segments' working frames. Raises `ZeroPivotError` as `articulated` does.
    """
    with tape.group("acceleration of the base, by LDL^T"):
        moving = [articulation.root_acceleration(tape)]
    accelerations = []
    segments = articulation.tree.segments[1:]
    for segment, joint, transform in zip(
        segments, articulation.joints, articulation.transforms, strict=True
    ):
        with tape.group(f"acceleration of {segment.joint_name}"):
            carried = moving[segment.parent].passed_out(tape, transform)
            relative, acceleration = joint.accelerated(tape, carried)
        accelerations.append(JointAcceleration(relative, carried, acceleration))
        moving.append(acceleration)
    return moving[0], accelerations


def root_in_group_frame(
    tape: Scalars, articulation: Articulation, root: Acceleration
) -> Acceleration:
    """The root's acceleration in its group frame, from that where its system is solved."""
    with tape.group("acceleration of the base"):
        for rotation in articulation.root_turns:
            root = root.rotated(tape, rotation)
    return root


def _freed(
    tape: Scalars,
    tree: SegmentTree,
    k: int,
    body: ArticulatedBody,
    effort: sp.Expr,
    armature: sp.Expr,
) -> tuple[SolvedJoint, ArticulatedBody]:
    """Solve a joint's equation, ∂S/∂θ̈ = τ, and eliminate its acceleration.

    `body` is the subtree of segment k about the joint, in its working frame. The second result is
    what the parent feels of it: in the joint's direction nothing but the effort, where there is no
    armature. Raises `ZeroPivotError` where the acceleration has no inertia to it.
    """
    direction = tree.segments[k].direction
    column = body.inertia.rows[direction]
    if column[direction] == 0 and armature == 0:
        raise ZeroPivotError(k - 1)
    inverse = tape.let(1 / tape.let(column[direction] + armature))
    load = body.load.entries
    share = tape.let(tape.let(effort + load[direction]) * inverse)
    ratios = tuple(
        sp.S.One if i == direction and armature == 0 else tape.let(times(entry, inverse))
        for i, entry in enumerate(column)
    )
    left = Wrench.of(
        # Without armature nothing but the effort, which is what is left of entry − D·share.
        tape.let(times(armature, share) - effort)
        if i == direction
        else tape.less(entry, tape.let(times(column[i], share)))
        for i, entry in enumerate(load)
    )
    felt = body.inertia.without(tape, direction, ratios, armature)
    joint = SolvedJoint(direction, ratios, share, inverse, armature)
    return joint, ArticulatedBody(felt, left)


def _link(
    tape: Scalars, tree: SegmentTree, k: int, motion: Motion, applied: Wrench = NO_WRENCH
) -> ArticulatedBody:
    """Segment k by itself: its applied wrench less its 𝒮 and ℛ (eq. 6), in its working frame."""
    inertia = ArticulatedInertia.rigid(tape, tree.working_inertia(tape, k))
    inertial = link_wrench(tape, tree, k, motion)
    return ArticulatedBody(inertia, applied.plus(tape, inertial.opposite))


def root_turn(tree: SegmentTree) -> Rotation:
    """Rotation about z to the root's working frame from that in which the root's system is solved.

    Where the root has a single child, which turns the arm about the base normal through the origin,
    it is cheaper to turn the base against it than the arm's articulated inertia: a base of equal
    arms does not notice, and an arm in a plane keeps its zeros.
    """
    if len(tree.children[0]) == 1 and tree.works_in_own_frame(1):
        first = tree.segments[1]
        if not first.starts_group and first.step == ZERO:
            return first.rotation
    return NO_ROTATION
