"""Where the robot's points are and how its frames move, in world axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import sympy as sp

from gibbs_codegen.derivation.forces import rotor_position
from gibbs_codegen.derivation.motion import Acceleration
from gibbs_codegen.derivation.root.protocol import Root
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.tree_dynamics import free_motions
from gibbs_codegen.robot.coordinates import frames_of
from gibbs_codegen.robot.model import BASE
from gibbs_codegen.robot.names import identifier
from gibbs_codegen.symbolic.structural import Turn, product, turned_by_rpy
from gibbs_codegen.symbolic.tape import Scalars, Stage
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
            axes = _turned(tape, parent.own, segment.turn)
            position = add(tape, parent.position, _combined(tape, axes, segment.step))
            starts = segment.starts_group
            group = _turned(tape, axes, segment.twist) if starts else parent.group
            position = add(tape, position, scale(tape, segment.d, group[2]))
            frames.append(SegmentFrame(position, group, _turned(tape, group, segment.rotation)))
    return frames


def _frames(symbolic: SymbolicRobot) -> list[SegmentFrame]:
    return segment_frames(symbolic.tape, symbolic.root, symbolic.reduced_tree)


@dataclass(frozen=True)
class MountedFrame:
    """A named frame on a segment: `position` from its joint (m) and `turn`, in its own frame."""

    name: str
    segment: int
    position: Vector
    turn: Turn


def mounted_frames(symbolic: SymbolicRobot) -> list[MountedFrame]:
    """The frames of a robot.

    Args:
        symbolic: The robot in symbols.

    Returns:
        The frames, in the order of FRAMES.
    """
    tape, robot = symbolic.tape, symbolic.robot
    mounted = []
    for frame in frames_of(robot):
        body = symbolic.bodies.frames[frame.on]
        if frame in robot.frames:
            place = symbolic.parameters.frame(frame.name)
        elif frame.on != BASE:  # The tip: the end of the last link.
            place = axis_vector(0, symbolic.parameters.link(frame.on).body.length)
        else:
            place = ZERO
        with tape.group("places of the frames", Stage.PARAMETER):
            position = body.point(tape, place)
        turn = product(body.turn, turned_by_rpy(frame.pose.rpy_deg))
        mounted.append(MountedFrame(identifier(frame.name), body.segment, position, turn))
    return mounted


def _named(symbolic: SymbolicRobot, name: str) -> MountedFrame:
    return next(frame for frame in mounted_frames(symbolic) if frame.name == name)


def _position(tape: Scalars, frames: Sequence[SegmentFrame], mounted: MountedFrame) -> Vector:
    """A frame's origin from the origin of the coordinates, in world axes."""
    frame = frames[mounted.segment]
    with tape.group(f"position of {mounted.name}"):
        return add(tape, frame.position, _combined(tape, frame.own, mounted.position))


def positions(symbolic: SymbolicRobot) -> list[Vector]:
    """World positions of the points.

    Args:
        symbolic: The robot in symbols.

    Returns:
        Positions (m) of POINTS: the base, the rotors, the joints and the frames.
    """
    tape, frames, robot = symbolic.tape, _frames(symbolic), symbolic.robot
    named = [
        _position(tape, frames, mounted)
        for mounted in mounted_frames(symbolic)
        if mounted.name != "base"
    ]
    with tape.group("base centre and rotors"):
        centre = _combined(tape, frames[0].own, symbolic.centre)
        rotors = []
        for k in range(1, robot.rotors + 1):
            segment, place = rotor_position(symbolic, symbolic.bodies, k)
            point = _combined(tape, frames[segment].own, place)
            rotors.append(add(tape, frames[segment].position, point) if segment else point)
    joints = [_joint_position(tape, symbolic, frames, i) for i in robot.moving]
    base = [rotors[0], centre] if robot.base.rotors else [centre]
    with tape.group("positions in the world"):
        return [add(tape, symbolic.origin, point) for point in [*base, *rotors, *joints, *named]]


def _joint_position(
    tape: Scalars, symbolic: SymbolicRobot, frames: Sequence[SegmentFrame], i: int
) -> Vector:
    """The joint of a link from the origin of the coordinates, in world axes.

    Args:
        symbolic: The robot in symbols.
        frames: Those of the segments.
        i: Number of the link.

    Returns:
        The origin of the frame that the robot file gives the link (m).
    """
    body = symbolic.bodies.frames[i]
    frame = frames[body.segment]
    with tape.group(f"position of {symbolic.reduced_tree.segments[body.segment].joint_name}"):
        return add(tape, frame.position, _combined(tape, frame.own, body.origin))


def frame_pose(symbolic: SymbolicRobot, mounted: MountedFrame) -> list[list[sp.Expr]]:
    """Homogeneous transform of a frame.

    Args:
        symbolic, mounted: The robot and the frame.

    Returns:
        4×4 matrix, by rows; the position is in m.
    """
    tape, frames = symbolic.tape, _frames(symbolic)
    with tape.group(f"position of {mounted.name}"):
        position = add(tape, symbolic.origin, _position(tape, frames, mounted))
    own = frames[mounted.segment].own
    with tape.group(f"axes of {mounted.name}"):
        columns = zip(*mounted.turn, strict=True)
        axes = [_combined(tape, own, (x, y, z)) for x, y, z in columns]
    rows = [[axis[i] for axis in axes] + [position[i]] for i in range(3)]
    zero = sp.S.Zero
    return [*rows, [zero, zero, zero, sp.S.One]]


def frame_jacobian(symbolic: SymbolicRobot, mounted: MountedFrame) -> list[list[sp.Expr]]:
    """Jacobian of a frame, in world axes.

    Args:
        symbolic, mounted: The robot and the frame.

    Returns:
        6 rows, linear and then angular; columns in the order of v. A joint that does not support
        the frame has a column of zeros.
    """
    tape, tree, frames = symbolic.tape, symbolic.reduced_tree, _frames(symbolic)
    point = _position(tape, frames, mounted)
    with tape.group("columns of the base"):
        base = symbolic.root.velocities_at(tape, point)
    joints = [(ZERO, ZERO)] * tree.joints
    for k in reversed(tree.path(mounted.segment)[:-1]):
        segment, frame = tree.segments[k], frames[k]
        axis = frame.group[2]
        if segment.joint == "revolute":
            with tape.group(f"column of {segment.joint_name}"):
                arm = add(tape, point, minus(frame.position))
                joints[k - 1] = (cross(tape, axis, arm), axis)
        else:
            joints[k - 1] = (axis, ZERO)
    columns = symbolic.places.joined(base, joints)
    return [[column[part][i] for column in columns] for part in range(2) for i in range(3)]


def frame_bias_acceleration(symbolic: SymbolicRobot, mounted: MountedFrame) -> list[sp.Expr]:
    """J̇ v of a frame's Jacobian: how the frame accelerates where a = 0.

    What each segment on the path to the frame adds is summed from there inwards and turned towards
    the world on the way: passed outwards, the sum would be turned twice.

    Args:
        symbolic, mounted: The robot and the frame.

    Returns:
        Linear and then angular acceleration (m/s², rad/s²), in world axes.
    """
    tape, root, tree = symbolic.tape, symbolic.root, symbolic.reduced_tree
    motions = free_motions(tape, root, tree, symbolic.v)
    base_rates, rates = symbolic.places.split(symbolic.v)
    reach = mounted.position
    end = Acceleration(ZERO, motions[mounted.segment].omega_dot)
    for k in tree.path(mounted.segment):
        segment = tree.segments[k]
        own_to_working, working_to_group = segment.rotation, NO_ROTATION
        if tree.works_in_own_frame(k):
            own_to_working, working_to_group = working_to_group, own_to_working
        with tape.group(f"acceleration of {mounted.name} that {segment.name} adds"):
            x, y, z = own_to_working.vector(tape, reach)
            step = (x, y, tape.let(z + segment.d))
            motion = replace(motions[k], acceleration=end.linear).displaced(tape, step)
            if segment.joint == "prismatic":
                motion = motion.slid(tape, rates[k - 1], sp.S.Zero)
            end = Acceleration(motion.acceleration, end.angular)
            end = end.rotated(tape, working_to_group).rotated(tape, segment.twist)
            end = end.rotated(tape, segment.turn)
            reach = segment.turn.vector(tape, segment.step)
    with tape.group(f"acceleration of {mounted.name} in world axes"):
        base = root.frame_motion(tape, base_rates, [sp.S.Zero] * len(base_rates), sp.S.Zero)
        linear = add(tape, end.linear, base.acceleration)
        return [*root.world(tape, linear), *root.world(tape, end.angular)]


def tip_pose(symbolic: SymbolicRobot) -> list[list[sp.Expr]]:
    """Homogeneous transform of the tip.

    Args:
        symbolic: The robot in symbols.

    Returns:
        4×4 matrix, by rows; the position is in m.
    """
    return frame_pose(symbolic, _named(symbolic, "tip"))


def tip_jacobian(symbolic: SymbolicRobot) -> list[list[sp.Expr]]:
    """Jacobian of the tip, in world axes.

    Args:
        symbolic: The robot in symbols.

    Returns:
        6 rows, linear and then angular; columns in the order of v.
    """
    return frame_jacobian(symbolic, _named(symbolic, "tip"))


def tip_bias_acceleration(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """J̇ v of the tip Jacobian.

    Args:
        symbolic: The robot in symbols.

    Returns:
        Linear and then angular acceleration (m/s², rad/s²), in world axes.
    """
    return frame_bias_acceleration(symbolic, _named(symbolic, "tip"))


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
