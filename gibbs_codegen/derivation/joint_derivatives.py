"""How the forces of joints depend on the angles and rates of joints, by composites carried inwards.

Every joint's column is passed in from group to group, towards the root. At a joint on the way its
wrenches have the entries of that joint's row; and what that joint's own motion consists of makes,
with the column's wrench, the entry on the other side of the diagonal. Joints of which neither
carries the other have zeros.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import sympy as sp

from gibbs_codegen.derivation.composite_inertia import composites_inward
from gibbs_codegen.derivation.group_passage import GroupPassage
from gibbs_codegen.derivation.inertia import Inertia
from gibbs_codegen.derivation.inertia_forces import before_joints, subtree_wrenches
from gibbs_codegen.derivation.moments import joint_velocities, subtree_moments
from gibbs_codegen.derivation.motion import Motion
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.derivation.unit_motions import STILL, Column, MovingBody, UnitMotion, column
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import ZERO, Vector, X, Y, Z, add

# Entries between joints by row and column: indices of segments, 1 or more.
Entries = dict[tuple[int, int], sp.Expr]


@dataclass(frozen=True)
class MovingTree:
    """A tree in motion: what each joint does, and what it carries.

    `composite` is the inertia of the whole tree about the root, in its group frame. `units` and
    `bodies` are those of each segment about its joint, in its group frame. The root does
    not move by itself, and its body has neither the mass of its own link nor B₀r̈.
    """

    tree: SegmentTree
    composite: Inertia
    units: list[UnitMotion]
    bodies: list[MovingBody]

    @classmethod
    def of(
        cls,
        tape: Scalars,
        tree: SegmentTree,
        root_motion: Motion,
        motions: Sequence[Motion],
        rates: Sequence[sp.Expr],
    ) -> MovingTree:
        """A tree by its motions.

        `root_motion` is of the root's group frame in its own axes, `motions` are those of the
        segments in their working frames.
        """
        before = before_joints(tape, tree, root_motion, motions)
        velocities = joint_velocities(tape, tree, before, motions, rates)
        composites = dict(composites_inward(tape, tree))
        moments = subtree_moments(tape, tree, motions, velocities)
        wrenches = subtree_wrenches(tape, tree, motions)
        bodies, units = [], [STILL]
        for k in range(len(tree.segments)):
            with tape.group(f"inertia forces of {tree.subtree_about_joint(k)}"):
                wrench = tree.to_group_frame(tape, k, wrenches[k])
            bodies.append(MovingBody(composites[k], moments[k], wrench))
        for k, segment in enumerate(tree.segments[1:], start=1):
            with tape.group(f"motion per unit of {segment.joint_name}"):
                if segment.joint == "prismatic":
                    units.append(UnitMotion.sliding(tape, before[k]))
                else:
                    velocity = velocities[k].before
                    units.append(UnitMotion.turning(tape, Z, before[k], velocity))
        others = (segment.inertia.mass for segment in tree.segments[1:])
        without_root = replace(composites[0], mass=tape.let(sp.Add(*others)))
        bodies[0] = replace(bodies[0], inertia=without_root)
        return cls(tree, composites[0], units, bodies)


@dataclass
class JointDerivatives:
    """Entries between joints of M and of the derivatives by q and v, and columns at the root.

    `columns` maps joints, by the index of their segment, to their column about the root, in its
    group frame.
    """

    columns: dict[int, Column] = field(default_factory=dict)
    mass: Entries = field(default_factory=dict)
    by_angle: Entries = field(default_factory=dict)
    by_rate: Entries = field(default_factory=dict)


def joint_derivatives(tape: Scalars, moving: MovingTree) -> JointDerivatives:
    """Derivatives of the forces of all joints by their angles and rates, and M between them."""
    tree, found = moving.tree, JointDerivatives()
    offsets = _offsets_from_lead(tape, tree)
    units = [unit.about(tape, arm) for unit, arm in zip(moving.units, offsets, strict=True)]
    leads = [k for k, segment in enumerate(tree.segments) if segment.starts_group]
    for lead in reversed(leads):
        joint = tree.segments[lead].joint_name or "the base"
        for i in filter(None, tree.subtree(lead)):
            with tape.group(f"derivatives, columns of the joints carried in to {joint}"):
                passage = GroupPassage.of(tape, tree, i, lead)
                own = found.columns.get(i) or column(tape, moving.units[i], moving.bodies[i])
                found.columns[i] = _passed_in(tape, tree, found, i, passage, own)
                for j in passage.way:
                    if 0 < j < i:
                        _add_row_entries(tape, tree, found, i, j, units)
    return found


def _add_row_entries(
    tape: Scalars,
    tree: SegmentTree,
    found: JointDerivatives,
    i: int,
    j: int,
    units: Sequence[UnitMotion],
) -> None:
    """Add to `found` the entries in the row of joint i and the column of joint j, which carries it.

    The column of joint i has come to j's group; `units` are about the leads of their groups.
    """
    own, motion = found.columns[i], units[j]
    by_angle = by_rate = sp.S.Zero
    joints = {tree.segments[i].joint, tree.segments[j].joint}
    planar = own.mass.moment[X] == own.mass.moment[Y] == 0
    if joints == {"revolute"} and tree.lead(i) == tree.lead(j) and not planar:
        # The joint itself has the same turn, and its own entries are on the diagonal. Of a planar
        # body there is less of the turn than of the difference.
        motion = motion.beyond(tape, units[i])
        by_angle, by_rate = found.by_angle[i, i], found.by_rate[i, i]
    found.by_angle[i, j] = tape.let(by_angle + own.by_angle(tape, motion))
    found.by_rate[i, j] = tape.let(by_rate + own.by_rate(tape, motion))


def _passed_in(
    tape: Scalars,
    tree: SegmentTree,
    found: JointDerivatives,
    i: int,
    passage: GroupPassage,
    own: Column,
) -> Column:
    """Pass column i in to the lead of a group, and put its entries where they belong.

    `own` is the column where the way begins; the result is about the lead, in the group frame.
    """
    at_lead = []
    for wrench, entries in (
        (own.mass, found.mass),
        (own.rate, found.by_rate),
        (own.angle, found.by_angle),
    ):
        along, last = passage.passed_in(tape, wrench)
        at_lead.append(last)
        for j, here in zip(passage.way, along, strict=True):
            if j > 0:
                entries[j, i] = tree.segments[j].row(here)
    mass, rate, angle = at_lead
    return Column(mass, rate, angle, passage.turned(tape, own.couple))


def _offsets_from_lead(tape: Scalars, tree: SegmentTree) -> list[Vector]:
    """Each joint from the lead of its group (m), in the group frame."""
    offsets: list[Vector] = []
    for k, segment in enumerate(tree.segments):
        offset = ZERO
        if not segment.starts_group:
            offset = add(tape, offsets[segment.parent], tree.step_in_group(tape, k))
        offsets.append(offset)
    return offsets
