"""The motion of a flight's base as sensors and logs have it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibbs_codegen.flight.plant.kinematics import kinematics_of, quaternions_of
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.vectors import Array, times, transposed


@dataclass(frozen=True)
class BaseMotion:
    """The motion of the frame "base" of a flight, a row per sample.

    `position` (s, 3), m, world axes, and unit `quaternion` (s, 4), x y z w, without jumps;
    `velocity` and `spin` (s, 3), m/s and rad/s, of its origin and angular, in its own axes, and
    `specific_force` (s, 3), m/s², what accelerometers at its origin measure. Also, in world axes,
    `rates` (s, 3) of the position and their `growth`.
    """

    position: Array
    quaternion: Array
    velocity: Array
    spin: Array
    specific_force: Array
    rates: Array
    growth: Array


def base_motion(flight: Flight) -> BaseMotion:
    """The motion of the base; specific forces are NaN of files of before flights had gravity."""
    rotation = flight.base_rotation
    inverse = transposed(rotation)
    position = flight.point(flight.centre)
    kinematics = kinematics_of(flight.layout)
    velocity, acceleration, spin, growth = kinematics.base_motion(flight.q, flight.v, flight.a)
    centre = np.zeros_like(position)
    if flight.layout.moves_freely:
        # x, y, z are of a point of the base, the first motor of some; its frame is at the centre.
        centre = times(inverse, position - flight.q[:, flight.layout.q.position])
    else:  # The base's pose turns it in the frame that moves.
        turn = inverse @ kinematics.rotation(flight.q)
        spin, growth = times(turn, spin), times(turn, growth)
    linear = times(inverse, velocity) + np.cross(spin, centre)
    carried = np.cross(growth, centre) + np.cross(spin, np.cross(spin, centre))
    change = times(inverse, acceleration) + carried
    return BaseMotion(
        position,
        quaternions_of(rotation),
        linear,
        spin,
        change + flight.gravity * inverse[..., 2],
        times(rotation, linear),
        times(rotation, change),
    )


def shares(flight: Flight) -> Array:
    """Commanded inputs (s, nu) as shares of the greatest, NaN where there is no limit."""
    most = flight.input_limits[1]
    return flight.commanded / np.where(np.isfinite(most) & (most > 0.0), most, np.nan)


def imus(flight: Flight) -> dict[str, tuple[str, Array]]:
    """By the name of each IMU its frame and readings (s, 6): specific force, m/s², and spin."""
    last = "_acceleration_x"
    # Nothing else at a frame reads accelerations.
    return {
        name.removesuffix(last): (flight.sensor_frames[k], flight.sensors[:, k : k + 6])
        for k, (name, unit) in enumerate(zip(flight.sensor_names, flight.sensor_units, strict=True))
        if unit == "m/s^2" and name.endswith(last)
    }
