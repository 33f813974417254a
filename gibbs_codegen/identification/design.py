"""Design of an experiment: a motion that tells numbers of a robot file, before anyone flies it.

The base goes through points, and joints move from posture to posture, from rest to rest: paths that
scenarios have, so that every law flies them, and limits of joints hold. What is searched for are
the points. A motion is judged by a flight of it in simulation: by the covariance that a fit of its
readings has, which needs no fit, since it depends on the motion and not on noise. What is made
least is the mean of the variances of the numbers in units of the prior, which the least certain
ones decide.
"""

from __future__ import annotations

import logging
import os
import threading
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import numpy as np

from gibbs_codegen.errors import GibbsCodegenError, ScenarioFileError, UsageError
from gibbs_codegen.files.shipped import text_of
from gibbs_codegen.files.staging import new_place
from gibbs_codegen.files.toml import merged, nested
from gibbs_codegen.flight.desired.trajectory import base_path
from gibbs_codegen.flight.plant.allocation import commands_all
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.simulation import flight_start, simulate
from gibbs_codegen.flight.vectors import Array
from gibbs_codegen.identification.identify import Progress, identifiable, model_of, unseen
from gibbs_codegen.identification.model import Model
from gibbs_codegen.identification.recorded import Readings, flight_recordings
from gibbs_codegen.identification.report import as_text, number_row
from gibbs_codegen.identification.smoothing import Smoother
from gibbs_codegen.identification.unknowns import PRIOR, Prior, Unknowns
from gibbs_codegen.robot.layout import Layout
from gibbs_codegen.robot.text import toml_lines

_log = logging.getLogger("gibbs_codegen")

# What is flown where no scenario says so: laws, sensors and steps.
_FLIGHT: dict[str, Any] = {
    "name": "excitation",
    "duration": 12,
    "control": {"rate": 200, "frequency": 2},
    "integration": {"method": "rk4", "step": 0.0025, "rate": 200},
    "sensors": {"encoders": [{"rate": 100, "resolution": 1.5e-3}]},
}
# What is read of a base that moves, and where it begins if it can.
_MOVING: dict[str, Any] = {
    "sensors.imu": [{"rate": 200, "accelerometer_noise": 0.007, "gyroscope_noise": 0.0007}],
    "sensors.pose": [{"rate": 100, "position_noise": 0.001, "attitude_noise": 0.005}],
}
_HIGH: dict[str, Any] = {"base.path": {"kind": "fixed", "position": [0, 0, 2]}}
# What leads an arm in place of moves.
_LED = "tip", "tip_in_base", "tip_beside_base", "frames", "guess", "guess_deg"
# Rest at both ends, time from point to point, and how long a turn takes, s.
_REST, _PIECE, _TURN = 0.2, 0.6, 2.0
# How far joints without limits move, rad or m, and shares of limits that are used.
_FAR, _FAR_ALONG, _USED = 1.0, 0.1, 0.95
# The greatest rate of a move from rest to rest with minimum jerk, over the mean one.
_PEAK = 1.875
# Angle, degrees, and lean of the axis of the greatest turn.
_ANGLE, _LEAN = 180.0, 0.5
# Of a search: the first step, shares of one after success and failure; halvings of a start.
_STEP, _LONGER, _SHORTER, _HALVINGS = 0.25, 1.5, 0.8, 6


@dataclass(frozen=True, eq=False)
class Design:
    """A motion that identifies numbers, and their expected deviations.

    - `names` (f): numbers that are free, `before` (f) their values in the robot file, SI units
    - `deviations` (f) and `covariance` (f, f): those of a fit of a flight of it, as expected
    - `unseen`: in words what the motion does not identify
    - `scenario`: text of a scenario file
    """

    robot: str
    names: tuple[str, ...]
    before: Array
    deviations: Array
    covariance: Array = field(repr=False)
    unseen: tuple[str, ...]
    scenario: str = field(repr=False)

    def text(self) -> str:
        """Say it as a table in text."""
        rows = [number_row(*x) for x in zip(self.names, self.before, self.deviations, strict=True)]
        heads = ("number", "robot file", "± expected", "of it")
        listed = [(words,) for words in self.unseen] or [("Nothing.",)]
        sections = [(f"{self.robot}, before it moves, in SI units", heads, rows)]
        return as_text([*sections, ("What the motion cannot identify", ("",), listed)])

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the scenario to a new file.

        Args:
            path: The file.

        Raises:
            UsageError: If it is there already.
            OutputError: If it cannot be written; nothing is left.
        """
        with new_place(path) as new:
            new.write_text(self.scenario, encoding="utf-8")


def design(
    robot: ModuleType | str | os.PathLike[str],
    free: Sequence[str] = (),
    scenario: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    room: float = 1.0,
    prior: Prior = PRIOR,
    tries: int = 40,
    progress: Progress = lambda what, share: None,
) -> Design:
    """Find the motion within limits that identifies numbers of a robot file best.

    Args:
        robot: The robot, as of `identify`.
        free: Numbers to identify, as for `identify`.
        scenario: A scenario file, or its tables: from it law, sensors, duration, limits and the
            place where the motion begins are taken. By default 12 s with encoders and, of a base
            that moves, an IMU and motion capture.
        room: How far the base may go from where it begins along each axis, m.
        prior: Standard deviations of the robot file's numbers, as for `identify`.
        tries: How many motions are flown in simulation.
        progress: Called with the name of the work and the share done.

    Returns:
        The motion, and the expected deviations.

    Raises:
        UsageError: If the robot cannot be identified, or flies no motion of the scenario.
    """
    module = identifiable(robot)
    if not room > 0.0 or tries < 1:
        raise UsageError("room: must be above 0, and tries 1 or more")
    unknowns = Unknowns(module, free, prior)
    f, z = len(unknowns.names), np.zeros(len(unknowns.names))
    experiment = _Experiment(module, unknowns, _tables(module, scenario), room)
    best = searched(
        experiment.spread,
        experiment.gentle(),
        tries,
        lambda detail, share: progress(f"flying motions: {detail}", share),
    )
    slopes, whole = unknowns.slopes(z), experiment.covariance(best)[:f, :f]
    covariance = slopes @ whole @ slopes.T
    deviations = np.sqrt(np.diag(covariance))
    tables, names = experiment.tables_of(best), tuple(unknowns.names)
    lines = [f"# A motion for these numbers of {module.NAME}, with expected standard deviations:"]
    lines += [f"# {name} ± {s:.2g}" for name, s in zip(names, deviations, strict=True)]
    lines += toml_lines({key: x for key, x in tables.items() if not isinstance(x, Mapping)})
    for key, table in tables.items():
        lines += ["", f"[{key}]", *toml_lines(table)] if isinstance(table, Mapping) else []
    words, text = unseen(unknowns, whole, slopes), "\n".join([*lines, ""])
    return Design(module.NAME, names, unknowns.before(), deviations, covariance, words, text)


def _tables(module: ModuleType, scenario: Any) -> dict[str, Any]:
    """Tables of the scenario in which a motion takes the place of that of base and arm."""
    if scenario is None:
        layout = Layout.of_module(module)
        high = _HIGH if 2 in layout.own_axes[0] else {}
        return merged(_FLIGHT, nested(high | (_MOVING if layout.q.base else {})))
    read_scenario(scenario)  # It refuses what is no scenario, with its lines.
    if not isinstance(scenario, Mapping):
        scenario = tomllib.loads(text_of(os.fspath(scenario), "scenarios", ScenarioFileError)[0])
    tables = merged({}, nested(scenario))
    for key in _LED:
        tables.get("arm", {}).pop(key, None)
    return tables


class _Experiment:
    """Motions by numbers from −1 to 1, 0 for none, and what flights of them tell.

    Numbers are those of `count` points for each axis of the base and each joint, then of a turn.
    """

    def __init__(
        self, module: ModuleType, unknowns: Unknowns, tables: Mapping[str, Any], room: float
    ) -> None:
        self.module, self.unknowns, self._tables, self._room = module, unknowns, tables, room
        start = flight_start(module, read_scenario(tables), lambda what, share: None, False)
        vehicle, actuators = start.loop.vehicle, start.loop.actuators
        duration, self._begin = start.scenario.duration, start.q[vehicle.arm]
        count = max(1, round((duration - 2 * _REST) / _PIECE) - 1)
        self._times = np.linspace(_REST, duration - _REST, count + 2).round(2)
        self._at = base_path(vehicle, start.scenario)(0.0)[0]
        self._axes = vehicle.layout.own_axes[0] if vehicle.rotors else []
        self._joints = [k for k in range(vehicle.joints) if actuators.efforts[k] > 0.0]
        self._names, self._rates = vehicle.joint_names, actuators.velocities
        self._revolute = [unit == "rad" for unit in module.COORDINATE_UNITS[vehicle.arm]]
        far = np.where(self._revolute, _FAR, _FAR_ALONG)
        ends = _USED * (actuators.joints - self._begin)
        self._ways = np.where(np.isfinite(ends), ends, [-far, far])
        flies = bool(vehicle.rotors) and vehicle.layout.moves_freely
        self._turns = 3 * (flies and duration > 2 * _TURN)
        # A base that leans turns about the vertical alone.
        self._lean = _LEAN * (flies and commands_all(vehicle, start.q))
        self._count = count
        self._model: Model | None = None
        self._wind: Array | None = None
        self.size = (len(self._axes) + len(self._joints)) * count + self._turns
        if not self.size:
            raise UsageError(f"{vehicle.name}: has no rotor and no driven joint to move")
        if vehicle.layout.q.base and not self._axes:
            words = "%s: only joints are moved; its base stays, or follows the scenario's base.path"
            _log.warning(words, vehicle.name)

    def tables_of(self, x: Array) -> dict[str, Any]:
        """Tables of the scenario with a motion (size)."""
        of_points, turn = x[: self.size - self._turns].reshape(-1, self._count), x[-self._turns :]
        changes = dict[str, Any]()
        if self._axes:
            points = np.tile(self._at, (len(self._times), 1))
            points[1:-1, self._axes] += self._room * of_points[: len(self._axes)].T
            path = {"times": self._times.tolist(), "points": points.round(4).tolist()}
            changes["base.path"] = {"kind": "waypoints", **path}
        for k, row in zip(self._joints, of_points[len(self._axes) :], strict=True):
            table = "arm.moves_deg" if self._revolute[k] else "arm.moves"
            changes[f"{table}.{self._names[k]}"] = self._moves(k, row)
        if self._turns:
            axis = [*(self._lean * turn[1:]).round(4).tolist(), 1.0]
            angle, begin = round(_ANGLE * float(turn[0]), 2), float(self._times[1])
            turned = {"angle_deg": angle, "duration": _TURN, "axis": axis, "begin": begin}
            changes["base.attitude"] = {"kind": "turn", **turned}
        return merged(self._tables, nested(changes))

    def _moves(self, joint: int, row: Array) -> list[dict[str, float]]:
        """Moves of a joint, no faster than it may be, the last back to its posture."""
        back, ahead = self._ways[:, joint]
        at, moves, unit = 0.0, [], np.degrees(1.0) if self._revolute[joint] else 1.0
        durations = _USED * np.diff(self._times)
        for target, begin, duration in zip(
            [*np.where(row > 0.0, ahead * row, -back * row), 0.0],
            self._times.tolist(),
            durations.round(4).tolist(),
            strict=False,
        ):
            most = _USED * self._rates[joint] * duration / _PEAK
            at = float(np.clip(target, at - most, at + most))
            to = round(float(unit * (self._begin[joint] + at)), 4)
            moves.append({"to": to, "duration": duration, "begin": begin})
        return moves

    def covariance(self, x: Array) -> Array:
        """Covariance of what a fit of a flight finds: unknowns first.

        Raises `UsageError` where the flight ends early, or comes near limits of inputs.
        """
        flight = simulate(self.module, read_scenario(self.tables_of(x)))
        if flight.stopped:
            raise UsageError(f"{self.module.NAME}: {flight.stopped}")
        least, most = flight.input_limits
        room, span = np.minimum(flight.commanded - least, most - flight.commanded), most - least
        # Joints that nothing drives have no range, and some inputs no limits.
        judged = (span > 0.0) & np.isfinite(span)
        room = np.divide(room, span, out=np.ones_like(room), where=judged)
        sample, place = np.unravel_index(np.argmin(room), room.shape)
        if room[sample, place] < 1.0 - _USED:
            words = (
                f"even a small motion leaves {self.module.INPUTS[place]}, of {least[place]:.4g} to "
                f"{most[place]:.4g}, less than {1.0 - _USED:.0%} of its range at "
                f"{flight.time[sample]:.3g} s; give a posture or path that needs less (--scenario)"
            )
            raise UsageError(f"{self.module.NAME}: {words}")
        recording = flight_recordings(flight, self.module, flight.scenario)[0]
        model = self._model = self._model or model_of(self.module, [recording])
        smoother = Smoother(model, self.unknowns, [Readings(recording, self.module, model.imus)])
        times = recording.time[:: smoother.samples]
        estimate, rows = smoother.start(), np.searchsorted(flight.time, times - 1e-9)
        estimate.state |= {"q": flight.q[rows], "v": flight.v[rows]}
        if self._wind is None:
            estimate = smoother.run(estimate, lambda detail, share: None, numbers=False)
            self._wind = estimate.wind
        estimate.wind = self._wind
        return smoother.covariance(estimate)

    def gentle(self) -> Array:
        """A motion (size) that is flown, however small. Raises why even a gentle one is not."""
        x = _STEP * np.random.default_rng(1).normal(size=self.size)
        for _ in range(_HALVINGS):
            if np.isfinite(self.spread(x)):
                return x
            x = 0.5 * x
        self.covariance(x)
        return x

    def spread(self, x: Array) -> float:
        """The mean of variances of unknowns in units of the prior; infinite beyond limits."""
        thread = threading.get_ident()

        def loud(record: logging.LogRecord) -> bool:
            """What readings of a motion lack is told of the best one."""
            return record.thread != thread or record.levelno >= logging.ERROR

        _log.addFilter(loud)
        try:
            covariance = self.covariance(x)
        except GibbsCodegenError:
            return np.inf
        finally:
            _log.removeFilter(loud)
        prior = self.unknowns.prior
        return float(np.mean(np.diag(covariance)[: len(prior)] / prior**2))


def searched(
    judge: Callable[[Array], float], start: Array, tries: int, tell: Callable[[str, float], None]
) -> Array:
    """Numbers from −1 to 1 that are judged least: random steps, and on where one was better.

    Ctrl-C ends the search with the best so far.
    """
    rng, best, least = np.random.default_rng(0), start, judge(start)
    length, way = _STEP, np.zeros(0)
    for number in range(tries):
        step = way if way.size else length * rng.normal(size=best.shape)
        x = np.clip(best + step, -1.0, 1.0)
        try:
            value = judge(x)
        except KeyboardInterrupt:
            _log.warning("stopped after %d of %d motions; the best one is kept", number, tries)
            break
        if value < least:
            way, best, least, length = x - best, x, value, min(_STEP, _LONGER * length)
        else:
            length = length if way.size else _SHORTER * length
            way = np.zeros(0)
        tell(f"try {number + 1} of {tries}, best {least:.3g} of the prior", (number + 1) / tries)
    return best
