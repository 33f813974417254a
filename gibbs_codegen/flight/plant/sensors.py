"""The sensors of a robot: what they read of motions, and the readings of a flight, one by one.

Reading k of a sensor is measured at k / rate, and its errors depend on the seed, the sensor's name
and k alone. At each sample a law gets readings from before its new command acts; samples
of a flight, from which readings can be taken afterwards, are of behind it.
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gibbs_codegen.arrays.evaluation import Evaluator
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Program
from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.arguments import whole
from gibbs_codegen.flight.plant.environment import Environment
from gibbs_codegen.flight.plant.state_program import StateProgram, state_program
from gibbs_codegen.flight.plant.vehicle import Array, RobotData, Vehicle
from gibbs_codegen.flight.scenario.parts import Sensors
from gibbs_codegen.machine.sensors import Channel, SensorAt, measurement_program, reading_program
from gibbs_codegen.runtime.load import load

# Time, s, by which instants may differ that count as the same.
SAME = 1e-9


class Reading(NamedTuple):
    """The last values of a sensor, and the time of their measurement, s; NaN before the first."""

    time: float
    values: Array


class Errors:
    """Errors of the readings (…, k) of one sensor, by its name and its channels."""

    def __init__(self, name: str, channels: Sequence[Channel], xp: Any) -> None:
        self._name, self._xp = name, xp
        self._evaluator = Evaluator(reading_program(channels), {}, xp)
        self._steps = np.array([channel.resolution for channel in channels for _ in channel.names])

    def drawn(self, seed: int) -> np.random.Generator:
        """The generator of noise, reading by reading: white noise (k), then steps of biases."""
        return np.random.default_rng([whole("seed", seed, 0), 2, *self._name.encode()])

    def __call__(self, measured: Any, white: Array, walk: Array) -> Any:
        """Readings (…, k) of measurements, by noise and sums of steps of the biases."""
        arguments = {"measured": measured, "white": white, "walk": walk}
        values, steps = self._evaluator(arguments)["reading"], self._steps
        return self._xp.round(values / steps) * steps if steps.all() else values


def frames_of_sensors(robot: RobotData, sensors: Sensors) -> list[int]:
    """Places of the frames at which sensors are; `UsageError` where the robot lacks what it takes.

    Sensors at no frame have the first.
    """
    frames = []
    for device in sensors.devices:
        key = f"sensors.{device.measures}: {device.name}"
        frames.append(robot.frame_place(getattr(device, "frame", robot.frames[0]), key))
        if device.measures == "encoders" and not robot.joints:
            raise UsageError(f"{key}: {robot.name} has no joints; leave the encoders out")
    return frames


class SensorSuite:
    """The sensors that `[sensors]` of a scenario declares, on one robot.

    Readings (m) have those of one sensor after those of the other: of every `imu` specific force
    (3), m/s², and angular velocity (3), rad/s, in the axes of its frame; of a `barometer` the
    pressure altitude, m; of a `magnetometer` the field (3), T, in the axes of its frame; of a `gps`
    position (3), m, and velocity (3), m/s, world axes; of `encoders` the joints' coordinates; of a
    `wrench` force (3), N, and torque (3), N m, in the axes of its frame. `names` (m) and `units`
    (m) describe the entries, and `program` is the array program of the exact measurements.

    Args:
        robot: A generated module with the back end "numpy", "c" or "jax", or the name or path of
            one, which is loaded with the C back end.
        sensors: `read_scenario(…).sensors`.
        parameters: Parameters of the module's `prepare`, if not those of the robot file.

    Raises:
        UsageError: If the robot has no such frame, or no joints for encoders.
    """

    def __init__(
        self,
        robot: ModuleType | str | os.PathLike[str] | Vehicle,
        sensors: Sensors | None,
        parameters: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        self._module: Any = robot if isinstance(robot, ModuleType) else None
        if not isinstance(robot, Vehicle):
            self._module = self._module or load(os.fspath(robot), "c")
            is_jax = getattr(self._module, "backend", "") == "jax"
            of_arrays = load(self._module.__path__[0]) if is_jax else self._module
            robot = Vehicle(of_arrays, parameters)
        self.vehicle, self._module = robot, self._module or robot.module
        settings = sensors or Sensors()
        self._parameters, self.seed, self.devices = parameters, settings.seed, settings.devices
        self.places_of_frames = frames_of_sensors(robot, settings)
        self._channels = [device.channels(robot.layout) for device in self.devices]
        sizes = [sum(len(one.names) for one in channels) for channels in self._channels]
        ends = np.cumsum([0, *sizes]).tolist()
        # The place of each sensor's values in readings.
        self.places = [slice(a, b) for a, b in itertools.pairwise(ends)]
        self.size: int = ends[-1]

    @property
    def feels_contacts(self) -> bool:
        """True if a sensor measures wrenches of contacts, which take time to find."""
        return any(device.measures == "wrench" for device in self.devices)

    @property
    def _entries(self) -> Iterator[tuple[Any, str, str]]:
        """Device, name and unit of each entry of readings."""
        for device, channels in zip(self.devices, self._channels, strict=True):
            for c in channels:
                yield from zip(itertools.repeat(device), c.names, c.units, strict=False)

    @property
    def names(self) -> tuple[str, ...]:
        """Names (m) of the entries of readings, each with its sensor's."""
        return tuple(f"{device.name}_{name}" for device, name, _ in self._entries)

    @property
    def units(self) -> tuple[str, ...]:
        """Units (m) of the entries of readings."""
        return tuple(unit for _, _, unit in self._entries)

    @property
    def variances(self) -> list[Array]:
        """Variances of the readings of each sensor, by noise and resolution."""
        return [np.concatenate([c.variances for c in channels]) for channels in self._channels]

    @property
    def biases(self) -> list[dict[int, tuple[float, float]]]:
        """For each sensor, by entries that have a bias, its size and the density of its walk.

        It is as large as the largest of the entries that err alike.
        """
        return [
            {
                k: bias
                for k, bias in enumerate(
                    (float(np.abs(c.bias).max()), c.walk * math.sqrt(device.rate))
                    for c in channels
                    for _ in c.names
                )
                if any(bias)
            }
            for device, channels in zip(self.devices, self._channels, strict=True)
        ]

    @property
    def frames(self) -> tuple[str, ...]:
        """Names (m) of the frames of the entries, "" for entries without a frame."""
        return tuple(getattr(device, "frame", "") for device, _, _ in self._entries)

    @property
    def timing(self) -> Array:
        """How often (m) entries are read, Hz, and how late readings come, s."""
        return np.array([(device.rate, device.delay) for device, _, _ in self._entries]).T

    @cached_property
    def program(self) -> Program:
        """Measurements (m) as an array program of q, v, a, wrenches and gravity.

        Raises:
            UsageError: If there are no sensors.
        """
        if not self.devices:
            raise UsageError(
                "sensors: missing; declare some, such as [[sensors.imu]] in the scenario"
            )
        pairs = zip(self.devices, self.places_of_frames, strict=True)
        devices = [SensorAt(device.measures, frame, device.figures) for device, frame in pairs]
        return measurement_program(Functions(self._module), devices)

    @cached_property
    def _xp(self) -> Any:
        if getattr(self._module, "backend", "") != "jax":
            return np
        import jax.numpy

        return jax.numpy

    @cached_property
    def _measure(self) -> tuple[Evaluator, dict[str, Any], Array]:
        """The program's evaluation, constants, and the acceleration of gravity (3), m/s²."""
        constants = self.vehicle.constants
        if self._xp is not np and self._parameters:
            constants = self._module.prepare(dict(self._parameters))
        evaluator = Evaluator(self.program, {"robot": self._module}, self._xp)
        return evaluator, {"robot": constants}, Environment(self.vehicle).gravity

    @cached_property
    def errors(self) -> list[Errors]:
        """Errors of the readings of each sensor."""
        pairs = zip(self.devices, self._channels, strict=True)
        return [Errors(device.name, channels, self._xp) for device, channels in pairs]

    def measurements(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, wrenches: ArrayLike | None = None
    ) -> Any:
        """Measurements of motions by sensors without errors.

        Args:
            q: Coordinates (…, nq).
            v: Velocities (…, nv).
            a: Accelerations (…, nv), the derivatives of v.
            wrenches: What contacts do to the frames (…, f, 6), world axes; nothing if None.

        Returns:
            Measurements (…, m).
        """
        none = np.zeros((len(self.vehicle.frames), 6))
        evaluator, constants, gravity = self._measure
        arguments = {"q": q, "v": v, "a": a, "wrenches": none if wrenches is None else wrenches}
        return evaluator({**arguments, "gravity": gravity}, constants)["measured"]

    def measured(self, q: Array, v: Array, a: Array) -> Array:
        """Measurements (m) of one state that nothing touches, in C where the module is.

        Args:
            q: Coordinates (nq).
            v: Velocities (nv).
            a: Accelerations (nv).

        Returns:
            Measurements (m).
        """
        program = self.prepare()
        for name, x in (("q", q), ("v", v), ("a", a)):
            program.inputs[name][...] = x
        program.run()
        return program.outputs["measured"].copy()

    def prepare(self) -> StateProgram:
        """Compile now what `measured` runs."""
        return self._of_one_state

    @cached_property
    def _of_one_state(self) -> StateProgram:
        gravity = Environment(self.vehicle).gravity
        return state_program(self.vehicle, self.program, {"gravity": gravity})

    def readings(
        self,
        time: ArrayLike,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        wrenches: ArrayLike | None = None,
        seed: int | None = None,
    ) -> Any:
        """Readings of the sensors at the samples of motions, with delays and errors.

        A reading that is due between two samples is taken at the second.

        Args:
            time: Times (s) of the samples, s, ascending from 0.
            q: Coordinates (…, s, nq).
            v: Velocities (…, s, nv).
            a: Accelerations (…, s, nv), the derivatives of v.
            wrenches: What contacts do to the frames (…, s, f, 6), world axes; nothing if None.
            seed: Seed of the errors; that of `sensors` if None.

        Returns:
            Readings (…, s, m): the last one that had arrived from each sensor; NaN before the
            first.

        Raises:
            UsageError: If the seed is no integer of 0 or more.
        """
        times = np.asarray(time, dtype=np.float64)
        measured = self.measurements(q, v, a, wrenches)
        lead, columns = measured.shape[:-2], []
        for device, rows, errors in zip(self.devices, self.places, self.errors, strict=True):
            count = int((times[-1] + SAME) * device.rate) + 1
            taken = np.arange(count) / device.rate
            samples = np.searchsorted(times[:-1], taken - SAME)
            size, drawn = rows.stop - rows.start, errors.drawn(self.seed if seed is None else seed)
            noise = drawn.standard_normal((*lead, count, 2, size))
            walk = np.cumsum(noise[..., 1, :], -2)
            values = errors(measured[..., samples, rows], noise[..., 0, :], walk)
            places = arrived(taken, times, device.delay)
            latest = values[..., np.maximum(places, 0), :]
            columns.append(self._xp.where((places < 0)[:, np.newaxis], np.nan, latest))
        return self._xp.concatenate(columns, -1)


def arrived(taken: Array, times: Array, delay: float) -> NDArray[np.intp]:
    """Places (s) of the last readings, taken at times (k), that have come by times (s); or -1."""
    places = np.searchsorted(taken + delay, times + SAME, side="right") - 1
    return places.astype(np.intp)


class Readings:
    """The readings of one flight, which are taken as it is flown."""

    def __init__(self, suite: SensorSuite) -> None:
        self.suite = suite
        # How often, Hz, something is taken at least.
        self.rates = {device.rate for device in suite.devices}
        self.reset(suite.seed)

    def reset(self, seed: int) -> None:
        """Begin a flight, with errors of a seed."""
        suite = self.suite
        self._noise = [errors.drawn(seed) for errors in suite.errors]
        self._times: list[list[float]] = [[] for _ in suite.devices]
        self._values: list[list[Array]] = [[] for _ in suite.devices]
        self._walks = [np.zeros(rows.stop - rows.start) for rows in suite.places]
        self._come = [0] * len(suite.devices)

    def instants(self, begin: float, end: float) -> Array:
        """Times from `begin` to `end`, s, at which there is something to measure."""
        times: set[float] = set()
        for rate in self.rates:
            first, last = math.floor(begin * rate), math.ceil(end * rate)
            times.update(k / rate for k in range(first, last + 1))
        return np.array(sorted(time for time in times if begin <= time <= end))

    def take(self, time: float, measure: Callable[[], Array]) -> None:
        """Take the readings that are due at a time, s; `measure` finds measurements (m)."""
        suite, measured = self.suite, None
        for k, (device, rows) in enumerate(zip(suite.devices, suite.places, strict=True)):
            while (now := len(self._times[k]) / device.rate) <= time + SAME:
                measured = measure() if measured is None else measured
                white, step = self._noise[k].standard_normal((2, rows.stop - rows.start))
                self._walks[k] = self._walks[k] + step
                values = suite.errors[k](measured[rows], white, self._walks[k])
                values.setflags(write=False)
                self._times[k].append(now)
                self._values[k].append(values)

    def at(self, time: float) -> dict[str, Reading]:
        """The last readings that had come by a time, s, by the names of the sensors."""
        suite, last = self.suite, dict[str, Reading]()
        for device, rows, times, values in zip(
            suite.devices, suite.places, self._times, self._values, strict=True
        ):
            place = len(times) - 1
            while place >= 0 and times[place] + device.delay > time + SAME:
                place -= 1
            unknown = Reading(np.nan, np.full(rows.stop - rows.start, np.nan))
            last[device.name] = Reading(times[place], values[place]) if place >= 0 else unknown
        return last

    def come(self, time: float) -> Iterator[tuple[str, float, Array]]:
        """Sensor, time of measurement, s, and values of readings that came since the last call."""
        for k, device in enumerate(self.suite.devices):
            times, values = self._times[k], self._values[k]
            while self._come[k] < len(times) and times[self._come[k]] + device.delay <= time + SAME:
                self._come[k] += 1
                yield device.name, times[self._come[k] - 1], values[self._come[k] - 1]

    def series(self, times: Array) -> Array:
        """The last readings (s, m) of the sensors by times (s), s."""
        tables = [np.zeros((len(times), 0))]
        pairs = zip(self.suite.devices, self.suite.places, self._times, self._values, strict=True)
        for device, rows, taken, values in pairs:
            places = arrived(np.array(taken), times, device.delay)
            table = np.array([*values, np.full(rows.stop - rows.start, np.nan)])  # -1 is the last.
            tables.append(table[places])
        return np.concatenate(tables, axis=-1)
