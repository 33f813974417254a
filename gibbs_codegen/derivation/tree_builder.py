"""From links to a tree of segments: which joints share a group frame, and how each is turned in it.

A link whose joint axis is parallel to its parent's (no twist) belongs to its parent's group. But
where a sibling is twisted, the parent works in its own frame, so there all siblings start groups.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction

import sympy as sp

from gibbs_codegen.derivation.inertia import Inertia
from gibbs_codegen.derivation.segment_tree import Segment, SegmentTree
from gibbs_codegen.robot.model import JointKind
from gibbs_codegen.symbolic.exact_angles import radians
from gibbs_codegen.symbolic.tape import Scalars, Stage
from gibbs_codegen.symbolic.vectors import Rotation, Vector, X, Z


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
    turn_deg: Fraction
    step: Vector
    alpha_deg: Fraction
    d: sp.Expr
    theta_deg: Fraction
    name: str
    joint_name: str


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
