"""Velocity couplings of all subtrees: velocities outwards, and couplings inwards.

All velocities are against that of the root's origin, and doubled, as the couplings take them.
"""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from gibbs_codegen.derivation.articulated import Articulation, root_turn
from gibbs_codegen.derivation.motion import Acceleration, Motion
from gibbs_codegen.derivation.velocity_coupling import NO_COUPLING, VelocityCoupling
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import ZERO, Vector, Z, add, axis_vector, moved, scale

_TWO = sp.Integer(2)


def doubled_velocities(
    tape: Scalars,
    articulation: Articulation,
    motions: Sequence[Motion],
    rates: Sequence[sp.Expr],
) -> list[Acceleration]:
    """2V and 2ω of every segment's joint against the root's origin, in its working frame.

    Those of the root are where its system is solved. `motions` are in the working frames too.
    """
    tree = articulation.tree
    turn = root_turn(tree).inverse
    found = [Acceleration(ZERO, scale(tape, _TWO, turn.vector(tape, motions[0].omega)))]
    for k, segment in enumerate(tree.segments[1:], start=1):
        with tape.group(f"velocity of {segment.joint_name}"):
            there = found[segment.parent].passed_out(tape, articulation.transforms[k - 1])
            linear = there.linear
            if segment.joint == "prismatic":
                linear = add(tape, linear, axis_vector(Z, tape.let(2 * rates[k - 1])))
            found.append(Acceleration(linear, scale(tape, _TWO, motions[k].omega)))
    return found


def couplings_inward(
    tape: Scalars, articulation: Articulation, doubled: Sequence[Acceleration]
) -> tuple[VelocityCoupling, list[tuple[VelocityCoupling, Vector]]]:
    """Velocity couplings of all subtrees, from the leaves inwards.

    The first is that of the whole tree where the root's system is solved; then comes for each joint
    after the root, in the segment's working frame, what the parent feels, with the ratios of the
    joint's acceleration to −ε. `doubled` is as of `doubled_velocities`.
    """
    tree = articulation.tree
    received = [NO_COUPLING for _ in tree.segments]
    felt: list[tuple[VelocityCoupling, Vector]] = []
    for k in range(tree.joints, -1, -1):
        with tape.group(f"velocity coupling of {tree.subtree_about_joint(k)}"):
            inertia = tree.working_inertia(tape, k)
            if k == 0:
                inertia = inertia.rotated(tape, root_turn(tree).inverse)
            twice = doubled[k]
            own = VelocityCoupling.rigid(tape, inertia, twice.angular, twice.linear)
            whole = own.plus(tape, received[k])
            if k == 0:
                break
            joint, parent = articulation.joints[k - 1], tree.segments[k].parent
            ratios = scale(tape, joint.lightness, whole.rows[joint.direction])
            left = scale(tape, joint.armature, ratios)
            freed = whole.without(tape, joint.direction, joint.ratios, left)
            felt.insert(0, (freed, ratios))
            passed = moved(tape, freed, articulation.transforms[k - 1])
            received[parent] = received[parent].plus(tape, passed)
    return whole, felt
