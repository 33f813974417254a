"""Equations of motion of a tree on its root: mass matrix, residual, Gibbs function (eqs. 5, 11).

The same code derives a single open chain of the decomposition and the reduced system, which is the
arm on a root that has the sum of all chains' inertia: *sum before projecting*. Coordinates are
those of the root and of the joints of the segments, where the root places them.

Motions pass outwards over the tree and inertia forces inwards, which gives ∂S/∂θ̈ by recursion
(eqs. 5 and 6). The mass matrix comes from composite bodies, the inertias of all subtrees: a unit
acceleration of joint k moves the subtree of segment k as one rigid body. What that takes is a
wrench at joint k; its components along joint k and along the joints from there to the root are the
column of the mass matrix. All other joints have a zero there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import sympy as sp

from gibbs_codegen.derivation import gibbs
from gibbs_codegen.derivation.inertia import Inertia
from gibbs_codegen.derivation.motion import Motion, TreeState
from gibbs_codegen.derivation.root import Root
from gibbs_codegen.derivation.segment_tree import GroupPassage, SegmentTree
from gibbs_codegen.robot.layout import Places
from gibbs_codegen.symbolic.tape import Scalars, Values
from gibbs_codegen.symbolic.vectors import (
    NO_ROTATION,
    NO_WRENCH,
    Matrix,
    Wrench,
    axis_vector,
    zeros,
)


def outward(
    tape: Scalars, tree: SegmentTree, root_motion: Motion, moves: Sequence[Values]
) -> list[Motion]:
    """Motion of every segment, in its working frame.

    `root_motion` is of the root's group frame in its own axes. `moves` have rate and acceleration
    of each joint, and of a `ReferenceMotion` the reference's rate; the root's own are its turn
    about z against that frame.
    """
    motions: list[Motion] = []
    for k, segment in enumerate(tree.segments):
        with tape.group(f"motion of {segment.name}"):
            motion = _passed_out(tape, tree, k, motions[segment.parent]) if k else root_motion
            move = motion.spun if segment.joint == "revolute" else motion.slid
            motion = move(tape, *moves[k])
            if tree.works_in_own_frame(k):
                motion = motion.rotated(tape, segment.rotation.inverse)
        motions.append(motion)
    return motions


def _passed_out(tape: Scalars, tree: SegmentTree, k: int, motion: Motion) -> Motion:
    """Motion of segment k ≥ 1 before joint k moves, in its group frame, from its parent's."""
    segment = tree.segments[k]
    if segment.starts_group:
        motion = motion.rotated(tape, segment.turn.inverse)
        motion = motion.stepped(tape, NO_ROTATION, segment.step)
        motion = motion.rotated(tape, segment.twist.inverse)
    else:
        parent = tree.segments[segment.parent]
        motion = motion.stepped(tape, parent.rotation, segment.step)
    return motion.displaced(tape, axis_vector(2, segment.d))


def before_joints(
    tape: Scalars, tree: SegmentTree, root_motion: Motion, motions: Sequence[Motion]
) -> list[Motion]:
    """Motion of every segment before its joint moves it, in its group frame, from `outward`'s."""
    before = [root_motion]
    for k, segment in enumerate(tree.segments[1:], start=1):
        with tape.group(f"motion of {segment.name}"):
            before.append(_passed_out(tape, tree, k, motions[segment.parent]))
    return before


def link_wrench(tape: Scalars, tree: SegmentTree, k: int, motion: Motion) -> Wrench:
    """𝒮 and ℛ of segment k (eq. 6) about its joint, in its working frame (N, N m).

    The root's B₀r̈ is left out: regrouping brings most of the mass there, and it is cheapest in
    world axes.
    """
    segment = tree.segments[k]
    inertia = tree.working_inertia(tape, k)
    values = inertia.values
    if k == 0:
        values[gibbs.MASS] = sp.S.Zero
    values.update(zip(gibbs.ACCELERATION, motion.acceleration, strict=True))
    for j, column in enumerate(motion.gradient):
        values.update((gibbs.GRADIENT[i][j], entry) for i, entry in enumerate(column))
    force, moment = gibbs.link_partials_by_gradient()
    wrench = Wrench.of(tape.let(gibbs.evaluated(partial, values)) for partial in (*force, *moment))
    c_x, c_y, c_z = segment.inertia.moment
    if c_y == c_z == 0 and values[gibbs.MASS] == 0 and not tree.works_in_own_frame(k):
        # A rod: its 𝒮 is parallel to the step to the next joint, which the kinematics has.
        return Wrench(tape.scale(c_x, motion.along_x(tape, segment.rotation)), wrench.moment)
    return wrench


def inward(
    tape: Scalars,
    tree: SegmentTree,
    motions: Sequence[Motion],
    loads: Mapping[int, Wrench] = MappingProxyType({}),
) -> tuple[Wrench, list[sp.Expr]]:
    """∂S/∂θ̈ of the tree (eq. 5): 𝒮 and ℛ of it all at the root, and the rows of the joints.

    They are about the root in its group frame, without its B₀r̈, which the caller adds. The
    arguments are those of `subtree_wrenches`.
    """
    root, *others = subtree_wrenches(tape, tree, motions, loads)
    # Neither component along the joint is turned by what turns about it.
    rows = [s.row(wrench) for s, wrench in zip(tree.segments[1:], others, strict=True)]
    with tape.group(f"inertia forces of {tree.subtree_about_joint(0)}"):
        return tree.to_group_frame(tape, 0, root), rows


def subtree_wrenches(
    tape: Scalars,
    tree: SegmentTree,
    motions: Sequence[Motion],
    loads: Mapping[int, Wrench] = MappingProxyType({}),
) -> list[Wrench]:
    """𝒮 and ℛ of each segment with all that it supports: the wrench that its joint supplies.

    They are about the joint in the working frame, as `motions` are; the root's are without its
    B₀r̈. `loads` act on segments after the root, by their index, about the joint in the segment's
    own frame (N, N m), and are subtracted.
    """
    received = [NO_WRENCH for _ in tree.segments]
    for k in range(tree.joints, -1, -1):
        segment = tree.segments[k]
        with tape.group(f"inertia forces of {tree.subtree_about_joint(k)}"):
            wrench = link_wrench(tape, tree, k, motions[k]).plus(tape, received[k])
            if k in loads:
                load = tree.to_working_frame(tape, k, loads[k])
                wrench = wrench.plus(tape, load.opposite)
            received[k] = wrench
            if k > 0:
                wrench = tree.to_group_frame(tape, k, wrench)
        if k > 0:
            with tape.group(f"inertia forces of {tree.subtree_about_joint(segment.parent)}"):
                wrench = tree.passed_in(tape, k, wrench)
                received[segment.parent] = received[segment.parent].plus(tape, wrench)
    return received


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


def tree_motions(tape: Scalars, root: Root, tree: SegmentTree, state: TreeState) -> list[Motion]:
    """Motion of every segment, in its working frame."""
    base, joints = state.split(root.places(tree.joints))
    with tape.group(f"motion of {tree.segments[0].name}"):
        root_motion = root.frame_motion(tape, base)
    spins, turns = (filter(None, (x.rates, x.accelerations, x.references)) for x in (base, joints))
    moves = [[root.segment_spin(of_base) for of_base in spins], *zip(*turns, strict=True)]
    return outward(tape, tree, root_motion, moves)


def free_motions(tape: Scalars, root: Root, tree: SegmentTree, rates: Values) -> list[Motion]:
    """Motions that the rates alone make about an origin at rest: every θ̈ is zero.

    Rates of the position are left out; motions are in the segments' working frames.
    """
    return motions_about_origin(tape, root, tree, TreeState.coasting(rates))


def motions_about_origin(
    tape: Scalars, root: Root, tree: SegmentTree, state: TreeState
) -> list[Motion]:
    """Motions about the origin of the coordinates, as if it were at rest, in working frames."""
    rates, accelerations = [*state.rates], [*state.accelerations]
    places = root.places(tree.joints)
    for values in (rates, accelerations):
        for place in range(places.size)[places.position]:
            values[place] = sp.S.Zero
    return tree_motions(tape, root, tree, TreeState(rates, accelerations, state.gravity))


def generalised_inertia_forces(
    tape: Scalars, root: Root, tree: SegmentTree, state: TreeState
) -> list[sp.Expr]:
    """∂S/∂θ̈, row by row (eq. 5): M a − R, or −R where the accelerations are zero (N m or N)."""
    motions = tree_motions(tape, root, tree, state)
    wrench, joints = inward(tape, tree, motions)
    places, mass = root.places(tree.joints), tree.segments[0].inertia.mass
    base, _ = state.split(places)
    with tape.group("inertia forces on attitude and position"):
        *angular, x, y, z = root.rows(tape, wrench)
        moved = root.origin_acceleration(tape, base)
        linear = [tape.let(row + mass * r) for row, r in zip((x, y, z), moved, strict=True)]
    return places.joined([*angular, *linear], joints)


def gibbs_function(tape: Scalars, root: Root, tree: SegmentTree, state: TreeState) -> sp.Expr:
    """S of the tree up to terms free of accelerations (eqs. 2–3)."""
    terms = []
    for k, motion in enumerate(tree_motions(tape, root, tree, state)):
        with tape.group(f"Gibbs function of {tree.segments[k].name}"):
            values = tree.working_inertia(tape, k).values
            values.update(zip(gibbs.ACCELERATION, motion.acceleration, strict=True))
            values.update(zip(gibbs.OMEGA, motion.omega, strict=True))
            values.update(zip(gibbs.OMEGA_DOT, motion.omega_dot, strict=True))
            terms.append(tape.let(gibbs.evaluated(gibbs.link_gibbs_function(), values)))
    with tape.group("sum over the links"):
        return tape.let(sp.Add(*terms))


def mass_matrix(tape: Scalars, root: Root, tree: SegmentTree) -> Matrix:
    """Mass matrix of the tree in the order of its coordinates, both triangles.

    It is zero between joints of which neither supports the other.
    """
    inertia = joint_space_inertia(tape, tree)
    with tape.group("mass matrix of attitude and position"):
        root_block = root.mass_block(tape, inertia.composite)
    with tape.group("mass matrix between the joints and attitude and position"):
        rows = [root.rows(tape, wrench) for wrench in inertia.wrenches]
    entries = {(j + 1, k + 1): entry for (j, k), entry in inertia.entries.items()}
    entries |= {(k, j): entry for (j, k), entry in entries.items()}
    return assembled(root.places(tree.joints), root_block, rows, rows, entries)


# Entries between joints by row and column: indices of segments, 1 or more.
Entries = dict[tuple[int, int], sp.Expr]


def assembled(
    places: Places,
    block: Matrix,
    columns: Sequence[Values],
    rows: Sequence[Values],
    entries: Entries,
) -> Matrix:
    """A matrix in the order of v, of the base and the joints.

    `block` is that of the base by itself, `columns` are the joints' columns on the base, `rows` the
    joints' rows in its columns, and `entries` are between joints, by their segments.
    """
    base, joints = places.base, places.joint_places
    matrix = zeros(places.size, places.size)
    for i, values in zip(base, places.kept(block), strict=True):
        for j, entry in zip(base, places.kept(values), strict=True):
            matrix[i][j] = entry
    for joint, outer, inner in zip(joints, columns, rows, strict=True):
        pairs = zip(base, places.kept(outer), places.kept(inner), strict=True)
        for place, above, beside in pairs:
            matrix[place][joint], matrix[joint][place] = above, beside
    for (i, j), entry in entries.items():
        matrix[joints[i - 1]][joints[j - 1]] = entry
    return matrix
