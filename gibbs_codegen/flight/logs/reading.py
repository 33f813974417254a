"""Series of a log on one time base, with derivatives, as the flight of a robot."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.flight.attitude import Turning
from gibbs_codegen.flight.logs.estimation import estimated
from gibbs_codegen.flight.plant.actuators import module_actuators
from gibbs_codegen.flight.plant.kinematics import quaternions_of
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.record.recording import posture_series
from gibbs_codegen.flight.record.series import RANGES
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.vectors import Array, times

# Order of the filter, which is applied forwards and backwards; samples that it needs.
_ORDER, _LEAST = 4, 16
# Samples that are too many; steps without samples that a warning names.
_MOST, _LONG_GAP = 1e7, 20.0
# The time of samples that have none.
NO_TIME = -(2**63)
# How long no recording rests, ns, where its clock is right.
_LONG_REST = 3600 * 10**9
# Greatest numbers that a robot's samples can be, in SI units: around the Earth it is 4e7 m, in
# an orbit 8e3 m/s. Numbers beyond are bits that were flipped.
_GREATEST = {"position": 1e8, "attitude": 2.0, "velocity": 1e4, "spin": 1e4}
_GREATEST |= {"q": 1e8, "v": 1e4, "u": 1e8, "imu": 1e5}
_GREATEST_ACCELERATION = 1e8
# A warning names what shortens a log by more than this, s.
_LOST = 1.0
# How many entries of a list a message has.
_LISTED = 5
# Share of a step by which the last sample may be late.
_SAME_STEP = 1e-6

_log = logging.getLogger("gibbs_codegen")


class Samples(NamedTuple):
    """Time (s), ns, or `NO_TIME`, and values (s) or (s, k), in the order of the log."""

    time: NDArray[np.int64]
    values: Array

    def rows(self, chosen: Any) -> Samples:
        """Some of the samples, by a slice or a mask (s)."""
        return Samples(self.time[chosen], self.values[chosen])

    def curve(self, begin: int) -> CubicSpline:
        """A spline of the values over seconds since a time, ns."""
        return CubicSpline((self.time - begin) * 1e-9, self.values)


class Recorded(NamedTuple):
    """Contents of a log for a robot.

    `position` (s, 3), m, of the frame "base" and `attitude` (s, 4), quaternions x y z w from it to
    the world; `velocity` (s, 3), m/s, world axes, and `spin` (s, 3), rad/s, base's axes, None where
    they follow from those. Joints and rates by coordinates, and inputs by their names, have values
    (s). `offered` are names of joints that the log has. IMUs by frame have specific force, m/s²,
    and spin (s, 6), and commands by their names what is sent (s), in the units of the robot.
    `unread` lists other readings of the log.
    """

    position: Samples | None
    attitude: Samples | None
    velocity: Samples | None
    spin: Samples | None
    joints: Mapping[str, Samples]
    rates: Mapping[str, Samples]
    inputs: Mapping[str, Samples]
    offered: tuple[str, ...]
    imus: Mapping[str, Samples] = MappingProxyType({})
    commands: Mapping[str, Samples] = MappingProxyType({})
    unread: str = ""


def of_shares(vehicle: Vehicle, shares: Mapping[int, Samples]) -> dict[str, Samples]:
    """Commands by their names of shares of the greatest, by their numbers."""
    most = module_actuators(vehicle).sent[1]
    return {
        vehicle.commands[k]: share._replace(values=share.values * most[k])
        for k, share in shares.items()
        if np.isfinite(most[k])
    }


def flight_of_log(
    vehicle: Vehicle,
    recorded: Recorded,
    source: str,
    rate: float | None,
    cutoff: float | None,
    estimation: Scenario | None = None,
) -> Flight:
    """The flight of a robot by what was recorded, from the first instant at which all is known.

    Samples are those of the series of the base that has most, or `rate` a second; what is slower
    than `cutoff`, Hz, is kept of them, if given. `source` names the log. `estimation` says of which
    sensors a filter makes what, if one is to.
    """
    if recorded.position is None or recorded.attitude is None:
        raise UsageError(f"{source}: does not contain the pose of the base, which a flight needs")
    logged: dict[Any, Samples | None] = {
        "position": recorded.position,
        "attitude": recorded.attitude,
        "velocity": recorded.velocity,
        "spin": recorded.spin,
        **{("q", name): samples for name, samples in recorded.joints.items()},
        **{("v", name): samples for name, samples in recorded.rates.items()},
        **{("u", name): samples for name, samples in recorded.inputs.items()},
    }
    if estimation:
        logged |= {("imu", frame): samples for frame, samples in recorded.imus.items()}
    series = cleaned({name: log for name, log in logged.items() if log is not None}, source)
    begin, seconds = _time_base(series, source, rate, cutoff)
    curves = {name: x.curve(begin) for name, x in series.items() if name[0] != "imu"}
    arrays = {name: curve(seconds) for name, curve in curves.items()}
    if "velocity" not in arrays:
        arrays["velocity"] = curves["position"](seconds, 1)
    if "spin" not in arrays:
        arrays["spin"] = _spin(arrays["attitude"], curves["attitude"](seconds, 1))
    for name in recorded.joints.keys() - recorded.rates.keys():
        arrays["v", name] = curves["q", name](seconds, 1)
    if cutoff is not None:
        low = butter(_ORDER, cutoff, fs=1.0 / (seconds[1] - seconds[0]), output="sos")
        arrays = {name: sosfiltfilt(low, values, axis=0) for name, values in arrays.items()}
    q, v, a = motion_of(vehicle, arrays, seconds)
    fastest, sharpest = (float(np.abs(derivative).max()) for derivative in (v, a))
    if not (fastest <= _GREATEST["v"] and sharpest <= _GREATEST_ACCELERATION):
        raise UsageError(
            f"{source}: by its samples the robot moves at {fastest:.3g} m/s or rad/s and "
            f"{sharpest:.3g} m/s² or rad/s², which is impossible; some samples or times are "
            "wrong: remove them, name other topics, or give a lower rate"
        )
    unknown = np.full(len(seconds), np.nan)
    u = np.stack([arrays.get(("u", name), unknown) for name in vehicle.inputs], axis=1)
    limits = module_actuators(vehicle)
    no_place = np.full((len(seconds), 3), np.nan)
    fields = {
        name: value() for name, value in posture_series(vehicle, lambda: q, lambda: v).items()
    }
    if estimation:
        chosen = estimation.sensors, estimation.control.filter
        known = {"time": seconds, "q": q, "v": v}
        readings = {name: (1e-9 * (x.time - begin), x.values) for name, x in series.items()}
        fields |= estimated(vehicle, known, readings, *chosen)
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
    for name, samples in series.items():
        if len(samples.time) < _LEAST:
            raise UsageError(
                f"{source}: {title(name)} has {len(samples.time)} numeric samples; a flight "
                f"needs {_LEAST}"
            )
    begin, end = common_time(series, source)
    base = (series[name].time for name in ("position", "attitude"))
    most = max(((time[(begin <= time) & (time <= end)]) for time in base), key=len)
    if len(most) < _LEAST:
        raise UsageError(
            f"{source}: its series have {max(end - begin, 0) * 1e-9:.4g} s in common, with "
            f"{len(most)} samples of the base; a flight needs {_LEAST}"
        )
    if rate is None and cutoff is None:
        return begin, np.asarray((most - begin) * 1e-9)
    tell_gaps(series, source, begin, "a spline fills the gap")
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


def common_time(series: Mapping[Any, Samples], source: str) -> tuple[int, int]:
    """From when to when all series are known, ns; a warning tells which shorten a log by much."""
    last = max(series, key=lambda name: series[name].time[0])
    first = min(series, key=lambda name: series[name].time[-1])
    begin, end = int(series[last].time[0]), int(series[first].time[-1])
    both, start = 1e-9 * (end - begin), min(x.time[0] for x in series.values())
    whole = 1e-9 * float(np.ptp([x.time[[0, -1]] for x in series.values()]))
    if whole - both > _LOST:
        words = (
            "%s: of %.4g s only %.4g s are read, from where %s begins, at %.4g s, to where %s "
            "ends; times count from that begin"
        )
        seconds = whole, max(both, 0.0), title(last), 1e-9 * (begin - start)
        _log.warning(words, source, *seconds, title(first))
    return begin, end


def tell_gaps(series: Mapping[Any, Samples], source: str, begin: int, then: str) -> None:
    """Warn of each series that is not known for long, in a log that begins at a time, ns."""
    for name, samples in series.items():
        pairs = gaps(samples.time, _LONG_GAP * float(np.median(np.diff(samples.time))))
        if len(pairs):
            words = "%s: %s is not known for %s; %s"
            _log.warning(words, source, title(name), listed_gaps(pairs - begin), then)


def gaps(time: NDArray[np.int64], longest: float) -> NDArray[np.int64]:
    """From when to when (g, 2), ns, nothing is known at times (s), for longer than that, ns."""
    long = np.diff(time) > longest
    return np.stack([time[:-1][long], time[1:][long]], axis=1)


def listed_gaps(gaps: NDArray[np.int64]) -> str:
    """Gaps from one time, ns, to another (g, 2) as a list."""
    return listed(
        [f"{1e-9 * (end - last):.3g} s after {1e-9 * last:.4g} s" for last, end in gaps.tolist()]
    )


def listed(words: Sequence[str]) -> str:
    """The first words of a list, and how many follow."""
    rest = len(words) - _LISTED
    return ", ".join(words[:_LISTED]) + f" and {rest} more" * (rest > 0)


def known_attitudes(quaternions: Array) -> Array:
    """Quaternions (s, 4), NaN where they are zero or otherwise far from unit length."""
    with np.errstate(over="ignore"):
        length = np.linalg.norm(quaternions, axis=1, keepdims=True)
    return np.where((length > 0.5) & (length < 2.0), quaternions, np.nan)


def of_base(position: Array, quaternion: Array, mounts: Array) -> tuple[Array, Array]:
    """Poses (s, 3), (s, 4) of the base by those of frames that are mounted on it by (…, 4, 4).

    Of an attitude that is not known, NaN, the position is not known either.
    """
    known = np.isfinite(quaternion).all(axis=1, keepdims=True)
    attitude = Rotation.from_quat(np.where(known, quaternion, [0.0, 0.0, 0.0, 1.0]))
    attitude *= Rotation.from_matrix(mounts[..., :3, :3]).inv()
    place = position - attitude.apply(mounts[..., :3, 3])
    return np.where(known, place, np.nan), np.where(known, attitude.as_quat(), np.nan)


def cleaned(series: Mapping[Any, Samples], source: str) -> dict[Any, Samples]:
    """Samples that can be, of one run of the clock, in the order of time; others are logged."""
    sound, left_out = dict[Any, Samples](), dict[tuple[str, int, int], list[str]]()

    def kept(name: Any, samples: Samples, right: Any, why: str) -> Samples:
        """The samples that are right; others are counted under the words for why they are not."""
        if count := len(right) - int(np.count_nonzero(right)):
            left_out.setdefault((why, count, len(series[name].time)), []).append(title(name))
        return samples.rows(right)

    for name, samples in series.items():
        if name == "attitude":
            samples = samples._replace(values=known_attitudes(samples.values))
        samples = kept(name, samples, samples.time != NO_TIME, "have no time")
        values = np.abs(
            samples.values.reshape(len(samples.time), math.prod(samples.values.shape[1:]))
        )
        right = (values <= _GREATEST[name if isinstance(name, str) else name[0]]).all(axis=1)
        sound[name] = kept(
            name, samples, right, "are not numbers or attitudes, or are impossibly large"
        )
    runs = {name: _runs(samples.time) for name, samples in sound.items()}
    if odd := [name for name, parts in runs.items() if len(parts) > 1]:
        first = next(iter(runs))
        lengths = [run.stop - run.start for run in runs[first]]
        number, count = int(np.argmax(lengths)), len(lengths)
        if other := [name for name, run in runs.items() if len(run) != count]:
            parts = len(runs[other[0]])
            raise UsageError(
                f"{source}: its clock jumps back, or ahead by more than an hour, and cuts "
                f"{title(first)} into {count} parts but {title(other[0])} into {parts}; cut the "
                "log there, and read its parts"
            )
        sound = {name: samples.rows(runs[name][number]) for name, samples in sound.items()}
        _log.warning(
            "%s: the clock of %s jumps back, or ahead by more than an hour; of the %d parts "
            "between jumps only the longest is read, number %d, with %d samples of %s",
            *(source, ", ".join(map(title, odd)), count, number + 1, lengths[number], title(first)),
        )
    for name, samples in sound.items():
        latest = np.maximum.accumulate(samples.time)
        later = np.append(True, samples.time[1:] > latest[:-1])[: len(latest)]
        sound[name] = kept(name, samples, later, "are not later than an earlier one")
    if left_out:
        words = (
            f"{count} of {whole} samples of {', '.join(names)}, which {why}"
            for (why, count, whole), names in left_out.items()
        )
        _log.warning("%s: left out: %s", source, "; ".join(words))
    if "attitude" in sound:
        turned = Rotation.from_quat(sound["attitude"].values).as_matrix()
        sound["attitude"] = sound["attitude"]._replace(values=quaternions_of(turned))
    return sound


def _runs(time: NDArray[np.int64]) -> list[slice]:
    """Samples between which a clock goes back for more than one of them, or leaps ahead."""
    step = np.diff(time)
    after = np.append(time[2:], np.iinfo(np.int64).max)[: len(step)]
    breaks = 1 + np.flatnonzero((step < 0) & (after <= time[:-1]) | (step > _LONG_REST))
    ends = [0, *breaks.tolist(), len(time)]
    return [slice(*pair) for pair in pairwise(ends)]


def title(name: str | tuple[str, str]) -> str:
    """The title of a series in messages."""
    if isinstance(name, str):
        return name
    return f"the IMU at {name[1]}" if name[0] == "imu" else printable(name[1])


def _spin(quaternion: Array, rate: Array) -> Array:
    """Angular velocities (s, 3), own axes, by quaternions (s, 4), of about unit length, and rates.

    That is twice the vector of the product of the conjugate with the rate.
    """
    vector, scalar = quaternion[:, :3], quaternion[:, 3:]
    twice = scalar * rate[:, :3] - rate[:, 3:] * vector - np.cross(vector, rate[:, :3])
    return 2.0 * twice / np.sum(quaternion**2, axis=1, keepdims=True)


def motion_of(
    vehicle: Vehicle, arrays: Mapping[Any, Array], seconds: Array
) -> tuple[Array, Array, Array]:
    """Coordinates (s, nq), velocities and accelerations (s, nv) by series at times (s)."""

    def rate(values: Array) -> Array:
        return CubicSpline(seconds, values)(seconds, 1)

    layout, kinematics = vehicle.layout, vehicle.kinematics
    rotation = Rotation.from_quat(arrays["attitude"]).as_matrix()
    spin = times(rotation, arrays["spin"])
    turning = Turning(rotation @ vehicle.base_turn.T, spin, rate(spin))
    # The place of x, y, z in the frame "base".
    away = -times(turning.rotation, vehicle.lever)
    carried = np.cross(spin, away)
    velocity = arrays["velocity"] + carried
    acceleration = rate(arrays["velocity"]) + np.cross(turning.acceleration, away)
    acceleration += np.cross(spin, carried)
    q = np.zeros((len(seconds), layout.q.size))
    v, a = np.zeros((2, len(seconds), layout.v.size))
    places = layout.v.attitude
    q[:, layout.q.attitude], v[:, places], a[:, places] = kinematics.turned(turning)
    q[:, layout.q.position] = (arrays["position"] - vehicle.centre_offset(q))[:, layout.own_axes[0]]
    places = layout.v.position
    v[:, places], a[:, places] = kinematics.moved(turning, velocity, acceleration)
    for k, name in enumerate(vehicle.joint_names):
        q[:, layout.q.joint_places[k]] = arrays["q", name]
        v[:, layout.v.joint_places[k]] = arrays["v", name]
        a[:, layout.v.joint_places[k]] = rate(arrays["v", name])
    if layout.q.wheels:
        q[:, layout.q.angles] = vehicle.rolled(seconds, q, v, a)
    return q, v, a
