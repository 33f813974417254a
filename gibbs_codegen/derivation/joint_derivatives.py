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
from gibbs_codegen.derivation.unit_motions import Column, MovingBody, UnitMotion, column
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import ZERO, Vector, Z, add

# Entries between joints by row and column: indices of segments, 1 or more.
Entries = dict[tuple[int, int], sp.Expr]


@dataclass(frozen=True)
class MovingTree:
    """A tree in motion: what each joint does, and what it carries.

    `composite` is the inertia of the whole tree about the root, in its group frame. `units` and
    `bodies` are those of each segment about its joint, in its group frame. The unit of the root is
    not used, and its body has neither the mass of the root's own link nor its B₀r̈.
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

        Args:
            tree: The tree.
            root_motion: Motion of the root's group frame, in its own axes.
            motions: Motion of each segment, in its working frame.
            rates: Rate of every segment's joint (rad/s or m/s).

        Returns:
            The tree in motion.
        """
        before = before_joints(tape, tree, root_motion, motions)
        velocities = joint_velocities(tape, tree, before, motions, rates)
        composites = dict(composites_inward(tape, tree))
        moments = subtree_moments(tape, tree, motions, velocities)
        wrenches = subtree_wrenches(tape, tree, motions)
        units, bodies = [], []
        for k, segment in enumerate(tree.segments):
            with tape.group(f"inertia forces of {tree.subtree_about_joint(k)}"):
                wrench = tree.to_group_frame(tape, k, wrenches[k])
            bodies.append(MovingBody(composites[k], moments[k], wrench))
            with tape.group(f"what {segment.joint_name} does per unit"):
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
    """Derivatives of the forces of all joints by their angles and rates, and M between them.

    Args:
        moving: The tree in motion.

    Returns:
        The entries, and the columns at the root.
    """
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
                        found.by_angle[i, j] = found.columns[i].by_angle(tape, units[j])
                        found.by_rate[i, j] = found.columns[i].by_rate(tape, units[j])
    return found


def _passed_in(
    tape: Scalars,
    tree: SegmentTree,
    found: JointDerivatives,
    i: int,
    passage: GroupPassage,
    own: Column,
) -> Column:
    """Pass a column in to the lead of a group, and put its entries where they belong.

    Args:
        tree: The tree.
        found: What the entries are added to.
        i: Index of the column's segment.
        passage: The way into and through the group.
        own: The column where the way begins.

    Returns:
        The column about the lead, in the group frame.
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
