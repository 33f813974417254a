"""Wrenches: the effect of those on the frames, and those that pass through the joints.

A wrench on a frame is a load on its segment, or the generalised forces JᵀW.

What a joint, held and welded ones included, passes on to the body that it carries (eqs. 6 and 14)
is what inertia, gravity and thrusts of all beyond it leave to be supplied: all six components of
the sum of which the equations of motion have the one along the joint. So inertias must not be
regrouped, and every link has a joint of its own. Torques of motors, dampers and springs of joints
are part of what a joint passes on, and need not be known; springs between frames pull at bodies.
"""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from gibbs_codegen.derivation.forces import (
    forces_of_wrenches,
    frame_loads,
    rod_thrust,
    thrust_wrenches,
)
from gibbs_codegen.derivation.hybrid import rod_wrench
from gibbs_codegen.derivation.inertia import about_z
from gibbs_codegen.derivation.passive import spring_loads
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.tree_dynamics import link_wrench, subtree_wrenches, tree_motions
from gibbs_codegen.robot.parts.numbers import BASE
from gibbs_codegen.symbolic.structural import applied, back
from gibbs_codegen.symbolic.vectors import NO_WRENCH, Wrench, minus


def wrench_forces(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """Generalised forces of the wrenches W on the frames (N m or N), without a Jacobian."""
    loads = frame_loads(symbolic)
    with symbolic.tape.group("wrenches carried in to the base"):
        return forces_of_wrenches(symbolic, symbolic.reduced_tree, loads)


def joint_wrenches(symbolic: SymbolicRobot, *, with_frames: bool = False) -> list[list[sp.Expr]]:
    """The wrench that every joint passes on to the body that it carries.

    With `with_frames` the wrenches W on the frames act on the bodies too.
    There is a row for each of BODIES: force and moment about the joint (N, N m), in the axes of the
    frame that the robot file gives the body.
    """
    tape, wrenches = symbolic.tape, []
    for chain, serial in symbolic.open_chains:
        if chain.rod is not None:
            inertial = rod_wrench(symbolic, serial, symbolic.state)
            with tape.group(f"wrench through {serial.segments[1].joint_name}"):
                unit, thrust = rod_thrust(symbolic, chain.rod), symbolic.u[chain.rod - 1]
                active = Wrench.of(tape.let(thrust * entry) for entry in unit.entries)
                through = serial.to_own_frame(tape, 1, inertial)
                wrenches.append(through.plus(tape, active.opposite))
    tree, bodies = symbolic.whole_tree, symbolic.all_bodies
    state = symbolic.state_with(symbolic.state, bodies.numbers)
    motions = tree_motions(tape, symbolic.root, tree, state)
    loads = thrust_wrenches(symbolic, bodies)
    pushed = frame_loads(symbolic, bodies) if with_frames else {}
    for k, load in (*pushed.items(), *spring_loads(symbolic, bodies).items()):
        loads[k] = loads.get(k, NO_WRENCH).plus(tape, load)
    sums = subtree_wrenches(tape, tree, motions, loads)
    # Inertias that stand for rotors are among the links', but act on what carries the joints.
    geared = [symbolic.parameters.links[i].geared for i in bodies.numbers]
    pairs = zip(tree.segments, [sp.S.Zero, *geared], strict=True)
    rotors = SegmentTree(tuple(replace(x, inertia=about_z(moment)) for x, moment in pairs))
    for k, i in enumerate(bodies.numbers, start=1):
        if i < BASE:
            continue
        with tape.group(f"wrench through {tree.segments[k].joint_name}, in its frame"):
            on_rotor = link_wrench(tape, rotors, k, motions[k])
            through = tree.to_own_frame(tape, k, sums[k].plus(tape, on_rotor.opposite))
            about = through.shifted(tape, minus(bodies.frames[i].origin))
            turn = back(bodies.frames[i].turn)
            parts = (applied(turn, about.force), applied(turn, about.moment))
            wrenches.append(Wrench.of(tape.let(entry) for part in parts for entry in part))
    return [wrench.entries for wrench in wrenches]
