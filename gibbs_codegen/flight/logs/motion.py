"""The motion of a flight's base as sensors and logs have it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gibbs_codegen.flight.plant.kinematics import kinematics_of, quaternions_of
from gibbs_codegen.flight.plant.sensors import arrived
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.vectors import Array, times, transposed

# Entries of poses that differ by less are the same, rounded.
_STILL = 1e-9
# Ends of names of what encoders, IMUs and sensors of poses read.
_KINDS = "", "_acceleration", "_angular_velocity", "_position", "_x_axis", "_y_axis"


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


def shares(flight: Flight, inputs: Array) -> Array:
    """Inputs (s, nu) as shares of the greatest, NaN where there is no limit."""
    most = flight.input_limits[1]
    return inputs / np.where(np.isfinite(most) & (most > 0.0), most, np.nan)


def new_readings(flight: Flight, entries: Sequence[int]) -> Array:
    """Readings (s, k) of entries of a sensor, NaN at samples at which it has none that is new.

    Files that do not say how often it is read have a new one where an entry changes.
    """
    readings = flight.sensors[:, entries]
    if len(flight.sensor_rates):
        rate, delay = flight.sensor_rates[entries[0]], float(flight.sensor_delays[entries[0]])
        taken = np.arange(int(flight.time[-1] * rate) + 2) / rate
        new = np.diff(arrived(taken, flight.time, delay), prepend=-1) > 0
    else:
        new = np.append(True, (readings[1:] != readings[:-1]).any(axis=1))
    return np.where(new[:, np.newaxis], readings, np.nan)


def known_rows(readings: Array) -> NDArray[np.bool_]:
    """Which rows (s) of readings (s, k) are known."""
    return np.asarray(np.isfinite(readings).all(axis=1))


def imus(flight: Flight) -> dict[str, tuple[str, Array]]:
    """By the name of each IMU its frame and new readings (s, 6): specific force, m/s², and spin."""
    last = "_acceleration_x"
    # Nothing else at a frame reads accelerations.
    return {
        name.removesuffix(last): (flight.sensor_frames[k], new_readings(flight, range(k, k + 6)))
        for k, (name, unit) in enumerate(zip(flight.sensor_names, flight.sensor_units, strict=True))
        if unit == "m/s^2" and name.endswith(last)
    }


def poses(flight: Flight) -> dict[str, tuple[str, Array, Array]]:
    """By the name of each pose sensor and GPS its frame, positions (s, 3), m, and quaternions.

    World axes; NaN at samples without a new reading, and quaternions (s, 4) of a GPS.
    """
    last, found = "_position_x", dict[str, tuple[str, Array, Array]]()
    for k, (name, frame) in enumerate(zip(flight.sensor_names, flight.sensor_frames, strict=True)):
        if not (frame and name.endswith(last)):
            continue
        sensor, attitude = name.removesuffix(last), np.full((len(flight.time), 4), np.nan)
        position = new_readings(flight, range(k, k + 3))
        if f"{sensor}_x_axis_x" in flight.sensor_names:
            x, y = np.split(new_readings(flight, range(k + 3, k + 9)), 2, axis=1)
            known = known_rows(x)
            axes = np.stack([x, y, np.cross(x, y)], axis=-1)[known]
            attitude[known] = quaternions_of(Rotation.from_matrix(axes).as_matrix())
        found[sensor] = frame, position, attitude
    return found


def on_base(vehicle: Vehicle) -> dict[str, Array]:
    """Frames that neither joints nor wheels move, with their poses (4, 4) in the base's axes."""
    q, places = np.tile(vehicle.neutral, (2, 1)), vehicle.layout.q
    for place in (places.joints, places.angles):  # By amounts of which none makes up for another.
        q[1, place] += np.sqrt(1.0 + np.arange(len(q[1, place])))
    poses = vehicle.module.frame_poses(q)
    poses = np.linalg.inv(poses[:, [vehicle.frames.index("base")]]) @ poses
    rests = np.ptp(poses, axis=0).max(axis=(1, 2)) < _STILL
    return {vehicle.frames[k]: poses[0, k] for k in np.flatnonzero(rests)}


def unread(flight: Flight, read: Iterable[str]) -> str:
    """Names of readings of a flight but some, given by them or their sensors', "" if none."""
    known = {f"{name}{kind}" for name in read for kind in _KINDS}
    rest = (re.sub("_[xyz]$", "", name) for name in flight.sensor_names if name not in known)
    return ", ".join(name for name in dict.fromkeys(rest) if name not in known)
