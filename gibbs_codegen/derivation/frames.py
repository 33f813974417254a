"""Where segments and named frames are, and their axes, in world axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.derivation.root.protocol import Root
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.robot.coordinates import frames_of
from gibbs_codegen.robot.model import BASE
from gibbs_codegen.robot.names import identifier
from gibbs_codegen.symbolic.structural import Turn, product, turned_by_rpy
from gibbs_codegen.symbolic.tape import Scalars, Stage
from gibbs_codegen.symbolic.vectors import ZERO, Rotation, Vector, add, axis_vector, scale

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
