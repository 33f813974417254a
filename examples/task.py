"""A task for any robot: from hover, bring a point once around a circle."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.analysis.arguments import numbers, real
from gibbs_codegen.flight.analysis.trim import trim
from gibbs_codegen.flight.desired.posture import rest_posture
from gibbs_codegen.flight.plant.actuators import Actuators, module_actuators
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.text import robot_text


@dataclass(frozen=True)
class CircularPath:
    """A level circle that begins and ends at rest at `start` (3), m."""

    start: Array
    radius: float
    duration: float

    def __call__(self, time: Array) -> Array:
        """Positions (…, 3), m."""
        angle, _ = self._turned(time)
        moved = np.stack([1 - np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
        return np.asarray(self.start + self.radius * moved)

    def velocity(self, time: Array) -> Array:
        """Velocities (…, 3), m/s."""
        angle, rate = self._turned(time)
        along = np.stack([np.sin(angle), np.cos(angle), np.zeros_like(angle)], axis=-1)
        return np.asarray(self.radius * rate[..., None] * along)

    def _turned(self, time: Array) -> tuple[Array, Array]:
        """The angle, rad, and its rate, rad/s, with the shape of the times."""
        s = np.clip(np.asarray(time, dtype=np.float64) / self.duration, 0.0, 1.0)
        angle = 2 * np.pi * s**3 * (10 + s * (6 * s - 15))
        return angle, 60 * np.pi * (s * (1 - s)) ** 2 / self.duration


# What is as bad as the point being off by a share of the reach: angles, rad; rates, of angles
# and of the reach, 1/s; and inputs, as a share of their largest in hover.
_POINT, _ANGLE, _RATE, _INPUT = 2e-3, 0.3, 1.0, 0.5
# Cost of each of these.
_UNIT = 1e-2
# Distances, m, and thrusts, N, that are no more than rounding.
_NOTHING = 1e-9


@dataclass(frozen=True)
class Circle:
    """What is asked for; None is a choice by default.

    - `frame`: whose origin is the point; the last of the module's frames if None
    - `posture`: joints' coordinates in hover by name, rad or m; the arm hangs if None
    - `radius`: m; a quarter of the point's distance from the base if None
    - `thrust`: least and greatest, N; `effort`: greatest torque or force of the joints, N m or N;
      those of the robot file if None
    Raises `UsageError` for a number that is not what it must be.
    """

    frame: str | None = None
    posture: Mapping[str, float] | None = None
    radius: float | None = None
    duration: float = 8.0
    thrust: tuple[float, float] | None = None
    effort: float | None = None

    def __post_init__(self) -> None:
        _require_above_zero("duration", self.duration, "a finite time above zero, s")
        if self.radius is not None:
            _require_above_zero("radius", self.radius, "a finite length above zero, m")
        wanted = "a torque or force above zero, N m or N"
        if self.effort is not None and not real("effort", self.effort, wanted, ()) > 0.0:
            raise UsageError(f"effort: must be {wanted}, not {self.effort:g}")
        if self.thrust is not None:
            wanted = "the least thrust and a greater one, N"
            low, high = real("thrust", self.thrust, wanted, (2,))
            if not low < high:
                raise UsageError(f"thrust: must be {wanted}, not {low:g} and {high:g}")


def _require_above_zero(name: str, given: float, wanted: str) -> None:
    """Raise `UsageError`, with `wanted`, for a number that is not finite and above zero."""
    if numbers(name, given, wanted, ()) <= 0.0:
        raise UsageError(f"{name}: must be {wanted}, not {given:g}")


@dataclass(frozen=True)
class Weights:
    """What a cost wants: half the weighted sum of squares of what is off, at every step.

    - `point`: weight of the point's distance from its path, 1/m²
    - `stage`, `wanted`: weights of u, q and v, one after the other, and what they are to be near to
    - `position`: places of the base's position in q, which is free
    """

    point: float
    stage: Array
    wanted: Array
    position: slice


@dataclass(frozen=True)
class Task:
    """What is to be done, from where, within which limits.

    - `frame`: whose origin is the point; `path` is its path, world axes
    - `q`, `v`: state of hovering
    - `carried`: states (…, nq + nv) at times (…), s: those of hovering, moved along the path
    - `limits` (2, nu + nq + nv): least and greatest u, q and v
    """

    frame: str
    q: Array
    v: Array
    path: CircularPath
    carried: Callable[[Array], Array]
    weights: Weights
    limits: Array


def module_of(robot: Robot, out: Path, derivatives: tuple[str, ...]) -> Path:
    """Generate the module of a robot that was changed, with derivatives on request: its folder."""
    return generate_robot(robot, robot_text(robot), out, derivatives=derivatives)[1]


def circle_task(module: ModuleType, circle: Circle) -> Task:
    """From hover, bring a point once around a circle.

    Raises `UsageError` if the module has no such frame, it is at the base, or the robot cannot
    hover on its rotors within its limits.
    """
    frame = module.FRAMES[-1] if circle.frame is None else circle.frame
    if frame not in module.FRAMES:
        known = ", ".join(module.FRAMES)
        raise UsageError(f"frame {frame!r}: {module.NAME} has no such frame; its frames: {known}")
    vehicle = Vehicle(module)
    actuators = module_actuators(vehicle)
    if circle.thrust is not None:
        actuators.thrusts[:] = np.reshape(circle.thrust, (2, 1))
    if circle.effort is not None:
        actuators.efforts[:] = circle.effort
    posture = circle.posture
    if posture is None:
        low, high = actuators.joints
        hanging = rest_posture(vehicle, (low, high))
        posture = dict(zip(vehicle.joint_names, hanging, strict=True))
    hover = trim(module, posture, limits=actuators.thrusts)
    poses = module.frame_poses(hover.q)[:, :3, 3]
    point = poses[module.FRAMES.index(frame)]
    reach = _reach(module, frame, poses)
    if not np.abs(hover.u[: vehicle.rotors]).max(initial=0.0) > _NOTHING:
        raise UsageError(
            f"{module.NAME}: no thrust carries it in hover, and the weights are shares of the "
            "greatest one; it must have rotors, and weight (gravity in the robot file)"
        )
    radius = reach / 4 if circle.radius is None else circle.radius
    path = CircularPath(point, radius, circle.duration)
    return Task(
        frame,
        hover.q,
        hover.v,
        path,
        _carried(vehicle, path, hover.q, hover.v),
        _weights(vehicle, reach, hover.q, hover.u),
        limits(vehicle, actuators),
    )


def _reach(module: ModuleType, frame: str, positions: Array) -> float:
    """Distance, m, of a frame from the base, of positions (f, 3), m, world axes.

    Raises `UsageError` if there is none.
    """
    distances = np.linalg.norm(positions - positions[module.FRAMES.index("base")], axis=-1)
    reach = float(distances[module.FRAMES.index(frame)])
    if reach > _NOTHING:
        return reach
    apart = [f for f, d in zip(module.FRAMES, distances, strict=True) if d > _NOTHING]
    raise UsageError(
        f"frame {frame!r}: is at the base of {module.NAME}, and the weights are shares of the "
        "distance between them; "
        + (
            f"choose one that is away from it: {', '.join(apart)}"
            if apart
            else "so are all others; the robot needs an arm, or a [[frame]] away from the base"
        )
    )


def _carried(vehicle: Vehicle, path: CircularPath, q: Array, v: Array) -> Callable[[Array], Array]:
    """States (…, nq + nv), by times (…), s, that hover as q and v and move along a path."""
    layout = vehicle.layout
    # Beside a quaternion, v has the base's velocity in its own axes.
    axes = vehicle.base_rotation(q) if layout.is_quaternion else np.eye(3)

    def carried(time: Array) -> Array:
        qs, vs = (np.tile(x, (*np.shape(time), 1)) for x in (q, v))
        qs[..., layout.q.position] += path(time) - path.start
        vs[..., layout.v.position] += path.velocity(time) @ axes
        return np.concatenate([qs, vs], axis=-1)

    return carried


def _weights(vehicle: Vehicle, reach: float, q: Array, u: Array) -> Weights:
    """Weights that suit a robot of any size; where the base is does not matter.

    `reach` is the distance of the point from the base, m; q and u are those of hover.
    """
    rotors = vehicle.rotors
    thrust = np.abs(u[:rotors]).max()
    inputs = np.r_[np.full(rotors, thrust), np.full(len(u) - rotors, thrust * reach)]
    is_turning = np.array([unit == "rad/s" for unit in vehicle.module.VELOCITY_UNITS])
    angles = np.full(len(q), 1 / _ANGLE)
    angles[vehicle.layout.q.position] = 0.0
    rates = np.where(is_turning, 1 / _RATE, 1 / (_RATE * reach))
    stage = np.r_[1 / (_INPUT * inputs), angles, rates] ** 2
    wanted = np.r_[u, q, np.zeros(len(rates))]
    return Weights(_UNIT / (_POINT * reach) ** 2, _UNIT * stage, wanted, vehicle.layout.q.position)


def limits(vehicle: Vehicle, actuators: Actuators) -> Array:
    """Least and greatest u, q and v (2, nu + nq + nv), one after the other, infinite if none.

    Of rates, only those of the joints have limits.
    """
    unlimited = np.array([[-np.inf], [np.inf]])
    q = np.tile(unlimited, len(vehicle.coordinates))
    v = np.tile(unlimited, len(vehicle.module.VELOCITIES))
    q[:, vehicle.arm] = actuators.joints
    v[:, vehicle.arm_rates] = actuators.velocities * np.array([[-1.0], [1.0]])
    return np.concatenate([actuators.inputs, q, v], axis=1)
