"""The whole wrench through every joint, held and welded ones included (eqs. 6 and 14).

What a joint passes on to the body that it carries is what inertia, gravity and thrusts of all
beyond it leave to be supplied: all six components of the sum of which the equations of motion have
the one along the joint. So inertias must not be regrouped, and every link has a joint of its own.
Torques of motors, dampers and springs are part of what a joint passes on, and need not be known.
"""

from __future__ import annotations

import sympy as sp

from gibbs_codegen.derivation.forces import rod_thrust, thrust_wrenches
from gibbs_codegen.derivation.hybrid import constrained_joint_wrench
from gibbs_codegen.derivation.inertia_forces import subtree_wrenches
from gibbs_codegen.derivation.link_frames import BodyFrame
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.tree_dynamics import tree_motions
from gibbs_codegen.symbolic.structural import applied, back
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import Vector, Wrench, minus


def joint_wrenches(symbolic: SymbolicRobot) -> list[list[sp.Expr]]:
    """The wrench that every joint passes on to the body that it carries.

    There is a row for each of BODIES: force and moment about the joint (N, N m), in the axes of the
    frame that the robot file gives the body.
    """
    return [wrench.entries for wrench in (*_on_rods(symbolic), *_on_links(symbolic))]


def _on_rods(symbolic: SymbolicRobot) -> list[Wrench]:
    """The wrenches on the base's rods from the second on, which constraint torques hold."""
    tape, wrenches = symbolic.tape, []
    for chain, serial in symbolic.open_chains:
        if chain.rod is not None:
            inertial = constrained_joint_wrench(symbolic, serial, symbolic.state)
            with tape.group(f"wrench through {serial.segments[1].joint_name}"):
                unit, thrust = rod_thrust(symbolic, chain.rod), symbolic.u[chain.rod - 1]
                active = Wrench.of(tape.let(thrust * entry) for entry in unit.entries)
                own = serial.to_own_frame(tape, 1, inertial)
                wrenches.append(own.plus(tape, active.opposite))
    return wrenches


def _on_links(symbolic: SymbolicRobot) -> list[Wrench]:
    """The wrenches on the links, welded ones included."""
    tape, tree, bodies = symbolic.tape, symbolic.whole_tree, symbolic.all_bodies
    motions = tree_motions(tape, symbolic.root, tree, symbolic.state_of(bodies))
    loads = thrust_wrenches(symbolic, bodies)
    sums = subtree_wrenches(tape, tree, motions, loads)
    wrenches = []
    for k, i in enumerate(bodies.numbers, start=1):
        with tape.group(f"wrench through {tree.segments[k].joint_name}, in its frame"):
            own = tree.to_own_frame(tape, k, sums[k])
            wrenches.append(_seen(tape, bodies.frames[i], own))
    return wrenches


def _seen(tape: Scalars, frame: BodyFrame, wrench: Wrench) -> Wrench:
    """A wrench about a segment's joint, about the origin of a body's frame in its axes."""
    about = wrench.shifted(tape, minus(frame.origin))
    turn = back(frame.turn)

    def turned(vector: Vector) -> Vector:
        x, y, z = map(tape.let, applied(turn, vector))
        return (x, y, z)

    return Wrench(turned(about.force), turned(about.moment))
