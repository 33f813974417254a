"""Composite bodies: the inertia of every subtree, and the columns of the mass matrix from them.

A unit acceleration of joint k moves the subtree of segment k as one rigid body. What that takes is
a wrench at joint k; its components along joint k and along the joints from there to the root are
the column of the mass matrix. All other joints have a zero there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import sympy as sp

from gibbs_codegen.derivation.group_passage import GroupPassage
from gibbs_codegen.derivation.inertia import Inertia
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import Wrench

# Joints that a column of the mass matrix is passed in over before the next column is.
_JOINTS_AT_ONCE = 8


def whole_inertia(tape: Scalars, tree: SegmentTree) -> Inertia:
    """Inertia of the whole tree as one rigid body, about the root in its group frame."""
    *_, (_, whole) = composites_inward(tape, tree)
    return whole


def composites_inward(tape: Scalars, tree: SegmentTree) -> Iterator[tuple[int, Inertia]]:
    """Indices from last to first, with composite inertias about the joints, in group frames."""
    composites: dict[int, Inertia] = {}
    for k in range(tree.joints, -1, -1):
        with tape.group(f"composite inertia of {tree.subtree_about_joint(k)}"):
            inertia = tree.working_inertia(tape, k)
            for child in tree.children[k]:
                received = tree.passed_in(tape, child, composites.pop(child))
                inertia = inertia.plus(tape, received)
            composites[k] = tree.to_group_frame(tape, k, inertia)
        yield k, composites[k]


@dataclass(frozen=True)
class JointSpaceInertia:
    """The mass matrix before the root's coordinates are put in.

    `composite` is the inertia of the whole tree about the root and `wrenches` are the joints'
    columns there, both in the root's group frame. `entries` maps joints (i, j), i ≤ j, to their
    entry; a pair of joints of which neither supports the other is left out, its entry is zero.
    """

    composite: Inertia
    wrenches: list[Wrench]
    entries: dict[tuple[int, int], sp.Expr]


def with_armatures(
    tape: Scalars, inertia: JointSpaceInertia, armatures: Sequence[sp.Expr]
) -> JointSpaceInertia:
    """The mass matrix with the inertia of what turns with each joint alone (kg m² or kg)."""
    entries = dict(inertia.entries)
    with tape.group("mass matrix with the armature of the joints"):
        for j, armature in enumerate(armatures):
            entries[j, j] = tape.let(entries[j, j] + armature)
    return replace(inertia, entries=entries)


def joint_space_inertia(tape: Scalars, tree: SegmentTree) -> JointSpaceInertia:
    """Columns of the mass matrix for the joints after the root.

    From the leaves inwards, a few groups at a time, every column is passed in over them before the
    next few, so that the same statements follow one another once a column.
    """
    inertias: dict[int, Inertia] = {}
    columns: dict[int, Wrench] = {}
    entries: dict[tuple[int, int], sp.Expr] = {}
    inward = composites_inward(tape, tree)
    for leads in _few_groups(tree):
        while leads[-1] not in inertias:
            inertias.update([next(inward)])
        for k in range(max(leads[-1], 1), len(tree.segments)):
            way = [lead for lead in leads if lead in tree.path(k)]
            nearest = tree.segments[min(way, default=0)].joint_name or "the base"
            with tape.group(f"mass matrix, columns of the joints carried in to {nearest}"):
                for lead in way:
                    if k not in columns:
                        columns[k] = inertias[k].response(tape, tree.segments[k].direction)
                    passage = GroupPassage.of(tape, tree, k, lead)
                    along, columns[k] = passage.passed_in(tape, columns[k])
                    for j, wrench in zip(passage.way, along, strict=True):
                        if j > 0:
                            entries[j - 1, k - 1] = tree.segments[j].row(wrench)
    return JointSpaceInertia(inertias[0], [columns[k] for k in range(1, tree.joints + 1)], entries)


def _few_groups(tree: SegmentTree) -> Iterator[list[int]]:
    """The leads of the groups, the last first, those of a few joints at a time."""
    leads: list[int] = []
    joints = 0
    for k in range(tree.joints, -1, -1):
        joints += 1
        if tree.segments[k].starts_group:
            leads.append(k)
            if joints >= _JOINTS_AT_ONCE or k == 0:
                yield leads
                leads, joints = [], 0
