"""Inverse dynamics, the forces that accelerations take, and its derivatives, with M and C.

    ∂τ/∂q,  ∂τ/∂v,  M  and  τ  of  τ = M a − R

are derived in one pass. Derivatives by q are in the tangent space: of δ ↦ τ(q ⊕ δ) at zero, which
with Tait–Bryan angles are the partial derivatives.

Every joint's column is passed in from group to group, towards the root. At a joint on the way its
wrenches have the entries of that joint's row; and what that joint's own motion consists of makes,
with the column's wrench, the entry on the other side of the diagonal. Joints of which neither
carries the other have zeros.

The Coriolis matrix C has C v for velocity terms, and Ṁ − 2C is skew-symmetric:

    M_ij = ∫ξ_i·ξ_j dm,    C_ij = ∫ξ_i·ξ̇_j dm,    Ṁ_ij = C_ij + C_ji

with ξ_j the velocities that a unit of v_j makes. Twice that are the derivatives of the forces by v,
or nearly so where the base's velocities are in its own frame. So C is what these are for half of
the inertias.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import sympy as sp

from gibbs_codegen.derivation import tree_dynamics
from gibbs_codegen.derivation.inertia import Inertia
from gibbs_codegen.derivation.passive import passive_forces, passive_symbols, spring_slopes
from gibbs_codegen.derivation.root import BaseDerivatives
from gibbs_codegen.derivation.segment_tree import GroupPassage, SegmentTree
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.unit_motions import (
    STILL,
    Column,
    MovingBody,
    UnitMotion,
    column,
    joint_velocities,
    subtree_moments,
)
from gibbs_codegen.symbolic.tape import Scalars, Stage, Vector
from gibbs_codegen.symbolic.vectors import ZERO, Matrix, X, Y, Z


def inverse_dynamics(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """M a − R = ∂S/∂θ̈ at the given accelerations (N m or N), in the order of v."""
    tape = symbolic.tape
    forces = tree_dynamics.generalised_inertia_forces(
        tape, symbolic.root, symbolic.reduced_tree, symbolic.state
    )
    return with_joint_forces(symbolic, forces)


def with_joint_forces(symbolic: SymbolicRobot, forces: Sequence[sp.Expr]) -> list[sp.Expr]:
    """Forces that accelerations of the bodies take, and what the joints by themselves take."""
    tape = symbolic.tape
    base, joints = symbolic.places.split(forces)
    a = symbolic.joint_state.accelerations
    parts = zip(joints, a, passive_symbols(symbolic), passive_forces(symbolic), strict=True)
    with tape.group("forces of the joints with their armature, dampers and springs"):
        joint_forces = [tape.let(f + joint.armature * x - push) for f, x, joint, push in parts]
    return symbolic.places.joined(base, joint_forces)


@dataclass(frozen=True)
class MovingTree:
    """A tree in motion: the motion of each joint, and the bodies that it carries.

    `composite` is the inertia of the whole tree about the root, in its group frame. `units` and
    `bodies` are those of each segment about its joint, in its group frame. The root does
    not move by itself, and its body has neither the mass of its own link nor B₀r̈.
    """

    tree: SegmentTree
    composite: Inertia
    units: list[UnitMotion]
    bodies: list[MovingBody]

    @classmethod
    def of(cls, symbolic: SymbolicRobot, tree: SegmentTree) -> MovingTree:
        """A tree in the motion that the state says."""
        tape, root, base = symbolic.tape, symbolic.root, symbolic.base_state
        motions = tree_dynamics.tree_motions(tape, root, tree, symbolic.state)
        root_motion = root.frame_motion(tape, base)
        rates = [root.segment_spin(base.rates), *symbolic.joint_state.rates]
        before = tree_dynamics.before_joints(tape, tree, root_motion, motions)
        velocities = joint_velocities(tape, tree, before, motions, rates)
        composites = dict(tree_dynamics.composites_inward(tape, tree))
        moments = subtree_moments(tape, tree, motions, velocities)
        wrenches = tree_dynamics.subtree_wrenches(tape, tree, motions)
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
    mass: tree_dynamics.Entries = field(default_factory=dict)
    by_angle: tree_dynamics.Entries = field(default_factory=dict)
    by_rate: tree_dynamics.Entries = field(default_factory=dict)

    def pass_in(
        self, tape: Scalars, tree: SegmentTree, i: int, passage: GroupPassage, first: Column
    ) -> None:
        """Pass column i in to the lead of a group, and put its entries where they belong.

        `first` is the column where the way begins; then it is about the lead, in the group
        frame.
        """
        at_lead = []
        for wrench, entries in (
            (first.mass, self.mass),
            (first.rate, self.by_rate),
            (first.angle, self.by_angle),
        ):
            along, last = passage.passed_in(tape, wrench)
            at_lead.append(last)
            for j, here in zip(passage.way, along, strict=True):
                if j > 0:
                    entries[j, i] = tree.segments[j].row(here)
        mass, rate, angle = at_lead
        self.columns[i] = Column(mass, rate, angle, passage.turned(tape, first.couple))

    def add_row_entries(
        self, tape: Scalars, tree: SegmentTree, i: int, j: int, units: Sequence[UnitMotion]
    ) -> None:
        """Add the entries in the row of joint i and the column of joint j, which carries it.

        The column of joint i has come to j's group; `units` are about the leads of their groups.
        """
        carried, motion = self.columns[i], units[j]
        by_angle = by_rate = sp.S.Zero
        joints = {tree.segments[i].joint, tree.segments[j].joint}
        planar = carried.mass.moment[X] == carried.mass.moment[Y] == 0
        if joints == {"revolute"} and tree.lead(i) == tree.lead(j) and not planar:
            # The joint itself has the same turn, and its own entries are on the diagonal. Of a
            # planar body there is less of the turn than of the difference.
            motion = motion.beyond(tape, units[i])
            by_angle, by_rate = self.by_angle[i, i], self.by_rate[i, i]
        self.by_angle[i, j] = tape.let(by_angle + carried.by_angle(tape, motion))
        self.by_rate[i, j] = tape.let(by_rate + carried.by_rate(tape, motion))


def joint_derivatives(tape: Scalars, moving: MovingTree) -> JointDerivatives:
    """Derivatives of the forces of all joints by their angles and rates, and M between them."""
    tree, forces = moving.tree, JointDerivatives()
    # Each joint from the lead of its group (m), in the group frame.
    offsets: list[Vector] = []
    for k, segment in enumerate(tree.segments):
        steps = not segment.starts_group
        offsets.append(
            tape.add(offsets[segment.parent], tree.step_in_group(tape, k)) if steps else ZERO
        )
    units = [unit.about(tape, arm) for unit, arm in zip(moving.units, offsets, strict=True)]
    leads = [k for k, segment in enumerate(tree.segments) if segment.starts_group]
    for lead in reversed(leads):
        joint = tree.segments[lead].joint_name or "the base"
        for i in filter(None, tree.subtree(lead)):
            with tape.group(f"forces, columns of the joints carried in to {joint}"):
                passage = GroupPassage.of(tape, tree, i, lead)
                first = forces.columns.get(i) or column(tape, moving.units[i], moving.bodies[i])
                forces.pass_in(tape, tree, i, passage, first)
                for j in passage.way:
                    if 0 < j < i:
                        forces.add_row_entries(tape, tree, i, j, units)
    return forces


@dataclass(frozen=True)
class InverseDynamicsDerivatives:
    """τ (N m or N), ∂τ/∂q, ∂τ/∂v and M; rows and columns in the order of v."""

    force: list[sp.Expr]
    force_dq: Matrix
    force_dv: Matrix
    mass_matrix: Matrix


def inverse_dynamics_derivatives(symbolic: SymbolicRobot) -> InverseDynamicsDerivatives:
    """Derivatives of inverse dynamics, from the moments of all subtrees.

    Columns of the position in ∂τ/∂q are zero.
    """
    force = inverse_dynamics(symbolic)
    tree, of_base = symbolic.reduced_tree, base_derivatives(symbolic)
    matrices = inertial_derivatives(symbolic, tree, of_base)
    tape, places = symbolic.tape, symbolic.places.joint_places
    # On the diagonals of ∂τ/∂q, ∂τ/∂v and M.
    with tape.group("diagonals with the springs, dampers and armature of the joints"):
        for place, passive in zip(places, passive_symbols(symbolic), strict=True):
            parts = (passive.stiffness, passive.damping, passive.armature)
            for matrix, part in zip(matrices, parts, strict=True):
                matrix[place][place] = tape.let(matrix[place][place] + part)
    for matrix, by in zip(matrices, ("coordinate", "rate"), strict=False):
        for (i, j), slope in spring_slopes(symbolic, by).items():
            row, column = matrix[places[i - 1]], places[j - 1]
            row[column] = tape.less(row[column], slope)
    return InverseDynamicsDerivatives(force, *matrices)


def base_derivatives(symbolic: SymbolicRobot) -> BaseDerivatives:
    """Derivatives of forces by the motion of the base, in the state of the symbols."""
    with symbolic.tape.group("motion per unit of attitude and position"):
        return symbolic.root.derivatives(symbolic.tape, symbolic.base_state)


def inertial_derivatives(
    symbolic: SymbolicRobot, tree: SegmentTree, of_base: BaseDerivatives
) -> tuple[Matrix, Matrix, Matrix]:
    """Derivatives of the inertia forces by q, v and a, for the reduced tree with any inertias."""
    tape, root, places = symbolic.tape, symbolic.root, symbolic.places
    moving = MovingTree.of(symbolic, tree)
    joints = joint_derivatives(tape, moving)
    columns = [joints.columns[k] for k in range(1, symbolic.joints + 1)]
    with tape.group("mass matrix of attitude and position"):
        mass_block = root.mass_block(tape, moving.composite)
    block_dq, block_dv = of_base.blocks(tape, moving.bodies[0], mass_block)
    rows = [of_base.row(tape, column) for column in columns]
    with tape.group("columns of the joints, on attitude and position"):
        mass = [root.rows(tape, column.mass) for column in columns]
        by_rate = [root.rows(tape, column.rate) for column in columns]
        by_angle = [root.rows(tape, column.angle) for column in columns]
    mirrored = {(j, i): entry for (i, j), entry in joints.mass.items()}
    return (
        tree_dynamics.assembled(
            places, block_dq, by_angle, [dq for dq, _ in rows], joints.by_angle
        ),
        tree_dynamics.assembled(places, block_dv, by_rate, [dv for _, dv in rows], joints.by_rate),
        tree_dynamics.assembled(places, mass_block, mass, mass, joints.mass | mirrored),
    )


def coriolis_matrix(symbolic: SymbolicRobot) -> Matrix:
    """The Coriolis matrix, without dampers; rows and columns in the order of v."""
    tape, segments = symbolic.tape, []
    for segment in symbolic.reduced_tree.segments:
        with tape.group(f"half of the inertia of {segment.name}", Stage.PARAMETER):
            half = segment.inertia.mapped(lambda number: tape.let(sp.S.Half * number))
        segments.append(replace(segment, inertia=half))
    with tape.group("motion of the base, for the Coriolis matrix"):
        of_base = base_derivatives(symbolic).coriolis(tape)
    _, matrix, _ = inertial_derivatives(symbolic, SegmentTree(tuple(segments)), of_base)
    return matrix
