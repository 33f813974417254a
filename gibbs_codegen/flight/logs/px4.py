"""Flights as PX4 logs them, in tables that pyulog's `ulog2csv` would make of its logs, and logs.

World axes are north, east, down, those of the base forwards, right, down, as PX4 has them.
"""

from __future__ import annotations

import csv
import logging
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout, suppress
from functools import cache, partial
from io import StringIO
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import UsageError, printable, require
from gibbs_codegen.flight.logs.motion import base_motion, imus, known_rows, poses, shares, unread
from gibbs_codegen.flight.logs.reading import NO_TIME, Recorded, Samples, of_shares
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.record.series import write_table
from gibbs_codegen.flight.vectors import Array
from gibbs_codegen.robot.autopilot_axes import (
    attitude_turned_back,
    north_east_down,
    turned_attitude,
    turned_over,
)

# By topic its fields, and of these the values, a row per message.
Topics = dict[str, dict[str, NDArray[Any]]]
Fields = Mapping[str, NDArray[Any]]
# By a first field the flags that say whether it holds.
_VALID = {"x": ("xy_valid", "z_valid"), "vx": ("v_xy_valid", "v_z_valid")}
# Topics that are read, by what for.
_READ = {
    "position": "vehicle_local_position",
    "attitude": "vehicle_attitude",
    "spin": "vehicle_angular_velocity",
    "imu": "sensor_combined",
}
# Motors that a message of PX4 has.
_MOTORS = 12

_log = logging.getLogger("gibbs_codegen")


def write_tables(flight: Flight, folder: Path) -> None:
    """Write a flight to a new folder, with a table of each topic."""
    folder.mkdir()
    for topic, fields in topics_of(flight).items():
        write_table(folder / f"{topic}_0.csv", fields)


def topics_of(flight: Flight) -> Topics:
    """The topics of PX4 of a flight, with a message of each per sample, of sensors per reading.

    Joints, which PX4 does not have, are a topic of this package's.
    """
    base, time = base_motion(flight), np.round(flight.time * 1e6).astype(np.int64)
    count = len(time)
    forwards = flight.base_rotation[..., 0]
    positions = {
        **dict(zip(("x", "y", "z"), north_east_down(base.position).T, strict=True)),
        **dict(zip(("vx", "vy", "vz"), north_east_down(base.rates).T, strict=True)),
        **dict(zip(("ax", "ay", "az"), north_east_down(base.growth).T, strict=True)),
        "heading": np.arctan2(forwards[:, 0], forwards[:, 1]),
        **dict.fromkeys((*_VALID["x"], *_VALID["vx"]), np.ones(count, np.int64)),
    }
    exact = np.concatenate([base.specific_force, base.spin], axis=1)
    of_base = [(name, felt) for name, (frame, felt) in imus(flight).items() if frame == "base"]
    sensed, when = of_base[0][1] if of_base else exact, time
    if of_base:
        sensed, when = sensed[known_rows(sensed)], time[known_rows(sensed)]
    since = np.diff(when, prepend=when[:1])
    measured = {
        "timestamp": when,
        **_listed("gyro_rad", turned_over(sensed[:, 3:])),
        "gyro_integral_dt": since,
        "accelerometer_timestamp_relative": np.zeros(len(since), np.int64),
        **_listed("accelerometer_m_s2", turned_over(sensed[:, :3])),
        "accelerometer_integral_dt": since,
    }
    motors = np.full((count, _MOTORS), np.nan)
    of_rotors = shares(flight, flight.commanded)[:, : min(flight.rotors, _MOTORS)]
    motors[:, : of_rotors.shape[1]] = of_rotors
    places, rates = flight.layout.q.joints, flight.layout.v.joints
    joints = {
        **_listed("position", flight.q[:, places]),
        **_listed("velocity", flight.v[:, rates]),
        **_listed("effort", flight.applied[:, flight.rotors :]),
    }
    topics: Topics = {
        "vehicle_local_position": positions,
        "vehicle_attitude": _listed("q", turned_attitude(base.quaternion)),
        "vehicle_angular_velocity": _listed("xyz", turned_over(base.spin)),
        "sensor_combined": measured,
        "actuator_motors": _listed("control", motors),
    }
    if joints:
        topics["joint_states"] = joints
    read = ((name, x) for name, x in poses(flight).items() if x[0] == "base")
    seen = [(name, x) for name, x in read if np.isfinite(x[2]).any()][:1]
    for _, (_, position, quaternion) in seen:
        new = known_rows(quaternion)
        topics["vehicle_visual_odometry"] = {
            "timestamp": time[new],
            **_listed("position", north_east_down(position[new])),
            **_listed("q", turned_attitude(quaternion[new])),
        }
    if rest := unread(flight, [name for name, _ in (*of_base[:1], *seen)]):
        _log.warning("not written to the tables: readings %s", rest)
    return {topic: {"timestamp": time, **fields} for topic, fields in topics.items()}


def _listed(name: str, values: Array) -> dict[str, NDArray[Any]]:
    """Columns of values (s, k) by the names that entries of an array have."""
    return {f"{name}[{k}]": column for k, column in enumerate(values.T)}


def is_px4(path: Path) -> bool:
    """True if a log is a ULog, or a folder with tables of one."""
    return path.suffix.lower() == ".ulg" or any(path.glob("*.csv"))


def read_px4(path: Path, vehicle: Vehicle, names: Mapping[str, str | float]) -> Recorded:
    """Contents of a ULog, or of tables of one, for a robot, by names other than PX4's own."""
    topics = _logged(path)

    def series(role: str, *alternatives: tuple[str, ...], spared: bool = True) -> Samples | None:
        """Fields of the topic that has a role, those that it has first of some."""
        name, others = str(names.get(role, _READ[role])), ", ".join(sorted(topics)) or "none"
        fields = _topic(topics, name)
        for keys in alternatives:
            if fields.keys() >= {*keys}:
                return _samples(fields, keys)
        if spared and (fields or role not in names):
            return None
        raise UsageError(
            f"{printable(path)}: has no {printable(name)} that gives the {role} of the base "
            f"by {' or '.join(keys[0] for keys in alternatives)}; name another topic "
            f"(--name {role}=TOPIC); there are {printable(others, 800)}"
        )

    position = series("position", ("x", "y", "z"), _entries("position"), spared=False)
    attitude = series("attitude", _entries("q", 4), spared=False)
    velocity = series("position", ("vx", "vy", "vz"))
    spin = series("spin", _entries("xyz"), _entries("angular_velocity"), _entries("gyro_rad"))

    def of(name: str, field: str) -> Samples | None:
        """The series of a coordinate or input by the topic and field that it is called."""
        topic, _, field = str(names.get(name, f"joint_states.{field}")).partition(".")
        fields = _topic(topics, topic)
        return _samples(fields, (field,)) if field in fields else None

    felt = series("imu", (*_entries("accelerometer_m_s2"), *_entries("gyro_rad")))
    felt = felt and felt._replace(values=turned_over(felt.values.reshape(-1, 3)).reshape(-1, 6))
    motors = _topic(topics, "actuator_motors")
    keys = {k: f"control[{k}]" for k in range(vehicle.rotors) if vehicle.commands[k] not in names}
    sent = {k: _samples(motors, (key,)) for k, key in keys.items() if key in motors}
    named = {name: log for name in vehicle.commands if name in names and (log := of(name, ""))}
    if (outputs := _topic(topics, "actuator_outputs")) and not (sent or named):
        pulses = [_numbers(x) for name, x in outputs.items() if name.startswith("output[")]
        still = ", which never change: nothing flew" * all(bool(np.all(x == x[0])) for x in pulses)
        words = "%s: has no actuator_motors (PX4 logs them since 1.13), but pulses of the outputs%s"
        _log.warning(words, printable(path.name), still)
    joints = list(enumerate(vehicle.joint_names))
    inputs = [(name, k - vehicle.rotors) for k, name in enumerate(vehicle.inputs)]
    return Recorded(
        position and position._replace(values=north_east_down(position.values)),
        attitude and attitude._replace(values=attitude_turned_back(attitude.values)),
        velocity and velocity._replace(values=north_east_down(velocity.values)),
        spin and spin._replace(values=turned_over(spin.values)),
        {name: series_of for k, name in joints if (series_of := of(name, f"position[{k}]"))},
        {
            name: series_of
            for k, name in joints
            if name not in names and (series_of := of(name, f"velocity[{k}]"))
        },
        {name: series_of for name, k in inputs if (series_of := of(name, f"effort[{k}]"))},
        tuple(topics),
        {"base": felt} if felt else {},
        of_shares(vehicle, sent) | named,
    )


def _logged(path: Path) -> dict[str, Callable[[], Fields]]:
    """Readers of topics of a ULog, or of the tables in a folder; of several of a kind the first."""
    if path.suffix.lower() != ".ulg":
        tables = sorted(path.glob("*_0.csv"))
        return {table.stem.removesuffix("_0"): cache(partial(_table, table)) for table in tables}
    require("pyulog", "logs of PX4", "logs")
    from pyulog import ULog

    # Its output is no help: `file_corruption` is.
    with path.open("rb") as file, redirect_stdout(StringIO()):
        log = ULog(file)
    if log.file_corruption:
        _log.warning(
            "%s: is damaged or incomplete; only the undamaged part is read", printable(path.name)
        )
    return {data.name: partial(dict, data.data) for data in log.data_list if data.multi_id == 0}


def _table(path: Path) -> Fields:
    """Columns of a table by their names; what stands between columns stands after the first."""
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        head = file.readline().strip()
        file.seek(0)
        between = next((c for c in head if not (c.isalnum() or c in '_[]."')), ",")
        names, *rows = [*csv.reader(file, delimiter=between)] or [[]]
    if rows and "timestamp" not in names:
        raise UsageError(f"{printable(path)}: has no column timestamp, the time in µs")
    # Values that a row lacks are NaN, and all of a row with more columns than names.
    whole = (row if len(row) <= len(names) else row[:1] for row in rows if row)
    columns = zip_longest(*whole, fillvalue="")
    return dict(zip(names, map(np.array, columns), strict=False))


def _topic(topics: Mapping[str, Callable[[], Fields]], name: str) -> Fields:
    """Fields of a topic, none if there is no such one; tables may begin with the name of a log."""
    named = [topic for topic in topics if topic == name or topic.endswith(f"_{name}")]
    return topics[min(named, key=len)]() if named else {}


def _entries(name: str, count: int = 3) -> tuple[str, ...]:
    """Names of fields that are entries of an array."""
    return tuple(f"{name}[{k}]" for k in range(count))


def _samples(fields: Fields, names: tuple[str, ...]) -> Samples:
    """The series of some fields, (s) of one; NaN where PX4 says that they do not hold yet."""
    values = np.stack([_numbers(fields[name]) for name in names], axis=-1)
    for flag in _VALID.get(names[0], ()):
        if flag in fields:
            values[_numbers(fields[flag]) == 0.0] = np.nan
    return Samples(_times(fields), values if len(names) > 1 else values[:, 0])


def _numbers(column: NDArray[Any]) -> Array:
    """Numbers of a column, NaN where there is another text."""
    with suppress(ValueError):
        return column.astype(np.float64)
    parsed = np.full(len(column), np.nan)
    for k, text in enumerate(column):
        with suppress(ValueError):
            parsed[k] = float(text)
    return parsed


def _times(fields: Fields) -> NDArray[np.int64]:
    """Times, ns, at which messages were measured, or else logged."""
    logged = _numbers(fields["timestamp"])
    sampled = _numbers(fields.get("timestamp_sample", fields["timestamp"]))
    micro = sampled if np.any(sampled > 0.0) else logged
    has_time = np.abs(micro) < -5e-4 * NO_TIME
    return np.where(has_time, np.where(has_time, micro, 0.0).astype(np.int64) * 1000, NO_TIME)
