"""First and second moments of velocity of a link or of several as one: rotated, shifted and added.

With ẋ the velocity of a point against the origin of the coordinates, in axes that do not turn, and
ρ its place about a joint, P = ∫ẋ dm and D = ∫ρẋᵀdm are to velocities what the first and second
moments are to places. Derivatives need their doubles alone, which cost no more: what is doubled is
a parameter, or a rate that others have doubled too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import sympy as sp

from gibbs_codegen.derivation.articulated_inertia import Block, rotated_block
from gibbs_codegen.derivation.inertia import Inertia
from gibbs_codegen.derivation.motion import Motion
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import (
    ZERO,
    Rotation,
    Vector,
    Z,
    add,
    axis_vector,
    cross,
    scale,
)


@dataclass(frozen=True)
class Moments:
    """2P, and the rows of 2D about a point."""

    momentum: Vector
    rows: Block

    def plus(self, tape: Scalars, other: Moments) -> Moments:
        """Moments of both bodies about their common point.

        Args:
            other: About the same point, in the same frame.

        Returns:
            The sum.
        """
        first, second, third = (
            add(tape, mine, its) for mine, its in zip(self.rows, other.rows, strict=True)
        )
        return Moments(add(tape, self.momentum, other.momentum), (first, second, third))

    def rotated(self, tape: Scalars, rotation: Rotation) -> Moments:
        """The moments in another frame: P' = RP, D' = RDRᵀ.

        Args:
            rotation: Takes components in this frame to those in the other.

        Returns:
            The moments in the frame that `rotation` turns from.
        """
        if rotation.is_identity:
            return self
        rows = rotated_block(tape, rotation, self.rows)
        return Moments(rotation.vector(tape, self.momentum), rows)

    def shifted(self, tape: Scalars, arm: Vector) -> Moments:
        """The moments about another point: D' = D + rPᵀ.

        Args:
            arm: The old point from the new one (m), in the same frame.

        Returns:
            The moments about the new point.
        """
        first, second, third = (
            add(tape, row, scale(tape, r, self.momentum))
            for r, row in zip(arm, self.rows, strict=True)
        )
        return Moments(self.momentum, (first, second, third))


NO_MOMENTS = Moments(ZERO, (ZERO, ZERO, ZERO))


def link_moments(
    tape: Scalars, inertia: Inertia, omega: Vector, velocity: Vector, fixed: bool
) -> Moments:
    """Moments of one link: 2P = ω×2C + B₀2V, and row i of 2D is ω×2E_i + C_i2V.

    Args:
        inertia: About the link's joint.
        omega: Angular velocity (rad/s), in the same frame.
        velocity: 2V, twice the velocity of the joint (m/s), likewise.
        fixed: Whether the inertia is of parameters alone, which are doubled for nothing.

    Returns:
        The moments about the joint, in that frame.
    """
    rows = [tuple(inertia.entry(i, j) for j in range(3)) for i in range(3)]
    moment = inertia.moment
    if fixed:
        moment = scale(tape, sp.Integer(2), moment)
        rows = [scale(tape, sp.Integer(2), (x, y, z)) for x, y, z in rows]
    else:
        omega = scale(tape, sp.Integer(2), omega)
    momentum = add(tape, cross(tape, omega, moment), scale(tape, inertia.mass, velocity))
    first, second, third = (
        add(tape, cross(tape, omega, (x, y, z)), scale(tape, c, velocity))
        for (x, y, z), c in zip(rows, inertia.moment, strict=True)
    )
    return Moments(momentum, (first, second, third))


class JointVelocity(NamedTuple):
    """2V, twice the velocity of a joint against the origin (m/s).

    `before` is that of the point on the axis before the joint moves, in the segment's group frame,
    and `after` that of the segment's own point, in its working frame.
    """

    before: Vector
    after: Vector


def joint_velocities(
    tape: Scalars,
    tree: SegmentTree,
    before: Sequence[Motion],
    motions: Sequence[Motion],
    rates: Sequence[sp.Expr],
) -> list[JointVelocity]:
    """Velocities of all joints.

    Args:
        tree: The tree.
        before, motions: Motion of each segment before its joint moves it, in its group frame, and
            after, in its working frame.
        rates: Rate of every segment's joint (rad/s or m/s).

    Returns:
        The velocities of each segment's joint.
    """
    velocities = [JointVelocity(ZERO, ZERO)]
    for k, segment in enumerate(tree.segments[1:], start=1):
        with tape.group(f"velocity of {segment.joint_name}"):
            parent = velocities[segment.parent].after
            velocity = after = _passed_out(
                tape, tree, k, (motions[segment.parent].omega, before[k].omega), parent
            )
            if segment.joint == "prismatic":
                after = add(tape, velocity, axis_vector(Z, tape.let(2 * rates[k])))
            if tree.works_in_own_frame(k):
                after = segment.rotation.inverse.vector(tape, after)
        velocities.append(JointVelocity(velocity, after))
    return velocities


def _passed_out(
    tape: Scalars, tree: SegmentTree, k: int, turning: tuple[Vector, Vector], velocity: Vector
) -> Vector:
    """2V of joint k before it moves, from its parent's.

    Args:
        tree, k: The tree and the index of the segment, 1 or more.
        turning: Angular velocity of the parent, in its working frame and in the group frame of
            segment k (rad/s).
        velocity: 2V of the parent, in its working frame (m/s).

    Returns:
        The velocity in the group frame of segment k (m/s).
    """
    segment, two = tree.segments[k], sp.Integer(2)
    omega, omega_in_group = turning
    if not segment.starts_group:
        arm = tree.step_in_group(tape, k)
        return add(tape, velocity, cross(tape, scale(tape, two, omega), arm))
    omega = segment.turn.inverse.vector(tape, omega)
    velocity = segment.turn.inverse.vector(tape, velocity)
    velocity = add(tape, velocity, cross(tape, omega, scale(tape, two, segment.step)))
    velocity = segment.twist.inverse.vector(tape, velocity)
    along = axis_vector(Z, tape.let(2 * segment.d))
    return add(tape, velocity, cross(tape, omega_in_group, along))


def subtree_moments(
    tape: Scalars,
    tree: SegmentTree,
    motions: Sequence[Motion],
    velocities: Sequence[JointVelocity],
) -> list[Moments]:
    """Moments of every segment and all that it supports.

    Args:
        tree: The tree.
        motions: Motion of each segment, in its working frame.
        velocities: 2V of each segment.

    Returns:
        The moments about each segment's joint, in its group frame.
    """
    moments = [NO_MOMENTS for _ in tree.segments]
    for k in range(tree.joints, -1, -1):
        with tape.group(f"moments of velocity of {tree.subtree_about_joint(k)}"):
            fixed = tree.works_in_own_frame(k)
            inertia = tree.working_inertia(tape, k)
            own = link_moments(tape, inertia, motions[k].omega, velocities[k].after, fixed)
            for child in tree.children[k]:
                own = own.plus(tape, tree.passed_in(tape, child, moments[child]))
            moments[k] = tree.to_group_frame(tape, k, own)
    return moments
