"""Frames of a robot on paths, to which joints bring them that stay within their limits.

A joint between limits is a function of a number that may be any, and in the middle changes as that
number does: so what looks for joints needs to know of no limits.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.attitude import Derivatives
from gibbs_codegen.flight.desired.base_trajectory import bounded_path
from gibbs_codegen.flight.desired.inverse_kinematics import JointBounds
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.reference import Motion
from gibbs_codegen.flight.scenario.paths import ORDERS, Path
from gibbs_codegen.flight.vectors import Indices, halton

# Half the range of a joint without limits, rad or m: it is next to the number itself.
_ENDLESS = 1e6
# Postures that a search begins with, and how near to a limit, of half the range.
_GUESSES, _INSIDE = 32, 0.98


@dataclass(frozen=True)
class LedFrames:
    """Frames on paths, and the joints that move any of them.

    - `paths`: of the m frames, by name; `places` (m) are those of the frames in the module
    - `joints` (n): places among the arm's joints
    - `middle`, `half` (n): of the joints' ranges, rad or m
    - `starts` (k, n): numbers for joints that a search begins with
    """

    paths: Mapping[str, Path]
    places: Indices
    joints: Indices
    middle: Array
    half: Array
    starts: Array

    def targets(self, time: Array) -> Array:
        """Desired places of the frames (s, 4, m, 3), with three derivatives, world axes."""
        out = np.zeros((len(time), ORDERS, len(self.paths), 3))
        for place, (name, path) in enumerate(self.paths.items()):
            out[:, :, place] = bounded_path(time, path, f"path of {name}")
        return out

    def misses(self, vehicle: Vehicle, q: Array, targets: Array) -> Array:
        """Distances of the frames (s, 3 m) from their targets, m, world axes."""
        return np.reshape(self.positions(vehicle, q) - targets[:, 0], (len(q), -1))

    def positions(self, vehicle: Vehicle, q: Array) -> Array:
        """Positions of the frames (s, m, 3), world axes."""
        return vehicle.frame_poses(q)[:, self.places][..., :3, 3]

    def with_joints(self, vehicle: Vehicle, motion: Motion, numbers: Derivatives | Array) -> Motion:
        """A motion with joints of numbers (s, n), and their first two derivatives."""
        share = (numbers[0] - self.middle) / self.half
        root = 1.0 / np.sqrt(1.0 + share**2)
        slope, bend = root**3, -3.0 * share * root**5 / self.half
        q, v, a = motion.q.copy(), motion.v.copy(), motion.a.copy()
        rates = np.array(vehicle.layout.v.joint_places, dtype=int)[self.joints]
        q[:, np.array(vehicle.layout.q.joint_places, dtype=int)[self.joints]] = (
            self.middle + self.half * share * root
        )
        v[:, rates] = slope * numbers[1]
        a[:, rates] = slope * numbers[2] + bend * numbers[1] ** 2
        return Motion(motion.time, q, v, a)

    def by_numbers(self, vehicle: Vehicle, jacobian: Array, numbers: Array) -> Array:
        """Derivatives (s, …, n) by numbers (s, n), of those (s, …, nv) by velocities."""
        slope = (1.0 + ((numbers - self.middle) / self.half) ** 2) ** -1.5
        rates = np.array(vehicle.layout.v.joint_places, dtype=int)[self.joints]
        between = tuple(range(1, jacobian.ndim - 1))
        return jacobian[..., rates] * np.expand_dims(slope, between)

    def jacobians(self, vehicle: Vehicle, q: Array) -> Array:
        """Velocities of the frames (s, m, 3, nv) by those of the robot, world axes."""
        return vehicle.function("frame_jacobians")(q)[:, self.places, :3]

    def at_limits(self, vehicle: Vehicle, numbers: Array) -> str:
        """Names of joints that numbers (n) bring next to a limit."""
        near = np.abs(numbers - self.middle) > self.half * _INSIDE / np.sqrt(1.0 - _INSIDE**2)
        return ", ".join(np.array(vehicle.joint_names)[self.joints[near]])


def led_frames(
    vehicle: Vehicle, paths: Mapping[str, Path], limits: JointBounds, guess: Array | None = None
) -> LedFrames:
    """Frames that are to be on paths, by their names; `guess` are joints of the arm to begin with.

    Raises `UsageError` for frames that the robot does not have or that no joint moves.
    """
    keys = {name: "arm.tip" if name == "tip" else f"arm.frames.{name}" for name in paths}
    places = np.array([vehicle.frame_place(name, keys[name]) for name in paths], dtype=int)
    bounded = np.isfinite(limits[0]) & np.isfinite(limits[1])
    low, high = (np.where(bounded, limit, 0.0) for limit in limits)
    middle, half = 0.5 * (low + high), np.where(bounded, 0.5 * (high - low), _ENDLESS)
    reach = np.minimum(half, np.pi)
    # Some posture in which nothing is in line.
    q = vehicle.neutral
    q[vehicle.arm] = middle + 0.6 * reach * np.cos(np.arange(vehicle.joints))
    jacobians = vehicle.function("frame_jacobians")(q)[places, :3, vehicle.arm_rates]
    moves = np.any(jacobians != 0.0, axis=1)
    for name, moved in zip(paths, np.any(moves, axis=1), strict=True):
        if not moved:
            raise UsageError(
                f"{keys[name]}: no joint of {vehicle.name} moves it, so it cannot follow a path; "
                "leave it out"
            )
    joints = np.flatnonzero(np.any(moves, axis=0) & (half > 0.0))
    middle, half, reach = middle[joints], half[joints], reach[joints]
    postures = middle + reach * (2.0 * halton(_GUESSES, len(joints)) - 1)
    if guess is not None:
        postures = guess[np.newaxis, joints]
    share = np.clip((postures - middle) / half, -_INSIDE, _INSIDE)
    starts = middle + half * share / np.sqrt(1.0 - share**2)
    return LedFrames(paths, places, joints, middle, half, starts)
