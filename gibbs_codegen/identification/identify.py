"""Identification: numbers of a robot file from logs, with deviations, and what logs cannot tell."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType

import numpy as np

from gibbs_codegen.errors import RobotFileError, UsageError, printable
from gibbs_codegen.files.staging import new_place
from gibbs_codegen.flight.logs.log import recorded_of, require_log
from gibbs_codegen.flight.plant.actuators import has_battery
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.record.flight import Flight, flight_file, read_flight
from gibbs_codegen.flight.vectors import Array
from gibbs_codegen.identification.model import OUTLIER, Model
from gibbs_codegen.identification.recorded import (
    Readings,
    Recording,
    cut,
    felt_names,
    flight_recordings,
    input_noise,
    of_robot,
    part_of,
    recordings_of,
    without_spikes,
)
from gibbs_codegen.identification.regression import Regression
from gibbs_codegen.identification.report import as_text, html_report, sections
from gibbs_codegen.identification.robot_file import with_numbers
from gibbs_codegen.identification.smoothing import Estimate, Smoother
from gibbs_codegen.identification.unknowns import PRIOR, Prior, Unknowns
from gibbs_codegen.robot.parts.base import FIXED
from gibbs_codegen.runtime.load import load

_log = logging.getLogger("gibbs_codegen")
Progress = Callable[[str, float], None]
Log = Flight | Recording | str | os.PathLike[str]
# Shares of the prior's deviation from which on a log does not tell a direction, and of a direction
# from which on a number is part of it.
_UNSEEN, _PART = 0.5, 0.35
# How far is predicted, s, and samples of a first fit that gives numbers to begin with.
_AHEAD, _FIRST = 0.5, 2000
# Iterations that hold numbers which another fit found.
_HELD = 2
# Deviations of the prior from which on a value contradicts the robot file, and those from which on
# a fit begins elsewhere.
_CONTRADICTS, _FAR = 3.0, 1.0
_LATE = "delay of readings behind commands, s"
# Numbers at most that are proposed to be free.
_PROPOSED = 4


@dataclass(frozen=True, eq=False)
class Identified:
    """Numbers of a robot file, identified from logs.

    - `names` (f): numbers that were free, in SI units; `rotors.drag` is that of the first rotor,
      and all others keep their ratios to it
    - `settled`: whether the fit came to an end. If not, values are no results: deviations are NaN
    - `values`, `deviations` and `before` (f): their values, standard deviations, and those in the
      robot file; `covariance` (f, f) of the values
    - `unseen`: in words what the log cannot tell, or tells no better than the prior
    - `contradictions`: in words what is far from the robot file, by deviations of the prior
    - `residuals`: by reading its root mean square over its deviation, 1 where all is explained
    - `others`: drag of the base, N s/m, biases of IMUs, and the wind's deviation, m/s², by names;
      of bases that do not move freely the deviations of errors of inputs, N or N m
    - `prediction`: of what was held out, root mean squares of errors after half a second, by the
      numbers of the file and by those identified; empty if nothing was
    - `robot_file`: text of the robot file with the values; empty if the fit did not settle, or no
      file may have them: then `advice` says what to do
    """

    robot: str
    source: str
    names: tuple[str, ...]
    before: Array
    values: Array
    deviations: Array
    covariance: Array = field(repr=False)
    unseen: tuple[str, ...]
    residuals: Mapping[str, float]
    others: Mapping[str, tuple[float, float]]
    prediction: Mapping[str, tuple[float, float]]
    robot_file: str = field(repr=False)
    contradictions: tuple[str, ...]
    settled: bool
    advice: tuple[str, ...]

    def text(self) -> str:
        """Say it as a table in text."""
        return as_text(sections(self))

    def write(self, folder: str | os.PathLike[str]) -> None:
        """Write the robot file, if there is one, and the report to a new folder.

        Args:
            folder: The folder.

        Raises:
            UsageError: If it is there already.
            OutputError: If it cannot be written; nothing is left.
        """
        files = {"report.txt": self.text(), "report.html": html_report(self)}
        if self.robot_file:
            files[f"{self.robot}.toml"] = self.robot_file
        with new_place(folder) as new:
            new.mkdir()
            for name, text in files.items():
                (new / name).write_text(text, encoding="utf-8")


def identify(
    robot: ModuleType | str | os.PathLike[str],
    logs: Log | Sequence[Log],
    free: Sequence[str] = (),
    prior: Prior = PRIOR,
    hold_out: float = 0.0,
    names: Mapping[str, str | float] | None = None,
    between: tuple[float, float] = (0.0, np.inf),
    progress: Progress = lambda what, share: None,
) -> Identified:
    """Find the numbers of a robot file that explain logs best.

    They are those to be expected, given all readings with their noise, a wind that comes and goes,
    and a prior around the robot file.

    Args:
        robot: The robot that flew: a module, generated with the functions by default and loaded
            with the back end "c", or its name or path.
        logs: One or more, each a `Flight`, a `Recording`, a path that `simulate` wrote, or a log
            that `read_log` reads.
        free: Patterns of names of parameters, such as `forearm_mass` or `*_com_?`; `rotors.drag` is
            a number of all rotors alike. By default what a drawing does not tell: masses and
            their moments, thrusts, drags, lags, dampings, frictions, and servos' stiffnesses.
        prior: Standard deviation of the robot file's numbers, as a share; or by patterns of names,
            of which the last one counts, such as `{"*": 0.5, "base_mass": 0.01}`. Those of a load
            have a wide one of their own.
        hold_out: Share of each log, at its end, that is not used but predicted.
        names: What logs call things, as of `read_log`.
        between: Part of each log to use, s from its start, such as the time in the air.
        progress: Called with the name of the work and the share done.

    Returns:
        The numbers.

    Raises:
        UsageError: If a log or a pattern is not of the robot, or it has loops.
    """
    listed = [logs] if isinstance(logs, Flight | Recording | str | os.PathLike) else [*logs]
    if not listed:
        raise UsageError("logs: there is none; give one or more")
    check_given(listed, hold_out, between)
    module = identifiable(robot)
    unknowns = Unknowns(module, free, prior)
    whole = [part for log in listed for part in _recordings(log, module, names or {})]
    spans = [slice(*np.searchsorted(log.time, between).tolist()) for log in whole]
    spanned = zip(whole, spans, strict=True)
    recordings = [without_spikes(part) for log, rows in spanned for part in cut(log, [rows])]
    if not recordings:
        lasts = ", ".join(f"{log.source} lasts {log.time[-1]:.4g} s" for log in whole)
        words = f"no log has enough samples from {between[0]:g} to {between[1]:g} s; {lasts}"
        raise UsageError(f"between: {words}")
    model = model_of(module, recordings)
    if unlike := [r for r in recordings if abs(r.step / model.h - 1.0) > 0.01]:
        raise UsageError(
            f"{unlike[0].source}: has a sample every {unlike[0].step:.4g} s, "
            f"{recordings[0].source} one every {model.h:.4g} s; "
            "sample logs alike, or identify from one at a time"
        )
    ends = [round(len(r.time) * (1.0 - hold_out)) for r in recordings]
    used = [part_of(r, slice(end)) for r, end in zip(recordings, ends, strict=True)]
    progress("initial numbers", 0.0)
    readings = [Readings(r, module, model.imus) for r in used]
    blind = {log.blind: log.source for log in readings}
    if len(blind) > 1:
        raise UsageError(
            f"{blind[True]}: has no pose, but {blind[False]} does; identify from them separately"
        )
    sources = [*dict.fromkeys(r.source for r in recordings)]
    pairs = zip(recordings, ends, strict=True)
    parts = [part for r, end in pairs for part in cut(r, [slice(end, len(r.time))])]
    rest = [Readings(r, module, model.imus) for r in parts]
    longest = max(used, key=lambda recording: len(recording.time))
    # From where all is read that is read at all.
    known = np.isfinite(longest.q)
    late = int(np.argmax(known, axis=0)[known.any(axis=0)].max(initial=0))
    late = max(0, min(late, len(longest.q) - _FIRST))
    first = Readings(part_of(longest, slice(late, late + _FIRST)), module, model.imus)
    start = begin = np.zeros(len(unknowns.names))
    if first.blind:  # Where a pose is read, accelerations would take a servo's lag for its damping.
        y, _ = Regression(model, unknowns, [first]).run()
        far = np.isfinite(y).all() and np.any(np.abs(y[:-1]) > _FAR * unknowns.prior)
        start = begin = np.where(far, y[:-1], 0.0)

    def fitted(
        logs: Sequence[Readings], start: Array, what: str, numbers: bool = True
    ) -> tuple[Smoother, Estimate]:
        smoother = Smoother(model, unknowns, logs)
        estimate = smoother.start()
        estimate.shared[: len(start)] = start
        settings = numbers, what == "first samples", 0 if start is begin else _HELD
        return smoother, smoother.run(
            estimate, lambda detail, share: progress(f"{what}: {detail}", share), *settings
        )

    if sum(len(r.time) for r in used) > 1.5 * _FIRST:
        smoother, estimate = fitted([first], begin, "first samples")
        start = estimate.shared
    if start is begin or estimate.settled or not first.blind:
        smoother, estimate = fitted(readings, start, "all samples")
    unfit, charged = first.blind and not estimate.settled, has_battery(model.vehicle)
    if first.blind and charged and (rest or unfit):
        words = "%s: accelerations do not tell a battery's charge, so they are left out; log a pose"
        _log.warning(words, ", ".join(sources))
        rest = []
    held_out = Regression(model, unknowns, rest) if rest and first.blind else None
    if unfit and not charged:
        words = "%s: no motion explains the readings, so accelerations alone are fitted"
        _log.warning(words, ", ".join(sources))
        return _by_accelerations(Regression(model, unknowns, readings), held_out, sources)
    if estimate.settled:
        progress("deviations", 0.0)
        estimate.shared, estimate.covariance = smoother.spread(estimate)
    f = len(unknowns.names)
    prediction = {}
    if held_out:
        y = np.append(estimate.shared[:f], estimate.shared[f + model.free])
        prediction = _accelerations_ahead(held_out, y)
    elif rest and estimate.settled:
        held, motion = fitted(rest, estimate.shared, "the part held out", numbers=False)
        if motion.settled:
            prediction = _errors_ahead(held, motion)
        if not prediction:
            why = f"it is shorter than {_AHEAD} s" * motion.settled or "no motion explains it"
            words = "%s: nothing is predicted in the part held out, because %s"
            _log.warning(words, ", ".join(sources), why)
    progress("all samples", 1.0)
    return _by_motion(smoother, estimate, sources, prediction)


def identifiable(robot: ModuleType | str | os.PathLike[str]) -> ModuleType:
    """The module of a robot; `UsageError` if it has loops of a mechanism."""
    module = robot if isinstance(robot, ModuleType) else load(robot, "c")
    if getattr(module, "LOOPS", ()):
        raise UsageError(
            f"{module.NAME}: has loops, whose constraint forces no log contains; identify needs "
            "a tree of joints"
        )
    return module


def model_of(module: ModuleType, recordings: Sequence[Recording]) -> Model:
    """The model of a robot for recordings, with the steps of the first and IMUs that all have.

    One on a base that cannot move says nothing.
    """
    frames = [frame for frame in recordings[0].imus if all(frame in r.imus for r in recordings)]
    frames = [frame for frame in frames if frame != "base" or module.ATTITUDE != FIXED]
    for source, frame in dict.fromkeys((r.source, frame) for r in recordings for frame in r.imus):
        if frame not in frames:
            words = "%s: identify does not use its IMU at %s: it cannot move, or other logs lack it"
            _log.warning(words, source, frame)
    return Model(module, recordings[0].step, frames, input_noise(recordings, module))


def check_given(logs: Sequence[Log], hold_out: float, between: tuple[float, float]) -> None:
    """Raise `UsageError` for paths at which there is nothing, a share or a part that is none."""
    if not 0.0 <= hold_out <= 0.9:
        raise UsageError(f"hold_out, a share, must be from 0 to 0.9, but is {hold_out:g}")
    if not between[0] < between[1]:
        raise UsageError(f"between: {between[1]:g} s, its end, is not after {between[0]:g} s")
    for log in logs:
        if isinstance(log, str | os.PathLike) and flight_file(log) is None:
            require_log(log)


def _recordings(log: Log, module: ModuleType, names: Mapping[str, str | float]) -> list[Recording]:
    if isinstance(log, Recording):
        return [of_robot(log, Vehicle(module))]
    if isinstance(log, Flight):
        return flight_recordings(log, module, log.scenario)
    source = printable(Path(log).name)
    if flight_file(log) is not None:
        return flight_recordings(read_flight(log), module, source)
    vehicle = Vehicle(module)
    return recordings_of(vehicle, recorded_of(vehicle, log, names), source)


def _accelerations_ahead(held: Regression, y: Array) -> dict[str, tuple[float, float]]:
    """Root mean squares of errors of accelerations, by the numbers of the file and by y."""
    errors = [np.sqrt(np.mean(held.misses(x) ** 2, axis=0)).tolist() for x in (0.0 * y, y)]
    return dict(zip(held.names, zip(*errors, strict=True), strict=True))


def _by_accelerations(
    regression: Regression, held: Regression | None, sources: Sequence[str]
) -> Identified:
    """What accelerations alone tell, and how well they are predicted where they were held out."""
    y, settled = regression.run()
    unknowns, covariance = regression.unknowns, regression.covariance(y)
    left, delay = regression.misses(y), float(np.sqrt(covariance[-1, -1]))
    shares = np.sqrt(np.mean(left**2, axis=0) / np.mean(regression.measured**2, axis=0))
    residuals = dict(zip(regression.names, shares.tolist(), strict=True))
    others, whole = {_LATE: (float(y[-1]), delay)}, covariance[:-1, :-1]
    errors = _accelerations_ahead(held, y) if held else {}
    return _identified(unknowns, y[:-1], whole, settled, residuals, others, sources, errors)


def _by_motion(
    smoother: Smoother,
    estimate: Estimate,
    sources: Sequence[str],
    prediction: Mapping[str, tuple[float, float]],
) -> Identified:
    """What the most likely motion and numbers tell."""
    unknowns, f, module = smoother.unknowns, len(smoother.unknowns.names), smoother.model.module
    measured = np.flatnonzero(np.isfinite(estimate.misses).any(axis=0))
    if smoother.late:  # Nothing reads the pose.
        measured = np.setdiff1d(measured, smoother.model.layout.displaced.base)
    misses = np.clip(estimate.misses[:, measured], -OUTLIER, OUTLIER)
    spread = np.sqrt(np.nanmean(misses**2, axis=0))
    # What is not explained by noise makes numbers less certain than noise alone would.
    doubt = max(1.0, float(spread.max()), float(estimate.left.max())) ** 2
    whole = doubted(estimate.covariance, smoother.prior, doubt)
    names = [name for name, _ in smoother.model.layout.displacements]
    joints = {*names[smoother.model.layout.displaced.joints]}
    names = [f"joint, {name}" if name in joints else f"pose, along {name}" for name in names]
    felt = felt_names(smoother.model.imus)
    names += felt
    labels = ["drag of the base, N s/m"] * smoother.model.free
    labels += [_LATE] * smoother.late
    labels += [f"bias of the {name}" for name in felt]
    rest = zip(estimate.shared[f:], np.sqrt(np.diag(whole))[f:], strict=True)
    others = {label: (float(x), float(s)) for label, (x, s) in zip(labels, rest, strict=True)}
    if smoother.model.free:
        for axis, size in zip("xyz", estimate.wind.tolist(), strict=True):
            others[f"wind's pull along {axis}, deviation, m/s²"] = size, float("nan")
    else:
        for name, error in zip(module.INPUTS, smoother.model.noise.tolist(), strict=True):
            others[f"error of the input {name}, deviation"] = error, float("nan")
    residuals = dict(zip((names[k] for k in measured), spread.tolist(), strict=True))
    z, settled = estimate.shared[:f], estimate.settled
    return _identified(unknowns, z, whole[:f, :f], settled, residuals, others, sources, prediction)


def _identified(
    unknowns: Unknowns,
    z: Array,
    whole: Array,
    settled: bool,
    residuals: Mapping[str, float],
    others: Mapping[str, tuple[float, float]],
    sources: Sequence[str],
    prediction: Mapping[str, tuple[float, float]],
) -> Identified:
    """Numbers by unknowns (f) and their covariance `whole`, in words and as a robot file."""
    module, slopes = unknowns.module, unknowns.slopes(z)
    if not settled:  # Slopes at values that are no results say nothing of them.
        whole = np.full_like(whole, np.nan)
        others = {label: (value, float("nan")) for label, (value, _) in others.items()}
    covariance = slopes @ whole @ slopes.T
    values, deviations = unknowns.values(z), np.sqrt(np.diag(covariance))
    source = ", ".join(sources)
    words = {
        member: f"{name} " * ("payload." in name)
        + f"{value:.5g} ± {deviation:.2g}, identified from {source}"
        for name, value, deviation in zip(unknowns.names, values, deviations, strict=True)
        for member in unknowns.members[name][:1]
    }
    contradictions, clauses, robot_file = dict[str, str](), tuple[str, ...](), ""
    advice = () if settled else _advice(unknowns)
    if settled:
        contradictions = _contradictions(unknowns, z)
        clauses = tuple(
            words
            for words in unseen(unknowns, whole, slopes)
            if words.partition(":")[0] not in contradictions
        )
        try:
            robot_file = with_numbers(unknowns.text, unknowns.parameters(z), words)
        except RobotFileError as error:
            advice = (str(error), "write those numbers that you take into the file by hand")
    return Identified(
        module.NAME,
        source,
        tuple(unknowns.names),
        unknowns.before(),
        values,
        deviations,
        covariance,
        clauses,
        residuals,
        others,
        prediction,
        robot_file,
        tuple(contradictions.values()),
        settled,
        advice,
    )


def doubted(covariance: Array, prior: Array, doubt: float) -> Array:
    """Covariance if variances of readings are `doubt` times as large, and those of the prior not.

    With C = (D + P⁻¹)⁻¹ that is (D / doubt + P⁻¹)⁻¹, which is never more than the prior's P.
    """
    mixed = np.eye(len(prior)) + (doubt - 1.0) * covariance / prior**2
    return doubt * np.asarray(np.linalg.solve(mixed, covariance), np.float64)


def _contradictions(unknowns: Unknowns, z: Array) -> dict[str, str]:
    """Values that the prior all but excludes, in words, by names."""
    slopes = unknowns.slopes(0.0 * z)
    away = np.abs(slopes @ z) / np.linalg.norm(unknowns.prior * slopes, axis=1)
    rows = unknowns.names, unknowns.before(), unknowns.values(z), away
    return {
        name: f"{name}: {value:.4g} is "
        + (f"{value / before:.3g} times" if before else "far from")
        + (
            f" the robot file's {before:.4g}, {far:.2g} deviations of the prior away; the free "
            "numbers alone may not explain the log (if it is right, give a greater --prior)"
        )
        for name, before, value, far in zip(*rows, strict=True)
        if far > _CONTRADICTS
    }


def _advice(unknowns: Unknowns) -> tuple[str, ...]:
    """What to do about a fit that did not settle."""
    rest = [name for name in unknowns.chosen(()) if name not in unknowns.names]
    rest = sorted(rest, key=lambda name: "_inertia_" in name or "_com_" in name)[:_PROPOSED]
    advice = [
        f"free the numbers of the robot file that are wrong too, such as {', '.join(rest)} (--free)"
        if rest
        else "free fewer numbers, those that are wrong (--free)"
    ]
    numbers = [name for name, value in unknowns.file.items() if value]
    lacking = [f"`{k}`" for k in ("damping", "friction") if not any(f"_{k}" in n for n in numbers)]
    if lacking and unknowns.module.BODIES:
        words = " and ".join(lacking)
        advice.append(f"add {words} to the links of the robot file whose joints rub")
    vehicle = Vehicle(unknowns.module)
    if vehicle.rotors and not vehicle.layout.moves_freely:
        advice.append("fly in calm air: of a planar base the fit knows neither wind nor drag")
    advice.append("take a shorter part of the log, in which nothing touches it (--between)")
    return (*advice, "the greatest residuals below show what the robot file lacks")


def unseen(unknowns: Unknowns, covariance: Array, slopes: Array) -> tuple[str, ...]:
    """Directions in which a fit is not much surer than the prior, in words.

    `covariance` is that of unknowns, and `slopes` (f, f) derivatives of values by these.
    """
    covariance = covariance / np.outer(unknowns.prior, unknowns.prior)
    shares, directions = np.linalg.eigh(covariance)
    # By values over their deviations of the prior: an unknown may be in several moments of inertia.
    scaled = slopes * unknowns.prior
    scaled /= np.linalg.norm(scaled, axis=1, keepdims=True)
    surer = np.sqrt(np.diag(scaled @ covariance @ scaled.T))
    clauses = dict[str, None]()
    for share, direction in zip(
        np.sqrt(np.maximum(shares, 0.0)), (scaled @ directions).T, strict=True
    ):
        if share > _UNSEEN:
            order = np.argsort(-np.abs(direction))
            count = int(np.sum(np.abs(direction) > _PART))
            if count < 2 and surer[order[0]] > _UNSEEN:
                name = unknowns.names[order[0]]
                clauses[f"{name}: the log does not determine it; the prior does"] = None
            else:
                parts = [unknowns.names[k] for k in order[: min(4, max(2, count))]]
                words = f"{', '.join(parts[:-1])} and {parts[-1]}"
                clauses[f"{words}: the log determines only a combination of them"] = None
    return tuple(clauses)


def _errors_ahead(smoother: Smoother, estimate: Estimate) -> dict[str, tuple[float, float]]:
    """Root mean squares of errors of coordinates that are predicted without readings.

    They are by the numbers of the file and of an estimate, from the same states of the latter.
    """
    model, f, d = smoother.model, len(smoother.unknowns.names), smoother.model.layout.displaced
    steps = round(_AHEAD / model.h / smoother.samples)
    starts = np.arange(0, len(smoother.q) - steps, max(1, steps // 2))
    starts = starts[np.array([smoother.follows[k : k + steps].all() for k in starts], dtype=bool)]
    if not len(starts):
        return {}
    commands = smoother.commands(0.0)[starts[:, np.newaxis] + np.arange(steps + 1)]
    commands = commands.reshape(len(starts), -1, commands.shape[-1]).swapaxes(0, 1)
    # Some series are read at samples other than the first of a state.
    read, known = smoother.q[starts + steps], smoother.has[starts + steps, :, : model.nd] > 0.0
    ways = []
    for numbers in (np.zeros(f), estimate.shared[:f]):
        machine, drag = smoother.machine(np.append(numbers, estimate.shared[f:]))
        state, seen = {name: values[starts] for name, values in estimate.state.items()}, []
        for command in commands:
            seen.append(state["q"])
            state |= model(state, machine, command=command, drag=drag)[0]
        ends = np.stack(seen[-smoother.samples :], axis=1)
        ways.append(model.vehicle.displacement(read, ends))
    kinds = {"position, m": d.position, "attitude, rad": d.attitude, "joints, rad or m": d.joints}
    return {
        name: tuple(np.sqrt([np.mean(way[..., k][there] ** 2) for way in ways]).tolist())
        for name, k in kinds.items()
        if (there := known[..., k]).any()
    }
