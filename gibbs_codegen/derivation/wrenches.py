"""Wrenches: what those on the frames do to the robot, and those that pass through its joints.

A wrench on a frame is a load on its segment, or the generalised forces JᵀW.

What a joint, held and welded ones included, passes on to the body that it carries (eqs. 6 and 14)
is what inertia, gravity and thrusts of all beyond it leave to be supplied: all six components of
the sum of which the equations of motion have the one along the joint. So inertias must not be
regrouped, and every link has a joint of its own. Torques of motors, dampers and springs are part of
what a joint passes on, and need not be known.
"""

from __future__ import annotations

import sympy as sp

from gibbs_codegen.derivation.forces import generalised_forces, rod_thrust, thrust_wrenches
from gibbs_codegen.derivation.forward_kinematics import Frame, mounted_frames, segment_frames
from gibbs_codegen.derivation.hybrid import constrained_joint_wrench
from gibbs_codegen.derivation.inertia_forces import subtree_wrenches
from gibbs_codegen.derivation.jointed_bodies import BodyFrame
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.tree_dynamics import tree_motions
from gibbs_codegen.symbolic.structural import applied, back
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import NO_WRENCH, Vector, Wrench, dot, minus

# Components of a wrench.
_SIZE = 6


def frame_loads(symbolic: SymbolicRobot) -> dict[int, Wrench]:
    """The wrenches W on the frames, taken to the joints of the segments that they are on.

    They are by index of the segment, about its joint or about the origin, in its own frame (N, N
    m).
    """
    tape = symbolic.tape
    frames = segment_frames(tape, symbolic.root, symbolic.reduced_tree)
    loads: dict[int, Wrench] = {}
    for place, mounted in enumerate(mounted_frames(symbolic)):
        k, given = mounted.segment, symbolic.W[place * _SIZE : (place + 1) * _SIZE]
        with tape.group(f"wrench on {mounted.name}, in the frame of its link"):
            world = Wrench.of(given)
            force, moment = (
                _in_own_axes(tape, frames[k].own, v) for v in (world.force, world.moment)
            )
            load = Wrench(force, moment).shifted(tape, mounted.position)
            loads[k] = loads.get(k, NO_WRENCH).plus(tape, load)
    return loads


def wrench_forces(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """Generalised forces of the wrenches W on the frames (N m or N), without a Jacobian."""
    loads = frame_loads(symbolic)
    with symbolic.tape.group("wrenches carried in to the base"):
        return generalised_forces(symbolic, loads)


def _in_own_axes(tape: Scalars, axes: Frame, vector: Vector) -> Vector:
    """Components of a vector along axes, both given in world axes."""
    x, y, z = (dot(tape, axis, vector) for axis in axes)
    return (x, y, z)


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
            wrenches.append(_in_link_axes(tape, bodies.frames[i], own))
    return wrenches


def _in_link_axes(tape: Scalars, frame: BodyFrame, wrench: Wrench) -> Wrench:
    """A wrench about a segment's joint, about the origin of a body's frame in its axes."""
    about = wrench.shifted(tape, minus(frame.origin))
    turn = back(frame.turn)

    def turned(vector: Vector) -> Vector:
        x, y, z = map(tape.let, applied(turn, vector))
        return (x, y, z)

    return Wrench(turned(about.force), turned(about.moment))
