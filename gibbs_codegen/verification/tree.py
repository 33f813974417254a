"""The robot as a tree of rigid bodies on joints of one degree of freedom each, in plain numbers.

The position and the attitude of the base are joints without mass, and the constrained joints of the
base arms are joints like any other. Coordinates here are those of all joints in the order of the
hybrid system: θ₋₁, θ₀, θ₁, θ₂ … θ_N, θ_{N+1} … θ_{N+n}, x, y, z.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.robot.coordinates import points
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Body, Robot, Rod

# Real or complex: the Lagrangian formulation differentiates by complex steps.
Array = NDArray[Any]

WORLD = -1


@dataclass(frozen=True)
class Joint:
    """A joint with the body that it carries.

    `parent` is the number of the joint that it hangs on, `place` that of its coordinate. At
    coordinate zero its frame is turned by `rotation` (3, 3) and moved by `offset` (3,) against the
    parent's; `axis` is the number of the axis of its own frame about or along which it moves.
    `mass` in kg, `com` (3,) in m and `inertia` (3, 3) about the centre of mass in kg m² are the
    body's, in the joint's frame.
    """

    parent: int
    place: int
    revolute: bool
    axis: int
    rotation: Array
    offset: Array
    mass: float
    com: Array
    inertia: Array


@dataclass(frozen=True)
class Point:
    """A point fixed in the frame of a joint: `local` (3,) in m."""

    joint: int
    local: Array


@dataclass(frozen=True)
class Motor:
    """Where a motor sits, the direction of its thrust in that joint's frame, and its drag in m."""

    seat: Point
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
    """Joints from the world outwards, named points, motors, the tip, and which joints are held.

    `layout` is that of the reduced coordinates; `free` and `held` are their places and those of the
    constrained joints among all; `arm` the places of the arm's joints; `turns` tells which are
    angles. `reach` in m is a length of the machine's own size, and `scales` has it for each
    coordinate that is a length, 1 for each that is an angle; `tempo` in 1/s is what rates are of
    the order of.
    """

    def __init__(self, robot: Robot) -> None:
        self.gravity = robot.gravity
        self.mass = robot.total_mass
        self.joints: list[Joint] = []
        self.layout = layout_of(robot)
        self.free = self.layout.free
        self.size = len(self.free) + robot.rotors - 1
        self.held = [*range(self.size)[self.layout.constrained]]
        self.arm = self.free[self.layout.joints]
        named = self._base(robot)
        self.tip = self._arm(robot, named)
        self.turns = np.zeros(self.size, bool)
        self.turns[[joint.place for joint in self.joints if joint.revolute]] = True
        self._measure()
        self.points = [named[name] for name in points(robot)]
        self.motors = [
            Motor(named[f"motor{k}"], np.array(direction), drag)
            for k, (direction, drag) in enumerate(
                zip(robot.base.thrust, robot.base.drag, strict=True), start=1
            )
        ]

    def _base(self, robot: Robot) -> dict[str, Point]:
        base = robot.base
        joint = WORLD
        for place, letter in zip(self.free[self.layout.position], "xyz", strict=True):
            joint = self._add(joint, place, letter, revolute=False)
        for place, letter in zip(self.free[self.layout.attitude], base.attitude, strict=True):
            joint = self._add(joint, place, letter)
        length = base.arm(1).length
        start = np.array([0.0 if base.origin == "motor1" else -length, 0.0, 0.0])
        centre = start + np.array([length, 0.0, 0.0])
        self._load(joint, base.arm(1), start)
        self.base = joint
        named = {"O1": Point(joint, start), "O2": Point(joint, centre)}
        named["motor1"] = named["O1"]
        for k, place in enumerate(self.held, start=2):
            turned = _turn("z", -180.0 + 360.0 * (k - 1) / base.rotors)
            arm = self._add(self.base, place, "z", rotation=turned, offset=centre)
            self._load(arm, base.arm(k), np.zeros(3))
            named[f"motor{k}"] = Point(arm, np.array([base.arm(k).length, 0.0, 0.0]))
        return named

    def _arm(self, robot: Robot, named: dict[str, Point]) -> Point:
        end = named["O2"]
        before = 0.0
        for i, link in enumerate(robot.links, start=1):
            a = before if link.a is None else link.a
            twist = _turn("x", float(link.alpha_deg))
            # The tip of a link is where the next frame would be by default; a replaces that.
            start = end.local if i == 1 else np.zeros(3)
            joint = self._add(
                end.joint,
                self.arm[i - 1],
                "z",
                revolute=link.joint == "revolute",
                rotation=twist @ _turn("z", float(link.theta_deg)),
                offset=start + np.array([a, 0.0, 0.0]) + twist @ np.array([0.0, 0.0, link.d]),
            )
            self._load(joint, link.body, np.zeros(3))
            named[f"joint{robot.rotors + i}"] = Point(joint, np.zeros(3))
            before = link.body.length
            end = Point(joint, np.array([before, 0.0, 0.0]))
        named["tip"] = end
        return end

    def _add(
        self,
        parent: int,
        place: int,
        axis: str,
        revolute: bool = True,
        rotation: Array | None = None,
        offset: Array | None = None,
    ) -> int:
        turned = np.eye(3) if rotation is None else rotation
        moved = np.zeros(3) if offset is None else offset
        nothing = (0.0, np.zeros(3), np.zeros((3, 3)))
        self.joints.append(
            Joint(parent, place, revolute, "xyz".index(axis), turned, moved, *nothing)
        )
        return len(self.joints) - 1

    def _load(self, joint: int, body: Body, start: Array) -> None:
        """Give a joint its body, whose own frame begins at `start` of the joint's."""
        mass, com, inertia = _mass_properties(body)
        bare = self.joints[joint]
        self.joints[joint] = Joint(
            bare.parent,
            bare.place,
            bare.revolute,
            bare.axis,
            bare.rotation,
            bare.offset,
            mass,
            start + com,
            inertia,
        )

    def _measure(self) -> None:
        """Set the machine's own length and time."""
        offsets = [np.linalg.norm(joint.offset) for joint in self.joints]
        bodies = [np.linalg.norm(joint.com) for joint in self.joints]
        # How far from the base anything of the machine may be, or 1 if it is a point.
        self.reach = float(sum(offsets) + max(bodies) + np.linalg.norm(self.tip.local)) or 1.0
        # At the rate at which a pendulum of that length swings, weight and inertia are alike.
        self.tempo = float(np.sqrt(abs(self.gravity) / self.reach)) or 1.0
        self.scales = np.where(self.turns, 1.0, self.reach)

    def in_units(self, length: float, mass: float, time: float) -> Tree:
        """The same machine, its numbers in units of so many m, kg and s."""

        def moved(point: Point) -> Point:
            return replace(point, local=point.local / length)

        other = copy.copy(self)
        other.gravity = self.gravity * time**2 / length
        other.mass = self.mass / mass
        other.joints = [
            replace(
                joint,
                offset=joint.offset / length,
                mass=joint.mass / mass,
                com=joint.com / length,
                inertia=joint.inertia / mass / length**2,
            )
            for joint in self.joints
        ]
        other.tip = moved(self.tip)
        other.points = [moved(point) for point in self.points]
        other.motors = [
            replace(motor, seat=moved(motor.seat), drag=motor.drag / length)
            for motor in self.motors
        ]
        other._measure()
        return other

    def spread(self, values: Array) -> Array:
        """Reduced values (…, nq) as those of all joints (…, size), zero at the held ones."""
        every = np.zeros((*values.shape[:-1], self.size), values.dtype)
        every[..., self.free] = values
        return every

    def frames(self, q: Array) -> Frames:
        """Frames of all joints at coordinates (…, size), which may be complex."""
        rotations: list[Array] = []
        positions: list[Array] = []
        steps: list[Array] = []
        for joint in self.joints:
            rotation, step = joint.rotation, joint.offset
            if joint.parent != WORLD:
                parent = rotations[joint.parent]
                rotation, step = parent @ rotation, parent @ step
            travel = q[..., joint.place]
            if joint.revolute:
                rotation = rotation @ _about(joint.axis, travel)
            else:
                step = step + rotation[..., joint.axis] * travel[..., None]
            rotations.append(np.broadcast_to(rotation, (*travel.shape, 3, 3)))
            steps.append(np.broadcast_to(step, (*travel.shape, 3)))
            begin = 0.0 if joint.parent == WORLD else positions[joint.parent]
            positions.append(begin + steps[-1])
        return Frames(rotations, positions, steps)


def _mass_properties(body: Body) -> tuple[float, Array, Array]:
    """Mass, centre of mass and inertia about it, in the body's own frame."""
    if isinstance(body, Rod):
        mass, length = body.mass_per_length * body.length, body.length
        thin = mass * length**2 / 12
        x, y, z = body.section_inertia
        inertia = np.diag([x, y + thin, z + thin])
        return mass, np.array([length / 2, 0.0, 0.0]), inertia
    xx, yy, zz, xy, xz, yz = body.inertia
    return body.mass, np.array(body.com), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _turn(axis: str, degrees: float) -> Array:
    return _about("xyz".index(axis), np.array(np.deg2rad(degrees)))


def _about(axis: int, angle: Array) -> Array:
    """Rotations (…, 3, 3) about a coordinate axis."""
    cosine, sine = np.cos(angle), np.sin(angle)
    following, last = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.zeros((*angle.shape, 3, 3), angle.dtype)
    rotation[..., axis, axis] = 1.0
    rotation[..., following, following] = rotation[..., last, last] = cosine
    rotation[..., last, following] = sine
    rotation[..., following, last] = -sine
    return rotation


def times(matrices: Array, vectors: Array) -> Array:
    """Products of matrices (…, i, j) and vectors (…, j)."""
    product: Array = (matrices @ vectors[..., None])[..., 0]
    return product


def cross(a: Array, b: Array) -> Array:
    """Cross products of vectors (…, 3): np.cross takes four times as long for so few of them."""
    product: Array = a[..., (1, 2, 0)] * b[..., (2, 0, 1)] - a[..., (2, 0, 1)] * b[..., (1, 2, 0)]
    return product
