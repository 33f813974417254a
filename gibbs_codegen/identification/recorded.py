"""What was recorded of a robot, on a grid of time, and how much its readings err."""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from types import ModuleType
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator, interp1d
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation, Slerp

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.arguments import real
from gibbs_codegen.flight.logs.cdr import times_of
from gibbs_codegen.flight.logs.motion import base_motion, imus, new_readings, on_base, poses, unread
from gibbs_codegen.flight.logs.reading import (
    Recorded,
    Samples,
    cleaned,
    common_time,
    gaps,
    known_attitudes,
    listed,
    listed_gaps,
    motion_of,
    of_base,
    tell_gaps,
    title,
)
from gibbs_codegen.flight.plant.kinematics import quaternions_of
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.vectors import Array

_log = logging.getLogger("gibbs_codegen")
# The shortest step of the grid, s, the fewest samples, and readings of a coordinate.
_SHORTEST, _LEAST, _LEAST_READINGS = 4e-3, 200, 20
# Deviations below which no reading is trusted, m or rad, m/s² and rad/s.
_FLOOR, _FLOOR_FELT, _FLOOR_SPIN = 1e-4, 5e-3, 5e-4
# Of arms on a base that does not fly: of encoders, rad or m, and of inputs, N m or N.
_FLOOR_ENCODER, _FLOOR_INPUT = 1e-5, 1e-3
# The deviation of a delay of readings, s, before a log tells it.
DELAY = 0.02
# Of a first guess of velocities, Hz, and of where up is of a base of which no log tells the pose;
# deviations of that pose, which say next to nothing, m and rad.
_CUTOFF, _SWAY = 12.0, 0.1
_ANYWHERE, _ANYHOW = 100.0, 3.0
# By how many deviations a reading is off its neighbours to be left out.
_SPIKE = 12.0
# Third differences of white noise have so many times its variance; the deviation by the median.
_THIRD, _BY_MEDIAN = 20.0, 1.4826
# Commands that are late by more, s, are unknown.
_GAP = 0.2
# Delays that are tried, and the greatest, s; steps by Gauss and Newton, s and their number; time
# over which turns are compared, and their differences correlated, s; what share may differ.
_TRIED, _FAR, _NEAR, _STEPS = np.linspace(-0.2, 0.2, 15).tolist(), 0.21, 0.01, 4
_WINDOW, _CORRELATED, _UNLIKE = 0.3, 1.0, 0.5
# A delay with a greater deviation than the first, s, is unknown. It is corrected if it is greater
# than so many deviations, and than the last, s.
_VAGUE, _SURE, _BRIEF = 2e-3, 3.0, 5e-4
# Delays are not looked for in gaps above so many usual steps and s; logs may come in bursts.
_TORN, _BURST = 3.0, 0.05
# Time from command to command, s, that tells little of motors.
_SELDOM = 0.03
# Steps that differ by more than this share of the whole are no grid.
_UNEVEN = 0.02


@dataclass(frozen=True, eq=False)
class Recording:
    """Readings of a flight, a row for each time of a grid; NaN is what was not read then.

    Args:
        time: Times (s), s, evenly spaced.
        commands: Commands of motors and servos (s, nu), or inputs of a robot without these, each
            from its time to the next.
        q: Coordinates (s, nq): of the base as motion capture tells them, of joints as encoders do;
            where nothing tells those of a base on wheels, angles of its wheels do.
        imus: By frame specific force and angular velocity (s, 6), m/s² and rad/s, its axes.
        source: Name of the log.
    """

    time: Array
    commands: Array
    q: Array
    imus: Mapping[str, Array] = field(default_factory=dict)
    source: str = "recording"

    def __post_init__(self) -> None:
        """Refuse what is no grid, or too short. Raises `UsageError`."""
        steps = np.diff(self.time)
        if len(self.time) < _LEAST:
            raise UsageError(
                f"{self.source}: has {len(self.time)} samples and needs {_LEAST}; record for "
                "longer, or more often"
            )
        if not np.ptp(steps) < _UNEVEN * np.median(steps):
            late = self.time[int(np.abs(steps - np.median(steps)).argmax())]
            raise UsageError(
                f"{self.source}: its samples are not evenly spaced at {late:.6g} s (a gap, or a "
                "clock that jumps back); cut the log there, and give the parts as separate logs"
            )
        if not np.isfinite(self.commands).all():
            raise UsageError(
                f"{self.source}: has no command of some motor or servo at some time, and forces "
                "need it; cut that part out"
            )

    @property
    def step(self) -> float:
        """The time from sample to sample, s."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)


def of_robot(recording: Recording, vehicle: Vehicle) -> Recording:
    """A recording with arrays, if shapes, frames and attitudes are those of a robot.

    Raises `UsageError` otherwise.
    """
    source, module, count = recording.source, vehicle.module, len(recording.time)
    if unknown := [frame for frame in recording.imus if frame not in module.FRAMES]:
        words = f"{source}: imus: {module.NAME} has no frame {', '.join(unknown)}"
        raise UsageError(f"{words}; its frames are {', '.join(module.FRAMES)}")

    def taken(what: str, values: Array, columns: Sequence[str]) -> Array:
        wanted = f"rows of {', '.join(columns)}, one for each time"
        return real(f"{source}: {what}", values, wanted, (count, len(columns)))

    time = real(f"{source}: time", recording.time, "a list of times, s", (count,))
    q = taken("q", recording.q, module.COORDINATES)
    if vehicle.layout.is_quaternion:
        turned = q[:, vehicle.layout.q.attitude]
        if (wrong := np.isnan(known_attitudes(turned)) & np.isfinite(turned)).any():
            words = f"{source}: q: at {time[wrong.any(axis=1)][0]:.6g} s the attitude is no unit"
            raise UsageError(f"{words} quaternion; NaN says that it was not read")
    felt = {f: taken(f"imus: {f}", x, felt_names([f])) for f, x in recording.imus.items()}
    commands = taken("commands", recording.commands, vehicle.commands)
    return Recording(time, commands, q, felt, source)


def part_of(recording: Recording, rows: slice) -> Recording:
    """Some of the samples of a recording."""
    felt = {frame: values[rows] for frame, values in recording.imus.items()}
    series = recording.time[rows], recording.commands[rows], recording.q[rows]
    return Recording(*series, felt, recording.source)


def cut(recording: Recording, parts: Sequence[slice]) -> list[Recording]:
    """Parts of a recording; a warning of the logger tells which are too short to tell anything."""
    if short := [part for part in parts if 0 < part.stop - part.start < _LEAST]:
        words = "%s: %d samples from %s s on are left out, because a part needs at least %d"
        begins = listed([f"{recording.time[part.start]:.4g}" for part in short])
        count = sum(part.stop - part.start for part in short)
        _log.warning(words, recording.source, count, begins, _LEAST)
    return [part_of(recording, part) for part in parts if part.stop - part.start >= _LEAST]


def flight_recordings(flight: Flight, module: ModuleType, source: str) -> list[Recording]:
    """What a flight tells: its IMUs and encoders, and coordinates that no encoder reads.

    Parts, where commands have gaps.

    Raises `UsageError` where it is not of the robot, or constraints hold.
    """
    if flight.held:
        raise UsageError(
            f"{source}: {', '.join(flight.held)} held the robot, with forces that no log "
            "contains; give a flight without [[hold]]"
        )
    if flight.coordinates != module.COORDINATES:
        raise UsageError(
            f"{source}: is a flight of {flight.robot}, and its coordinates differ from "
            f"{module.NAME}'s; give the robot that flew"
        )
    vehicle, stamps = Vehicle(module), times_of(flight.time)
    commands = flight.commands
    if not commands.size:
        commands = np.clip(flight.commanded, *flight.input_limits)
    if not np.isfinite(commands).any(axis=0).all():
        raise UsageError(
            f"{source}: has no command of some motor or servo, and forces need it; give a flight "
            "of `simulate`, or the log itself"
        )
    if not flight.control_rate:  # Laws that act at all times go on between samples.
        commands = np.concatenate([0.5 * (commands[1:] + commands[:-1]), commands[-1:]])
    sensor, *placed = _placed(flight, vehicle)
    q, by_frame = flight.q.copy(), dict[str, tuple[str, Array]]()
    for name, (frame, values) in imus(flight).items():
        by_frame.setdefault(frame, (name, values))
    read = [sensor, *(name for name, _ in by_frame.values())]
    encoders = defaultdict[str, dict[int, int]](dict)
    for k, reading in enumerate(flight.sensor_names):
        ends = [name for name in flight.coordinates if reading.endswith(f"_{name}")]
        if ends and flight.sensor_frames[k] == "":
            joint = max(ends, key=len)  # Of the joints "arm" and "fore_arm" the latter.
            if (place := flight.coordinates.index(joint)) not in chain(*encoders.values()):
                encoders[reading.removesuffix(joint)][place] = k
    for places in encoders.values():
        q[:, [*places]] = new_readings(flight, [*places.values()])
        read += [flight.sensor_names[k] for k in places.values()]
    posed = not vehicle.layout.q.base or f"{sensor}_x_axis_x" in flight.sensor_names
    exact = ["attitude" if sensor else "pose"] * (not posed)
    if exact := exact + ["joints"] * (len({*chain(*encoders.values())}) < vehicle.joints):
        words = "%s: no sensor reads the %s; taken without noise"
        _log.warning(words, source, " and ".join(exact))

    def known(values: Array) -> Samples:
        rows = np.isfinite(values.reshape(len(values), -1)).all(axis=1)
        return Samples(stamps, values).rows(rows)

    joints = {name: known(q[:, flight.coordinates.index(name)]) for name in vehicle.joint_names}
    sent = {name: known(c) for name, c in zip(vehicle.commands, commands.T, strict=True)}
    felt = {frame: known(values) for frame, (_, values) in by_frame.items()}
    (position, attitude), rest = map(known, placed), unread(flight, read)
    log = Recorded(position, attitude, None, None, joints, {}, {}, (), felt, sent, rest)
    if not (recordings := recordings_of(vehicle, log, source)):
        raise UsageError(
            f"{source}: no part of it has {_LEAST} samples; sample it more often, or fly for longer"
        )
    if flight.control_rate:  # The first reading is taken before the first command.
        for values in recordings[0].imus.values():
            values[0] = np.nan
    return recordings


def _placed(flight: Flight, vehicle: Vehicle) -> tuple[str, Array, Array]:
    """The sensor of the base's pose, and what it reads of that: positions, quaternions (s, ·).

    It is the first at a frame that stays on the base, one of poses rather than a GPS, beside which
    attitudes are the true ones. Where there is none, "", all are.
    """
    base, mounts = base_motion(flight), on_base(vehicle) if vehicle.layout.q.base else {}
    sensors = [(name, x) for name, x in poses(flight).items() if x[0] in mounts]
    if not sensors:
        return "", base.position, base.quaternion
    name, (frame, position, quaternion) = min(sensors, key=lambda x: np.isnan(x[1][2]).all())
    if np.isnan(quaternion).all():
        turned = Rotation.from_quat(base.quaternion) * Rotation.from_matrix(mounts[frame][:3, :3])
        quaternion = turned.as_quat()
    return name, *of_base(position, quaternion, mounts[frame])


def recordings_of(vehicle: Vehicle, log: Recorded, source: str) -> list[Recording]:
    """What a log tells, on a grid of the fastest of its readings; parts, where commands have gaps.

    Readings are taken at times of the grid at which there is one within half a step; of IMUs and
    commands means. Raises `UsageError` where it does not tell what was commanded.
    """
    if log.unread:
        _log.warning("%s: identify does not use its readings %s", source, log.unread)
    sent = {**({} if vehicle.is_driven else log.inputs), **log.commands}
    if lacking := [name for name in vehicle.commands if name not in sent]:
        raise UsageError(
            f"{source}: has no {', '.join(lacking)}, and forces need it; give its name in the "
            f"log (--name {lacking[0]}=NAME)"
        )
    logged: dict[Any, Samples] = {("u", name): sent[name] for name in vehicle.commands}
    if vehicle.layout.q.base and log.position is not None and log.attitude is not None:
        logged |= {"position": log.position, "attitude": log.attitude}
    logged |= {("q", name): samples for name, samples in log.joints.items()}
    logged |= {("imu", frame): samples for frame, samples in log.imus.items()}
    series = cleaned(logged, source)
    read = {name: samples for name, samples in series.items() if name[0] != "u"}
    if not read:
        raise UsageError(
            f"{source}: has no readings of an IMU, a pose or joints; give a log with some"
        )
    if few := [name for name, samples in series.items() if len(samples.time) < _LEAST_READINGS]:
        raise UsageError(
            f"{source}: has fewer than {_LEAST_READINGS} samples of {title(few[0])}; name another "
            "series (--name), or give a log that has it"
        )
    _take_back_delay(series, vehicle, source)
    spacing = {name: float(np.median(np.diff(s.time))) * 1e-9 for name, s in series.items()}
    rates = ", ".join(f"{title(name)} {1.0 / x:.4g}" for name, x in spacing.items())
    _log.info("%s: samples a second: %s", source, rates)
    if (seldom := max(x for name, x in spacing.items() if name[0] == "u")) > _SELDOM:
        words = "%s: commands are logged %.3g times a second, too rarely for lags and quick motion"
        _log.warning(words, source, 1.0 / seldom)
    step = max(_SHORTEST, min(spacing[name] for name in read))
    begin, end = common_time(series, source)
    tell_gaps(read, source, begin, "the motion is found without it there")
    grid = begin + np.round(np.arange(0.0, (end - begin) * 1e-9, step) * 1e9).astype(np.int64)
    half = round(0.5e9 * step)
    layout, zero = vehicle.layout.q, np.zeros((len(grid), 3))
    arrays: dict[Any, Array] = dict.fromkeys(("position", "velocity", "spin"), zero)
    arrays["attitude"] = np.tile([0.0, 0.0, 0.0, 1.0], (len(grid), 1))
    arrays |= {("v", name): zero[:, 0] for name in vehicle.joint_names}
    places: dict[Any, Any] = {"position": layout.position, "attitude": layout.attitude}
    places |= {("q", n): p for n, p in zip(vehicle.joint_names, layout.joint_places, strict=True)}
    unknown = {name: np.ones(len(grid), bool) for name in places}
    for name in places.keys() & series.keys():
        samples = series[name]
        arrays[name] = interp1d(samples.time, samples.values, axis=0)(grid)
        nearest = np.searchsorted(samples.time, grid - half)
        unknown[name] = samples.time[nearest] >= grid + half
    time = step * np.arange(len(grid), dtype=np.float64)
    q = motion_of(vehicle, arrays, time)[0]
    q[:, layout.angles] = np.nan  # Of which nothing is read.
    for name, place in places.items():
        q[unknown[name], place] = np.nan
    commands = np.stack([_held(series["u", u], grid, 2 * half) for u in vehicle.commands], axis=1)
    felt = {f: _means(series["imu", f], grid - half, 2 * half) for f in log.imus}
    # Where commands have gaps nobody knows what acted.
    torn = {name: gaps(series["u", name].time, _GAP * 1e9) for name in vehicle.commands}
    pairs, parts, first = np.unique(np.concatenate([*torn.values()]), axis=0), list[slice](), 0
    if len(pairs):
        names = ", ".join(name for name, of_command in torn.items() if len(of_command))
        words = "%s: commands of %s are not known for %s; the log is cut there"
        _log.warning(words, source, names, listed_gaps(pairs - begin))
    for last, again in pairs.tolist():
        parts.append(slice(first, int(np.searchsorted(grid, last))))
        first = max(first, int(np.searchsorted(grid, again)))
    whole = Recording(time, commands, q, felt, source)
    return cut(whole, [*parts, slice(first, len(grid))])


def _reckoned(vehicle: Vehicle, q: Array) -> Array:
    """Coordinates (s, nq) of a base on wheels: where nothing tells its place, their angles do.

    Of the angles themselves, which nothing depends on, none is left that is not known.
    """
    layout, base, angles = vehicle.layout, vehicle.layout.q.base, q[:, vehicle.layout.q.angles]
    ways = np.eye(layout.v.size)[layout.v.base]
    turns = vehicle.coordinate_rates(np.tile(vehicle.neutral, (len(ways), 1)), ways)
    turns = turns[:, layout.q.angles]
    if np.isnan(angles).any():
        angles = np.zeros_like(angles)
    elif np.isnan(q[:, base]).all() and np.linalg.matrix_rank(turns) == len(ways):
        moves = np.diff(angles, axis=0) @ np.linalg.pinv(turns) @ ways
        places = [vehicle.neutral]
        for move in moves:
            places.append(vehicle.module.integrate(places[-1], move))
        q[:, base] = np.array(places)[:, base]
    q[:, layout.q.angles] = angles
    return q


def _means(samples: Samples, begin: Any, length: int) -> Array:
    """Means (s, k) of samples within a length, ns, from times on; NaN where none is."""
    sums = np.cumsum(np.concatenate([0.0 * samples.values[:1], samples.values]), axis=0)
    first, last = (np.searchsorted(samples.time, begin + shift) for shift in (0, length))
    with np.errstate(invalid="ignore"):
        means: Array = (sums[last] - sums[first]) / (last - first)[:, np.newaxis]
    return means


def _held(samples: Samples, begin: Any, length: int) -> Array:
    """Means (s) of commands within a length, ns, from times on, each held until the next."""
    time = np.append(samples.time, samples.time[-1] + 2 * length)
    areas = np.append(0.0, np.cumsum(samples.values * np.diff(time)))
    means: Array = (np.interp(begin + length, time, areas) - np.interp(begin, time, areas)) / length
    return means


def _take_back_delay(series: dict[Any, Samples], vehicle: Vehicle, source: str) -> None:
    """Take back how much later the pose is than IMUs on the base, or these, by how they turn."""
    felt = [name for name in series if name[0] == "imu"]
    mounts = on_base(vehicle) if felt and "attitude" in series else {}
    delays = dict[Any, float]()
    for name in felt:
        if (frame := name[1]) not in mounts:
            continue
        samples = series[name]
        spins = samples.values[:, 3:] @ mounts[frame][:3, :3].T
        delay, deviation = _delay(series["attitude"], samples._replace(values=spins))
        if deviation > _VAGUE:
            words = (
                "%s: turns too little, or unlike its IMU, to tell whether the pose lags the IMU at "
                "%s; no delay is assumed; turn it to and fro quickly, and compare the axes of both"
            )
            _log.warning(words, source, frame)
            continue
        delays[name] = delay if abs(delay) > max(_SURE * deviation, _BRIEF) else 0.0
        if delays[name]:
            late = "the pose lags the IMU at %s" if delay > 0.0 else "the IMU at %s lags the pose"
            words = f"%s: {late} by %.4f ± %.1g s, which is corrected"
            _log.warning(words, source, frame, abs(delay), deviation)
    # The least late is not late, for nothing is read ahead of time.
    pose_late = max([0.0, *delays.values()])
    moves = {"position": pose_late, "attitude": pose_late}
    moves |= {name: pose_late - delay for name, delay in delays.items()}
    for name, delay in moves.items() if delays else ():
        series[name] = series[name]._replace(time=series[name].time - round(delay * 1e9))


def _delay(pose: Samples, felt: Samples) -> tuple[float, float]:
    """By how much attitudes are later than rates of turn, in their axes, and its deviation, s.

    Turns over windows are those that the gyroscope integrates to, but for its bias, with noise that
    is correlated for a while. The deviation is infinite where they differ too much.
    """
    time, at = (1e-9 * (samples.time - felt.time[0]) for samples in (felt, pose))
    steps, turned = np.diff(time), Rotation.from_quat(pose.values)
    spins = 0.5 * (felt.values[1:] + felt.values[:-1])
    reckoned = Slerp(time, _products(Rotation.from_rotvec(spins * steps[:, np.newaxis])))
    # Windows between gaps of the IMU, of which a gap of the pose lengthens none.
    gaps = np.flatnonzero(steps > max(_TORN * np.median(steps), _BURST))
    begins, ends = np.append(time[gaps], time[-1]), np.append(0.0, time[gaps + 1])
    first = np.arange(np.searchsorted(at, at[-1] - _WINDOW))
    last = np.searchsorted(at, at[first] + _WINDOW)
    most = _FAR + _NEAR
    known = begins.searchsorted(at[last] + most) < ends.searchsorted(at[first] - most, "right")
    known &= at[last] - at[first] < 1.5 * _WINDOW
    first, last = first[known], last[known]
    if len(first) < _LEAST_READINGS:
        return 0.0, np.inf
    turns = turned[first].inv() * turned[last]
    middle = Rotation.from_rotvec(0.5 * turns.as_rotvec())

    def missed(delay: float) -> Array:
        """What turns differ by, in axes halfway, in which a bias stays the same."""
        begin, end = reckoned(at[first] - delay), reckoned(at[last] - delay)
        differences: Array = middle.apply(((begin.inv() * end).inv() * turns).as_rotvec())
        return differences - differences.mean(axis=0)

    delay = min(_TRIED, key=lambda tried: float(np.sum(missed(tried) ** 2)))
    for _ in range(_STEPS):
        slope = (missed(delay - _NEAR) - missed(delay + _NEAR)) / (2.0 * _NEAR)
        worth = float(np.sum(slope**2)) or 1.0
        delay = float(np.clip(delay + np.sum(slope * missed(delay)) / worth, -_FAR, _FAR))
    rest = missed(delay)
    if abs(delay) == _FAR or rest.var() >= _UNLIKE * turns.as_rotvec().var(axis=0).mean():
        return 0.0, np.inf
    # Sums over parts tell the variance with correlations; where parts are few, too small a one.
    sums = np.append(0.0, np.cumsum(np.sum(slope * rest, axis=1)))
    length = max(1, min(round(_CORRELATED / float(np.median(np.diff(at)))), len(first) // 4))
    variance = np.mean((sums[length:] - sums[:-length]) ** 2) * len(first) / length
    return delay, float(np.sqrt(max(variance, worth * np.mean(rest**2))) / worth)


def _products(turns: Rotation) -> Rotation:
    """Of rotations the products of the first 0, 1, 2, …, each in axes that those before turned."""
    products, count = Rotation.concatenate([Rotation.identity(), turns]), 1
    while count < len(products):
        products = Rotation.concatenate([products[:count], products[:-count] * products[count:]])
        count *= 2
    return products


def _filled(series: Array) -> Array:
    """Series (s, k) with straight lines where they are NaN."""
    filled, places = series.copy(), np.arange(len(series))
    for column in filled.T:
        if (known := np.isfinite(column)).any():
            column[~known] = np.interp(places[~known], places[known], column[known])
    return filled


def felt_names(frames: Sequence[str]) -> list[str]:
    """What is said of readings of IMUs (6 each) at frames."""
    kinds = [f"{kind} {axis}" for kind in ("acceleration", "angular velocity") for axis in "xyz"]
    return [f"IMU at {frame}, {kind}" for frame in frames for kind in kinds]


def _reckoned_by_imu(
    vehicle: Vehicle, recording: Recording, frames: Sequence[str]
) -> tuple[Array, Array]:
    """Coordinates (s, ·) of a base that stays where it is and turns as an IMU tells, and its spin.

    Its gyroscope tells how attitudes follow each other, and the mean of specific forces, which is
    vertical of what does not fly away, where up is. Raises `UsageError` if no IMU is on the base.
    """
    layout, count = vehicle.layout, len(recording.time)
    mounts = on_base(vehicle)
    frame = next((f for f in frames if f in mounts), None)
    if frame is None:
        raise UsageError(
            f"without a pose an IMU on the base is needed, and {', '.join(frames)} are on links; "
            "give a log with an IMU on the base, or with a pose"
        )
    for f in frames:
        if (np.isfinite(recording.imus[f]).sum(axis=0) < _LEAST_READINGS).any():
            raise UsageError(
                f"{recording.source}: has no pose, and in a part an IMU has no readings; cut that "
                "part out (--between)"
            )
    axes = mounts[frame][:3, :3]
    force, spin = np.split(_filled(recording.imus[frame]), 2, axis=1) @ axes.T
    turned = _products(Rotation.from_rotvec(recording.step * spin[:-1]))
    slow = butter(1, _SWAY, fs=1 / recording.step, output="sos")
    up = sosfiltfilt(slow, turned.apply(force), axis=0)
    cosine = np.linalg.norm(up, axis=1) + up[:, 2]
    turned = (
        Rotation.from_quat(np.column_stack([up[:, 1], -up[:, 0], 0.0 * cosine, cosine])) * turned
    )
    arrays: dict[Any, Array] = dict.fromkeys(("position", "velocity", "spin"), np.zeros((count, 3)))
    arrays["attitude"] = quaternions_of(turned.as_matrix())
    joints = {(kind, name): np.zeros(count) for name in vehicle.joint_names for kind in "qv"}
    return motion_of(vehicle, arrays | joints, recording.time)[0][:, layout.q.base], spin


def without_spikes(recording: Recording) -> Recording:
    """A recording without entries of IMUs that are far from those before and after, which agree.

    Those are the four nearest, which differ at the top of a smooth peak by more than it stands out.
    Weights of outliers alone would not do: a fit explains one reading that is a hundred deviations
    off by numbers that nothing else shows well.
    """
    count, imus = 0, {frame: values.copy() for frame, values in recording.imus.items()}
    for values in imus.values():
        for column, size in zip(values.T, _felt_deviations(values), strict=True):
            known = np.flatnonzero(np.isfinite(column))
            x = column[known]
            if len(x) < 5:
                continue
            here = np.arange(len(x))[:, np.newaxis]
            nearest = np.clip(here, 2, len(x) - 3) + np.arange(-2, 3)
            others = x[nearest[nearest != here].reshape(-1, 4)]
            changes = np.abs(np.diff(others)).max(axis=1)
            away = np.abs(x[np.clip(here + np.array([-1, 1]), 0, len(x) - 1)] - x[here])
            away[[0, -1]] = away[[0, -1]].max(axis=1, keepdims=True)
            spikes = away.min(axis=1) > np.maximum(_SPIKE * size, 2.0 * changes)
            column[known[spikes]] = np.nan
            count += int(spikes.sum())
    if count:
        words = "%s: left out entries of IMUs that are unlike those before and after: %d"
        _log.warning(words, recording.source, count)
    return replace(recording, imus=imus)


def _felt_deviations(felt: Array) -> Array:
    """Deviations (6 i) of readings (s, 6 i) of IMUs."""
    floors = [*[_FLOOR_FELT] * 3, *[_FLOOR_SPIN] * 3]
    return deviation(felt, np.resize(floors, felt.shape[1]))


def deviation(values: Array, floor: Array | float, increments: bool = False) -> Array:
    """Standard deviations (k) of white noise in series (s, k), smooth otherwise, with gaps."""
    found = np.zeros(values.shape[1]) + floor
    for k, column in enumerate(values.T):
        known = column[np.isfinite(column)]
        third = np.diff(known, 2 if increments else 3)
        if len(third):
            noise = _BY_MEDIAN * float(np.median(np.abs(third))) / np.sqrt(_THIRD)
            change = np.abs(known if increments else np.diff(known))
            steps = change[change > 1e-12]
            resolution = float(steps.min()) if len(steps) else 0.0
            found[k] = max(found[k], noise, resolution / np.sqrt(12.0))
    return found


def delayed(commands: Array, samples: float) -> Array:
    """Commands (s, nu) that many samples later, the first until then, smoothly in the delay."""
    if not samples:
        return commands
    times = np.arange(len(commands))
    later: Array = PchipInterpolator(times, commands)(np.clip(times - samples, 0, times[-1]))
    return later


def input_noise(recordings: Sequence[Recording], module: Any) -> Array:
    """Deviations (nu) of inputs that were measured, the least of those that servos make."""
    if getattr(module, "COMMANDS", ()):
        return np.full(len(module.INPUTS), _FLOOR_INPUT)
    return np.mean([deviation(r.commands, _FLOOR_INPUT) for r in recordings], axis=0)


class Readings:
    """Readings of a recording as a fit takes them, with deviations, and a first guess of states.

    `q` (s, nq) are those that are known, `has` (s, nd) which; `felt` (s, 6 i) of IMUs, NaN where
    there is none, by `frames`, and `felt_filled`. `blind` if no reading tells the pose of a base
    that flies; then it has the pose that an IMU tells, with deviations that say next to nothing.
    """

    def __init__(self, recording: Recording, module: Any, frames: tuple[str, ...]) -> None:
        self.source, self.frames = recording.source, frames
        q, vehicle = recording.q.copy(), Vehicle(module)
        vehicle.check_wheels()
        layout = vehicle.layout
        if layout.q.wheels:
            q = _reckoned(vehicle, q)
        known = np.isfinite(q)
        lacking = known.sum(axis=0) < _LEAST_READINGS
        self.blind = bool(layout.moves_freely and frames and lacking[layout.q.base].all())
        if self.blind:
            lacking[layout.q.base] = False
            known[:, layout.q.base] = True
            q[:, layout.q.base], spins = _reckoned_by_imu(vehicle, recording, frames)
        if lacking.any():
            names = ", ".join(np.array(module.COORDINATES)[lacking])
            raise UsageError(f"{recording.source}: has no readings of {names}")
        h, count, self.commands = recording.step, len(recording.time), recording.commands
        smooth = _filled(np.where(known, q, np.nan))
        self.q = np.where(known, q, smooth)
        # A quaternion's four entries, which a free base has behind its place, are three of `v`;
        # angles of wheels at the end are none.
        self.has = np.delete(known, [6] * layout.is_quaternion, axis=1)
        self.has = self.has[:, : layout.displaced.size]
        self.felt = np.concatenate(
            [np.zeros((count, 0)), *(recording.imus[frame] for frame in frames)], axis=1
        )
        self.felt_deviations = _felt_deviations(self.felt)
        self.felt_filled = _filled(self.felt)
        low = butter(4, min(_CUTOFF, 0.4 / h), fs=1 / h, output="sos")
        guess = sosfiltfilt(low, smooth, axis=0)
        zero = np.zeros(len(module.VELOCITIES))
        self.guess = module.integrate(module.integrate(guess, zero), zero)
        if layout.is_quaternion:
            self.guess[:, 3:7] /= np.linalg.norm(self.guess[:, 3:7], axis=1, keepdims=True)
        ahead = module.difference(self.guess[:-1], self.guess[1:]) / h
        self.rates = np.concatenate([ahead[:1], 0.5 * (ahead[1:] + ahead[:-1]), ahead[-1:]])
        floor = _FLOOR if layout.moves_freely else _FLOOR_ENCODER
        self.deviations = np.empty(len(self.has.T))
        for k, rows in enumerate(self.has.T):
            moves = vehicle.displacement(self.q[rows][:-1], self.q[rows][1:])[:, [k]]
            self.deviations[k] = deviation(moves, floor, increments=True)[0]
        if self.blind:
            self.deviations[layout.displaced.position] = _ANYWHERE
            self.deviations[layout.displaced.attitude] = _ANYHOW
            if layout.is_quaternion:
                self.rates[:, layout.v.attitude] = spins
