"""What was recorded of a robot, on a grid of time, and how much its readings err."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import numpy as np
from scipy.signal import butter, sosfiltfilt

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.logs.motion import imus
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.vectors import Array

# The shortest step of the grid, s, and the fewest samples.
_SHORTEST, _LEAST = 4e-3, 200
# Deviations below which no reading is trusted, m or rad, m/s² and rad/s.
_FLOOR, _FLOOR_FELT, _FLOOR_SPIN = 1e-4, 5e-3, 5e-4
# Of arms on a base that does not fly: of encoders, rad or m, and of inputs, N m or N.
_FLOOR_ENCODER, _FLOOR_INPUT = 1e-5, 1e-3
# Of a first guess of velocities, Hz.
_CUTOFF = 12.0
# Third differences of white noise have so many times its variance; the deviation by the median.
_THIRD, _BY_MEDIAN = 20.0, 1.4826
# Steps that differ by more than this share of the whole are no grid.
_UNEVEN = 0.02


@dataclass(frozen=True, eq=False)
class Recording:
    """Readings of a flight, a row for each time of a grid; NaN is what was not read then.

    Args:
        time: Times (s), s, evenly spaced.
        commands: Commands of motors and servos (s, nu), or inputs of a robot without these, each
            from its time to the next.
        q: Coordinates (s, nq): of the base as motion capture tells them, of joints as encoders do.
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
                f"{self.source}: has {len(self.time)} samples; {_LEAST} are the fewest that tell "
                "anything: record for longer, or more often"
            )
        if np.ptp(steps) > _UNEVEN * np.median(steps):
            late = self.time[int(np.abs(steps - np.median(steps)).argmax())]
            raise UsageError(
                f"{self.source}: its samples are not evenly spaced at {late:.6g} s: a gap, or a "
                "clock that goes back; cut the log there, and give its parts as logs of their own"
            )
        if not np.isfinite(self.commands).all():
            raise UsageError(
                f"{self.source}: does not tell what motors and servos were commanded at all times; "
                "without it no force is known"
            )

    @property
    def step(self) -> float:
        """The time from sample to sample, s."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)


def part_of(recording: Recording, rows: slice) -> Recording:
    """Some of the samples of a recording."""
    felt = {frame: values[rows] for frame, values in recording.imus.items()}
    series = recording.time[rows], recording.commands[rows], recording.q[rows]
    return Recording(*series, felt, recording.source)


def recording_of(flight: Flight, module: ModuleType, source: str) -> Recording:
    """What a flight tells: its IMUs and encoders, and coordinates that no encoder reads.

    Raises `UsageError` where it is not of the robot.
    """
    if flight.coordinates != module.COORDINATES:
        raise UsageError(
            f"{source}: is a flight of {flight.robot}, whose coordinates are not those of "
            f"{module.NAME}; give the robot that flew"
        )
    time = flight.time
    every = max(1, round(_SHORTEST / float(np.median(np.diff(time)))))
    commands = flight.commands
    if not commands.size:
        commands = np.clip(flight.commanded, *flight.input_limits)
    if not flight.control_rate:  # Laws that act at all times go on between samples.
        commands = np.concatenate([0.5 * (commands[every:] + commands[:-every]), commands[-every:]])
    q = flight.q.copy()
    for place, name in enumerate(flight.coordinates):
        for k, sensor in enumerate(flight.sensor_names):
            if flight.sensor_frames[k] == "" and sensor.endswith(f"_{name}"):
                q[:, place] = _new(flight.sensors[:, k : k + 1])[:, 0]
    felt = {frame: _new(values) for frame, values in imus(flight).values()}
    return part_of(Recording(time, commands, q, felt, source), slice(None, None, every))


def _new(values: Array) -> Array:
    """Readings (s, k), NaN where they repeat the last."""
    again = np.append(False, np.all(values[1:] == values[:-1], axis=1))
    return np.where(again[:, np.newaxis], np.nan, values)


def deviation(values: Array, floor: float, increments: bool = False) -> Array:
    """Standard deviations (k) of white noise in series (s, k), smooth otherwise, with gaps."""
    found = np.full(values.shape[1], floor)
    for k, column in enumerate(values.T):
        known = column[np.isfinite(column)]
        third = np.diff(known, 2 if increments else 3)
        if len(third):
            noise = _BY_MEDIAN * float(np.median(np.abs(third))) / np.sqrt(_THIRD)
            change = np.abs(known if increments else np.diff(known))
            steps = change[change > 1e-12]
            resolution = float(steps.min()) if len(steps) else 0.0
            found[k] = max(floor, noise, resolution / np.sqrt(12.0))
    return found


def input_noise(recordings: Sequence[Recording], module: Any) -> Array:
    """Deviations (nu) of inputs that were measured, the least of those that servos make."""
    if getattr(module, "COMMANDS", ()):
        return np.full(len(module.INPUTS), _FLOOR_INPUT)
    return np.mean([deviation(r.commands, _FLOOR_INPUT) for r in recordings], axis=0)


class Readings:
    """Readings of a recording as a fit takes them, with deviations, and a first guess of states.

    `q` (s, nq) are those that are known, `has` (s, nv) which; `felt` (s, 6 i) of IMUs likewise.
    """

    def __init__(self, recording: Recording, module: Any, frames: tuple[str, ...]) -> None:
        known = np.isfinite(recording.q)
        if lacking := [n for n, k in zip(module.COORDINATES, known.T, strict=True) if k.sum() < 20]:
            raise UsageError(f"{recording.source}: has no readings of {', '.join(lacking)}")
        if not {*frames} <= {*recording.imus}:
            raise UsageError(f"{recording.source}: has no IMU at {', '.join(frames)}, as others do")
        h, count, self.commands = recording.step, len(recording.time), recording.commands
        smooth = np.stack(
            [
                np.interp(recording.time, recording.time[k], column[k])
                for column, k in zip(recording.q.T, known.T, strict=True)
            ],
            axis=1,
        )
        self.q = np.where(known, recording.q, smooth)
        extra = self.q.shape[1] - len(module.VELOCITIES)
        # A quaternion's four entries, which a free base has behind its place, are three of `v`.
        self.has = np.delete(known, [6] * extra, axis=1)
        self.felt = np.concatenate(
            [np.zeros((count, 0)), *(recording.imus[frame] for frame in frames)], axis=1
        )
        low = butter(4, min(_CUTOFF, 0.4 / h), fs=1 / h, output="sos")
        guess = sosfiltfilt(low, smooth, axis=0)
        zero = np.zeros(len(module.VELOCITIES))
        self.guess = module.integrate(module.integrate(guess, zero), zero)
        if extra:
            self.guess[:, 3:7] /= np.linalg.norm(self.guess[:, 3:7], axis=1, keepdims=True)
        ahead = module.difference(self.guess[:-1], self.guess[1:]) / h
        self.rates = np.concatenate([ahead[:1], 0.5 * (ahead[1:] + ahead[:-1]), ahead[-1:]])
        rows = self.has.all(axis=1)
        of_pose = module.difference(self.q[rows][:-1], self.q[rows][1:])
        floor = _FLOOR if {"x", "y", "z"} <= {*module.COORDINATES} else _FLOOR_ENCODER
        self.deviations = deviation(of_pose, floor, increments=True)
        for k, columns in enumerate(self.has.T):  # Entries that are not read with all others.
            if not rows.any() or columns.sum() > 1.5 * rows.sum():
                self.deviations[k] = deviation(smooth[columns][:, [k + extra]], floor)[0]
        floors = [*[_FLOOR_FELT] * 3, *[_FLOOR_SPIN] * 3]
        self.felt_deviations = np.array(
            [
                deviation(column[:, np.newaxis], floors[k % 6])[0]
                for k, column in enumerate(self.felt.T)
            ]
        )
