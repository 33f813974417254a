"""Robots with constraints, and what Pinocchio's Jacobians and masses make of them, densely."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.layout import frames_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.constraint import Constraint, ConstraintKind, LoopJoint
from gibbs_codegen.robot.parts.numbers import AXES
from gibbs_codegen.robot.parts.pose import Pose
from support.machines import base, constraint, frame, link, machine
from support.pinocchio_oracle import Oracle, placed
from support.random_robots import random_pose, random_robot, random_tree, thrust

Array = np.ndarray
# With what is held by the world and within the robot, some of it redundantly.
TEXT = machine(
    "held",
    base(1.2, [0.01, 0.01, 0.02], attitude="quaternion"),
    link("finger", "y", [0, 0, -0.05], 0.1, [0, 0, -0.1], [0.0003, 0.0003, 2e-05]),
    frame("claw", "finger", [0, 0.01, -0.2], rpy_deg=[0, 20, 0]),
    constraint("grip", "frame", "claw", xyz=[0, 0, 2], rpy_deg=[10, 0, 30], frequency=8),
    constraint("rope", "distance", "base", xyz=[0, 0.1, 1], distance=1.5),
    constraint("folded", "loop", "claw", to="base", xyz=[0, 0, -0.25], joint="revolute", axis="y"),
)
LIGHT_FINGER = machine(
    "light",
    base(20, [0.5, 0.5, 0.9], attitude="quaternion"),
    link("finger", "y", [0, 0, -0.1], 0.01, [0, 0, -0.005], [5e-07, 5e-07, 5e-07]),
    frame("pad", "finger", [0, 0, -0.01]),
    frame("foot", "base", [0, 0, -0.2]),
    constraint("stand", "point", "foot"),
    constraint("grip", "frame", "pad"),
)
# Five rows for two.
FOUR_BAR = machine(
    "four_bar",
    base(1.0, [0.02, 0.03, 0.04], attitude="quaternion"),
    link("crank", "y", [0, 0, 0], 0.2, [0.1, 0, 0], [0.0001, 0.001, 0.001]),
    link("coupler", "y", [0.2, 0, 0], 0.3, [0.2, 0, 0], [0.0001, 0.004, 0.004]),
    link("rocker", "y", [0.4, 0, 0], 0.2, [0.15, 0, 0], [0.0001, 0.002, 0.002], parent="base"),
    frame("end", "coupler", [0.4, 0, 0]),
    frame("pin", "rocker", [0.3, 0, 0]),
    constraint("closing", "loop", "end", to="pin", joint="revolute", axis="y"),
)
HELD_STILL = machine(
    "perched",
    base(1.5, [0.015, 0.016, 0.03], attitude="quaternion", com=[0.01, 0, 0]),
    link("leg", "y", [0, 0, -0.05], 0.2, [0, 0, -0.1], [0.001, 0.001, 0.0001]),
    frame("toe", "leg", [0, 0, -0.3]),
    constraint("grip", "frame", "base"),
    constraint("stand", "point", "toe", frequency=8),
)
KINDS: tuple[ConstraintKind, ...] = ("point", "frame", "distance", "loop", "plane")
_ROUNDING = 1e-13
JOINTS: tuple[LoopJoint, ...] = ("fixed", "revolute", "spherical")


def random_constraint(rng: np.random.Generator, robot: Robot, name: str) -> Constraint:
    """Any constraint of some frames of a robot."""
    frames = [frame.name for frame in frames_of(robot)]
    frame, other = (str(each) for each in rng.permutation([*frames, *frames])[:2])
    kind = KINDS[rng.integers(len(KINDS))]
    if frame == other and kind == "loop":
        kind = "point"
    to = other if other != frame and (kind == "loop" or rng.random() < 0.4) else None
    frequency = float(rng.choice((0.0, 5.0)))
    constraint = Constraint(
        name,
        kind,
        frame,
        to,
        **vars(random_pose(rng) if kind in ("frame", "loop") else Pose(random_pose(rng).xyz)),
        distance=float(rng.uniform(0.3, 1.0)) if kind == "distance" else 0.0,
        normal=thrust(rng) if kind == "plane" else AXES["z"],
        joint=JOINTS[rng.integers(len(JOINTS))] if kind == "loop" else "fixed",
        axis=thrust(rng) if kind == "loop" else AXES["z"],
        frequency=frequency,
        damping_ratio=0.7 if frequency else 1.0,
    )
    # An axis belongs to a loop that turns alone.
    return constraint if constraint.joint == "revolute" else replace(constraint, axis=AXES["z"])


def constrained_robot(seed: int, redundant: bool = False) -> Robot:
    """The robot of a seed with one to three constraints, the last of which repeats the first.

    That is if it is to be `redundant`.
    """
    rng = np.random.default_rng([seed, 7])
    links = int(rng.integers(1, 5))
    robot = random_tree(seed) if seed % 3 else random_robot(seed, int(rng.integers(2, 6)), links)
    count = int(rng.integers(1, 3 if redundant else 4))
    found = [random_constraint(rng, robot, f"hold {k}") for k in range(count)]
    if redundant:
        found.append(replace(found[0], name="again"))
    return replace(robot, name=f"constrained_{seed}", constraints=tuple(found))


@dataclass
class Dense:
    """Constraints of a robot in one state, by dense matrices: rows as of CONSTRAINT_ROWS."""

    robot: Robot
    q: Array
    v: Array

    def __post_init__(self) -> None:
        self.oracle = Oracle(self.robot, rigid_base=True)
        rows = [self._of(each) for each in self.robot.constraints]
        self.errors, self.jacobian, self.bias, self.back = (
            np.concatenate(parts) for parts in zip(*rows, strict=True)
        )
        self.owner = np.repeat(range(len(rows)), [len(row[0]) for row in rows])

    def _frame(self, name: str | None) -> tuple[pin.SE3, Array, Array]:
        """Placement of a frame, its Jacobian in world axes, and its acceleration where a is 0."""
        if name is None:
            return pin.SE3.Identity(), np.zeros((6, len(self.v))), np.zeros(6)
        place = self.oracle.frames[name]
        jacobian, placement = self.oracle.point_jacobian(self.q, place)
        jacobian = jacobian[:, self.oracle.free] if jacobian.shape[1] > len(self.v) else jacobian
        return placement, jacobian, self.oracle.bias_acceleration(self.q, self.v, place)

    def _of(self, own: Constraint) -> tuple[Array, Array, Array, Array]:
        """Errors, Jacobian, bias, and what is added to bring errors back."""
        frame, of_frame, bias = self._frame(own.frame)
        carrier, of_carrier, carried = self._frame(own.to)
        anchor = carrier * placed(own.anchor)
        arm, way = frame.translation - carrier.translation, frame.translation - anchor.translation
        lift = np.eye(6)
        lift[:3, 3:] = -pin.skew(arm)
        jacobian = of_frame - lift @ of_carrier
        jacobian[np.abs(jacobian) < _ROUNDING] = 0.0  # Of frames on one body nothing else is left.
        moving, spin = jacobian @ self.v, (of_carrier @ self.v)[3:]
        relative = bias - lift @ carried
        relative[:3] -= np.cross(spin, np.cross(spin, arm)) + 2.0 * np.cross(spin, moving[:3])
        relative[3:] -= np.cross(spin, (of_frame @ self.v)[3:])
        axes, apart = anchor.rotation.T, anchor.rotation.T @ frame.rotation
        sine = 0.5 * np.array(
            [apart[2, 1] - apart[1, 2], apart[0, 2] - apart[2, 0], apart[1, 0] - apart[0, 1]]
        )
        linear, angular = np.eye(6)[:3], np.eye(6)[3:]
        rows, errors, extra = axes @ linear, axes @ way, 0.0
        kind = own.joint if own.kind == "loop" else own.kind
        if kind in ("frame", "fixed"):
            rows, errors = np.vstack([rows, axes @ angular]), np.concatenate([errors, sine])
        if kind == "revolute":
            axis = np.array(own.axis) / np.linalg.norm(own.axis)
            across = self.across(own)
            rows = np.vstack([rows, across @ axes @ angular])
            errors = np.concatenate([errors, across @ np.cross(axis, apart @ axis)])
        if kind == "plane":
            normal = np.array(own.normal) / np.linalg.norm(own.normal)
            rows, errors = normal[None] @ rows, normal[None] @ errors
        if kind == "distance":
            length = own.distance
            rows, errors = way[None] @ linear / length, np.array([way @ way - length**2])
            errors, extra = errors / (2.0 * length), moving[:3] @ moving[:3] / length
        w, z = own.frequency, own.damping_ratio
        back = 2.0 * z * w * rows @ moving + w**2 * errors
        return errors, rows @ jacobian, rows @ relative + extra, back

    @staticmethod
    def across(own: Constraint) -> Array:
        """Two unit vectors across the axis of a hinge, as the rows have them."""
        from gibbs_codegen.symbolic.structural import z_onto

        columns = np.array(z_onto(own.axis), float).T
        assert np.allclose(columns @ columns.T, np.eye(3))
        assert np.allclose(columns[2], np.array(own.axis) / np.linalg.norm(own.axis))
        return columns[:2]

    def active_rows(self, active: Array) -> Array:
        """Numbers of the rows of active constraints."""
        return np.flatnonzero(active[self.owner] > 0.5)

    def inverse(self, active: Array) -> tuple[Array, Array]:
        """The pseudo-inverse of A among the active rows, and M⁻¹Jᵀ of these."""
        jacobian = self.jacobian[self.active_rows(active)]
        matrix = self.oracle.mass_matrix(self.q)[np.ix_(self.oracle.free, self.oracle.free)]
        moved = np.linalg.solve(matrix, jacobian.T)
        return np.linalg.pinv(jacobian @ moved, rcond=1e-11, hermitian=True), moved

    def solved(self, right: Array, active: Array) -> tuple[Array, Array]:
        """The least forces (rows) that take `right` away, and what they do to the velocities."""
        inverse, moved = self.inverse(active)
        rows, forces = self.active_rows(active), np.zeros(len(self.errors))
        forces[rows] = -inverse @ right[rows]
        return forces, moved @ forces[rows]

    def dynamics(self, u: Array, active: Array) -> tuple[Array, Array]:
        """Accelerations and forces."""
        free = self.oracle.dynamics(self.q, self.v, u).acceleration
        forces, gain = self.solved(self.jacobian @ free + self.bias + self.back, active)
        return free + gain, forces


def random_state(robot: Robot, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Coordinates, velocities and inputs."""
    layout = Description(robot).layout
    q, v = rng.uniform(-1.0, 1.0, layout.q.size), rng.normal(size=layout.v.size)
    if layout.is_quaternion:
        q[layout.q.attitude] /= np.linalg.norm(q[layout.q.attitude])
    return q, v, rng.normal(size=len(Description(robot).inputs)) * 5.0
