"""The state of a robot by its sensors: what a filter estimates by readings at their times."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Program
from gibbs_codegen.errors import UsageError, written
from gibbs_codegen.flight.arguments import real, vector
from gibbs_codegen.flight.plant.environment import Environment
from gibbs_codegen.flight.plant.sensors import SAME, SensorSuite
from gibbs_codegen.flight.plant.state_program import StateProgram, state_program
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.scenario.parts import Filter, Sensors
from gibbs_codegen.machine.filters import FilteredSensor, StateFilter
from gibbs_codegen.machine.sensors import SensorAt

# The least standard deviation of a reading: with none, errors could have no deviation at all.
_LEAST = 1e-6
# What the program is called by which motion goes on where nothing leads.
_COAST = "coast"
# So many outliers of a sensor in a row are none: then what is known is wrong.
_MOST_OUTLIERS = 5
# The longest step of a prediction, s: longer times are so many steps.
_LONGEST = 0.01
# For so long, s, besides the time between two readings, the IMU that leads may tell nothing.
_GAP = 0.05
# Density of noise, m/s²/√Hz and rad/s²/√Hz, of what it then does not tell.
_UNTOLD = 10.0


class Estimate(NamedTuple):
    """An estimate of a filter at a time, s: coordinates q (nq) and velocities v (nv).

    `values` are of what else it estimates, by names such as "wrench", "efforts", "payload" and
    "imu_bias"; `deviations` standard deviations of these and, as "q" (nd) and "v" (nv), of
    displacements of q and of v; `covariance` (n, n) is that of all errors in this order.
    """

    time: float
    q: Array
    v: Array
    values: Mapping[str, Array]
    deviations: Mapping[str, Array]
    covariance: Array


@dataclass
class _Instant:
    """A time, s, the inputs (nu) that acted before it, and readings that were taken there.

    With what is known of before these readings, and after them. `felt` is the reading of the IMU
    that leads, and `latest` the last one until then with its time, s.
    """

    time: float
    u: Array
    before: dict[str, Array] = field(default_factory=dict)
    after: dict[str, Array] = field(default_factory=dict)
    readings: list[tuple[str, Array]] = field(default_factory=list)
    felt: Array | None = None
    latest: tuple[float, Array] | None = None


class Estimator:
    """A Kalman filter of a robot's motion on the readings of its sensors.

    Readings that come late are taken at their time, and what came since is taken again. `programs`
    are the array programs that it evaluates.

    Args:
        robot: A generated module with the back end "numpy" or "c" and with derivatives, or the name
            or path of one, which is loaded with the C back end.
        sensors: `read_scenario(…).sensors`: what there is to read, and how it errs.
        settings: `read_scenario(…).control.filter`: quantities estimated besides; None: the
            default.
        parameters: Parameters of the module's `prepare`, if not those of the robot file.

    Raises:
        UsageError: If there are no sensors, or the robot lacks a frame.
        MissingFunctionError: If the module was generated without the derivatives.
    """

    def __init__(
        self,
        robot: ModuleType | str | os.PathLike[str] | Vehicle,
        sensors: Sensors | None,
        settings: Filter | None = None,
        parameters: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        self._suite = suite = SensorSuite(robot, sensors, parameters)
        if not suite.devices:
            raise UsageError("sensors: missing; a filter needs some, such as sensors.imu")
        self._vehicle = vehicle = suite.vehicle
        vehicle.check_wheels()
        self._settings = chosen = settings or Filter()
        of_sensors = zip(suite.devices, suite.places_of_frames, suite.biases, strict=True)
        sensing = {
            x.name: FilteredSensor(SensorAt(x.measures, frame, x.figures), tuple(biases))
            for x, frame, biases in of_sensors
        }
        for x, frame in zip(suite.devices, suite.places_of_frames, strict=True):
            vehicle.smooth_place(vehicle.frames[frame], f"sensors.{x.measures}: {x.name}")
        self._names = [device.name for device in suite.devices]
        self._leads = self._leading()
        # Nothing tells a wrench on what does not move.
        led = self._leads is not None
        pushed = not led and (vehicle.layout.v.base or chosen.wrench != "base")
        names = {"wrench": chosen.wrench if pushed else "", "payload": chosen.payload}
        frames = {
            key: vehicle.smooth_place(name, f"control.filter.{key}") if name else None
            for key, name in names.items()
        }
        functions, joints = Functions(vehicle.module), vehicle.joints > 0 and not led
        leads = "" if self._leads is None else self._names[self._leads]
        self._filter = StateFilter(functions, sensing, efforts=joints, leads=leads, **frames)
        self.programs: Mapping[str, Program] = self._filter.programs() | (
            {x.name: x for x in [self._filter.coast()]} if led else {}
        )
        self._latest = max(device.delay for device in suite.devices)
        self._instants: list[_Instant] = []
        # Times, s, and then what is known, its deviations, and the last innovation of each sensor.
        self._record: list[tuple[float, Array, Array, Array]] = []

    def _leading(self) -> int | None:
        """The number of the IMU that leads the motion, None if the model does."""
        vehicle, suite = self._vehicle, self._suite
        if self._settings.by == "model":
            return None
        kinds = [device.measures for device in suite.devices]
        words = 'control.filter.by: must be "model" for'
        if not vehicle.layout.moves_freely:
            raise UsageError(f"{words} {vehicle.name}, whose base does not move freely")
        if kinds.count("imu") != 1 or "wrench" in kinds:
            there = ", ".join(self._names)
            raise UsageError(
                f'{words} these sensors: "imu" needs exactly one imu, and no wrench sensor; there '
                f"are {there}"
            )
        place = suite.places_of_frames[leads := kinds.index("imu")]
        moving = vehicle.function("frame_jacobians")(vehicle.neutral)[place]
        if np.any(moving[:, vehicle.layout.v.joints]):
            raise UsageError(f"{words} {self._names[leads]}, which joints move, not the base alone")
        return leads

    @cached_property
    def _compiled(self) -> dict[str, StateProgram]:
        vehicle, suite = self._vehicle, self._suite
        values = {"gravity": Environment(vehicle).gravity, "noise": self.noise}
        programs, begin = dict(self.programs), f"{self._filter.name}_"
        compiled = {"": state_program(vehicle, programs.pop(f"{begin}predict"), values)}
        if self._leads is not None:
            untold, places = self.noise.copy(), vehicle.layout.v
            untold[self._filter.places["v"]][places.base] += _UNTOLD**2
            others = values | {"noise": untold}
            compiled[_COAST] = state_program(vehicle, programs.pop(f"{begin}{_COAST}"), others)
        for key, program in programs.items():
            name = key.removeprefix(f"{begin}update_")
            variances = suite.variances[self._names.index(name)]
            values["variances"] = np.maximum(variances, _LEAST**2)
            compiled[name] = state_program(vehicle, program, values)
        return compiled

    @cached_property
    def _gates(self) -> list[float]:
        """Bounds of each sensor's nis from which on it counts as an outlier."""
        from scipy.special import chdtri  # Late, as SciPy takes long to import.

        sizes = [len(variances) for variances in self._suite.variances]
        return [float(chdtri(size, self._settings.outliers)) for size in sizes]

    @cached_property
    def noise(self) -> Array:
        """Variances (n) that noise adds to errors in a second."""
        chosen, noise = self._settings, np.zeros(self._filter.size)
        densities: dict[str, ArrayLike] = {
            "v": chosen.acceleration,
            "wrench": np.repeat([chosen.force, chosen.torque], 3),
            "efforts": chosen.effort,
            "payload": chosen.mass,
            **self._of_biases(1),
        }
        for name, place in self._filter.places.items():
            noise[place] = np.square(densities.get(name, 0.0))
        if self._leads is not None:
            rates, places = noise[self._filter.places["v"]], self._vehicle.layout.v
            # Angular velocities are as gyroscopes tell.
            rates[places.joints], rates[places.attitude] = chosen.joints**2, 0.0
        return noise

    def _of_biases(self, part: int) -> dict[str, ArrayLike]:
        """Sizes of the biases of sensors, or densities of their walks, by names of the errors."""
        pairs = zip(self._suite.devices, self._suite.biases, strict=True)
        return {f"{device.name}_bias": [x[part] for x in b.values()] for device, b in pairs if b}

    def begin(self, q: ArrayLike, v: ArrayLike, time: float = 0.0) -> None:
        """Begin at a time, s, from a state that is known as well as the settings' `start` says.

        Args:
            q: Coordinates (nq).
            v: Velocities (nv).
            time: When that is, s.
        """
        places, layout, chosen = self._filter.places, self._vehicle.layout, self._settings
        # Loads and biases are as large as a second of their walk makes them, or as is declared.
        variances = self.noise.copy()
        variances[: places["v"].stop] = chosen.start**2
        for name, sizes in self._of_biases(0).items():
            variances[places[name]] += np.square(sizes)
        memory = {
            "q": vector("q", q, layout.q.size),
            "v": vector("v", v, layout.v.size),
            "loads": np.zeros(self._filter.loaded - places["v"].stop),
            "biases": np.zeros(self._filter.size - self._filter.loaded),
            "covariance": np.diag(variances),
            "outliers": np.zeros(len(self._names)),
            "innovations": np.full(len(self._names), np.nan),
        }
        self._instants = [_Instant(time, np.zeros(len(self._vehicle.inputs)), memory, memory)]
        self._begin, self._record = time, []

    def follow(
        self, time: float, u: ArrayLike, readings: Iterable[tuple[str, float, ArrayLike]] = ()
    ) -> None:
        """Go on to a time, s, under inputs, and take readings that have come.

        Args:
            time: Not before the last one, s.
            u: Inputs (nu) that acted since: thrusts, N, then efforts of the joints, N m and N.
            readings: Name of the sensor, time of its measurement, s, and values of each, NaN where
                it has none. One that is measured between two times of calls counts at the second.

        Raises:
            UsageError: If `begin` was not called, a time is too early or too late, or inputs or
                values are not as many numbers as there must be.
        """
        last, instants, first = self._last, self._instants, len(self._instants)
        inputs, leads = vector("u", u, len(self._vehicle.inputs)), self._filter.leads
        if not time > last.time - SAME:
            raise UsageError(f"time: must not be before the last, {last.time:g} s, not {time:g} s")
        come = [self._checked(time, *reading) for reading in readings]
        if time > last.time + SAME:
            instants.append(_Instant(time, inputs))
        elif first == 1 and not last.readings:
            last.u = inputs
        for name, taken, values in come:
            place = next(k for k, x in enumerate(instants) if x.time > taken - SAME)
            now = instants[place]
            if name != leads:
                now.readings.append((name, values))
            # At the begin nothing acts yet on what is simulated.
            elif now.time > self._begin and np.isfinite(values).all():
                now.felt = values
                # What came since the reading before follows from both.
                followers = (k + 1 for k in reversed(range(place)) if instants[k].felt is not None)
                place = next(followers, min(place, 1))
            first = min(first, place)
        for k in range(first, len(instants)):
            now = instants[k]
            if k > 0:
                now.before = self._ahead(k)
            last = instants[max(k - 1, 0)]
            now.latest = last.latest if now.felt is None else (now.time, now.felt)
            now.after = now.before
            for name, values in now.readings:
                now.after = self._run(name, now.after, u=now.u, reading=values)
        oldest = time - self._latest - SAME
        free = oldest - self._most if self._leads is not None else oldest
        old = [
            k for k, x in enumerate(instants) if x.time < (oldest if x.felt is not None else free)
        ]
        del instants[: old[-1] if old else 0]
        if self._record and time < self._record[-1][0] + SAME:
            self._record.pop()
        memory = self.memory
        known = np.concatenate([memory[name] for name in ("q", "v", "loads", "biases")])
        spread = np.sqrt(np.diagonal(memory["covariance"]))
        self._record.append((time, known, spread, memory["innovations"]))

    @property
    def _rest(self) -> dict[str, list[tuple[str, str]]]:
        """Names and units of entries of loads and of biases, by what they are part of."""
        vehicle, suite = self._vehicle, self._suite
        units = vehicle.layout.effort_units[: vehicle.joints]
        joints = zip(vehicle.joint_names, units, strict=True)
        pushes = [("force", "N"), ("torque", "N m")]
        entries = {
            "wrench": [(f"wrench_{x}_{axis}", unit) for x, unit in pushes for axis in "xyz"],
            "efforts": [(f"effort_{name}", unit) for name, unit in joints],
            "payload": [("payload", "kg")],
        }
        named = list(zip((f"{name}_bias" for name in suite.names), suite.units, strict=True))
        for name, rows, biased in zip(self._names, suite.places, suite.biases, strict=True):
            entries[f"{name}_bias"] = [named[rows][k] for k in biased]
        return {name: entries[name] for name in self._filter.places if name in entries}

    def series(self, time: Array, q: Array, v: Array) -> dict[str, Any]:
        """What was known at times, last before or then.

        Args:
            time: Times (s) since `begin`, s.
            q: True coordinates (s, nq).
            v: True velocities (s, nv).

        Returns:
            Fields of a `Flight` by their names, as from `estimates` to `innovations` there.
        """
        times, known, spread, innovations = map(np.array, zip(*self._record, strict=True))
        last = np.maximum(np.searchsorted(times, time + SAME) - 1, 0)
        places = np.cumsum([q.shape[1], v.shape[1]])
        known_q, known_v, _ = np.split(known[last], places, axis=1)
        off = self._vehicle.displacement(known_q, q)
        corrected = [k for k in range(len(self._names)) if k != self._leads]
        rest = [*itertools.chain(*self._rest.values())]
        return {
            "estimates": known[last],
            "estimate_names": tuple(name for name, _ in rest),
            "estimate_units": tuple(unit for _, unit in rest),
            "estimate_deviations": spread[last],
            "estimate_errors": np.concatenate([off, v - known_v], axis=1),
            "innovations": innovations[last][:, corrected],
            "innovation_names": tuple(self._names[k] for k in corrected),
        }

    def _checked(
        self, now: float, name: str, taken: float, values: Any
    ) -> tuple[str, float, Array]:
        """A reading that comes at a time, s."""
        oldest = self._instants[0].time
        if name not in self._names:
            raise UsageError(f"readings: {written(name)} is none of {', '.join(self._names)}")
        size = len(self._suite.variances[self._names.index(name)])
        numbers = real(f"readings: {name}", values, f"{size} numbers", (size,))
        if not oldest - SAME <= taken <= now + SAME and np.isfinite(numbers).all():
            raise UsageError(
                f"readings: {name}: measured at {taken:g} s, but now only {oldest:g} s to "
                f"{now:g} s are accepted; if readings come later, give the sensor a longer delay"
            )
        return name, min(taken, now), numbers

    @property
    def _most(self) -> float:
        """How long the IMU that leads tells between two readings at most, s."""
        return _GAP + 1.0 / self._suite.devices[self._leads or 0].rate

    def _ahead(self, place: int) -> dict[str, Array]:
        """What is known at an instant by its place before its readings, from one before on.

        Where an IMU leads, that is the last at which something was read.
        """
        instants, now, led = self._instants, self._instants[place], self._leads is not None
        k = place - 1
        while led and k > 0 and instants[k].felt is None and not instants[k].readings:
            k -= 1
        last, known = instants[k], instants[k].after
        ahead = now.time - last.time
        steps = max(math.ceil(ahead / _LONGEST - SAME), 1)
        h, felt = ahead / steps, self._led(last, place) if led else None
        for k in range(steps):
            if felt is not None:
                start, slope = felt
                # Steps shorter than between readings have the same density of noise.
                shorter = 1.0 / (self._suite.devices[self._leads or 0].rate * h)
                variances = np.maximum(self._suite.variances[self._leads or 0], _LEAST**2)
                inputs = {
                    "before": start + k * h * slope,
                    "reading": start + (k + 1) * h * slope,
                    "variances": variances * max(shorter, 1.0),
                }
                known = self._run("", known, **inputs, h=h)
            else:
                known = self._run(_COAST if led else "", known, u=now.u, h=h)
        return known

    def _led(self, last: _Instant, place: int) -> tuple[Array, Array] | None:
        """What the IMU that leads reads at `last`, and its rate until the instant at a place.

        Readings between two are on a line. None if it has been silent for too long.
        """
        instants, reading = self._instants, last.latest
        come = next(((x.time, x.felt) for x in instants[place:] if x.felt is not None), None)
        if reading is None and come is not None:
            reading = self._begin, come[1]
        if reading is None:
            return None
        start, first = reading
        delay = self._suite.devices[self._leads or 0].delay
        end = come[0] if come else instants[place].time - delay
        if end - start > self._most + SAME:
            return None
        slope = (come[1] - first) / (end - start) if come else np.zeros_like(first)
        return first + (last.time - start) * slope, slope

    def _run(self, name: str, memory: dict[str, Array], **values: ArrayLike) -> dict[str, Array]:
        """What is known after a step, or after a reading of a sensor by its name."""
        program, corrects = self._compiled[name], name in self._names
        of_sensor = self._names.index(name) if corrects else 0
        gate = self._gates[of_sensor]
        if memory["outliers"][of_sensor] >= _MOST_OUTLIERS:
            gate = np.inf
        for key, value in {**memory, **values, "gate": gate}.items():
            if key in program.inputs:
                program.inputs[key][...] = value
        program.run()
        outputs = {key.removesuffix("_next"): x for key, x in program.outputs.items()}
        if corrects:
            nis, counts = program.outputs["nis"], memory["outliers"].copy()
            if not np.isnan(nis):
                counts[of_sensor] = counts[of_sensor] + 1 if nis >= gate else 0
            outputs |= {"outliers": counts, "innovations": memory["innovations"].copy()}
            outputs["innovations"][of_sensor] = nis / len(self._suite.variances[of_sensor])
        return {key: outputs[key].copy() if key in outputs else x for key, x in memory.items()}

    @property
    def _last(self) -> _Instant:
        """The last time, and what is known there."""
        if not self._instants:
            raise UsageError("the filter has no state yet; call begin(q, v) first")
        return self._instants[-1]

    @property
    def time(self) -> float:
        """The last time, s."""
        return self._last.time

    @property
    def memory(self) -> dict[str, Array]:
        """What programs remember, by the names of their inputs."""
        return self._last.after

    @property
    def estimate(self) -> Estimate:
        """What is known at the last time."""
        time, memory, places = self._last.time, self.memory, self._filter.places
        spread = np.sqrt(np.diagonal(memory["covariance"]))
        rest, first = np.concatenate([memory["loads"], memory["biases"]]), places["v"].stop
        values = {
            name: rest[place.start - first : place.stop - first]
            for name, place in places.items()
            if name not in ("q", "v")
        }
        deviations = {name: spread[place] for name, place in places.items()}
        parts = memory["q"].copy(), memory["v"].copy(), values, deviations
        return Estimate(time, *parts, memory["covariance"])
