"""The closed loop of vehicle, motors and controller: what integrators integrate.

The state is q, v, the work done since the start, the state of the actuators, what the law of
control remembers, and the bristles of contacts. Work is part of the state so that the energy
balance is as exact as the integration. The length of a quaternion drifts with errors of
integration, and means nothing: who takes a state apart gets it of length 1.
"""

from __future__ import annotations

import itertools
from bisect import bisect_right
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from gibbs_codegen.arrays.evaluation import Evaluator
from gibbs_codegen.arrays.nodes import Program
from gibbs_codegen.flight.attitude import LARGEST_THETA_0
from gibbs_codegen.flight.control.laws import Controller, constants_of, evaluator_of, law_program
from gibbs_codegen.flight.control.observation import Measured
from gibbs_codegen.flight.control.sampled_control import (
    ControlLaw,
    Measure,
    SampledControl,
    ZeroOrderHold,
)
from gibbs_codegen.flight.integration.state_history import (
    NOTHING,
    Loads,
    SmoothInterval,
)
from gibbs_codegen.flight.plant.actuators import (
    Actuators,
    at_limits,
    check_charge,
    commands_for,
    has_battery,
)
from gibbs_codegen.flight.plant.environment import Environment, Rests
from gibbs_codegen.flight.plant.sensors import SensorSuite
from gibbs_codegen.flight.plant.vehicle import Array, Flags, Vehicle
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.machine import closed_loop
from gibbs_codegen.machine.contact import bristles_of
from gibbs_codegen.machine.laws import turns_servos
from gibbs_codegen.machine.machine import NO_SURROUNDINGS, Surroundings
from gibbs_codegen.machine.state import State, StateLayout
from gibbs_codegen.runtime.program_flow import Samples

# Axes of what `motion` finds, if it is not two.
_AXES = {"a": 1, "holding": 1}
# Shares of a wrench that thrusts may fail to produce and still count as exact.
DOUBLE, SINGLE = 1e-9, 1e-4


@dataclass(frozen=True)
class ClosedLoop:
    """Vehicle, controller, limits and lag of its motors and joints, and what else acts on it.

    `vehicle` is the plant; the controller has its own, with the parameters that it knows. Where
    `environment` is None, nothing acts but inputs. `compensated`: whether the lag of the motors is,
    as `control.laws` has it. `bristles`: those with which flights start, none strained if None.
    `sensors`: those of the robot, if it has any.
    """

    vehicle: Vehicle
    controller: ControlLaw
    actuators: Actuators
    environment: Environment | None = None
    compensated: bool = False
    bristles: Array | None = None
    sensors: SensorSuite | None = None

    def with_plant(
        self, parameters: Mapping[str, Any], lag: Array, scenario: Scenario, table: str = "plant"
    ) -> ClosedLoop:
        """The same law over another plant, in the surroundings of a scenario.

        `parameters` are those in which it differs from what the scenario says of the robot, the
        plant stays as it is where there are none; messages call them `table`. `lag` (…, N) of its
        motors is in s.
        """
        plant = self.vehicle
        if parameters:
            plant = Vehicle(plant.module, {**scenario.parameters, **parameters}, table)
        environment = Environment.of(plant, scenario, self.actuators.spins)
        actuators = replace(self.actuators, lag=lag)
        sensors = SensorSuite(plant, scenario.sensors)
        return replace(
            self,
            vehicle=plant,
            actuators=actuators,
            environment=environment,
            sensors=sensors if sensors.devices else None,
        )

    @cached_property
    def limited(self) -> bool:
        """True if a thrust, torque or force has a limit."""
        return bool(np.any(np.isfinite(self.actuators.inputs)))

    @property
    def hold(self) -> ZeroOrderHold | None:
        """The law that holds its inputs from one command to the next, if it is one."""
        return self.controller if isinstance(self.controller, ZeroOrderHold) else None

    @property
    def sampled(self) -> SampledControl | None:
        """What samples a law of the package, if one is sampled."""
        hold = self.controller
        return hold if isinstance(hold, SampledControl) and hold.sampled else None

    @cached_property
    def lags(self) -> bool:
        """True if a motor lags."""
        return bool(np.any(self.actuators.lag))

    @property
    def compensates(self) -> bool:
        """True if motors lag, and a law that commands at all times makes up for it."""
        commands = self.hold is None and self.controller.law != "off"
        times = self.actuators.times
        lags = self.lags or (times is not None and bool(np.any(times)))
        return self.compensated and lags and commands

    @cached_property
    def layout(self) -> StateLayout:
        """The layout of the state."""
        contacts = self.environment.around.contacts if self.environment else ()
        actuators = len(self.vehicle.actuator_states) + self.lags * self.vehicle.rotors
        sizes = self.vehicle.layout.q.size, self.vehicle.layout.v.size, 1, actuators
        return StateLayout(*sizes, self.controller.memory, bristles_of(contacts))

    @property
    def size(self) -> int:
        """Length of the state."""
        return self.layout.size

    def start(self, q: Array, v: Array, charge: float = 1.0) -> Array:
        """States (…, size) at time 0, with motors and servos settled at what the law wants.

        Raises `UsageError` for a charge as `check_charge` does.
        """
        check_charge(self.vehicle, charge)
        if self.hold is not None:
            # The first sample sees this before anything is commanded.
            none = np.zeros_like(self.hold.inputs)
            parts = self.parts(self._settled(q, v, none, charge))
            self.hold.start(q, v, partial(self.measured, 0.0, parts, none))
        memory = np.zeros((*v.shape[:-1], self.controller.memory))
        wanted, _ = self.controller.commanded(0.0, q, v, memory, {})
        return self._settled(q, v, wanted, charge)

    def _settled(self, q: Array, v: Array, wanted: Array, charge: float) -> Array:
        """States (…, size) at time 0, with motors and servos settled at wanted inputs (…, nu)."""
        sent = (wanted if self.hold is not None else self.sent(0.0, q, v, wanted)).copy()
        if self.idles(0.0):
            sent[..., : self.vehicle.rotors] = self.actuators.idling
        sent = np.clip(sent, *self.actuators.sent)
        thrusts = sent[..., : self.vehicle.rotors if self.lags else 0]
        settled = np.concatenate([self.vehicle.actuator_state_of(sent), thrusts], axis=-1)
        if has_battery(self.vehicle):
            settled[..., -1] = charge
        memory = np.zeros((*v.shape[:-1], self.controller.memory))
        work, bristles = (np.zeros((*v.shape[:-1], n)) for n in (1, self.layout.bristles))
        if self.bristles is not None:
            bristles[...] = self.bristles
        return np.concatenate([q, v, work, settled, memory, bristles], axis=-1)

    def sent(self, time: float | Array, q: Array, v: Array, wanted: Array) -> Array:
        """Commands (…, nu) of motors and servos for inputs that a law wants at times (…), s."""
        if not turns_servos(self.controller.law):
            q, v, _ = self.controller.reference(time)
        return commands_for(self.controller.vehicle, q, v, wanted, self.actuators.inputs)

    def parts(self, states: Array) -> State[Array]:
        """Parts of states (…, size), the quaternion made of length 1."""
        q, v, work, *others = (states[..., place] for place in self.layout.places)
        return State(self.vehicle.kinematics.normalised(q), v, work[..., 0], *others)

    def inputs(
        self, time: float | Array, parts: State[Array], loads: Loads = NOTHING
    ) -> tuple[Array, Array]:
        """Inputs (…, nu) that are commanded, not yet within limits, and those that act.

        With what makes up for lag of motors; thrusts are those of the motors where they lag.
        Raises `AllocationError` if no thrusts at all produce the wrench.
        """
        commanded, _, acting = self.commands(time, parts, loads)
        return commanded, acting

    def commands(
        self, time: float | Array, parts: State[Array], loads: Loads = NOTHING
    ) -> tuple[Array, Array, Array]:
        """As `inputs`, and between both what is aimed for: commands of motors and servos."""
        instant = {"time": time, **parts._asdict()}
        if self.hold is not None and loads.inputs is None:
            instant["held"], _ = self.hold.commanded(time, parts.q, parts.v, parts.memory, {})
        inputs = self._outputs_of("commands", loads, instant)
        shape = (*parts.q.shape[:-1], len(self.vehicle.inputs))
        names = ("commanded", "aimed", "acting")
        commanded, aimed, acting = (np.broadcast_to(inputs[x], shape) for x in names)
        return commanded, aimed, acting

    def saturated(self, time: float, state: Array) -> list[str]:
        """Names of inputs of which the greatest or the least value is commanded."""
        if not self.limited:
            return []
        commanded, _ = self.inputs(time, self.parts(state), self.loads(time))
        reached = at_limits(commanded, self.actuators.inputs)
        return [self.vehicle.inputs[place] for place in np.flatnonzero(reached)]

    def motion(
        self, time: float | Array, parts: State[Array], aimed: Array, inputs: Array, loads: Loads
    ) -> dict[str, Array]:
        """Accelerations `a` (…, nv) under inputs (…, nu) and all else that acts.

        `aimed` (…, nu) is as of `commands`. `wrenches` (…, f, 6) are on the frames by that but the
        inputs: force, N, and torque about the origin, N m, world axes; `touching` (…, f, 6) those
        of contacts and of the push alone. `contacts` (…, c, 8) are as of `Touch.series`, `holding`
        (…, l) of constraints, 0 where none holds.
        """
        state = {name: getattr(parts, name) for name in ("q", "v", "actuators", "bristles")}
        instant = {"time": time, "u": inputs, "aimed": aimed, **state}
        motion = self._outputs_of("motion", loads, instant)
        if not motion["holding"].size:
            rows = len(getattr(self.vehicle.module, "CONSTRAINT_ROWS", ()))
            motion["holding"] = np.zeros(rows)
        return {
            name: np.broadcast_to(x, (*parts.q.shape[:-1], *x.shape[-_AXES.get(name, 2) :]))
            for name, x in motion.items()
        }

    def contact_wrenches(self, parts: State[Array]) -> Array:
        """Wrenches (…, f, 6) of contacts alone on the frames: N and N m, world axes."""
        state = {name: getattr(parts, name) for name in ("q", "v", "bristles")}
        wrenches = self._outputs_of("contact_wrenches", NOTHING, state)["wrenches"]
        return np.broadcast_to(wrenches, (*parts.q.shape[:-1], *wrenches.shape[-2:]))

    def _outputs_of(self, name: str, loads: Loads, instant: dict[str, Any]) -> dict[str, Array]:
        """Results of a program of the loop by its name, while something acts."""
        held = instant.get("held", loads.inputs)
        around, figures = acting(self.environment, loads)
        key = name, around, held is not None, bool(np.any(loads.idle))
        if key not in self._evaluators:
            whole = loop_program(self, loads._replace(inputs=held))
            self._evaluators[key] = evaluator_of(whole, name)
        constants = constants_of(self.vehicle, self.controller.vehicle)
        values = {"held": held, **self._values, "idle": loads.idle, **figures, **instant}
        outputs = self._evaluators[key](values, constants, self.controller.externals)
        if np.any(outputs.get("refused", 0.0) > 0.0):
            parts = instant if "q" in instant else self.parts(instant["x"])._asdict()
            time, q, v = instant["time"], parts["q"], parts["v"]
            self.controller.commanded(time, q, v, parts["memory"], {})  # It says which wrench.
        return outputs

    @cached_property
    def _evaluators(self) -> dict[Any, Evaluator]:
        return {}

    @cached_property
    def _values(self) -> dict[str, Any]:
        """Values of all inputs, but for what acts."""
        return loop_values(self, np.inf, NOTHING)

    def idles(self, time: float | Array) -> Flags:
        """True at times (…), s, when motors idle: by themselves, or while a constraint holds."""
        alone = self.actuators.idles(time)
        return alone if self.environment is None else alone | self.environment.idles(time)

    def loads(self, time: float | Array) -> Loads:
        """Loads at times (…), s."""
        idle, around = self.idles(time), self.environment
        if around is None:
            return Loads(idle=idle)
        push, payloads = around.push_acts(time), around.carries(time)
        holds, stops = around.holding(time), around.restitution(time) >= 0.0
        return Loads(push, payloads, idle=idle, holds=holds, stops=stops)

    def struck(self, states: Array, active: Any, restitution: Any = 0.0) -> tuple[Array, ...]:
        """States (…, size) after an impact on active constraints (c) of some restitution (c).

        And kinetic energies (…), J, that are lost, as work done, and left, and impulses (…, l).
        """
        vehicle = self.vehicle
        q, v, work, *_ = self.parts(states)
        hits = np.asarray(active, dtype=np.float64)
        after, impulses = vehicle.function("impact")(q, v, hits, restitution * hits)
        left = vehicle.kinetic_energy(q, after)
        lost = vehicle.kinetic_energy(q, v) - left
        successors = states.copy()
        successors[..., self.layout.places.v] = after
        successors[..., self.layout.places.work] = (work - lost)[..., np.newaxis]
        return successors, lost, left, impulses

    def stopped(self, time: float, state: Array, loads: Loads) -> bool:
        """True where a frame comes to a stop from outside, or one on which it rests would pull."""
        instant, watched = {"time": time, "x": state}, bool(np.any(loads.stops))
        return watched and bool(self._outputs_of("stop", loads, instant)["stopped"] > 0.0)

    def resting(self, rests: Rests) -> ClosedLoop:
        """The same with frames that rest on stops."""
        if self.environment is None or self.environment.rests == rests:
            return self
        return replace(self, environment=replace(self.environment, rests=rests))

    def derivative(self, time: float, state: Array, loads: Loads = NOTHING) -> Array:
        """Time derivative (size) of a state, NaN for a state that is not finite.

        What acts is given, since an integrator may ask for the end of an interval without a push,
        which is when the push begins.
        """
        if not np.all(np.isfinite(state)):
            return np.full_like(state, np.nan)
        return self._outputs_of("slope", loads, {"time": time, "x": state})["rate"]

    def step(self, time: float, state: Array, size: float, loads: Loads = NOTHING) -> Array:
        """The state (size) after one step of the classical method of Runge and Kutta, of s."""
        if not np.all(np.isfinite(state)):
            return np.full_like(state, np.nan)
        with np.errstate(all="ignore"):
            return self._outputs_of("after", loads, {"time": time, "x": state, "h": size})["x_next"]

    def begun(self, interval: SmoothInterval, state: Array) -> tuple[SmoothInterval, str]:
        """An interval with the inputs held through it, after samples that are due, and a reason.

        That is why the flight cannot go on, "" if it can. `state` is that at its begin.
        """
        if self.hold is None:
            return interval, ""
        inputs = self.hold.inputs

        def sample() -> tuple[Array, Array, Measure]:
            parts = self.parts(state)
            return parts.q, parts.v, partial(self.measured, interval.begin, parts, inputs)

        stopped = self.hold.begin(interval.begin, sample)
        loads = interval.loads._replace(inputs=self.hold.inputs)
        return interval._replace(loads=loads), stopped

    def took(self, law: SampledControl, ahead: Samples, begun: int, states: Array | None) -> None:
        """Keep what a law commanded, and sensors read, at the begins of intervals ahead.

        So many were `begun`, in `states` (begun, size), which sensors read.
        """
        if states is not None and law.readings is not None:
            held = ahead.commands[np.append(0, ahead.acting[: begun - 1])]
            measured = self.measured(ahead.begins[:begun], self.parts(states), held).sensors
            for time, row in zip(ahead.begins.tolist(), measured, strict=False):
                law.readings.take(time, partial(np.asarray, row))
        law.took(ahead, begun)

    def measured(self, time: float | Array, parts: State[Array], inputs: Array) -> Measured:
        """Measurements of sensors without noise in a state while inputs (nu) are held."""
        loads = self.loads(time)._replace(inputs=inputs)
        _, aimed, acting = self.commands(time, parts, loads)
        motion = self.motion(time, parts, aimed, acting, loads)
        moved, touching = (parts.q, parts.v, motion["a"]), motion["touching"]
        readings = self.sensors.measurements(*moved, touching) if self.sensors else np.zeros(0)
        others = motion["holding"], readings, acting
        return Measured(motion["a"], touching, parts.actuators, *others)

    def smooth_intervals(self, begin: float, end: float) -> Iterator[SmoothInterval]:
        """The intervals of a flight between which the push, held inputs and motors may change.

        Each begins where the one before ends; they are without the inputs that are held.
        """
        if not begin < end:  # Nothing is left of a duration that rounding takes.
            return
        times = [begin, *(time for time in self._jumps if begin < time < end), end]
        if self.hold is not None and len(instants := self.hold.instants(begin, end)):
            near = np.abs(instants[:, np.newaxis] - times) <= self.hold.same
            times = np.sort([*times, *instants[~near.any(axis=1)]]).tolist()
        for first, last in itertools.pairwise(times):
            yield SmoothInterval(first, last, self.acting[bisect_right(self._jumps, first)])

    @cached_property
    def _jumps(self) -> list[float]:
        """Times, s, at which what acts, or how it changes, jumps."""
        around = self.environment
        return sorted({*self.actuators.span, *(around.jumps if around else ())})

    @cached_property
    def acting(self) -> list[Loads]:
        """Loads before the first jump, and from each on, without the inputs that are held."""
        stages = []
        for time in [-np.inf, *self._jumps]:
            loads = self.loads(time)
            payloads, *holds = (
                tuple(np.atleast_1d(values).tolist())
                for values in (loads.payloads, loads.holds, loads.stops)
            )
            stages.append(Loads(bool(loads.push), payloads, None, bool(loads.idle), *holds))
        return stages


def loop_values(
    closed: ClosedLoop, bounds: Array | float, loads: Loads, exact: float = DOUBLE
) -> dict[str, Any]:
    """Values of the inputs of a closed loop's program by their names, while something acts.

    `bounds` of errors, then of their rates, are (2 nv) or one number. `exact` is DOUBLE or SINGLE.
    """
    plant, lag = closed.vehicle, closed.actuators.lag
    values = {
        **closed.controller.values,
        **closed.actuators.values,
        **closed.actuators.of_commands,
        "lag": lag,
        "pace": np.divide(1.0, lag, out=np.zeros(np.shape(lag)), where=lag > 0.0),
        "centre": plant.lever,
        "wrenches": np.swapaxes(plant.thrust_wrenches(), -1, -2),
        "losses": plant.damping,
        "bounds": np.broadcast_to(bounds, (*np.shape(bounds)[:-1], 2 * plant.layout.v.size)),
        "largest_lean": LARGEST_THETA_0,
        "exact": exact,
        "idle": loads.idle,
        "idling": closed.actuators.idling,
    }
    if loads.inputs is not None:
        values["held"] = np.array(loads.inputs)
    return values | acting(closed.environment, loads)[1]


def loop_program(
    closed: ClosedLoop, loads: Loads, varying_inputs: Collection[str] = ()
) -> closed_loop.LoopStructure:
    """The closed loop as an array program, while something acts.

    `varying_inputs` are names of inputs that differ from flight to flight.
    """
    law, held = closed.controller, loads.inputs is not None
    return law_program(
        law.vehicle,
        law.allocation,
        "held" if held else law.law,
        None if held else law.moved,
        integral=law.memory > 0,
        limited=closed.limited,
        lags=closed.lags,
        compensates=closed.compensates and not held,
        idles=bool(np.any(loads.idle)),
        around=acting(closed.environment, loads)[0],
        varying_inputs=varying_inputs,
    )


def sample_program(closed: ClosedLoop, law: Controller, loads: Loads) -> Program:
    """The program by which a law that is sampled commands the robot, while something acts."""
    around = acting(closed.environment, loads)[0]
    return law.program(limited=True, lags=closed.lags, around=around).sample()


def acting(environment: Environment | None, loads: Loads) -> tuple[Surroundings, dict[str, Any]]:
    """Surroundings, with the frames on which they act, and their figures."""
    if environment is None:
        return NO_SURROUNDINGS, {}
    return environment.under(loads.push, loads.payloads, loads.holds, loads.stops)
