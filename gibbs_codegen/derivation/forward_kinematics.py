"""Where the robot's points are and how the tip moves, in world axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import sympy as sp

from gibbs_codegen.derivation.forces import motor_position
from gibbs_codegen.derivation.motion import Acceleration
from gibbs_codegen.derivation.root.protocol import Root
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.tree_dynamics import free_motions
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import (
    NO_ROTATION,
    ZERO,
    Rotation,
    Vector,
    add,
    axis_vector,
    cross,
    minus,
    scale,
)

Frame = tuple[Vector, Vector, Vector]


@dataclass(frozen=True)
class SegmentFrame:
    """Where a segment is: its joint from the origin of the coordinates, and axes, in world axes.

    `group` are the axes of its group frame, the last of them that of its joint; `own` are the
    link's.
    """

    position: Vector
    group: Frame
    own: Frame


def segment_frames(tape: Scalars, root: Root, tree: SegmentTree) -> list[SegmentFrame]:
    """Forward kinematics of all segments, from the root to the leaves.

    Args:
        root, tree: The tree and how its root moves.

    Returns:
        The frame of each segment, in world axes, from the origin of the coordinates.
    """
    with tape.group("axes of the base"):
        group: Frame = (
            root.world(tape, axis_vector(0)),
            root.world(tape, axis_vector(1)),
            root.world(tape, axis_vector(2)),
        )
        frames = [SegmentFrame(ZERO, group, _turned(tape, group, tree.segments[0].rotation))]
    for segment in tree.segments[1:]:
        parent = frames[segment.parent]
        with tape.group(f"{segment.joint_name} and the axes of {segment.name}"):
            position = add(tape, parent.position, scale(tape, segment.a, parent.own[0]))
            starts = segment.starts_group
            group = _turned(tape, parent.own, segment.twist) if starts else parent.group
            position = add(tape, position, scale(tape, segment.d, group[2]))
            frames.append(SegmentFrame(position, group, _turned(tape, group, segment.rotation)))
    return frames


def _frames(symbolic: SymbolicRobot) -> list[SegmentFrame]:
    return segment_frames(symbolic.tape, symbolic.root, symbolic.reduced_tree)


def _tip(symbolic: SymbolicRobot, frames: Sequence[SegmentFrame]) -> Vector:
    """The tip from the origin of the coordinates, in world axes."""
    tape, last = symbolic.tape, frames[symbolic.tip_segment]
    with tape.group("tip"):
        return add(tape, last.position, scale(tape, symbolic.reach, last.own[0]))


def positions(symbolic: SymbolicRobot) -> list[Vector]:
    """World positions of the points.

    Args:
        symbolic: The robot in symbols.

    Returns:
        Positions (m) of O1, O2, the motors, the joints and the tip.
    """
    tape, frames = symbolic.tape, _frames(symbolic)
    tip = _tip(symbolic, frames)
    with tape.group("base centre and motors"):
        base = [axis_vector(0, symbolic.centre_offset)]
        base += [motor_position(symbolic, k) for k in range(1, symbolic.robot.rotors + 1)]
        on_base = [_combined(tape, frames[0].own, point) for point in base]
    motor_1 = on_base[1]
    origin = symbolic.origin
    relative = [motor_1, *on_base, *(frame.position for frame in frames[1:]), tip]
    with tape.group("positions in the world"):
        return [add(tape, origin, point) for point in relative]


def tip_pose(symbolic: SymbolicRobot) -> list[list[sp.Expr]]:
    """Homogeneous transform of the tip: the axes of its segment and its position.

    Args:
        symbolic: The robot in symbols.

    Returns:
        4×4 matrix, by rows; the position is in m.
    """
    frames = _frames(symbolic)
    tip = _tip(symbolic, frames)
    with symbolic.tape.group("position of the tip"):
        position = add(symbolic.tape, symbolic.origin, tip)
    axes = frames[symbolic.tip_segment].own
    rows = [[axis[i] for axis in axes] + [position[i]] for i in range(3)]
    zero = sp.S.Zero
    return [*rows, [zero, zero, zero, sp.S.One]]


def tip_jacobian(symbolic: SymbolicRobot) -> list[list[sp.Expr]]:
    """Jacobian of the tip, in world axes.

    Args:
        symbolic: The robot in symbols.

    Returns:
        6 rows, linear and then angular; columns in the order of v. A joint that does not support
        the tip has a column of zeros.
    """
    tape, tree, frames = symbolic.tape, symbolic.reduced_tree, _frames(symbolic)
    tip = _tip(symbolic, frames)
    with tape.group("columns of the attitude angles"):
        base = symbolic.root.velocities_at(tape, tip)
    joints = [(ZERO, ZERO)] * tree.joints
    for k in reversed(tree.path(symbolic.tip_segment)[:-1]):
        segment, frame = tree.segments[k], frames[k]
        axis = frame.group[2]
        if segment.joint == "revolute":
            with tape.group(f"column of {segment.joint_name}"):
                arm = add(tape, tip, minus(frame.position))
                joints[k - 1] = (cross(tape, axis, arm), axis)
        else:
            joints[k - 1] = (axis, ZERO)
    columns = symbolic.places.joined(base, joints)
    return [[column[part][i] for column in columns] for part in range(2) for i in range(3)]


def tip_bias_acceleration(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """J̇ v of the tip Jacobian: how the tip accelerates where θ̈ = 0.

    What each segment on the path to the tip adds is summed from the tip inwards and turned towards
    the world on the way: passed outwards, the sum would be turned twice.

    Args:
        symbolic: The robot in symbols.

    Returns:
        Linear and then angular acceleration (m/s², rad/s²), in world axes.
    """
    tape, root, tree = symbolic.tape, symbolic.root, symbolic.reduced_tree
    motions = free_motions(tape, root, tree, symbolic.v)
    base_rates, rates = symbolic.places.split(symbolic.v)
    reach = symbolic.reach
    tip = Acceleration(ZERO, motions[symbolic.tip_segment].omega_dot)
    for k in tree.path(symbolic.tip_segment):
        segment = tree.segments[k]
        own_to_working, working_to_group = segment.rotation, NO_ROTATION
        if tree.works_in_own_frame(k):
            own_to_working, working_to_group = working_to_group, own_to_working
        with tape.group(f"acceleration of the tip that {segment.name} adds"):
            x, y, _ = own_to_working.vector(tape, axis_vector(0, reach))
            motion = replace(motions[k], acceleration=tip.linear).displaced(tape, (x, y, segment.d))
            if segment.joint == "prismatic":
                motion = motion.slid(tape, rates[k - 1], sp.S.Zero)
            tip = Acceleration(motion.acceleration, tip.angular)
            tip = tip.rotated(tape, working_to_group).rotated(tape, segment.twist)
        reach = segment.a
    with tape.group("acceleration of the tip in world axes"):
        base = root.frame_motion(tape, base_rates, [sp.S.Zero] * len(base_rates), sp.S.Zero)
        linear = add(tape, tip.linear, base.acceleration)
        return [*root.world(tape, linear), *root.world(tape, tip.angular)]


def _combined(tape: Scalars, frame: Frame, point: Vector) -> Vector:
    return add(
        tape, *(scale(tape, length, axis) for length, axis in zip(point, frame, strict=True))
    )


def _turned(tape: Scalars, frame: Frame, rotation: Rotation) -> Frame:
    """Axes of the frame that `rotation` turns out of `frame`."""
    p, q = rotation.plane
    axes = list(frame)
    axes[p] = _mixed(tape, rotation.cos, frame[p], rotation.sin, frame[q])
    axes[q] = _mixed(tape, -rotation.sin, frame[p], rotation.cos, frame[q])
    return (axes[0], axes[1], axes[2])


def _mixed(tape: Scalars, p: sp.Expr, a: Vector, q: sp.Expr, b: Vector) -> Vector:
    """The linear combination pa + qb.

    Args:
        p, q: Factors, a cosine and a sine with signs.
        a, b: Vectors in one frame.

    Returns:
        The vector in that frame.
    """
    x, y, z = (tape.let(p * i + q * j) for i, j in zip(a, b, strict=True))
    return (x, y, z)
