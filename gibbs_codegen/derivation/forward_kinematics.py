"""Where the robot's points and frames are and how they move, in world axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import sympy as sp

from gibbs_codegen.derivation.forces import rotor_position
from gibbs_codegen.derivation.motion import Acceleration
from gibbs_codegen.derivation.root.protocol import Root
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.tree_dynamics import State, free_motions, motions_about_origin
from gibbs_codegen.robot.layout import frames_of
from gibbs_codegen.robot.model import BASE
from gibbs_codegen.robot.names import identifier
from gibbs_codegen.symbolic.structural import Turn, product, turned_by_rpy
from gibbs_codegen.symbolic.tape import Scalars, Stage
from gibbs_codegen.symbolic.vectors import (
    NO_ROTATION,
    ZERO,
    Matrix,
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
    """Frames of all segments, from the root to the leaves, in world axes from the origin."""
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
            position = add(tape, parent.position, combined(tape, axes, segment.step))
            starts = segment.starts_group
            group = _turned(tape, axes, segment.twist) if starts else parent.group
            position = add(tape, position, scale(tape, segment.d, group[2]))
            frames.append(SegmentFrame(position, group, _turned(tape, group, segment.rotation)))
    return frames


@dataclass(frozen=True)
class MountedFrame:
    """A named frame on a segment: `position` from its joint (m) and `turn`, in its own frame."""

    name: str
    segment: int
    position: Vector
    turn: Turn

    def from_origin(self, tape: Scalars, frames: Sequence[SegmentFrame]) -> Vector:
        """Its origin from the origin of the coordinates, in world axes (m)."""
        frame = frames[self.segment]
        with tape.group(f"position of {self.name}"):
            return add(tape, frame.position, combined(tape, frame.own, self.position))


def mounted_frames(symbolic: SymbolicRobot) -> list[MountedFrame]:
    """The frames of a robot, in the order of FRAMES."""
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


def combined(tape: Scalars, frame: Frame, vector: Vector) -> Vector:
    """A vector of a frame, in the axes that those of the frame are given in."""
    return add(
        tape, *(scale(tape, length, axis) for length, axis in zip(vector, frame, strict=True))
    )


def _turned(tape: Scalars, frame: Frame, rotation: Rotation) -> Frame:
    """Axes of the frame that `rotation` turns out of `frame`."""
    p, q = rotation.plane
    axes = list(frame)
    axes[p] = _mixed(tape, rotation.cos, frame[p], rotation.sin, frame[q])
    axes[q] = _mixed(tape, -rotation.sin, frame[p], rotation.cos, frame[q])
    return (axes[0], axes[1], axes[2])


def _mixed(tape: Scalars, p: sp.Expr, a: Vector, q: sp.Expr, b: Vector) -> Vector:
    """The linear combination pa + qb; p and q are a cosine and a sine with signs."""
    x, y, z = (tape.let(p * i + q * j) for i, j in zip(a, b, strict=True))
    return (x, y, z)


def _segment_frames(symbolic: SymbolicRobot) -> list[SegmentFrame]:
    return segment_frames(symbolic.tape, symbolic.root, symbolic.reduced_tree)


def positions(symbolic: SymbolicRobot) -> list[Vector]:
    """World positions (m) of POINTS: the base, the rotors, the joints and the frames."""
    tape, robot = symbolic.tape, symbolic.robot
    frames = _segment_frames(symbolic)
    named = [
        mounted.from_origin(tape, frames)
        for mounted in mounted_frames(symbolic)
        if mounted.name != "base"
    ]
    with tape.group("base centre and rotors"):
        centre = combined(tape, frames[0].own, symbolic.centre)
        rotors = []
        for k in range(1, robot.rotors + 1):
            segment, place = rotor_position(symbolic, symbolic.bodies, k)
            point = combined(tape, frames[segment].own, place)
            rotors.append(add(tape, frames[segment].position, point) if segment else point)
    joints = [_joint_position(tape, symbolic, frames, i) for i in robot.moving]
    base = [rotors[0], centre] if robot.base.rotors else [centre]
    with tape.group("positions in the world"):
        return [add(tape, symbolic.origin, point) for point in [*base, *rotors, *joints, *named]]


def _joint_position(
    tape: Scalars, symbolic: SymbolicRobot, frames: Sequence[SegmentFrame], i: int
) -> Vector:
    """The file's frame of link i from the origin of the coordinates, in world axes (m)."""
    body = symbolic.bodies.frames[i]
    frame = frames[body.segment]
    with tape.group(f"position of {symbolic.reduced_tree.segments[body.segment].joint_name}"):
        return add(tape, frame.position, combined(tape, frame.own, body.origin))


def frame_poses(symbolic: SymbolicRobot, mounted: Sequence[MountedFrame]) -> list[Matrix]:
    """Homogeneous transforms of frames, 4×4 by rows; positions in m."""
    frames = _segment_frames(symbolic)
    return [_pose(symbolic, frames, frame) for frame in mounted]


def _pose(symbolic: SymbolicRobot, frames: Sequence[SegmentFrame], mounted: MountedFrame) -> Matrix:
    """Homogeneous transform of a frame, 4×4 by rows."""
    tape, own = symbolic.tape, frames[mounted.segment].own
    with tape.group(f"position of {mounted.name}"):
        position = add(tape, symbolic.origin, mounted.from_origin(tape, frames))
    with tape.group(f"axes of {mounted.name}"):
        columns = zip(*mounted.turn, strict=True)
        axes = [combined(tape, own, (x, y, z)) for x, y, z in columns]
    rows = [[axis[i] for axis in axes] + [position[i]] for i in range(3)]
    zero = sp.S.Zero
    return [*rows, [zero, zero, zero, sp.S.One]]


def frame_jacobians(symbolic: SymbolicRobot, mounted: Sequence[MountedFrame]) -> list[Matrix]:
    """Jacobians of frames, 6 rows each, linear and then angular, in world axes.

    Columns are in the order of v; a joint that does not support the frame has a column of zeros.
    """
    frames = _segment_frames(symbolic)
    return [_jacobian(symbolic, frames, frame) for frame in mounted]


def _jacobian(
    symbolic: SymbolicRobot, frames: Sequence[SegmentFrame], mounted: MountedFrame
) -> Matrix:
    """Jacobian of a frame, 6 rows in world axes; columns in the order of v."""
    tape, tree = symbolic.tape, symbolic.reduced_tree
    point = mounted.from_origin(tape, frames)
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


def frame_velocities(symbolic: SymbolicRobot) -> list[list[sp.Expr]]:
    """Linear and then angular velocity of each frame, in world axes (m/s, rad/s).

    They are the accelerations at rest, with v for a.
    """
    zeros = [sp.S.Zero] * len(symbolic.v)
    return _accelerations(symbolic, State(zeros, symbolic.v, sp.S.Zero))


def frame_bias_accelerations(symbolic: SymbolicRobot) -> list[list[sp.Expr]]:
    """J̇ v of all frames' Jacobians, linear and then angular in world axes: theirs where a = 0."""
    return _accelerations(symbolic, State(symbolic.v, (), sp.S.Zero).unaccelerated)


def _accelerations(symbolic: SymbolicRobot, state: State) -> list[list[sp.Expr]]:
    """Linear and then angular accelerations of all frames, in world axes, from one pass outwards.

    `state` is without gravity.
    """
    tape, tree, frames = symbolic.tape, symbolic.reduced_tree, _segment_frames(symbolic)
    motions = motions_about_origin(tape, symbolic.root, tree, state)
    origin = symbolic.origin_acceleration(state)
    rows = []
    for mounted in mounted_frames(symbolic):
        k, frame = mounted.segment, frames[mounted.segment]
        own = tree.works_in_own_frame(k)
        with tape.group(f"motion of {mounted.name} in world axes"):
            rotation = NO_ROTATION if own else tree.segments[k].rotation
            motion = motions[k].displaced(tape, rotation.vector(tape, mounted.position))
            axes = frame.own if own else frame.group
            linear = add(tape, origin, combined(tape, axes, motion.acceleration))
            rows.append([*linear, *combined(tape, axes, motion.omega_dot)])
    return rows


def frame_bias_acceleration(symbolic: SymbolicRobot, mounted: MountedFrame) -> list[sp.Expr]:
    """J̇ v of a frame's Jacobian: linear and angular acceleration where a = 0, in world axes.

    What each segment on the path to the frame adds is summed from there inwards and turned towards
    the world on the way: passed outwards, the sum would be turned twice.
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
