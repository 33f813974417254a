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

from gibbs_codegen.derivation.articulated_inertia import NO_ARTICULATED_INERTIA, ArticulatedInertia
from gibbs_codegen.derivation.inertia_forces import link_wrench
from gibbs_codegen.derivation.motion import Acceleration, Motion
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.symbolic.ldlt import ZeroPivotError, minimum_degree, solve_symmetric
from gibbs_codegen.symbolic.quick import times
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import (
    NO_ROTATION,
    NO_WRENCH,
    ZERO,
    Rotation,
    Transform,
    Vector,
    Wrench,
    moved,
)


@dataclass(frozen=True)
class ArticulatedBody:
    """Â and p of ½aᵀÂa − aᵀp: a link, or the subtree of a segment."""

    inertia: ArticulatedInertia
    load: Wrench

    def plus(self, tape: Scalars, other: ArticulatedBody) -> ArticulatedBody:
        """Both together about their common point.

        Args:
            other: About the same point, in the same frame.

        Returns:
            The sum.
        """
        inertia = self.inertia.plus(tape, other.inertia)
        return ArticulatedBody(inertia, self.load.plus(tape, other.load))

    def rotated(self, tape: Scalars, rotation: Rotation) -> ArticulatedBody:
        """The same in another frame.

        Args:
            rotation: Takes components in this frame to those in the other.

        Returns:
            The body in the frame that `rotation` turns from.
        """
        inertia = self.inertia.rotated(tape, rotation)
        return ArticulatedBody(inertia, self.load.rotated(tape, rotation))

    def shifted(self, tape: Scalars, arm: Vector) -> ArticulatedBody:
        """The same about another point.

        Args:
            arm: The old point from the new one (m), in the same frame.

        Returns:
            The body about the new point.
        """
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
        """The accelerations of the joint and of its segment, from that of the parent.

        Args:
            parent: The parent's acceleration, taken to the joint, in the segment's working frame.

        Returns:
            θ̈ (rad/s² or m/s²), and the segment's acceleration in the same frame.
        """
        entries = parent.entries
        if self.armature != 0:
            pairs = zip(self.ratios, entries, strict=True)
            given = sp.Add(*(tape.let(ratio * entry) for ratio, entry in pairs))
            relative = tape.let(self.share - given)
            entries[self.direction] = tape.let(entries[self.direction] + relative)
            return relative, Acceleration.of(entries)
        rest = [
            tape.let(ratio * entry)
            for i, (ratio, entry) in enumerate(zip(self.ratios, entries, strict=True))
            if i != self.direction
        ]
        own = tape.let(self.share - sp.Add(*rest))
        relative = tape.let(own - entries[self.direction])
        entries[self.direction] = own
        return relative, Acceleration.of(entries)


@dataclass(frozen=True)
class Articulation:
    """A tree with every joint's equation solved, and what is left for the root.

    Entry k − 1 of a list is that of joint k: `transforms` take what is in the segment's working
    frame to its parent's, or to the frame in which the root's system is solved; `joints` are the
    equations; `felt` is what the parent feels of the subtree, in the segment's working frame.
    `root` is the whole tree in the frame in which the root's system is solved.
    """

    tree: SegmentTree
    transforms: list[Transform]
    joints: list[SolvedJoint]
    felt: list[ArticulatedBody]
    root: ArticulatedBody

    def root_responses(
        self, tape: Scalars, loads: Sequence[Sequence[sp.Expr]]
    ) -> list[list[sp.Expr]]:
        """The root's accelerations, from Âa = p.

        Args:
            loads: Wrenches p on the root, six components each, where its system is solved.

        Returns:
            Six components of a for each.

        Raises:
            ZeroPivotError: Where one component has no inertia to it.
        """
        rows = self.root.inertia.rows
        order = minimum_degree(rows)
        try:
            return [solve_symmetric(tape, rows, load, order) for load in loads]
        except ZeroPivotError as error:
            raise ZeroPivotError(self.tree.joints + (error.unknown + 3) % 6) from None

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
    own: Acceleration


def articulated(
    tape: Scalars,
    tree: SegmentTree,
    motions: Sequence[Motion],
    thrust: Wrench,
    efforts: Sequence[sp.Expr],
    armatures: Sequence[sp.Expr],
    loads: Mapping[int, Wrench] = MappingProxyType({}),
) -> Articulation:
    """Solve every joint's equation, from the leaves inwards.

    Args:
        tree, motions: The tree, and the motion that the rates alone make of each segment, in its
            working frame.
        thrust: About the root, in its own frame (N, N m).
        efforts: The joints' torques or forces (N m or N).
        armatures: Inertia of what turns with each joint alone (kg m² or kg).
        loads: Wrenches on segments after the root, by their index, about the joint, in the
            segment's own frame (N, N m).

    Returns:
        The solved equations, and the root's system.

    Raises:
        ZeroPivotError: Where one joint has no inertia to it.
    """
    transforms = [_transform_in(tape, tree, k) for k in range(1, len(tree.segments))]
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
    return Articulation(tree, transforms, joints, felt, base)


def accelerations_outward(
    tape: Scalars, articulation: Articulation
) -> tuple[Acceleration, list[JointAcceleration]]:
    """Accelerations of the root and, from it outwards, of all joints.

    Args:
        articulation: The solved equations.

    Returns:
        The root's acceleration where its system is solved, and those of each joint after it, in
        the segment's working frame.

    Raises:
        ZeroPivotError: Where one component of the root's has no inertia to it.
    """
    with tape.group("acceleration of the base, by LDL^T"):
        (entries,) = articulation.root_responses(tape, [articulation.root.load.entries])
    moving = [Acceleration.of(entries)]
    found = []
    segments = articulation.tree.segments[1:]
    for segment, joint, transform in zip(
        segments, articulation.joints, articulation.transforms, strict=True
    ):
        with tape.group(f"acceleration of {segment.joint_name}"):
            carried = moving[segment.parent].passed_out(tape, transform)
            relative, own = joint.accelerated(tape, carried)
        found.append(JointAcceleration(relative, carried, own))
        moving.append(own)
    return moving[0], found


def root_in_group_frame(
    tape: Scalars, articulation: Articulation, root: Acceleration
) -> Acceleration:
    """The root's acceleration in its group frame.

    Args:
        articulation: The solved equations.
        root: The acceleration in the frame in which the root's system is solved.

    Returns:
        The same in the root's group frame.
    """
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

    Args:
        tree, k: The segment of the joint, by its index.
        body: Its subtree about the joint, in its working frame.
        effort: Torque or force of the joint (N m or N).
        armature: Inertia of what turns with the joint alone (kg m² or kg).

    Returns:
        The solved equation, and what the parent feels of the body: in the joint's direction nothing
        but the effort, where there is no armature.

    Raises:
        ZeroPivotError: Where the acceleration has no inertia to it.
    """
    direction = tree.segments[k].direction
    column = body.inertia.rows[direction]
    if column[direction] == 0 and armature == 0:
        raise ZeroPivotError(k - 1)
    inverse = tape.let(1 / tape.let(column[direction] + armature))
    load = body.load.entries
    share = tape.let(tape.let(effort + load[direction]) * inverse)
    ratios = tuple(
        sp.S.One if i == direction and armature == 0 else tape.let(entry * inverse)
        for i, entry in enumerate(column)
    )
    left = Wrench.of(
        # Without armature nothing but the effort, which is what is left of entry − D·share.
        tape.let(times(armature, share) - effort)
        if i == direction
        else tape.let(entry - tape.let(column[i] * share))
        for i, entry in enumerate(load)
    )
    felt = body.inertia.without(tape, direction, ratios, armature)
    joint = SolvedJoint(direction, ratios, share, inverse, armature)
    return joint, ArticulatedBody(felt, left)


def _link(
    tape: Scalars, tree: SegmentTree, k: int, motion: Motion, applied: Wrench = NO_WRENCH
) -> ArticulatedBody:
    """A segment by itself: what is applied to it less its 𝒮 and ℛ (eq. 6).

    Args:
        tree, k: The segment, by its index.
        motion: Its motion, in its working frame.
        applied: Wrench on it about its joint, in its working frame.

    Returns:
        The body about the joint, in the working frame.
    """
    inertia = ArticulatedInertia.rigid(tape, tree.working_inertia(tape, k))
    inertial = link_wrench(tape, tree, k, motion)
    return ArticulatedBody(inertia, applied.plus(tape, inertial.opposite))


def root_turn(tree: SegmentTree) -> Rotation:
    """Rotation to the root's working frame from that in which the root's system is solved.

    Where the root has a single child, which turns the arm about the base normal through the origin,
    it is cheaper to turn the base against it than the arm's articulated inertia: a base of equal
    arms does not notice, and an arm in a plane keeps its zeros.

    Args:
        tree: The tree.

    Returns:
        The rotation, about z.
    """
    if len(tree.children[0]) == 1 and tree.works_in_own_frame(1):
        first = tree.segments[1]
        if not first.starts_group and first.step == ZERO:
            return first.rotation
    return NO_ROTATION


def _transform_in(tape: Scalars, tree: SegmentTree, k: int) -> Transform:
    """The transform of a segment's body to its parent.

    Args:
        tree, k: The segment, by its index from 1.

    Returns:
        Rotations and shifts from the joint, in the segment's working frame, to the parent's joint
        in the parent's working frame or, at the root, in the frame in which the root's system is
        solved.
    """
    segment = tree.segments[k]
    turned = segment.parent == 0 and not root_turn(tree).is_identity
    own = [segment.rotation] if tree.works_in_own_frame(k) and not turned else []
    return [*own, *tree.transform_in(tape, k)]
