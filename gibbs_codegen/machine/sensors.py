"""Readings of sensors as array programs: of a motion without error, and with errors.

Errors come in as numbers of the standard normal distribution, so that the same numbers give the
same readings in every language. Frames are given by their numbers; what a sensor feels is in the
axes of its frame, what satellites and the air tell in those of the world: x east, y north, z up.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Node, Program, clip, constant, entries_of, join, variable
from gibbs_codegen.machine.surroundings import origin_of, rotation_of


class Channel(NamedTuple):
    """Entries of a reading that err alike: their names, units, and errors of each entry.

    A reading is off by the `bias`, by its `walk`, of which that is the deviation of a step from
    reading to reading, and by noise of its own. It is kept within ± `span`, and a multiple of the
    `resolution`, if that is not 0.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    noise: tuple[float, ...]
    walk: float = 0.0
    bias: tuple[float, ...] = (0.0,)
    span: float = math.inf
    resolution: float = 0.0

    @property
    def variances(self) -> np.ndarray:
        """The variance of noise and of rounding of each entry."""
        rounding = self.resolution**2 / 12.0
        return np.broadcast_to(np.square(self.noise) + rounding, len(self.names))


class SensorAt(NamedTuple):
    """A sensor: what kind it is, by `MEASUREMENTS`, its frame, and figures of where on earth."""

    kind: str
    frame: int
    figures: tuple[float, ...]


class SensedMotion(NamedTuple):
    """A robot's coordinates q, velocities v, accelerations a, and wrenches (f, 6) of contacts.

    With the acceleration of gravity (3), m/s², world axes.
    """

    robot: Functions
    q: Node
    v: Node
    a: Node
    wrenches: Node
    gravity: Node

    def pose(self, device: SensorAt) -> Node:
        """The pose (4, 4) of a sensor's frame."""
        pose: Node = self.robot.frame_poses(self.q)[device.frame]
        return pose

    def velocity(self, device: SensorAt) -> Node:
        """Velocity (3) of the origin, m/s, and angular velocity (3), rad/s, world axes."""
        velocity: Node = self.robot.frame_velocities(self.q, self.v)[device.frame]
        return velocity

    def felt(self, device: SensorAt, *vectors: Node) -> Node:
        """Vectors (3 each) of the world in the axes of a sensor's frame."""
        turn = rotation_of(self.pose(device)).transposed
        return join(*(turn @ vector for vector in vectors))


def imu(motion: SensedMotion, device: SensorAt) -> Node:
    """Specific force (3), m/s², and angular velocity (3), rad/s, in the axes of the frame."""
    robot, frame = motion.robot, device.frame
    drift = robot.frame_bias_accelerations(motion.q, motion.v)[frame][:3]
    # Velocities of the frames by accelerations for velocities: functions that have derivatives.
    acceleration = robot.frame_velocities(motion.q, motion.a)[frame][:3] + drift
    return motion.felt(device, acceleration - motion.gravity, motion.velocity(device)[3:])


def barometer(motion: SensedMotion, device: SensorAt) -> Node:
    """Height (1) of the frame above sea level, m, of which the figure is that of the origin."""
    return join(origin_of(motion.pose(device))[2] + device.figures[0])


def magnetometer(motion: SensedMotion, device: SensorAt) -> Node:
    """The magnetic field (3), T, in the axes of the frame; figures are that in the world's."""
    return motion.felt(device, constant(device.figures))


def gps(motion: SensedMotion, device: SensorAt) -> Node:
    """Position (3), m, and velocity (3), m/s, of the frame's origin."""
    return join(origin_of(motion.pose(device)), motion.velocity(device)[:3])


def pose(motion: SensedMotion, device: SensorAt) -> Node:
    """Position (3), m, and directions (3 each) of the x and the y axis of the frame."""
    pose = motion.pose(device)
    turn = rotation_of(pose).transposed
    return join(origin_of(pose), turn[0], turn[1])


def encoders(motion: SensedMotion, device: SensorAt) -> Node:
    """Coordinates of the joints, rad or m."""
    places = motion.robot.layout.q.joints
    return entries_of(motion.q)[places.start : places.stop]


def wrench(motion: SensedMotion, device: SensorAt) -> Node:
    """Force (3), N, and torque (3), N m, of contacts on the frame, in its axes."""
    acting = motion.wrenches[device.frame]
    return motion.felt(device, acting[:3], acting[3:])


MEASUREMENTS: dict[str, Callable[[SensedMotion, SensorAt], Node]] = {
    measure.__name__: measure
    for measure in (imu, barometer, magnetometer, gps, pose, encoders, wrench)
}


def measurement_program(robot: Functions, devices: Sequence[SensorAt]) -> Program:
    """Measurements (m) without error, one sensor's after the other's, of a motion and gravity."""
    q, v = robot.state()
    motion_inputs = q, v, robot.velocities("a"), variable("wrenches", robot.frames, 6)
    motion = SensedMotion(robot, *motion_inputs, variable("gravity", 3))
    measured = join(*(MEASUREMENTS[device.kind](motion, device) for device in devices))
    return Program("measurement", motion[1:], {"measured": measured})


def reading_program(channels: Sequence[Channel]) -> Program:
    """Readings (m) of measurements (m), with errors but for the resolution.

    `white` (m) are numbers of the normal distribution, `walk` (m) sums of such up to the reading.
    """
    size = sum(len(c.names) for c in channels)
    measured, white, walk = (variable(name, size) for name in ("measured", "white", "walk"))
    readings, first = [], 0
    for c in channels:
        count = len(c.names)
        noise, bias = (np.broadcast_to(x, count) for x in (c.noise, c.bias))
        rows = slice(first, first + count)
        value = measured[rows] + bias + c.walk * walk[rows] + noise * white[rows]
        readings.append(clip(value, -c.span, c.span) if math.isfinite(c.span) else value)
        first += count
    return Program("reading", (measured, white, walk), {"reading": join(*readings)})
