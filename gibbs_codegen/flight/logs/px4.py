"""Flights as PX4 logs them, as tables that pyulog's `ulog2csv` would make of its logs.

World axes are north, east, down, those of the base forwards, right, down, as PX4 has them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.flight.logs.motion import base_motion, shares
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.record.series import write_table
from gibbs_codegen.flight.vectors import Array
from gibbs_codegen.robot.autopilot_axes import north_east_down, turned_attitude, turned_over

# By topic its fields, and of these the values, a row per message.
Topics = dict[str, dict[str, NDArray[Any]]]
# Motors that a message of PX4 has.
_MOTORS = 12


def write_tables(flight: Flight, folder: Path) -> None:
    """Write a flight to a new folder, with a table of each topic."""
    folder.mkdir()
    for topic, fields in topics_of(flight).items():
        write_table(folder / f"{topic}_0.csv", fields)


def topics_of(flight: Flight) -> Topics:
    """The topics of PX4 of a flight, with a message of each per sample.

    Joints, which PX4 does not have, are a topic of this package's.
    """
    base, time = base_motion(flight), np.round(flight.time * 1e6).astype(np.int64)
    count, since = len(time), np.diff(time, prepend=time[0])
    forwards = flight.base_rotation[..., 0]
    positions = {
        **dict(zip(("x", "y", "z"), north_east_down(base.position).T, strict=True)),
        **dict(zip(("vx", "vy", "vz"), north_east_down(base.rates).T, strict=True)),
        **dict(zip(("ax", "ay", "az"), north_east_down(base.growth).T, strict=True)),
        "heading": np.arctan2(forwards[:, 0], forwards[:, 1]),
        **dict.fromkeys(
            ("xy_valid", "z_valid", "v_xy_valid", "v_z_valid"), np.ones(count, np.int64)
        ),
    }
    spin = turned_over(base.spin)
    measured = {
        **_listed("gyro_rad", spin),
        "gyro_integral_dt": since,
        "accelerometer_timestamp_relative": np.zeros(count, np.int64),
        **_listed("accelerometer_m_s2", turned_over(base.specific_force)),
        "accelerometer_integral_dt": since,
    }
    motors = np.full((count, _MOTORS), np.nan)
    of_rotors = shares(flight)[:, : min(flight.rotors, _MOTORS)]
    motors[:, : of_rotors.shape[1]] = of_rotors
    places, rates = flight.layout.q.joints, flight.layout.v.joints
    joints = {
        **_listed("position", flight.q[:, places]),
        **_listed("velocity", flight.v[:, rates]),
        **_listed("effort", flight.applied[:, flight.rotors :]),
    }
    found: Topics = {
        "vehicle_local_position": positions,
        "vehicle_attitude": _listed("q", turned_attitude(base.quaternion)),
        "vehicle_angular_velocity": _listed("xyz", spin),
        "sensor_combined": measured,
        "actuator_motors": _listed("control", motors),
    }
    if joints:
        found["joint_states"] = joints
    return {topic: {"timestamp": time, **fields} for topic, fields in found.items()}


def _listed(name: str, values: Array) -> dict[str, NDArray[Any]]:
    """Columns of values (s, k) by the names that entries of an array have."""
    return {f"{name}[{k}]": column for k, column in enumerate(values.T)}
