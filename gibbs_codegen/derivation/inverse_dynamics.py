"""Inverse dynamics: the forces that given accelerations take."""

from __future__ import annotations

import sympy as sp

from gibbs_codegen.derivation.forces import armatures, passive_forces
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.tree_dynamics import generalised_inertia_forces


def inverse_dynamics(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """M a − R = ∂S/∂θ̈ at the given accelerations (N m or N), in the order of v."""
    tape = symbolic.tape
    forces = generalised_inertia_forces(tape, symbolic.root, symbolic.reduced_tree, symbolic.state)
    base, joints = symbolic.places.split(forces)
    _, accelerations = symbolic.places.split(symbolic.a)
    given = zip(joints, armatures(symbolic), accelerations, passive_forces(symbolic), strict=True)
    with tape.group("forces of the joints with their armature, dampers and springs"):
        own = [tape.let(force + m * a - passive) for force, m, a, passive in given]
    return symbolic.places.joined(base, own)
