"""What a change of a joint's coordinate or rate does, seen by all that turns with the joint.

Let a joint's coordinate change, and look on from what it carries. Nothing there has moved; but all
of it turns at an additional rate ε, and what would be at rest against the parent has an additional
acceleration ψ = (r̈, ω̇). In e, the joint's axis, which moves with ω, A and r̈ of the parent:

    revolute:   ε = ė = ω×e, ψ = (r̈×e + 2V×ė, ë) for the angle;  ε = e, ψ = (2V×e, 2ė) for its rate
    prismatic:  ε = 0, ψ = (ë, 0) for the travel;                 ε = 0, ψ = (2ė, 0) for its rate

with ë = Ae, and V the velocity of the joint against that of the root's origin, which the velocity
couplings count from. The parent feels a wrench: of ψ by the articulated inertia, of ε by the
coupling, of a spring or a damper by the joint's equation; and the wrench on what is carried is
turned or moved with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.derivation.articulated import (
    ArticulatedBody,
    Articulation,
    JointAcceleration,
    SolvedJoint,
)
from gibbs_codegen.derivation.motion import Acceleration, Motion
from gibbs_codegen.derivation.parameters import PassiveSymbols
from gibbs_codegen.derivation.subtree_couplings import couplings_inward, doubled_velocities
from gibbs_codegen.derivation.velocity_coupling import VelocityCoupling
from gibbs_codegen.symbolic.quick import times
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import (
    ZERO,
    Vector,
    Z,
    add,
    axis_vector,
    cross,
)

_TWO = sp.Integer(2)
_E = axis_vector(Z)
_NO_WRENCH = [sp.S.Zero] * 6


@dataclass(frozen=True)
class Perturbation:
    """A change at a joint, per unit, in the working frame of the joint's segment.

    `acceleration` is ψ and `turning` is ε; `effort` is what a spring or a damper adds to the joint,
    and `wrench` what the parent feels of it all, about the joint.
    """

    acceleration: Acceleration
    turning: Vector
    effort: sp.Expr
    wrench: list[sp.Expr]


@dataclass(frozen=True)
class JointPerturbations:
    """The changes of a joint's coordinate and of its rate; and ratios of its equation to ε."""

    coordinate: Perturbation
    rate: Perturbation
    turning_ratios: Vector


def convected_perturbations(
    tape: Scalars,
    articulation: Articulation,
    motions: Sequence[Motion],
    rates: Sequence[sp.Expr],
    accelerations: Sequence[JointAcceleration],
    passive: Sequence[PassiveSymbols],
) -> tuple[VelocityCoupling, list[JointPerturbations]]:
    """Velocity coupling of the whole tree, and the changes of the joints after the root.

    The coupling is where the root's system is solved. `motions` are what the rates alone make of
    the segments, in their working frames; `accelerations` are as of `accelerations_outward`.
    """
    doubled = doubled_velocities(tape, articulation, motions, rates)
    whole, couplings = couplings_inward(tape, articulation, doubled)
    found = []
    for k, segment in enumerate(articulation.tree.segments[1:], start=1):
        coupling, ratios = couplings[k - 1]
        joint, felt = articulation.joints[k - 1], articulation.felt[k - 1]
        carried, own = accelerations[k - 1].carried, passive[k - 1]
        is_revolute = segment.joint == "revolute"
        with tape.group(f"changes of {segment.joint_name} and of its rate"):
            if is_revolute:
                angle = _angle_change(tape, motions[k], doubled[k].linear, carried)
                rate = Acceleration(cross(tape, doubled[k].linear, _E), _axis_rate(doubled[k])), _E
            else:
                angle = Acceleration(_axis_acceleration(tape, motions[k], carried), ZERO), ZERO
                rate = Acceleration(_axis_rate(doubled[k]), ZERO), ZERO
            moving = _moving_along(tape, is_revolute, felt, carried)
            parts = (joint, felt, coupling)
            found.append(
                JointPerturbations(
                    _perturbation(tape, *parts, *angle, -own.stiffness, moving),
                    _perturbation(tape, *parts, *rate, -own.damping, _NO_WRENCH),
                    ratios,
                )
            )
    return whole, found


def _axis_rate(twice: Acceleration) -> Vector:
    """ω×e, or twice that."""
    x, y, _ = twice.angular
    return (y, -x, sp.S.Zero)


def _axis_acceleration(tape: Scalars, motion: Motion, carried: Acceleration) -> Vector:
    """ë = Ae, with what the accelerations add to A."""
    return add(tape, motion.gradient[Z], cross(tape, carried.angular, _E))


def _angle_change(
    tape: Scalars, motion: Motion, doubled: Vector, carried: Acceleration
) -> tuple[Acceleration, Vector]:
    """ψ and ε for the angle of a revolute joint.

    `motion` is what the rates alone make of the segment, `doubled` twice the velocity of the joint,
    and `carried` what the accelerations add, the joint's own left out; all in one frame.
    """
    x, y, _ = motion.omega
    turning = (y, -x, sp.S.Zero)
    acceleration = add(tape, motion.acceleration, carried.linear)
    linear = add(tape, cross(tape, acceleration, _E), cross(tape, doubled, turning))
    return Acceleration(linear, _axis_acceleration(tape, motion, carried)), turning


def _moving_along(
    tape: Scalars, is_revolute: bool, felt: ArticulatedBody, carried: Acceleration
) -> list[sp.Expr]:
    """What moves with the joint (6) of the wrench on all that it carries.

    A revolute joint turns the wrench; otherwise its point moves. `carried` is the joint's
    acceleration without its own.
    """
    rows, load, given = felt.inertia.rows, felt.load.entries, carried.entries
    wrench = [
        tape.let(sp.Add(*(tape.let(times(e, a)) for e, a in zip(row, given, strict=True))) - p)
        for row, p in zip(rows, load, strict=True)
    ]
    (f_x, f_y, _, n_x, n_y, _), zero = wrench, sp.S.Zero
    if is_revolute:
        return [-f_y, f_x, zero, -n_y, n_x, zero]
    return [zero, zero, zero, -f_y, f_x, zero]


def _perturbation(
    tape: Scalars,
    joint: SolvedJoint,
    felt: ArticulatedBody,
    coupling: VelocityCoupling,
    acceleration: Acceleration,
    turning: Vector,
    effort: sp.Expr,
    moving: Sequence[sp.Expr],
) -> Perturbation:
    """A change with the wrench that the parent feels of it; `acceleration` is ψ, `turning` is ε.

    `effort` is what a spring or a damper adds to the joint, `moving` what moves with it of the
    wrench.
    """
    six = zip(felt.inertia.rows, coupling.rows, joint.ratios, moving, strict=True)
    wrench = [
        tape.let(
            sp.Add(
                *(
                    tape.let(times(e, a))
                    for e, a in zip(inertia, acceleration.entries, strict=True)
                ),
                *(tape.let(times(b, e)) for b, e in zip(row, turning, strict=True)),
                tape.let(times(ratio, effort)),
                part,
            )
        )
        for inertia, row, ratio, part in six
    ]
    return Perturbation(acceleration, turning, effort, wrench)
