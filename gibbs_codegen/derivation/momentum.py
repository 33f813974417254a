"""Mass as a whole: centre of mass and its Jacobian, gravity, momentum about the centre.

All of it comes from composite bodies, in one pass inwards over the tree.
"""

from __future__ import annotations

import sympy as sp

from gibbs_codegen.derivation.composite_inertia import composites_inward, whole_inertia
from gibbs_codegen.derivation.forward_kinematics import combined, segment_frames
from gibbs_codegen.derivation.inertia import Inertia
from gibbs_codegen.derivation.inertia_forces import inward
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.tree_dynamics import State, motions_about_origin
from gibbs_codegen.symbolic.vectors import Matrix, Vector, add, minus, scale


def centre_of_mass(symbolic: SymbolicRobot) -> Vector:
    """World position of the centre of mass (m)."""
    tape = symbolic.tape
    centre = _centre(symbolic, whole_inertia(tape, symbolic.reduced_tree))
    with tape.group("centre of mass in the world"):
        return add(tape, symbolic.origin, symbolic.root.world(tape, centre))


def _centre(symbolic: SymbolicRobot, whole: Inertia) -> Vector:
    """The centre of mass from the origin of the coordinates, in the root's group frame."""
    tape = symbolic.tape
    with tape.group("centre of mass from the origin"):
        return scale(tape, tape.let(1 / whole.mass), whole.moment)


def centre_of_mass_jacobian(symbolic: SymbolicRobot) -> Matrix:
    """Jacobian of the centre of mass: 3 rows in world axes, columns in the order of v.

    A joint moves the composite body that it carries, whose linear momentum is the force of its
    column of the mass matrix.
    """
    _, columns = _columns(symbolic)
    return [[column[i] for column in columns] for i in range(3)]


def _columns(symbolic: SymbolicRobot) -> tuple[sp.Expr, list[Vector]]:
    """The mass of the robot, and columns of the centre of mass's Jacobian in the order of v."""
    tape, root, tree = symbolic.tape, symbolic.root, symbolic.reduced_tree
    frames, composites = segment_frames(tape, root, tree), dict(composites_inward(tape, tree))
    whole = composites[0]
    centre = _centre(symbolic, whole)
    with tape.group("columns of the base"):
        centre = root.world(tape, centre)
        base = [linear for linear, _ in root.velocities_at(tape, centre)]
    joints = []
    for k, segment in enumerate(tree.segments[1:], start=1):
        with tape.group(f"column of {segment.joint_name}"):
            force = composites[k].response(tape, segment.direction).force
            share = scale(tape, tape.let(1 / whole.mass), force)
            joints.append(combined(tape, frames[k].group, share))
    return whole.mass, symbolic.places.joined(base, joints)


def gravity_forces(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """Generalised forces of gravity (N m or N): the weight at the centre of mass."""
    tape = symbolic.tape
    mass, columns = _columns(symbolic)
    with tape.group("weight at the centre of mass"):
        weight = tape.let(symbolic.parameters.gravity * mass)
        return [-tape.let(weight * height) for _, _, height in columns]


def centroidal_momentum(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """Linear and angular momentum about the centre of mass, in world axes (kg m/s, kg m²/s).

    They are inertia forces at rest, with v for a. The motion of the origin adds to the linear
    momentum alone.
    """
    tape, root, tree = symbolic.tape, symbolic.root, symbolic.reduced_tree
    still = [sp.S.Zero] * len(symbolic.v)
    state = State(still, symbolic.v, sp.S.Zero)
    momentum, _ = inward(tape, tree, motions_about_origin(tape, root, tree, state))
    whole = whole_inertia(tape, tree)
    centre = _centre(symbolic, whole)
    with tape.group("momentum in world axes"):
        angular = momentum.shifted(tape, minus(centre)).moment
        origin = scale(tape, whole.mass, symbolic.origin_acceleration(state))
        linear = add(tape, origin, root.world(tape, momentum.force))
        return [*linear, *root.world(tape, angular)]
