"""Series of a log on one time base, with derivatives, as the flight of a robot."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.flight.plant.actuators import module_actuators
from gibbs_codegen.flight.plant.kinematics import quaternions_of
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.record.recording import posture_series
from gibbs_codegen.flight.record.series import RANGES
from gibbs_codegen.flight.scenario.orientation import Turning
from gibbs_codegen.flight.vectors import Array, times

# Order of the filter, which is applied forwards and backwards; samples that it needs.
_ORDER, _LEAST = 4, 16
# Samples that are too many; how many steps without samples are told.
_MOST, _LONG_GAP = 1e7, 20.0
# Share of a step by which the last sample may be late.
_SAME_STEP = 1e-6

_log = logging.getLogger("gibbs_codegen")


class Samples(NamedTuple):
    """Times (s), ns, and values (s) or (s, k) at them."""

    time: NDArray[np.int64]
    values: Array

    @property
    def known(self) -> Samples:
        """Samples in the order of time, without those that are not finite or of the same time."""
        flat = self.values.reshape(len(self.time), -1)
        finite = np.flatnonzero(np.isfinite(flat).all(axis=1))
        time, first = np.unique(self.time[finite], return_index=True)
        return Samples(time, self.values[finite[first]])

    def curve(self, begin: int) -> CubicSpline:
        """A spline of the values over seconds since a time, ns."""
        return CubicSpline((self.time - begin) * 1e-9, self.values)


class Recorded(NamedTuple):
    """What a log has of a robot.

    `position` (s, 3), m, of the frame "base" and `attitude` (s, 4), quaternions x y z w from it to
    the world; `velocity` (s, 3), m/s, world axes, and `spin` (s, 3), rad/s, base's axes, None where
    they follow from those. Joints and rates by coordinates, and inputs by their names, have values
    (s). `offered` are names of joints that the log has.
    """

    position: Samples
    attitude: Samples
    velocity: Samples | None
    spin: Samples | None
    joints: Mapping[str, Samples]
    rates: Mapping[str, Samples]
    inputs: Mapping[str, Samples]
    offered: tuple[str, ...]


def flight_of_log(
    vehicle: Vehicle,
    recorded: Recorded,
    source: str,
    rate: float | None,
    cutoff: float | None,
) -> Flight:
    """The flight of a robot by what was recorded, from the first instant at which all is known.

    Samples are those of the series of the base that has most, or `rate` a second; what is slower
    than `cutoff`, Hz, is kept of them, if given. `source` names the log.
    """
    series = {
        name: each.known
        for name, each in (
            ("position", recorded.position),
            ("attitude", recorded.attitude._replace(values=_attitudes(recorded.attitude))),
            ("velocity", recorded.velocity),
            ("spin", recorded.spin),
            *((("q", name), each) for name, each in recorded.joints.items()),
            *((("v", name), each) for name, each in recorded.rates.items()),
            *((("u", name), each) for name, each in recorded.inputs.items()),
        )
        if each is not None
    }
    begin, seconds = _time_base(series, source, rate, cutoff)
    curves = {name: each.curve(begin) for name, each in series.items()}
    found = {name: curve(seconds) for name, curve in curves.items()}
    if "velocity" not in found:
        found["velocity"] = curves["position"](seconds, 1)
    if "spin" not in found:
        found["spin"] = _spin(found["attitude"], curves["attitude"](seconds, 1))
    for name in recorded.joints.keys() - recorded.rates.keys():
        found["v", name] = curves["q", name](seconds, 1)
    if cutoff is not None:
        low = butter(_ORDER, cutoff, fs=1.0 / (seconds[1] - seconds[0]), output="sos")
        found = {name: sosfiltfilt(low, values, axis=0) for name, values in found.items()}
    q, v, a = _motion(vehicle, found, seconds)
    unknown = np.full(len(seconds), np.nan)
    u = np.stack([found.get(("u", name), unknown) for name in vehicle.inputs], axis=1)
    limits = module_actuators(vehicle)
    no_place = np.full((len(seconds), 3), np.nan)
    fields = {
        name: value() for name, value in posture_series(vehicle, lambda: q, lambda: v).items()
    }
    # Nothing tells what was desired or commanded, nor what else acted.
    fields |= {
        "frames": (),
        "frame_wrenches": np.zeros((len(seconds), 0, 6)),
        **{
            f"{name}_desired": np.full_like(x, np.nan) for name, x in (("q", q), ("v", v), ("a", a))
        },
        **dict.fromkeys(("commanded", *RANGES[:2]), np.full_like(u, np.nan)),
        **dict.fromkeys(("applied", *RANGES[2:]), u),
    }
    return Flight(
        **fields,
        scenario=source,
        tangent_arm=0,
        stopped="",
        time=seconds,
        a=a,
        input_limits=limits.inputs,
        joint_limits=limits.joints,
        constraint_torques=vehicle.constraint_torques(q, v, a, u),
        centre_desired=no_place,
        tip_desired=no_place if vehicle.has_tip else np.zeros((len(seconds), 0)),
        heading_error=unknown,
        work=unknown,
    )


def _time_base(
    series: Mapping[Any, Samples], source: str, rate: float | None, cutoff: float | None
) -> tuple[int, Array]:
    """The begin of the time that all series have, ns, and seconds (s) since then."""
    for name, each in series.items():
        if len(each.time) < _LEAST:
            what = name if isinstance(name, str) else name[1]
            raise UsageError(
                f"{source}: of {printable(what)} it has {len(each.time)} samples that are numbers; "
                f"a flight needs {_LEAST}"
            )
    begin = int(max(each.time[0] for each in series.values()))
    end = int(min(each.time[-1] for each in series.values()))
    base = (series[name].time for name in ("position", "attitude"))
    most = max(((time[(begin <= time) & (time <= end)]) for time in base), key=len)
    if len(most) < _LEAST:
        raise UsageError(
            f"{source}: its series have {max(end - begin, 0) * 1e-9:.4g} s in common, with "
            f"{len(most)} samples of the base; a flight needs {_LEAST}"
        )
    if rate is None and cutoff is None:
        return begin, np.asarray((most - begin) * 1e-9)
    for name, each in series.items():
        gaps = np.diff(each.time)
        if np.max(gaps) > _LONG_GAP * np.median(gaps):
            what, late = name if isinstance(name, str) else name[1], each.time[np.argmax(gaps)]
            _log.warning(
                "%s: %s is not known for %.3g s after %.4g s; a spline goes across",
                *(source, printable(what), np.max(gaps) * 1e-9, (late - begin) * 1e-9),
            )
    step = 1.0 / rate if rate else float(np.median(np.diff(most))) * 1e-9
    if cutoff is not None and not 0.0 < cutoff < 0.5 / step:
        raise UsageError(
            f"cutoff: must be between 0 and {0.5 / step:.4g} Hz, half of the rate of the samples, "
            f"not {cutoff:g}"
        )
    if (end - begin) * 1e-9 / step > _MOST:
        raise UsageError(
            f"{source}: {(end - begin) * 1e-9:.4g} s in steps of {step:.3g} s are more than "
            f"{_MOST:.0g} samples; give a lower rate"
        )
    seconds = step * np.arange(int((end - begin) * 1e-9 / step + _SAME_STEP) + 1.0)
    if len(seconds) < _LEAST:
        raise UsageError(f"rate: {len(seconds)} samples are left; a flight needs {_LEAST}")
    return begin, seconds


def _attitudes(attitude: Samples) -> Array:
    """Unit quaternions (s, 4) without jumps; NaN for those of no length."""
    length = np.linalg.norm(attitude.values, axis=1, keepdims=True)
    known = np.flatnonzero((length > 0.0)[:, 0])
    found = np.full(attitude.values.shape, np.nan)
    found[known] = quaternions_of(Rotation.from_quat(attitude.values[known]).as_matrix())
    return found


def _spin(quaternion: Array, rate: Array) -> Array:
    """Angular velocities (s, 3), own axes, by quaternions (s, 4), of about unit length, and rates.

    That is twice the vector of the product of the conjugate with the rate.
    """
    vector, scalar = quaternion[:, :3], quaternion[:, 3:]
    twice = scalar * rate[:, :3] - rate[:, 3:] * vector - np.cross(vector, rate[:, :3])
    return 2.0 * twice / np.sum(quaternion**2, axis=1, keepdims=True)


def _motion(
    vehicle: Vehicle, found: Mapping[Any, Array], seconds: Array
) -> tuple[Array, Array, Array]:
    """Coordinates (s, nq), velocities and accelerations (s, nv) by series at times (s)."""

    def rate(values: Array) -> Array:
        slopes: Array = CubicSpline(seconds, values)(seconds, 1)
        return slopes

    layout, kinematics = vehicle.layout, vehicle.kinematics
    rotation = Rotation.from_quat(found["attitude"]).as_matrix()
    spin = times(rotation, found["spin"])
    turning = Turning(rotation, spin, rate(spin))
    # Where x, y, z are, seen from the frame "base".
    away = -times(rotation, vehicle.centre_offset(vehicle.neutral))
    carried = np.cross(spin, away)
    velocity = found["velocity"] + carried
    acceleration = rate(found["velocity"]) + np.cross(turning.acceleration, away)
    acceleration += np.cross(spin, carried)
    q = np.zeros((len(seconds), layout.q.size))
    v, a = np.zeros((2, len(seconds), layout.v.size))
    places = layout.v.attitude
    q[:, layout.q.attitude], v[:, places], a[:, places] = kinematics.turned(turning)
    q[:, layout.q.position] = found["position"] + away
    places = layout.v.position
    v[:, places], a[:, places] = kinematics.moved(turning, velocity, acceleration)
    for k, name in enumerate(vehicle.joint_names):
        q[:, layout.q.joint_places[k]] = found["q", name]
        v[:, layout.v.joint_places[k]] = found["v", name]
        a[:, layout.v.joint_places[k]] = rate(found["v", name])
    return q, v, a
