"""Laws of control, and controllers of users, that are evaluated at a rate: what they see and hold.

Inputs are held from one command to the next, and a command takes effect a delay after it was given.
Until the first one does, its value acts already: a flight begins as if it had been commanded for
long. All commands are recorded, since whoever gave them may not be asked again.
"""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Callable, Mapping
from functools import cache
from time import perf_counter
from typing import Any, ClassVar, Protocol

import numpy as np

from gibbs_codegen.errors import UsageError, written
from gibbs_codegen.flight.arguments import whole
from gibbs_codegen.flight.control.laws import Controller, Gains, curve_tables
from gibbs_codegen.flight.control.observation import Measured
from gibbs_codegen.flight.control.observation import Observation as Observation
from gibbs_codegen.flight.control.predictive import NoPlanError, predictive_law
from gibbs_codegen.flight.plant.actuators import Actuators, command_limits, commands_for
from gibbs_codegen.flight.plant.allocation import Allocation
from gibbs_codegen.flight.plant.estimator import Estimator
from gibbs_codegen.flight.plant.sensors import Readings, SensorSuite
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.reference import Reference
from gibbs_codegen.flight.scenario.parts import PREDICTIVE, Filter, Sensors
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.machine.laws import turns_servos
from gibbs_codegen.machine.policies import AHEAD
from gibbs_codegen.runtime.program_flow import Samples

# Instants are the same, to this share of a millisecond, and of the time between two samples.
_SAME = 1e-6
# Samples a second where a law has to be sampled and nobody says how often.
DEFAULT_RATE = 1000.0
# By units, commands that nobody means who commands throttles, or servos; they are also so many
# times beyond their limits.
_LEAST_WILD, _BEYOND = {"1": 2.0, "rad": math.pi}, 2.0
# The lowest rate of a controller, Hz.
_LOWEST_RATE = 0.1
_NO_INSTANTS = np.zeros(0)

_log = logging.getLogger("gibbs_codegen")

# Finds, when it is asked, what sensors measure of a state beside coordinates and velocities.
Measure = Callable[[], Measured]
# Finds q (nq), v (nv) and that of the state at a time.
Sample = Callable[[], tuple[Array, Array, Measure]]
# Whether motors idle at times, s.
Idles = Callable[[Any], Any]


class ZeroOrderHold:
    """A law of control whose commands are set from outside.

    A command takes effect `delay`, s, later; `rate` is commands a second, Hz, 0 if they come when
    they come. `law` knows the robot, the desired motion and the decay of errors.
    """

    # Nothing that is remembered is integrated with the state, and the law that is held moves none.
    memory, moved = 0, None
    # What is held is no law's, and calls nothing.
    externals: ClassVar[dict[str, Callable[..., Any]]] = {}
    # Readings of the robot's sensors while it flies, if someone takes them.
    readings: Readings | None = None
    # What tells the state by these, if something does.
    estimator: Estimator | None = None

    def __init__(self, law: ControlLaw, name: str, delay: float = 0.0, rate: float = 0.0) -> None:
        self.vehicle: Vehicle = law.vehicle
        self.reference: Reference = law.reference
        self.allocation: Allocation = law.allocation
        self.gains: Gains = law.gains
        # Bounds of errors beyond which control counts as lost.
        self.values: dict[str, Any] = {"back": np.array(law.gains.back)}
        self.law: str = name
        self.delay, self.rate = delay, rate
        # Time, s, by which instants may differ that count as the same.
        self.same = _SAME * min(1e-3, 1.0 / rate if rate else 1.0)
        # Sizes (nu) of commands that are in another unit, infinite once one was found.
        self._wild: Array = _wild_commands(law.vehicle)
        # The inputs (nu) that act.
        self.inputs: Array = np.zeros(len(law.vehicle.inputs))
        self._pending: deque[tuple[float, Array]] = deque()
        self._times: list[float] = []
        self._commands: list[Array] = []

    @property
    def tables(self) -> list[Array]:
        """Tables of the curves that give errors."""
        return curve_tables(self.reference, self.reference)

    def fault(self, command: Any) -> str:
        """The fault of a command that should be inputs u (nu), "" if there is none."""
        names, wrong_value = self.vehicle.commands, "None" if command is None else ""
        try:
            numbers = np.asarray(command, dtype=np.float64)
        except (TypeError, ValueError):
            wrong_value = written(command)
        if not wrong_value and numbers.shape != (len(names),):
            wrong_value = f"an array of shape {numbers.shape}"
        if wrong_value:
            noun = "inputs" if names == self.vehicle.inputs else "commands"
            return f"{wrong_value}, and not {len(names)} {noun}: {', '.join(names)}"
        if np.isfinite(numbers).all():
            return ""
        wrong = np.flatnonzero(~np.isfinite(numbers))[0]
        return f"{numbers[wrong]} for {names[wrong]}"

    def command(self, time: float, inputs: Array) -> None:
        """Give a command u (nu), which takes effect later by the delay; log a wrong unit of it."""
        if (wild := np.abs(inputs) > self._wild).any():
            k, module = int(np.argmax(wild)), self.vehicle.module
            self._wild = np.full(len(inputs), np.inf)
            name = self.vehicle.commands[k]
            words = "a throttle from 0 to 1; is it in percent, or a thrust in N? command_of makes"
            words += " commands of thrusts"
            if module.COMMAND_UNITS[k] == "rad":
                low, high = module.COMMAND_LIMITS[name]
                words = f"a position in rad, far beyond its range of {low:.4g} to {high:.4g}; is "
                words += "it in degrees?"
            values = self.vehicle.name, time, name, inputs[k], words
            _log.warning("%s: at t = %.6g s %s is commanded %g, %s", *values)
        self._pending.append((time + self.delay, np.array(inputs, dtype=np.float64)))
        if not self._times:
            self._act(-np.inf, self._pending[0][1])

    def start(self, q: Array, v: Array, measure: Measure) -> None:
        """Begin a flight, for which a first command was given."""

    def forget(self) -> None:
        """Forget all commands, before a flight."""
        self._pending.clear()
        self._times, self._commands = [], []
        self.inputs = np.zeros_like(self.inputs)

    def instants(self, begin: float, end: float) -> Array:
        """Times after `begin` and before `end`, s, of effects of commands and of readings."""
        times = [time for time, _ in self._pending if begin < time < end]
        if not times and (self.readings is None or not self.readings.suite.devices):
            return _NO_INSTANTS
        return self._inside(np.array(times), begin, end)

    def _inside(self, times: Array, begin: float, end: float) -> Array:
        """Times between two others, and of readings, in order, and of such as are the same one."""
        if self.readings is not None:
            times = np.concatenate([times, self.readings.instants(begin, end)])
        times = times[(times > begin + self.same) & (times < end - self.same)]
        if len(times) < 2:
            return times
        times = np.unique(times)
        return times[np.diff(times, prepend=-np.inf) > self.same]

    def begin(self, time: float, sample: Sample) -> str:
        """Let the commands that are due take effect; why the flight cannot go on, "" if it can.

        Times must not decrease from call to call.
        """
        self.act(time)
        return ""

    def act(self, time: float) -> None:
        """Let the commands that are due take effect."""
        while self._pending and self._pending[0][0] <= time + self.same:
            self._act(*self._pending.popleft())

    def _act(self, time: float, command: Array) -> None:
        self.inputs = command
        self._times.append(time)
        self._commands.append(command)

    def commanded(
        self,
        time: float | Array,
        q: Array,
        v: Array,
        memory: Array,
        limits: Mapping[str, Array],
        felt: Array | None = None,
    ) -> tuple[Array, Array]:
        """Inputs u (…, nu) that were commanded at times (…), s, whatever all else was.

        They are 0 where no command was given. Nothing is remembered.
        """
        places = np.searchsorted(self._times, np.asarray(time) + self.same, side="right") - 1
        return np.array(self._commands or [self.inputs])[places], memory


def _wild_commands(vehicle: Vehicle) -> Array:
    """Sizes (nu) beyond which commands are not meant in their unit, infinite where none is."""
    if not vehicle.is_driven:
        return np.full(len(vehicle.commands), np.inf)
    least = [_LEAST_WILD.get(unit, np.inf) for unit in vehicle.module.COMMAND_UNITS]
    return np.maximum(least, _BEYOND * np.abs(command_limits(vehicle.module)).max(axis=0))


class Sensing:
    """Observations of states, each with noise of its own; a state as it is by default.

    What is estimated is so at all `samples` of a flight, Hz, besides.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        reference: Reference,
        sensors: Sensors | None = None,
        estimation: Filter | None = None,
        samples: float = 0.0,
    ) -> None:
        noise = sensors or Sensors()
        self._vehicle, self._reference = vehicle, reference
        self.delay = noise.delay
        self._seed = noise.seed
        places = vehicle.layout.v
        # Standard deviations of displacements, of velocities and of accelerations (3, nv).
        self._deviations = np.zeros((3, places.size))
        for place, values in (
            (places.attitude, (noise.attitude, noise.angular_velocity, noise.angular_acceleration)),
            (places.position, (noise.position, noise.velocity, noise.acceleration)),
            (places.joints, (noise.joints, noise.joint_rates, noise.joint_accelerations)),
        ):
            self._deviations[:, place] = np.array(values)[:, np.newaxis]
        # And of forces and torques on a frame (6).
        self._of_wrenches = np.repeat([noise.force, noise.torque], 3)
        # Whether there are any of the state, and of what is measured besides.
        self._errs = bool(np.any(self._deviations[:2]))
        self._errs_besides = bool(np.any(self._deviations[2]) or np.any(self._of_wrenches))
        self.readings = Readings(SensorSuite(vehicle, noise))
        # What tells the state, if it is not told as it is but for noise.
        self.estimator = Estimator(vehicle, noise, estimation) if estimation else None
        if estimation:
            self.readings.rates.add(samples)
        self.reset()

    def reset(self, seed: int | None = None) -> None:
        """Draw the noise of a flight again from its begin, with another seed if given.

        Raises `UsageError` if it is no integer, or less than 0.
        """
        self._seed = whole("seed", self._seed if seed is None else seed, 0)
        self._noise = np.random.default_rng(self._seed)
        # Its own, so that what is measured besides changes no noise of the state.
        self._other_noise = np.random.default_rng([self._seed, 1])
        self.readings.reset(self._seed)
        self._begun = False

    def take(self, time: float, sample: Sample) -> None:
        """Take the readings that are due at a time, s, and estimate by those that come."""
        measure = cache(lambda: sample()[2]())
        self.readings.take(time, lambda: measure().sensors)
        if self.estimator:
            if not self._begun:
                self.estimator.begin(*sample()[:2], time)
            self._begun = True
            self.estimator.follow(time, measure().inputs, self.readings.come(time))

    def errors(self, count: int, frame: int | None) -> Array:
        """Errors (count, 2 nv + 6) of samples to come, of the wrench on a frame, if on any.

        They are of displacements and velocities before they are turned, as `__call__` does.
        """
        n, frames = self._deviations.shape[1], len(self._vehicle.frames)
        errors = np.zeros((count, 2 * n + 6))
        if self._errs:
            drawn = self._noise.standard_normal((count, 2 * n))
            errors[:, : 2 * n] = drawn * self._deviations[:2].ravel()
        if self._errs_besides:
            drawn = self._other_noise.standard_normal((count, n + 6 * frames))[:, n:]
            if frame is not None:
                of_frame = drawn[:, 6 * frame : 6 * frame + 6]
                errors[:, 2 * n :] = of_frame * self._of_wrenches
        return errors

    def errors_ahead(self, count: int, frame: int | None) -> Array:
        """Errors as of `errors`, which are drawn again: C may refuse samples that are ahead."""
        generators = self._noise.bit_generator, self._other_noise.bit_generator
        states = [generator.state for generator in generators]
        errors = self.errors(count, frame)
        for generator, state in zip(generators, states, strict=True):
            generator.state = state
        return errors

    def __call__(
        self, time: float, q: Array, v: Array, measure: Measure | None = None
    ) -> Observation:
        """The observation of a state, and of what else there is to `measure`.

        The attitude is turned by a random rotation vector; rates of attitude angles are off by
        those of a random angular velocity.
        """
        vehicle, layout, deviations = self._vehicle, self._vehicle.layout, self._deviations
        noise, wrenches = np.zeros(deviations.shape), np.zeros((len(vehicle.frames), 6))
        if self._errs:
            noise[:2] = self._noise.standard_normal(noise[:2].shape)
        if self._errs_besides:
            noise[2] = self._other_noise.standard_normal(len(v))
            wrenches = self._of_wrenches * self._other_noise.standard_normal(wrenches.shape)
        noise, place = deviations * noise, layout.v.attitude
        if np.any(noise[:, place]) and layout.moves_freely and not layout.is_quaternion:
            spins = noise[:, place]
            rates, _ = vehicle.kinematics.attitude_rates(np.tile(q, (3, 1)), spins, 0.0 * spins)
            noise[:, place] = rates
        displacement, velocities, accelerations = noise
        seen_q, seen_v = q.copy(), v + velocities
        if np.any(displacement):
            seen_q = np.asarray(vehicle.integrate(q, displacement))
        desired, estimate = self._reference(time), None
        if self.estimator:
            estimate = self.estimator.estimate
            seen_q, seen_v = estimate.q, estimate.v
        read = self.readings.at(time - self.delay)
        if measure is None:
            return Observation(time, seen_q, seen_v, *desired, sensors=read, estimate=estimate)

        def measured() -> Measured:
            now = measure()
            parts = now.actuators.copy(), now.constraint_forces.copy()
            loads = now.a + accelerations, now.wrenches + wrenches
            return Measured(*loads, *parts, q_ahead=self._reference(time + AHEAD)[0])

        return Observation(time, seen_q, seen_v, *desired, measured, read, estimate)


class OwnController(Protocol):
    """A controller of a user: any callable that takes an observation and returns inputs.

    It may have attributes `rate`, Hz, and `delay`, s, which come before those of the scenario, and
    a method `reset()`, which is called before a flight.
    """

    def __call__(self, observation: Observation, /) -> Any:
        """Inputs u (nu) for an observation: thrusts, N, then torques and forces of the joints."""


class LawController:
    """A law of the package on observations, with a memory from sample to sample.

    While an input is at a limit of `actuators`, nothing that is remembered grows, and while motors
    idle, which `idles` tells of times, s, nothing changes.
    """

    def __init__(self, law: Controller, actuators: Actuators, idles: Idles, rate: float) -> None:
        self.law, self.idles, self._rate = law, idles, rate
        self._limits = actuators.values
        self._of_commands = None if actuators.commands is None else actuators.inputs
        self.reset()

    def reset(self) -> None:
        """Forget what was remembered."""
        self.memory = np.zeros(self.law.memory)

    def __call__(self, observation: Observation) -> Array:
        """Inputs u (nu) for an observation; what is remembered grows as in the period after it.

        A robot with motors and servos gets commands for these.
        """
        law, seen = self.law, (observation.time, observation.q, observation.v)
        felt = np.zeros(6) if law.moved is None else observation.wrenches[law.moved.place]
        inputs, growth = law.commanded(*seen, self.memory, self._limits, felt)
        if not self.idles(observation.time):
            self.memory = self.memory + growth / self._rate
        if self._of_commands is None:
            return inputs
        at = observation.q_desired, observation.v_desired
        if turns_servos(law.law):
            at = observation.q, observation.v
        return commands_for(law.vehicle, *at, inputs, self._of_commands)


class SampledControl(ZeroOrderHold):
    """A law of control that samples another, or a controller of a user.

    A sample's command takes effect `delay`, s, later. `law` knows the robot, the desired motion and
    the decay of errors; `controller` is what is sampled, at `rate`, Hz.
    """

    def __init__(
        self,
        law: ControlLaw,
        rate: float,
        delay: float,
        sensing: Sensing,
        controller: OwnController,
        name: str = "own",
    ) -> None:
        super().__init__(law, name, delay, rate)
        self._sensing, self._controller = sensing, controller
        self.readings, self.estimator = sensing.readings, sensing.estimator
        self._taken = 0
        # Time that a controller of the user's took, s.
        self.spent = 0.0

    @property
    def sampled(self) -> Controller | None:
        """The law of the package that is sampled on the state, if there is one."""
        law = self._controller
        if self._sensing.estimator or not isinstance(law, LawController):
            return None
        return law.law

    def start(self, q: Array, v: Array, measure: Measure) -> None:
        """Begin a flight: forget what was, and take the first sample.

        Raises `UsageError` if the first command is not what inputs must be.
        """
        self.forget()
        self._taken = 0
        self._sensing.reset()
        reset = getattr(self._controller, "reset", None)
        if reset is not None:
            reset()
        if fault := self.begin(0.0, lambda: (q, v, measure)):
            raise UsageError(fault)

    def instants(self, begin: float, end: float) -> Array:
        """Times after `begin` and before `end`, s, of samples and effects of commands, in order."""
        late = self._sensing.delay
        first = max(int((begin - self.delay) * self.rate) - 1, 0)
        last = int(np.ceil((end + late) * self.rate)) + 1
        samples = np.arange(first, last) / self.rate
        return self._inside(np.concatenate([samples - late, samples + self.delay]), begin, end)

    def ahead(self, begins: Array) -> Samples:
        """Inputs of a law of the package in samples at times (n), s, with room for commands.

        Times are the begins of intervals at which samples are taken and commands take effect, as of
        `begin`; `took` tells of how many that was so.
        """
        until, late, law = begins + self.same, self._sensing.delay, self._controller
        most = int((until[-1] + late) * self.rate) + 2
        times = np.arange(self._taken, max(most, self._taken)) / self.rate
        taken = np.searchsorted(times - late, until, side="right")
        times = times[: taken[-1]]
        effects = [*(time for time, _ in self._pending), *(times + self.delay).tolist()]
        known = [self.inputs, *(command for _, command in self._pending)]
        commands = np.concatenate([known, np.zeros((len(times), len(self.inputs)))])
        assert isinstance(law, LawController)  # noqa: S101 - see `sampled`
        memory = np.zeros(law.law.memory_size)
        memory[: len(law.memory)] = law.memory
        place = None if law.law.moved is None else law.law.moved.place
        errors = self._sensing.errors_ahead(len(times), place)
        learns = np.where(law.idles(times), 0.0, 1.0 / self.rate)
        acting = np.searchsorted(effects, until, side="right")
        due = np.diff(taken, prepend=0)
        return Samples(begins, due, acting, times, learns, errors, memory, commands)

    def took(self, samples: Samples, begun: int) -> None:
        """Keep what a law commanded in the samples at so many times of those that were ahead."""
        law, number = self._controller, int(samples.due[:begun].sum())
        commands = samples.commands[len(samples.commands) - len(samples.times) :]
        for time, command in zip(samples.times[:number].tolist(), commands, strict=False):
            self.command(time, command)
        self._taken += number
        self._sensing.errors(number, None)
        self.act(samples.begins[begun - 1])
        if isinstance(law, LawController):
            law.memory = samples.memory[: len(law.memory)]

    def begin(self, time: float, sample: Sample) -> str:
        """Take due samples, and let due commands take effect; the fault of a command, "" if none.

        A sample is taken of the state that its observation tells, which is earlier by the delay of
        the sensors. Times must not decrease from call to call.
        """
        sample = cache(sample)
        self._sensing.take(time, sample)
        while (sampled := self._taken / self.rate) - self._sensing.delay <= time + self.same:
            self._taken += 1
            begin = perf_counter()
            try:
                inputs = self._controller(self._sensing(sampled, *sample()))
            except NoPlanError as error:
                return str(error)
            self.spent += perf_counter() - begin
            if fault := self.fault(inputs):
                return f"at t = {sampled:.6g} s the controller returned {fault}"
            self.command(sampled, inputs)
        self.act(time)
        return ""


# Controllers of motors and joints: inputs by a time, a state and their memory.
ControlLaw = Controller | ZeroOrderHold


def law_in_time(
    law: ControlLaw,
    scenario: Scenario,
    actuators: Actuators,
    idles: Idles,
    controller: OwnController | None = None,
) -> ControlLaw:
    """A law as a scenario evaluates it: at all times, or at a rate. `idles` tells when motors do.

    `controller`, if given, commands instead of the law. The law itself if nothing has a rate:
    neither scenario nor controller nor sensors. Raises `UsageError` if the controller is no
    callable, or its rate or delay is not what it must be.
    """
    control, sensors = scenario.control, scenario.sensors
    rate, delay = control.rate, control.delay
    known = sensors, control.estimation, scenario.integration.rate
    sensing = Sensing(law.vehicle, law.reference, *known)
    if controller is None and control.law == PREDICTIVE and isinstance(law, Controller):
        planning = predictive_law(law, scenario, actuators)
        return SampledControl(law, planning.rate, delay, sensing, planning, PREDICTIVE)
    if controller is None:
        if rate is None and not scenario.is_sampled:
            return law
    else:
        if isinstance(controller, type):
            name = controller.__name__
            raise UsageError(f"controller: {name} is a class: give an instance, such as {name}()")
        if not callable(controller):
            raise UsageError(
                f"controller: {written(controller)} cannot be called; give a function "
                "or an object that takes an Observation and returns inputs"
            )
        rate = _number(controller, "rate", rate, least=_LOWEST_RATE)
        delay = _number(controller, "delay", delay, least=0.0) or 0.0
    rate = rate or DEFAULT_RATE
    if controller is None and isinstance(law, Controller):
        return SampledControl(
            law, rate, delay, sensing, LawController(law, actuators, idles, rate), law.law
        )
    return SampledControl(law, rate, delay, sensing, controller) if controller else law


def _number(
    controller: OwnController, name: str, otherwise: float | None, least: float
) -> float | None:
    """A number that a controller may have as an attribute, `otherwise` if it has none.

    Raises `UsageError` if it is no number, or less than `least`.
    """
    value = getattr(controller, name, None)
    if value is None:
        return otherwise
    number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    if not (number and least <= value < np.inf):
        unit = {"rate": "Hz", "delay": "s"}[name]
        raise UsageError(
            f"controller: its {name} must be a number of {least:g} {unit} or more, not "
            f"{written(value)}"
        )
    return float(value)
