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
class _Body:
    """Â and p of ½aᵀÂa − aᵀp: a link, or the subtree of a segment."""

    inertia: ArticulatedInertia
    load: Wrench

    def plus(self, tape: Scalars, other: _Body) -> _Body:
        return _Body(self.inertia.plus(tape, other.inertia), self.load.plus(tape, other.load))

    def rotated(self, tape: Scalars, rotation: Rotation) -> _Body:
        return _Body(self.inertia.rotated(tape, rotation), self.load.rotated(tape, rotation))

    def shifted(self, tape: Scalars, arm: Vector) -> _Body:
        return _Body(self.inertia.shifted(tape, arm), self.load.shifted(tape, arm))


@dataclass(frozen=True)
class _Joint:
    """A joint's equation, solved for its own component of a: a_d = share − Σ ratios·(the rest).

    Where the joint has armature, which the parent does not turn, it is solved for θ̈: share −
    Σ ratios·a, with a that of the parent.
    """

    direction: int
    ratios: tuple[sp.Expr, ...]
    share: sp.Expr
    has_armature: bool = False

    def accelerated(self, tape: Scalars, parent: Acceleration) -> tuple[sp.Expr, Acceleration]:
        """The accelerations of the joint and of its segment, from that of the parent.

        Args:
            parent: The parent's acceleration, taken to the joint, in the segment's working frame.

        Returns:
            θ̈ (rad/s² or m/s²), and the segment's acceleration in the same frame.
        """
        entries = parent.entries
        if self.has_armature:
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


def articulated_accelerations(
    tape: Scalars,
    tree: SegmentTree,
    motions: Sequence[Motion],
    thrust: Wrench,
    efforts: Sequence[sp.Expr],
    armatures: Sequence[sp.Expr],
    loads: Mapping[int, Wrench] = MappingProxyType({}),
) -> tuple[list[sp.Expr], Acceleration]:
    """Accelerations of the joints and of the root.

    Args:
        tree, motions: The tree, and the motion that the rates alone make of each segment, in its
            working frame.
        thrust: About the root, in its own frame (N, N m).
        efforts: The joints' torques or forces (N m or N).
        armatures: Inertia of what turns with each joint alone (kg m² or kg).
        loads: Wrenches on segments after the root, by their index, about the joint, in the
            segment's own frame (N, N m).

    Returns:
        θ̈ of each joint after the root, and the root's acceleration in its group frame.

    Raises:
        ZeroPivotError: Where one acceleration has no inertia to it. Unknowns are numbered joints
            first, then ω̇ and r̈ of the root.
    """
    transforms = [_transform_in(tape, tree, k) for k in range(1, len(tree.segments))]
    joints: list[_Joint] = []
    received = [_Body(NO_ARTICULATED_INERTIA, NO_WRENCH) for _ in tree.segments]
    for k in range(tree.joints, 0, -1):
        segment = tree.segments[k]
        with tape.group(f"articulated inertia and load of {tree.subtree_about_joint(k)}"):
            load = tree.to_working_frame(tape, k, loads[k]) if k in loads else NO_WRENCH
            body = received[k].plus(tape, _link(tape, tree, k, motions[k], load))
        with tape.group(f"equation of {segment.joint_name}, its acceleration eliminated"):
            joint, freed = _freed(tape, tree, k, body, efforts[k - 1], armatures[k - 1])
        joints.append(joint)
        parent = segment.parent
        with tape.group(f"articulated inertia and load of {tree.subtree_about_joint(parent)}"):
            freed = moved(tape, freed, transforms[k - 1])
            received[parent] = received[parent].plus(tape, freed)
    moving = [_root_acceleration(tape, tree, motions[0], thrust, received[0])]
    accelerations = []
    steps = zip(tree.segments[1:], reversed(joints), transforms, strict=True)
    for segment, joint, transform in steps:
        with tape.group(f"acceleration of {segment.joint_name}"):
            parent_moving = moving[segment.parent].passed_out(tape, transform)
            relative, own = joint.accelerated(tape, parent_moving)
        accelerations.append(relative)
        moving.append(own)
    with tape.group("acceleration of the base"):
        root = moving[0].rotated(tape, _root_turn(tree))
        if tree.works_in_own_frame(0):
            root = root.rotated(tape, tree.segments[0].rotation)
    return accelerations, root


def _root_acceleration(
    tape: Scalars, tree: SegmentTree, motion: Motion, thrust: Wrench, received: _Body
) -> Acceleration:
    """The root's acceleration, from Âa = p.

    Args:
        tree, motion: The tree, and the root's motion in its working frame.
        thrust: What drives it, about the root in its own frame.
        received: What its children add, in the frame in which the system is solved.

    Returns:
        The acceleration in the frame in which the system is solved.

    Raises:
        ZeroPivotError: Where one component has no inertia to it.
    """
    with tape.group(f"articulated inertia and load of {tree.subtree_words(0)}"):
        if not tree.works_in_own_frame(0):
            thrust = thrust.rotated(tape, tree.segments[0].rotation)
        base = _link(tape, tree, 0, motion, thrust)
        base = base.rotated(tape, _root_turn(tree).inverse).plus(tape, received)
    with tape.group("acceleration of the base, by LDL^T"):
        rows, load = base.inertia.rows, base.load.entries
        try:
            return Acceleration.of(solve_symmetric(tape, rows, load, minimum_degree(rows)))
        except ZeroPivotError as error:
            raise ZeroPivotError(tree.joints + (error.unknown + 3) % 6) from None


def _freed(
    tape: Scalars, tree: SegmentTree, k: int, body: _Body, effort: sp.Expr, armature: sp.Expr
) -> tuple[_Joint, _Body]:
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
    ratios = tuple(tape.let(entry * inverse) for entry in column)
    if armature != 0:
        left = Wrench.of(
            tape.let(entry - tape.let(u * share)) for entry, u in zip(load, column, strict=True)
        )
        felt = body.inertia.less(tape, direction, ratios)
        return _Joint(direction, ratios, share, has_armature=True), _Body(felt, left)
    left = Wrench.of(
        -effort if i == direction else tape.let(entry - tape.let(column[i] * share))
        for i, entry in enumerate(load)
    )
    inertia = body.inertia.without(tape, direction, ratios)
    return _Joint(direction, ratios, share), _Body(inertia, left)


def _link(
    tape: Scalars, tree: SegmentTree, k: int, motion: Motion, applied: Wrench = NO_WRENCH
) -> _Body:
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
    return _Body(inertia, applied.plus(tape, inertial.opposite))


def _root_turn(tree: SegmentTree) -> Rotation:
    """Rotation to the root's working frame from that in which the root's system is solved.

    Where the root has a single child, which turns the arm about the base normal through the origin,
    it is cheaper to turn the base against it than the arm's articulated inertia: a base of equal
    arms does not notice, and an arm in a plane keeps its zeros.
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
    turned = segment.parent == 0 and not _root_turn(tree).is_identity
    own = [segment.rotation] if tree.works_in_own_frame(k) and not turned else []
    return [*own, *tree.transform_in(tape, k)]
