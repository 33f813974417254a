"""Where the machine's points are and how the tip moves, in world axes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import sympy as sp

from gibbs_codegen.derivation.articulated import Acceleration
from gibbs_codegen.derivation.chain_dynamics import free_motions
from gibbs_codegen.derivation.forces import motor_position
from gibbs_codegen.derivation.machine import Machine
from gibbs_codegen.derivation.serial_chain import Segment
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import (
    NO_ROTATION,
    ZERO,
    Rotation,
    Vector,
    add,
    axis_vector,
    cross,
    scale,
)

Frame = tuple[Vector, Vector, Vector]


@dataclass(frozen=True)
class Geometry:
    """World axes of arm 1, and the arm's joints and tip from the origin of the coordinates.

    Positions are in world axes; `joint_axes` are the z axes of the joints, `tip_frame` the axes of
    the last link (of arm 1 where there is no arm).
    """

    base_frame: Frame
    joint_positions: tuple[Vector, ...]
    joint_axes: tuple[Vector, ...]
    tip_frame: Frame
    tip: Vector


def arm_geometry(machine: Machine) -> Geometry:
    """Forward kinematics from the root to the tip."""
    tape, root = machine.tape, machine.root
    segments = machine.reduced_chain.segments
    with tape.group("axes of the base"):
        carrier: Frame = (
            root.world(tape, axis_vector(0)),
            root.world(tape, axis_vector(1)),
            root.world(tape, axis_vector(2)),
        )
        own = base = _turned(tape, carrier, segments[0].rotation)
    position = ZERO
    positions, axes = [], []
    for segment in segments[1:]:
        with tape.group(f"{segment.joint_name} and the axes of {segment.name}"):
            position = add(tape, position, scale(tape, segment.a, own[0]))
            carrier = _twisted(tape, own, segment) if segment.leads else carrier
            position = add(tape, position, scale(tape, segment.d, carrier[2]))
            own = _turned(tape, carrier, segment.rotation)
        positions.append(position)
        axes.append(carrier[2])
    with tape.group("tip"):
        tip = add(tape, position, scale(tape, machine.reach, own[0]))
    return Geometry(base, tuple(positions), tuple(axes), own, tip)


def positions(machine: Machine) -> list[Vector]:
    """World positions of the points, in their order: O1, O2, motors, joints, tip."""
    tape, geometry = machine.tape, arm_geometry(machine)
    with tape.group("base centre and motors"):
        base = [axis_vector(0, machine.centre_offset)]
        base += [motor_position(machine, k) for k in range(1, machine.robot.rotors + 1)]
        on_base = [_combined(tape, geometry.base_frame, point) for point in base]
    motor_1 = on_base[1]
    origin = machine.origin
    relative = [motor_1, *on_base, *geometry.joint_positions, geometry.tip]
    with tape.group("positions in the world"):
        return [add(tape, origin, point) for point in relative]


def tip_pose(machine: Machine) -> list[list[sp.Expr]]:
    """Homogeneous transform of the tip: the last link's axes and the tip's position."""
    geometry = arm_geometry(machine)
    with machine.tape.group("position of the tip"):
        position = add(machine.tape, machine.origin, geometry.tip)
    rows = [[axis[i] for axis in geometry.tip_frame] + [position[i]] for i in range(3)]
    zero = sp.S.Zero
    return [*rows, [zero, zero, zero, sp.S.One]]


def tip_jacobian(machine: Machine) -> list[list[sp.Expr]]:
    """Linear rows, then angular, in world axes; columns in the order of q."""
    tape, geometry = machine.tape, arm_geometry(machine)
    with tape.group("columns of the attitude angles"):
        base = machine.root.velocities_at(tape, geometry.tip)
    joints: list[tuple[Vector, Vector]] = []
    for segment, axis, joint in zip(
        machine.reduced_chain.segments[1:],
        geometry.joint_axes,
        geometry.joint_positions,
        strict=True,
    ):
        if segment.joint == "revolute":
            with tape.group(f"column of {segment.joint_name}"):
                arm = add(tape, geometry.tip, (-joint[0], -joint[1], -joint[2]))
                joints.append((cross(tape, axis, arm), axis))
        else:
            joints.append((axis, ZERO))
    columns = machine.places.joined(base, joints)
    return [[column[part][i] for column in columns] for part in range(2) for i in range(3)]


def tip_bias_acceleration(machine: Machine) -> list[sp.Expr]:
    """J̇ v of the tip Jacobian, in its rows' order: how the tip accelerates where θ̈ = 0.

    What each segment adds is summed from the tip inwards and turned towards the world on the way:
    passed outwards, the sum would be turned twice.
    """
    tape, root, chain = machine.tape, machine.root, machine.reduced_chain
    motions = free_motions(tape, root, chain, machine.v)
    _, rates = machine.places.split(machine.v)
    reaches = [*(segment.a for segment in chain.segments[1:]), machine.reach]
    tip = Acceleration(ZERO, motions[-1].omega_dot)
    for k in range(len(motions) - 1, -1, -1):
        segment = chain.segments[k]
        own_to_working, working_to_carrier = segment.rotation, NO_ROTATION
        if chain.works_in_own_frame(k):
            own_to_working, working_to_carrier = working_to_carrier, own_to_working
        with tape.group(f"acceleration of the tip that {segment.name} adds"):
            x, y, _ = own_to_working.vector(tape, axis_vector(0, reaches[k]))
            motion = replace(motions[k], acceleration=tip.linear).displaced(tape, (x, y, segment.d))
            if segment.joint == "prismatic":
                motion = motion.slid(tape, rates[k - 1], sp.S.Zero)
            tip = Acceleration(motion.acceleration, tip.angular)
            tip = tip.rotated(tape, working_to_carrier).rotated(tape, segment.twist)
    with tape.group("acceleration of the tip in world axes"):
        return [*root.world(tape, tip.linear), *root.world(tape, tip.angular)]


def _combined(tape: Scalars, frame: Frame, point: Vector) -> Vector:
    return add(
        tape, *(scale(tape, length, axis) for length, axis in zip(point, frame, strict=True))
    )


def _turned(tape: Scalars, frame: Frame, rotation: Rotation) -> Frame:
    """Axes of the frame that `rotation` (about z) turns out of `frame`."""
    x, y, z = frame
    return (
        _mixed(tape, rotation.cos, x, rotation.sin, y),
        _mixed(tape, -rotation.sin, x, rotation.cos, y),
        z,
    )


def _twisted(tape: Scalars, frame: Frame, segment: Segment) -> Frame:
    x, y, z = frame
    twist = segment.twist
    return (
        x,
        _mixed(tape, twist.cos, y, twist.sin, z),
        _mixed(tape, -twist.sin, y, twist.cos, z),
    )


def _mixed(tape: Scalars, p: sp.Expr, a: Vector, q: sp.Expr, b: Vector) -> Vector:
    x, y, z = (tape.let(p * i + q * j) for i, j in zip(a, b, strict=True))
    return (x, y, z)
