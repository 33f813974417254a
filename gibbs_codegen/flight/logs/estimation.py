"""What a filter makes of a log: its readings, one by one, at the times of their stamps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.plant.estimator import Estimator
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.scenario.parts import Filter, Sensors
from gibbs_codegen.flight.vectors import Array

# Times, s, that differ by less are the same.
_SAME = 1e-9


def estimated(
    vehicle: Vehicle,
    known: Mapping[str, Array],
    series: Mapping[Any, tuple[Any, Array]],
    sensors: Sensors | None,
    settings: Filter | None,
) -> dict[str, Any]:
    """Fields of a flight that a filter tells, by series with times, s, and values of each.

    `known` are time (s), s, q (s, nq), v (s, nv) and inputs u (s, nu) of the flight. Raises
    `UsageError` for sensors of which the log has nothing, and inputs that it lacks.
    """
    estimator, (time, u) = Estimator(vehicle, sensors, settings), (known["time"], known["u"])
    led = settings is not None and settings.by == "imu"
    unknown = np.isnan(u).any(axis=0)
    if unknown.any() and not led:
        names = ", ".join(np.array(vehicle.inputs)[unknown])
        raise UsageError(
            f"control.filter.by: the log has no series of {names}, by which the model moves the "
            'state ahead; name them, or let an IMU lead: by = "imu"'
        )
    come: dict[float, list[tuple[str, float, Array]]] = {float(x): [] for x in time}
    for device in (sensors or Sensors()).devices:
        for taken, values in zip(*_readings(vehicle, series, device), strict=True):
            if time[0] <= taken <= time[-1]:
                come.setdefault(float(taken), []).append((device.name, float(taken), values))
    estimator.begin(known["q"][0], known["v"][0], float(time[0]))
    for now in sorted(come):
        # What acted since the last sample before.
        row = u[max(int(np.searchsorted(time, now - _SAME)) - 1, 0)]
        estimator.follow(now, np.nan_to_num(row), come[now])
    return estimator.series(time, known["q"], known["v"])


def _readings(
    vehicle: Vehicle, series: Mapping[Any, tuple[Any, Array]], device: Any
) -> tuple[Array, Array]:
    """Times (k), s, and values (k, m) of a sensor's readings in a log."""
    kind, frame = device.measures, getattr(device, "frame", "base")
    felt = [name[1] for name in series if name[0] == "imu"]
    if kind == "imu" and frame in felt:
        return series["imu", frame]
    if kind == "encoders":
        joints = [series["q", name] for name in vehicle.joint_names]
        times = joints[0][0]
        return times, np.stack([CubicSpline(*joint)(times) for joint in joints], axis=1)
    times, place = series["position"]
    if kind == "pose" and frame == "base":
        turned = Rotation.from_quat(CubicSpline(*series["attitude"])(times)).as_matrix()
        return times, np.concatenate([place, turned[:, :, 0], turned[:, :, 1]], axis=1)
    if kind == "gps" and frame == "base" and "velocity" in series:
        return times, np.concatenate([place, CubicSpline(*series["velocity"])(times)], axis=1)
    has = ["pose", *(["gps"] if "velocity" in series else []), *["encoders"] * vehicle.joints]
    read = [f"{x} at base" if x != "encoders" else x for x in dict.fromkeys(has)]
    words = ", ".join([*read, *(f"imu at {x}" for x in felt)])
    raise UsageError(
        f"sensors.{kind}: the log has no readings of {device.name} at {frame}, but {words}"
    )
