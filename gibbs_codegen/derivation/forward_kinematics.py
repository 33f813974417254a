"""Positions and motions of the robot's points, frames and centre of mass, in world axes.

Mass as a whole comes from composite bodies, in one pass inwards over the tree: the centre of mass
and its Jacobian, gravity, and the momentum about the centre.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import sympy as sp

from gibbs_codegen.derivation import tree_dynamics
from gibbs_codegen.derivation.inertia import Inertia
from gibbs_codegen.derivation.jointed_bodies import JointedBodies
from gibbs_codegen.derivation.motion import Acceleration, TreeState
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.robot.layout import frames_of
from gibbs_codegen.robot.names import identifier
from gibbs_codegen.robot.parts.numbers import BASE
from gibbs_codegen.symbolic.structural import Turn, product, turned_by_rpy
from gibbs_codegen.symbolic.tape import Scalars, Stage, Vector, plus, times
from gibbs_codegen.symbolic.vectors import NO_ROTATION, ZERO, Matrix, Rotation, axis_vector, minus

Frame = tuple[Vector, ...]


@dataclass(frozen=True)
class SegmentFrame:
    """Pose of a segment: its joint from the origin of the coordinates, and axes, in world axes.

    `group` are the axes of its group frame, the last of them that of its joint; `axes` are
    the link's.
    """

    position: Vector
    group: Frame
    axes: Frame


def segment_frames(symbolic: SymbolicRobot, in_base: bool = False) -> list[SegmentFrame]:
    """Frames of all segments, from the root to the leaves, in world axes from the origin.

    With `in_base` they are in the axes of the root's group frame.
    """
    tape, root, tree = symbolic.tape, symbolic.root, symbolic.reduced_tree
    with tape.group("axes of the base"):
        units = map(axis_vector, range(3))
        group = tuple([unit if in_base else root.world(tape, unit) for unit in units])
        frames = [SegmentFrame(ZERO, group, _turned(tape, group, tree.segments[0].rotation))]
    for segment in tree.segments[1:]:
        parent = frames[segment.parent]
        with tape.group(f"{segment.joint_name} and the axes of {segment.name}"):
            axes = _turned(tape, parent.axes, segment.turn)
            position = tape.add(parent.position, combined(tape, axes, segment.step))
            starts = segment.starts_group
            group = _turned(tape, axes, segment.twist) if starts else parent.group
            position = tape.add(position, tape.scale(segment.d, group[2]))
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
            return tape.add(frame.position, combined(tape, frame.axes, self.position))


def mounted_frames(
    symbolic: SymbolicRobot, name: str | None = None, bodies: JointedBodies | None = None
) -> list[MountedFrame]:
    """The frames of a robot, in the order of FRAMES, or only that of a name.

    They are on segments of the reduced tree, or on those of other `bodies`.
    """
    tape, robot = symbolic.tape, symbolic.robot
    mounted = []
    for frame in frames_of(robot):
        body = (bodies or symbolic.bodies).frames[frame.on]
        if frame in robot.frames:
            place = symbolic.parameters.frames[frame.name]
        elif frame.rotor is not None:
            place = symbolic.parameters.rotors[frame.rotor]["position"]
        elif frame.on != BASE:  # The tip: the end of the last link.
            place = axis_vector(0, symbolic.parameters.links[frame.on].body.length)
        else:
            place = ZERO
        with tape.group("places of the frames", Stage.PARAMETER):
            position = body.point(tape, place)
        turn = product(body.turn, turned_by_rpy(frame.pose.rpy_deg))
        mounted.append(MountedFrame(identifier(frame.name), body.segment, position, turn))
    return [frame for frame in mounted if name in (None, frame.name)]


def rotor_place(symbolic: SymbolicRobot, bodies: JointedBodies, k: int) -> tuple[int, Vector]:
    """Segment of rotor k = 1 … N, and its position from the joint in the segment's frame (m)."""
    tape = symbolic.tape
    if symbolic.robot.thrusters:
        frame = bodies.frames[symbolic.robot.thrusters[k - 1].on]
        return frame.segment, frame.point(tape, symbolic.parameters.rotors[k]["position"])
    reach = axis_vector(0, symbolic.rod_reach(k))
    return 0, tape.add(symbolic.centre, symbolic.rod_frame(k).vector(tape, reach))


def combined(tape: Scalars, frame: Frame, vector: Vector) -> Vector:
    """A vector of a frame, in the axes that those of the frame are given in."""
    return tape.add(*(tape.scale(length, axis) for length, axis in zip(vector, frame, strict=True)))


def _turned(tape: Scalars, frame: Frame, rotation: Rotation) -> Frame:
    """Axes of the frame that `rotation` turns out of `frame`."""
    p, q = rotation.plane
    axes = list(frame)
    cos, sin, pairs = rotation.cos, rotation.sin, list(zip(frame[p], frame[q], strict=True))
    axes[p] = tuple([tape.let(plus(times(cos, a), times(sin, b))) for a, b in pairs])
    axes[q] = tuple([tape.less(times(cos, b), times(sin, a)) for a, b in pairs])
    return tuple(axes)


def positions(symbolic: SymbolicRobot) -> list[Vector]:
    """World positions (m) of POINTS: the base, the rotors, the joints and the frames."""
    tape, robot = symbolic.tape, symbolic.robot
    frames = segment_frames(symbolic)
    named = [
        mounted.from_origin(tape, frames)
        for mounted in mounted_frames(symbolic)
        if mounted.name != "base"
    ]
    with tape.group("base centre and rotors"):
        body = symbolic.bodies.frames[BASE]
        centre = combined(tape, frames[body.segment].axes, body.origin)
        if body.segment:
            centre = tape.add(frames[body.segment].position, centre)
        rotors = []
        for k in range(1, robot.rotors + 1):
            segment, place = rotor_place(symbolic, symbolic.bodies, k)
            point = combined(tape, frames[segment].axes, place)
            rotors.append(tape.add(frames[segment].position, point) if segment else point)
    joints = []
    for body in map(symbolic.bodies.frames.__getitem__, robot.moving):
        frame, joint = frames[body.segment], symbolic.reduced_tree.segments[body.segment]
        with tape.group(f"position of {joint.joint_name}"):
            place = combined(tape, frame.axes, body.origin)
            joints.append(tape.add(frame.position, place))
    base = [rotors[0], centre] if robot.base.rotors else [centre]
    with tape.group("positions in the world"):
        return [tape.add(symbolic.origin, point) for point in [*base, *rotors, *joints, *named]]


def frame_poses(symbolic: SymbolicRobot, name: str | None = None) -> list[Matrix]:
    """Homogeneous transforms of the frames, or of one, 4×4 by rows; positions in m."""
    tape, mounted, poses = symbolic.tape, mounted_frames(symbolic, name), []
    frames = segment_frames(symbolic)
    for frame in mounted:
        with tape.group(f"position of {frame.name}"):
            position = tape.add(symbolic.origin, frame.from_origin(tape, frames))
        with tape.group(f"axes of {frame.name}"):
            segment_axes, columns = frames[frame.segment].axes, zip(*frame.turn, strict=True)
            axes = [combined(tape, segment_axes, column) for column in columns]
        rows = [[axis[i] for axis in axes] + [position[i]] for i in range(3)]
        poses.append([*rows, [*ZERO, sp.S.One]])
    return poses


def frame_jacobians(symbolic: SymbolicRobot, name: str | None = None) -> list[Matrix]:
    """Jacobians of the frames, or of one, 6 rows each, linear and then angular, in world axes.

    Columns are in the order of v; a joint that does not support the frame has a column of zeros.
    """
    tape, tree, mounted = symbolic.tape, symbolic.reduced_tree, mounted_frames(symbolic, name)
    frames, jacobians = segment_frames(symbolic), []
    for mounting in mounted:
        point = mounting.from_origin(tape, frames)
        with tape.group("columns of the base"):
            base = symbolic.root.velocities_at(tape, point)
        joints = [(ZERO, ZERO)] * tree.joints
        for k in reversed(tree.path(mounting.segment)[:-1]):
            segment, frame = tree.segments[k], frames[k]
            axis = frame.group[2]
            if segment.joint == "revolute":
                with tape.group(f"column of {segment.joint_name}"):
                    arm = tape.add(point, minus(frame.position))
                    joints[k - 1] = (tape.cross(axis, arm), axis)
            else:
                joints[k - 1] = (axis, ZERO)
        columns = symbolic.places.joined(base, joints)
        rows = [[column[part][i] for column in columns] for part in range(2) for i in range(3)]
        jacobians.append(rows)
    return jacobians


def frame_velocities(symbolic: SymbolicRobot) -> list[list[sp.Expr]]:
    """Linear and then angular velocity of each frame, in world axes (m/s, rad/s).

    They are the accelerations at rest, with v for a.
    """
    return frame_motions(symbolic, TreeState.resting(symbolic.v))


def frame_bias_accelerations(symbolic: SymbolicRobot) -> list[list[sp.Expr]]:
    """J̇ v of all frames' Jacobians, linear and then angular in world axes: theirs where a = 0."""
    return frame_motions(symbolic, TreeState.coasting(symbolic.v))


def frame_motions(symbolic: SymbolicRobot, state: TreeState) -> list[list[sp.Expr]]:
    """Linear and then angular accelerations of all frames, in world axes, from one pass outwards.

    `state` is without gravity.
    """
    tape, tree, frames = symbolic.tape, symbolic.reduced_tree, segment_frames(symbolic)
    motions = tree_dynamics.motions_about_origin(tape, symbolic.root, tree, state)
    origin = symbolic.origin_acceleration(state)
    rows = []
    for mounted in mounted_frames(symbolic):
        k, frame = mounted.segment, frames[mounted.segment]
        by_segment = tree.works_in_own_frame(k)
        with tape.group(f"motion of {mounted.name} in world axes"):
            rotation = NO_ROTATION if by_segment else tree.segments[k].rotation
            motion = motions[k].displaced(tape, rotation.vector(tape, mounted.position))
            axes = frame.axes if by_segment else frame.group
            linear = tape.add(origin, combined(tape, axes, motion.acceleration))
            rows.append([*linear, *combined(tape, axes, motion.omega_dot)])
    return rows


def tip_bias_acceleration(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """J̇ v of the tip's Jacobian: linear and angular acceleration where a = 0, in world axes.

    What each segment on the path to the tip adds is summed from there inwards and turned towards
    the world on the way: passed outwards, the sum would be turned twice.
    """
    (mounted,) = mounted_frames(symbolic, "tip")
    tape, root, tree = symbolic.tape, symbolic.root, symbolic.reduced_tree
    motions = tree_dynamics.free_motions(tape, root, tree, symbolic.v)
    base_state, joints = TreeState.coasting(symbolic.v).split(symbolic.places)
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
                motion = motion.slid(tape, joints.rates[k - 1], sp.S.Zero)
            end = Acceleration(motion.acceleration, end.angular)
            end = end.rotated(tape, working_to_group).rotated(tape, segment.twist)
            end = end.rotated(tape, segment.turn)
            reach = segment.turn.vector(tape, segment.step)
    with tape.group(f"acceleration of {mounted.name} in world axes"):
        base = root.frame_motion(tape, base_state)
        linear = tape.add(end.linear, base.acceleration)
        return [*root.world(tape, linear), *root.world(tape, end.angular)]


def centre_of_mass(symbolic: SymbolicRobot) -> Vector:
    """World position of the centre of mass (m)."""
    tape = symbolic.tape
    centre = _centre(symbolic, tree_dynamics.whole_inertia(tape, symbolic.reduced_tree))
    with tape.group("centre of mass in the world"):
        return tape.add(symbolic.origin, symbolic.root.world(tape, centre))


def _centre(symbolic: SymbolicRobot, whole: Inertia) -> Vector:
    """The centre of mass from the origin of the coordinates, in the root's group frame."""
    tape = symbolic.tape
    with tape.group("centre of mass from the origin"):
        return tape.scale(tape.let(1 / whole.mass), whole.moment)


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
    frames, composites = segment_frames(symbolic), dict(tree_dynamics.composites_inward(tape, tree))
    whole = composites[0]
    centre = _centre(symbolic, whole)
    with tape.group("columns of the base"):
        centre = root.world(tape, centre)
        base = [linear for linear, _ in root.velocities_at(tape, centre)]
    joints = []
    for k, segment in enumerate(tree.segments[1:], start=1):
        with tape.group(f"column of {segment.joint_name}"):
            force = composites[k].response(tape, segment.direction).force
            share = tape.scale(tape.let(1 / whole.mass), force)
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
    state = TreeState.resting(symbolic.v)
    momentum, _ = tree_dynamics.inward(
        tape, tree, tree_dynamics.motions_about_origin(tape, root, tree, state)
    )
    whole = tree_dynamics.whole_inertia(tape, tree)
    centre = _centre(symbolic, whole)
    with tape.group("momentum in world axes"):
        angular = momentum.shifted(tape, minus(centre)).moment
        origin = tape.scale(whole.mass, symbolic.origin_acceleration(state))
        linear = tape.add(origin, root.world(tape, momentum.force))
        return [*linear, *root.world(tape, angular)]
