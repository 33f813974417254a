"""Momentum, its rate, and the forces of motions that a passive law refers to.

With C as of `coriolis_matrix`, for which Ṁ = C + Cᵀ, the momentum p = M v obeys

    ṗ = Cᵀ v + gravity + dampers and springs + B u + ΣJᵀW

whatever the velocities are. Row i of Cᵀ v is ∫ẋ·ξ̇_i dm, ξ_i the velocities that a unit of v_i
makes: about an axis e of a joint that moves with V and ω and carries the momentum P, L about the
joint, it is e·(L×ω + P×V), and along one e·(P×ω).

M a_r + C(q, v) v_r is ∂S/∂θ̈ where ẍ are the rates of velocities that v_r gives the links, with the
rates a_r, while these move with v (Slotine and Li, 1987).
"""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from gibbs_codegen.derivation import tree_dynamics
from gibbs_codegen.derivation.forward_kinematics import gravity_forces
from gibbs_codegen.derivation.inverse_dynamics import with_joint_forces
from gibbs_codegen.derivation.motion import TreeState
from gibbs_codegen.derivation.passive import armatures, passive_forces
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot


def momentum(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """M v (kg m²/s or kg m/s): inertia forces at rest, with v for a."""
    tape, places, state = symbolic.tape, symbolic.places, TreeState.resting(symbolic.v)
    forces = tree_dynamics.generalised_inertia_forces(
        tape, symbolic.root, symbolic.reduced_tree, state
    )
    base, joints = places.split(forces)
    with tape.group("momenta of the joints with their armature"):
        rotors = zip(joints, armatures(symbolic), symbolic.joint_state.rates, strict=True)
        return places.joined(base, [tape.let(p + inertia * v) for p, inertia, v in rotors])


def momentum_rate(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """ṗ without inputs and wrenches (N m or N)."""
    tape, root, tree = symbolic.tape, symbolic.root, symbolic.reduced_tree
    state = TreeState.resting(symbolic.v)
    # Those of the velocities, which take the place of accelerations.
    motions = tree_dynamics.tree_motions(tape, root, tree, state)
    whole, *momenta = tree_dynamics.subtree_wrenches(tape, tree, motions)
    joints = []
    for k, carried in enumerate(momenta, start=1):
        with tape.group(f"rate of the momentum of {tree.subtree_about_joint(k)}"):
            motion = motions[k]
            rates = carried.turned_with(tape, motion.acceleration, motion.omega_dot)
            joints.append(tree.segments[k].row(rates))
    with tape.group("rate of the momentum of the base"):
        base, _ = state.split(symbolic.places)
        origin = root.frame_motion(tape, base).acceleration
        push = tape.scale(tree.segments[0].inertia.mass, origin)
        about = tree.to_group_frame(tape, 0, whole)
        about = replace(about, force=tape.add(about.force, push))
        rates_of_base = root.momentum_rates(tape, base, about)
    rate = symbolic.places.joined(rates_of_base, joints)
    passive = symbolic.places.joined([sp.S.Zero] * 6, passive_forces(symbolic))
    weights = gravity_forces(symbolic)
    with tape.group("rate of the momentum with gravity, dampers and springs"):
        return [tape.let(sp.Add(*terms)) for terms in zip(rate, weights, passive, strict=True)]


def passive_inverse_dynamics(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """M a_r + C(q, v) v_r less gravity and springs and what dampers exert at v_r (N m or N)."""
    forces = tree_dynamics.generalised_inertia_forces(
        symbolic.tape, symbolic.root, symbolic.reduced_tree, symbolic.reference_state
    )
    return with_joint_forces(replace(symbolic, v=symbolic.v_r, a=symbolic.a_r), forces)
