"""The robot as a tree of rigid bodies on joints of one degree of freedom each, in plain numbers.

The position and the attitude of the base are joints without mass, and the constrained joints of the
base arms are joints like any other. Coordinates here are those of all joints in the order of the
hybrid system: θ₋₁, θ₀, θ₁, θ₂ … θ_N, θ_{N+1} … θ_{N+n}, x, y, z.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from gibbs_codegen.robot.coordinates import frames_of, points
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Base, Body, Robot, Rod
from gibbs_codegen.verification.vectors import Array, about, quaternions_of_angles

WORLD = -1


@dataclass(frozen=True)
class Joint:
    """A joint with the body that it carries.

    Attributes:
        parent: number of the joint that it hangs on, or `WORLD`.
        place: place of its coordinate.
        axis: number of the axis of its own frame about or along which it moves.
        revolute: whether it turns; else it slides.
        rotation: (3, 3) from its frame to its parent's, at coordinate zero.
        offset: (3,) from the parent's origin to its own, at coordinate zero, in m.
        mass: of the body, in kg.
        com: (3,) centre of mass of the body in the joint's frame, in m.
        inertia: (3, 3) of the body about its centre of mass, in the joint's axes, in kg m².
    """

    parent: int
    place: int
    axis: int
    revolute: bool = True
    rotation: Array = field(default_factory=lambda: np.eye(3))
    offset: Array = field(default_factory=lambda: np.zeros(3))
    mass: float = 0.0
    com: Array = field(default_factory=lambda: np.zeros(3))
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))


class Point(NamedTuple):
    """A point fixed in the frame of a joint: `local` (3,) in m."""

    joint: int
    local: Array


class Motor(NamedTuple):
    """The direction of a motor's thrust in the frame of the joint it sits on, and its drag in m."""

    direction: Array
    drag: float


class Frames(NamedTuple):
    """World rotations (…, 3, 3) and positions (…, 3) of joints' frames, in the joints' order.

    `steps` (…, 3) lead to each from its parent: short ones keep digits that differences of
    positions would lose.
    """

    rotations: list[Array]
    positions: list[Array]
    steps: list[Array]


class Tree:
    """Joints from the world outwards, named points, motors, and which joints are constrained.

    Attributes:
        layout: layout of the reduced coordinates.
        placement: where the world's first joints begin, rotation (s, 3, 3) and position (s, 3), for
            each of s states; None in the world's origin.
        free: places of the velocities among those of all joints.
        constrained: places of the constrained joints.
        arm: places of the arm's joints.
        turns: for each coordinate, whether it is an angle.
        reach: a length of the robot's own size, in m.
        scales: for each coordinate the reach if it is a length, and 1 if it is an angle.
        tempo: what rates are of the order of, in 1/s.
        points: the named points, in the order of a module's POINTS.
        frame_count: number of the frames, in the order of a module's FRAMES.
        seats: where the motors sit, and then the tip.
    """

    def __init__(self, robot: Robot) -> None:
        self.gravity = robot.gravity
        self.mass = robot.total_mass
        self.joints: list[Joint] = []
        self.layout = layout_of(robot)
        self.placement: tuple[Array, Array] | None = None
        self.free = self.layout.free
        self.size = len(self.free) + robot.rotors - 1
        self.constrained = [*range(self.size)[self.layout.constrained]]
        self.arm = self.free[self.layout.v.joints]
        named = self._base(robot.base)
        self.tip = named["tip"] = self._arm(robot, named)
        self.turns = np.zeros(self.size, bool)
        self.turns[[joint.place for joint in self.joints if joint.revolute]] = True
        offsets = [np.linalg.norm(joint.offset) for joint in self.joints]
        bodies = [np.linalg.norm(joint.com) for joint in self.joints]
        # How far from the base anything of the robot may be, or 1 if it is a point.
        self.reach = float(sum(offsets) + max(bodies) + np.linalg.norm(self.tip.local)) or 1.0
        # At the rate at which a pendulum of that length swings, weight and inertia are alike.
        self.tempo = float(np.sqrt(abs(self.gravity) / self.reach)) or 1.0
        self.scales = np.where(self.turns, 1.0, self.reach)
        self.points = [named[name] for name in points(robot)]
        self.frame_count = len(frames_of(robot))
        base = robot.base
        self.motors = [
            Motor(np.array(direction), drag)
            for direction, drag in zip(base.thrust, base.drag, strict=True)
        ]
        self.seats = [*(named[f"motor{k}"] for k in range(1, robot.rotors + 1)), self.tip]

    def _base(self, base: Base) -> dict[str, Point]:
        """Add the joints of the base and its arms; return their named points."""
        joint = WORLD
        for place, letter in zip(self.free[self.layout.v.position], "xyz", strict=True):
            joint = self._add(Joint(joint, place, "xyz".index(letter), revolute=False))
        sequence = "xyz" if self.layout.is_quaternion else self.layout.attitude
        for place, letter in zip(self.free[self.layout.v.attitude], sequence, strict=True):
            joint = self._add(Joint(joint, place, "xyz".index(letter)))
        length = base.arm(1).length
        start = np.array([0.0 if base.origin == "motor1" else -length, 0.0, 0.0])
        centre = start + np.array([length, 0.0, 0.0])
        self.joints[joint] = replace(self.joints[joint], **_carried(base.arm(1), start))
        named = {"O1": Point(joint, start), "O2": Point(joint, centre)}
        named["motor1"] = named["O1"]
        for k, place in enumerate(self.constrained, start=2):
            turned = _turn("z", -180.0 + 360.0 * (k - 1) / base.rotors)
            body = _carried(base.arm(k))
            arm = self._add(Joint(joint, place, 2, rotation=turned, offset=centre, **body))
            named[f"motor{k}"] = Point(arm, np.array([base.arm(k).length, 0.0, 0.0]))
        return named

    def _arm(self, robot: Robot, named: dict[str, Point]) -> Point:
        """Add the joints of the arm and their named points; return the tip."""
        end = named["O2"]
        before = 0.0
        for i, link in enumerate(robot.links, start=1):
            a = before if link.a is None else link.a
            twist = _turn("x", float(link.alpha_deg))
            # The tip of a link is where the next frame would be by default; a replaces that.
            start = end.local if i == 1 else np.zeros(3)
            joint = self._add(
                Joint(
                    end.joint,
                    self.arm[i - 1],
                    2,
                    revolute=link.joint == "revolute",
                    rotation=twist @ _turn("z", float(link.theta_deg)),
                    offset=start + np.array([a, 0.0, 0.0]) + twist @ np.array([0.0, 0.0, link.d]),
                    **_carried(link.body),
                )
            )
            named[f"joint{robot.rotors + i}"] = Point(joint, np.zeros(3))
            before = link.body.length
            end = Point(joint, np.array([before, 0.0, 0.0]))
        return end

    def _add(self, joint: Joint) -> int:
        self.joints.append(joint)
        return len(self.joints) - 1

    @property
    def middle_angle(self) -> int:
        """Place in v of the middle angle of the attitude, as `coordinates` takes it."""
        return range(self.size)[self.layout.v.attitude][1]

    def coordinates(self, angles: Array) -> Array:
        """Coordinates as the robot's module takes them.

        Args:
            angles: Coordinates in the order of v, the attitude as three angles, (…, nv).

        Returns:
            (…, nq).
        """
        if not self.layout.is_quaternion:
            return angles
        base, joints = self.layout.v, angles[..., self.layout.v.joints]
        attitude = quaternions_of_angles(angles[..., base.attitude])
        return np.concatenate([angles[..., base.position], attitude, joints], axis=-1)

    def spread(self, values: Array) -> Array:
        """Reduced values as those of all joints.

        Args:
            values: (…, nv), one for each velocity.

        Returns:
            (…, size), zero at the constrained joints.
        """
        every = np.zeros((*values.shape[:-1], self.size), values.dtype)
        every[..., self.free] = values
        return every

    def frames(self, q: Array) -> Frames:
        """Frames of all joints.

        Args:
            q: Coordinates of all joints in rad and m, (…, size), which may be complex.

        Returns:
            The frames, in the joints' order.
        """
        rotations: list[Array] = []
        positions: list[Array] = []
        steps: list[Array] = []
        for joint in self.joints:
            rotation, step, travel = joint.rotation, joint.offset, q[..., joint.place]
            if joint.parent != WORLD:
                parent = rotations[joint.parent]
                rotation, step = parent @ rotation, parent @ step
            elif self.placement:
                ones = (1,) * (travel.ndim - 1)
                rotation, step = (x.reshape(-1, *ones, *x.shape[1:]) for x in self.placement)
            if joint.revolute:
                rotation = rotation @ about(joint.axis, travel)
            else:
                step = step + rotation[..., joint.axis] * travel[..., None]
            rotations.append(np.broadcast_to(rotation, (*travel.shape, 3, 3)))
            steps.append(np.broadcast_to(step, (*travel.shape, 3)))
            begin = 0.0 if joint.parent == WORLD else positions[joint.parent]
            positions.append(begin + steps[-1])
        return Frames(rotations, positions, steps)

    @staticmethod
    def positions(frames: Frames, points: Sequence[Point]) -> Array:
        """World positions of points.

        Args:
            frames: The joints' frames.
            points: The points.

        Returns:
            Positions in m, (…, points, 3).
        """
        rotations, positions, _ = frames
        return np.stack(
            [positions[p.joint] + rotations[p.joint] @ p.local for p in points], axis=-2
        )

    def poses(self, frames: Frames) -> Array:
        """Homogeneous transforms of the seats, with the axes of their joints.

        Args:
            frames: The joints' frames.

        Returns:
            Transforms to the world, (…, seats, 4, 4).
        """
        positions = self.positions(frames, self.seats)
        poses = np.zeros((*positions.shape[:-1], 4, 4))
        poses[..., :3, :3] = np.stack([frames.rotations[p.joint] for p in self.seats], axis=-3)
        poses[..., :3, 3] = positions
        poses[..., 3, 3] = 1.0
        return poses


def _carried(body: Body, start: Array | float = 0.0) -> dict[str, Any]:
    """Mass, centre of mass and inertia of a body whose frame begins at `start` of its joint's."""
    if isinstance(body, Rod):
        mass, length = body.mass_per_length * body.length, body.length
        thin = mass * length**2 / 12
        x, y, z = body.section_inertia
        com, inertia = (length / 2, 0.0, 0.0), np.diag([x, y + thin, z + thin])
    else:
        xx, yy, zz, xy, xz, yz = body.inertia
        mass, com = body.mass, body.com
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return {"mass": mass, "com": start + np.array(com), "inertia": inertia}


def _turn(axis: str, degrees: float) -> Array:
    return about("xyz".index(axis), np.array(np.deg2rad(degrees)))
