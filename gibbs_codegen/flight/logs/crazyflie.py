"""Logs of a Crazyflie's memory card: IMU and motors, and its own estimate where that is logged."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.logs.reading import Recorded, Samples, of_shares
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.vectors import Array

_MAGIC, _GREATEST_PWM, _G = 0xBC, 65535, 9.80665


def is_crazyflie(path: Path) -> bool:
    """True if a file begins as such a log does."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(1) == bytes([_MAGIC])


def read_crazyflie(path: Path, vehicle: Vehicle, names: Mapping[str, str | float]) -> Recorded:
    """Contents of a log for a robot whose rotors are in the order of m1 to m4."""
    if renamed := [name for name, alias in names.items() if isinstance(alias, str)]:
        raise UsageError(
            f"names: {renamed[0]}: logs of a Crazyflie have the names of its firmware; leave it out"
        )
    time, columns = _decoded(path.read_bytes())

    def series(*keys: str, factor: float = 1.0) -> Samples | None:
        if not columns.keys() >= {*keys}:
            return None
        return Samples(time, factor * np.stack([columns[key] for key in keys], axis=1))

    forces = series(*(f"acc.{axis}" for axis in "xyz"), factor=_G)
    turns = series(*(f"gyro.{axis}" for axis in "xyz"), factor=np.pi / 180.0)
    felt = {}
    if forces and turns:
        felt["base"] = Samples(time, np.concatenate([forces.values, turns.values], axis=1))
    motors = {
        k: Samples(time, columns[f"motor.m{k + 1}"] / _GREATEST_PWM)
        for k in range(vehicle.rotors)
        if f"motor.m{k + 1}" in columns
    }
    place = series(*(f"stateEstimate.{axis}" for axis in "xyz"))
    attitude = series(*(f"stateEstimate.q{axis}" for axis in "xyzw"))
    return Recorded(place, attitude, None, None, {}, {}, {}, (), felt, of_shares(vehicle, motors))


def _decoded(data: bytes) -> tuple[NDArray[np.int64], dict[str, Array]]:
    """Times, ns, and columns by their names, of a log with one kind of event."""
    _, version, events = struct.unpack_from("<BHH", data)
    if version != 2 or events != 1:
        raise ValueError
    rest = data[7:].partition(b"\0")[2]
    (count,) = struct.unpack_from("<H", rest)
    *fields, rows = rest[2:].split(b"\0", count)
    if len(fields) != count:
        raise ValueError
    row = [(name.decode()[:-3], f"<{name.decode()[-2]}") for name in fields]
    layout = np.dtype([("event", "<u2"), ("time", "<u8"), *row])
    table = np.frombuffer(rows, layout, len(rows) // layout.itemsize)
    times = table["time"].astype(np.int64) * 1000
    return times, {name: table[name].astype(float) for name, _ in row}
