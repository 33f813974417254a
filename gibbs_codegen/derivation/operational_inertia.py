"""Operational-space inertias: how each segment of a tree gives way to a wrench on itself.

The inverse Y of the inertia that is felt there, all joints free, passes outwards from the root's.
In a frame fixed to the parent it only moves; a joint along s, with the ratios u of its equation and
an inertia D, gives the segment (1 − suᵀ)·Y·(1 − usᵀ) + ssᵀ/D.
"""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from gibbs_codegen.derivation.acceleration_column import sum_of_products
from gibbs_codegen.derivation.articulated import SolvedJoint
from gibbs_codegen.derivation.articulated_inertia import ArticulatedInertia
from gibbs_codegen.derivation.motion import Acceleration
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.symbolic.tape import Scalars, times
from gibbs_codegen.symbolic.vectors import Rotation, Transform, minus, moved

Rows = Sequence[Sequence[sp.Expr]]
# Joints inboard of a joint, on average, beyond which its parent's inertia is taken to be shorter.
# The operations are not counted: near the limit both ways take about as many.
_FEW = 6


def inertia_is_shorter(tree: SegmentTree) -> bool:
    """Whether operational-space inertias are likely to take fewer operations.

    That is estimated from how many joints are inboard of a joint; neither way is counted.
    """
    return sum(len(tree.path(k)) - 2 for k in range(1, len(tree.segments))) > _FEW * tree.joints


def passed_out(tape: Scalars, inverse: ArticulatedInertia, transform: Transform) -> Rows:
    """Y of a segment at a child's joint: rows in the child's working frame, r̈ first.

    An acceleration (ω̇, r̈) moves outwards as a wrench (force, moment) moves inwards; so does Y,
    with ω̇ before r̈. `transform` takes what is in the child's working frame to the segment's.
    """
    steps = [
        step.inverse if isinstance(step, Rotation) else minus(step) for step in reversed(transform)
    ]
    return _other_half_first(moved(tape, inverse, steps).rows).rows


def response(tape: Scalars, rows: Rows, wrench: Sequence[sp.Expr]) -> Acceleration:
    """A parent's acceleration at a joint that takes a wrench from it; rows as of `passed_out`."""
    return Acceleration.of([-sum_of_products(tape, row, wrench) for row in rows])


def with_joint(tape: Scalars, joint: SolvedJoint, rows: Rows) -> ArticulatedInertia:
    """Accelerations of a segment per unit of wrench, ω̇ first, from the parent's at the joint."""
    direction, ratios = joint.direction, joint.ratios
    rest = [sp.S.Zero if i == direction else ratio for i, ratio in enumerate(ratios)]
    left = tape.let(times(joint.armature, joint.lightness))  # 1 − u_d, which would cancel.
    given = [
        tape.let(times(left, row[direction]) - sum_of_products(tape, row, rest)) for row in rows
    ]
    other = [sp.S.Zero if i == direction else entry for i, entry in enumerate(given)]
    squares = times(left, given[direction]) - sum_of_products(tape, rest, other)
    own = tape.let(squares + joint.lightness)

    def entry(i: int, j: int) -> sp.Expr:
        if i == j == direction:
            return own
        if direction in (i, j):
            return given[j if i == direction else i]
        return rows[i][j]

    return _other_half_first(ArticulatedInertia.of_entries(entry).rows)


def _other_half_first(rows: Rows) -> ArticulatedInertia:
    """A symmetric matrix with ω̇ before r̈, or back."""
    return ArticulatedInertia.of_entries(lambda i, j: rows[(i + 3) % 6][(j + 3) % 6])
