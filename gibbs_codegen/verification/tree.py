"""The robot as a tree of rigid bodies on joints of one degree of freedom each, in plain numbers.

Coordinates here are those of all joints in the order of the hybrid system, such as θ₋₁, θ₀, θ₁,
θ₂ … θ_N, θ_{N+1} … θ_{N+n}, x, y, z.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.verification.joints import WORLD, Assembly, Point
from gibbs_codegen.verification.passive import PassiveJoints
from gibbs_codegen.verification.vectors import Array, about, quaternions_of_angles


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

    - `layout`: of the reduced coordinates.
    - `placement`: where the world's first joints begin, rotation (s, 3, 3) and position (s, 3), for
      each of s states; None in the world's origin.
    - `free`, `constrained`, `arm`: places of the velocities, of the constrained joints and of the
      arm's among all joints.
    - `turns`, `scales`: for each coordinate whether it is an angle; 1 if so, else the reach.
    - `reach`, `tempo`: a length of the robot's own size, in m; what rates are of the order of, in
      1/s.
    - `parts`, `bodies`, `carriers`: the bodies of the joints one by one, and as of `Assembly`.
    - `points`, `named`: points in the order of a module's POINTS, and frames in that of FRAMES.
    - `seats`: where the motors sit, and then the named frames.
    - `tip`: number of the frame of that name, or None.
    - `passive`: what acts on the joints by themselves.
    """

    def __init__(self, robot: Robot) -> None:
        self.gravity = robot.gravity
        self.mass = robot.total_mass
        self.layout = layout_of(robot)
        self.placement: tuple[Array, Array] | None = None
        self.free = self.layout.free
        built = Assembly(robot)
        self.joints, self.parts, self.arm = built.joints, built.parts, built.arm
        self.bodies, self.carriers = built.bodies, built.carriers
        self.size = len(self.joints)
        self.constrained = [*range(self.size)[self.layout.constrained]]
        self.turns = np.zeros(self.size, bool)
        self.turns[[joint.place for joint in self.joints if joint.revolute]] = True
        self.points = built.points
        offsets = [np.linalg.norm(joint.offset) for joint in self.joints]
        bodies = [np.linalg.norm(joint.com) for joint in self.joints]
        fixed = [np.linalg.norm(point.local) for point in self.points]
        # How far from the base anything of the robot may be, or 1 if it is a point.
        self.reach = float(sum(offsets) + max(bodies) + max(fixed)) or 1.0
        # At the rate at which a pendulum of that length swings, weight and inertia are alike.
        self.tempo = float(np.sqrt(abs(self.gravity) / self.reach)) or 1.0
        self.scales = np.where(self.turns, 1.0, self.reach)
        self.motors = [motor for _, motor in built.motors]
        self.named = [point for _, point in built.frames]
        self.seats = [*(seat for seat, _ in built.motors), *self.named]
        names = [frame.name for frame, _ in built.frames]
        self.tip = names.index("tip") if "tip" in names else None
        self.passive = PassiveJoints.of(robot, self.size, self.arm)

    @property
    def middle_angle(self) -> int:
        """Place in v of the middle angle of the attitude, as `coordinates` takes it."""
        return range(self.size)[self.layout.v.attitude][1]

    def coordinates(self, angles: Array) -> Array:
        """Coordinates (…, nq) as the robot's module takes them.

        `angles` (…, nv) are in the order of v, with the attitude as three angles.
        """
        if not self.layout.is_quaternion:
            return angles
        base, joints = self.layout.v, angles[..., self.layout.v.joints]
        attitude = quaternions_of_angles(angles[..., base.attitude])
        return np.concatenate([angles[..., base.position], attitude, joints], axis=-1)

    def spread(self, values: Array) -> Array:
        """Values (…, nv) as those (…, size) of all joints, zero at the constrained ones."""
        every = np.zeros((*values.shape[:-1], self.size), values.dtype)
        every[..., self.free] = values
        return every

    def at_joints(self, q: Array) -> Array:
        """Coordinates (…, size) of the arm's joints from q (…, nq), whatever the base's are.

        They are zero at the joints of the base and at the constrained ones.
        """
        every = np.zeros((*q.shape[:-1], self.size))
        every[..., self.arm] = q[..., self.layout.q.joints]
        return every

    def frames(self, q: Array) -> Frames:
        """Frames of all joints at coordinates q (…, size) of all, which may be complex."""
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
        """World positions of points, in m, (…, points, 3)."""
        rotations, positions, _ = frames
        return np.stack(
            [positions[p.joint] + rotations[p.joint] @ p.local for p in points], axis=-2
        )

    def poses(self, frames: Frames) -> Array:
        """Homogeneous transforms (…, seats, 4, 4) of the seats to the world."""
        positions = self.positions(frames, self.seats)
        poses = np.zeros((*positions.shape[:-1], 4, 4))
        turns = [frames.rotations[seat.joint] @ seat.rotation for seat in self.seats]
        poses[..., :3, :3] = np.stack(turns, axis=-3)
        poses[..., :3, 3] = positions
        poses[..., 3, 3] = 1.0
        return poses
