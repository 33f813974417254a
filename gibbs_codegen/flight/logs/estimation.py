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


def estimated(
    vehicle: Vehicle,
    known: Mapping[str, Array],
    series: Mapping[Any, tuple[Any, Array]],
    sensors: Sensors | None,
    settings: Filter | None,
) -> dict[str, Any]:
    """Fields of a flight that a filter tells, by series with times, s, and values of each.

    `known` are time (s), s, q (s, nq) and v (s, nv) of the flight. Raises `UsageError` for sensors
    of which the log has nothing, or which read the same of it, and inputs that it lacks.
    """
    estimator, time = Estimator(vehicle, sensors, settings), known["time"]
    led = settings is not None and settings.by == "imu"
    inputs = [] if led else [("u", name) for name in vehicle.inputs]
    if unknown := [name for _, name in inputs if ("u", name) not in series]:
        raise UsageError(
            f"control.filter.by: the log has no {', '.join(unknown)}, which the model needs for "
            'its prediction; name them, or predict with an IMU: by = "imu"'
        )
    come: dict[float, list[tuple[str, float, Array]]] = {float(x): [] for x in time}
    for name in inputs:
        come |= {float(x): [] for x in series[name][0] if time[0] <= x <= time[-1]}
    curves, read = [CubicSpline(*series[name]) for name in inputs], dict[Any, str]()
    for device in (sensors or Sensors()).devices:
        kind, readings = device.measures, _readings(vehicle, series, device)
        source = {"imu": ("imu", getattr(device, "frame", "")), "encoders": kind}.get(kind, "place")
        if source in read:
            raise UsageError(
                f"sensors.{kind}: {device.name} and {read[source]} read the same data of the "
                "log; leave one of them out"
            )
        read[source] = device.name
        for taken, values in zip(*readings, strict=True):
            if time[0] <= taken <= time[-1]:
                come.setdefault(float(taken), []).append((device.name, float(taken), values))
    estimator.begin(known["q"][0], known["v"][0], float(time[0]))
    none = np.zeros(len(vehicle.inputs))
    for now in sorted(come):
        between = 0.5 * (estimator.time + now)
        estimator.follow(now, none if led else [curve(between) for curve in curves], come[now])
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
