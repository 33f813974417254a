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
        """Moments of both bodies about their common point, in one frame."""
        first, second, third = (
            add(tape, mine, its) for mine, its in zip(self.rows, other.rows, strict=True)
        )
        return Moments(add(tape, self.momentum, other.momentum), (first, second, third))

    def rotated(self, tape: Scalars, rotation: Rotation) -> Moments:
        """The same in another frame, to which `rotation` takes components: P' = RP, D' = RDRᵀ."""
        if rotation.is_identity:
            return self
        rows = rotated_block(tape, rotation, self.rows)
        return Moments(rotation.vector(tape, self.momentum), rows)

    def shifted(self, tape: Scalars, arm: Vector) -> Moments:
        """The moments about another point: D' = D + rPᵀ; r, `arm`, is the old from the new (m)."""
        first, second, third = (
            add(tape, row, scale(tape, r, self.momentum))
            for r, row in zip(arm, self.rows, strict=True)
        )
        return Moments(self.momentum, (first, second, third))


NO_MOMENTS = Moments(ZERO, (ZERO, ZERO, ZERO))


def link_moments(
    tape: Scalars, inertia: Inertia, omega: Vector, velocity: Vector, fixed: bool
) -> Moments:
    """Moments of one link about its joint: 2P = ω×2C + B₀2V, and row i of 2D is ω×2E_i + C_i2V.

    `velocity` is 2V, twice the velocity of the joint; `fixed` says that the inertia is of
    parameters alone, which are doubled for nothing.
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
    """2V of all joints; `before` and `motions` are the segments' before and after joints move."""
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
    """2V of joint k ≥ 1 before it moves, in the group frame of segment k, from its parent's (m/s).

    `turning` is ω of the parent in its working frame and in that group frame (rad/s); `velocity` is
    2V of the parent in its working frame.
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
    """Moments of each segment and all that it supports, about its joint in its group frame."""
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
