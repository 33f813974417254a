"""A flight of which the caller owns the loop: inputs in, an observation out, step by step."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from functools import partial
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.arguments import numbers, seconds, vector
from gibbs_codegen.flight.control.observation import Measured
from gibbs_codegen.flight.control.sampled_control import (
    DEFAULT_RATE,
    Observation,
    Sensing,
    ZeroOrderHold,
)
from gibbs_codegen.flight.desired.trajectory import Progress
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.compiled_loop import CompiledLoops
from gibbs_codegen.flight.integration.integrators import Integration
from gibbs_codegen.flight.plant.actuators import check_charge
from gibbs_codegen.flight.plant.kinematics import UNIT, unit_quaternions
from gibbs_codegen.flight.plant.sensors import Reading
from gibbs_codegen.flight.plant.vehicle import Array
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.record.recording import flight_of
from gibbs_codegen.flight.scenario.file import AnyScenario
from gibbs_codegen.flight.simulation import flight_start
from gibbs_codegen.machine.state import State


class Simulation:
    """A flight in steps of the caller, with everything in the scenario.

    Only its law of control is not looked at: inputs are those of `step`, held until the next ones,
    with `control.delay`, limits, lag of the motors, and sensors. The scenario's duration is no
    limit.

    Args:
        robot: a generated module with the back end "numpy" or "c", or the name or path of one.
        scenario: a scenario, or what `read_scenario` takes.
        progress: is called with the name of the work and the share done, 0 to 1.

    Raises:
        UsageError: for a flight that cannot begin.
    """

    def __init__(
        self,
        robot: ModuleType | str | os.PathLike[str],
        scenario: AnyScenario,
        progress: Progress = lambda stage, share: None,
    ) -> None:
        start = flight_start(robot, scenario, progress, custom_law=True)
        self._scenario, control = start.scenario, start.scenario.control
        law = start.loop.controller
        self._hold = ZeroOrderHold(law, "own", control.delay)
        sensors = start.scenario.sensors
        known = sensors, control.estimation, start.scenario.integration.rate
        self._sensing = Sensing(law.vehicle, law.reference, *known)
        self._hold.readings, self._hold.estimator = self._sensing.readings, self._sensing.estimator
        self._loop = replace(start.loop, controller=self._hold)
        self._start, self._bristles = (start.q, start.v), start.loop.bristles
        self._compiled: CompiledLoops | None = None
        # Accelerations, and when they were asked for, s.
        self._growth: tuple[float, Array] | None = None
        self._usual = 1.0 / (control.rate or DEFAULT_RATE)
        self.reset()

    @property
    def loop(self) -> ClosedLoop:
        """Robot, actuators, surroundings and desired motion, for rooms of flight above."""
        return self._loop if self._flight is None else self._flight.loop

    @property
    def time(self) -> float:
        """Time that was flown, s."""
        return 0.0 if self._flight is None else self._flight.time

    @property
    def state(self) -> Array:
        """The state (size) of the loop as it is, for rooms of flight above."""
        if self._flight is None:
            return self._loop.start(*self._begin, self._charge)
        return self._flight.state

    @property
    def q(self) -> Array:
        """Coordinates (nq) as they are, without sensors."""
        return self._now.q.copy()

    @property
    def v(self) -> Array:
        """Velocities (nv) as they are, without sensors."""
        return self._now.v.copy()

    @property
    def a(self) -> Array:
        """Accelerations (nv) as they are, under the inputs that acted before, without sensors."""
        if self._growth is None or self._growth[0] != self.time:
            rate = (self._flight or self._integration()).rate()
            places = self._loop.vehicle.layout
            self._growth = self.time, rate[places.q.size : places.q.size + places.v.size]
        return self._growth[1].copy()

    @property
    def stopped(self) -> str:
        """Why the flight has ended; "" while it runs."""
        return "" if self._flight is None else self._flight.stopped

    @property
    def sensors(self) -> dict[str, Reading]:
        """The last readings of the robot's sensors, by name: `Observation.sensors` as of now."""
        return self._sensing.readings.at(self.time - self._sensing.delay)

    def reset(
        self,
        q: ArrayLike | None = None,
        v: ArrayLike | None = None,
        seed: int | None = None,
        charge: float | None = None,
    ) -> Observation:
        """Begin anew at time 0.

        Args:
            q, v: Coordinates (nq) and velocities (nv); those with which the scenario begins, if
                None.
            seed: Seed of the sensors' noise; if None that of before, initially that of the
                scenario.
            charge: Charge of the battery, 0 to 1; if None that of the scenario.

        Returns:
            Readings of the sensors.

        Raises:
            UsageError: If q or v has the wrong length or is not finite, a quaternion cannot be
                normalised, the seed is not an integer of at least 0, or the charge is not from 0 to
                1.
        """
        start_state = [
            start if values is None else vector(name, values, len(start))
            for name, values, start in zip("qv", (q, v), self._start, strict=True)
        ]
        vehicle = self._loop.vehicle
        unit, right = unit_quaternions(vehicle.module, vehicle.layout, start_state[0])
        if not right:
            raise UsageError(f"q: must be coordinates {UNIT}")
        charged = self._scenario.start.charge
        level = charged if charge is None else float(numbers("charge", charge, "a number", ()))
        check_charge(vehicle, level)
        self._sensing.reset(seed)
        self._begin, self._charge = (unit, start_state[1]), level
        self._loop = replace(self._loop, bristles=self._bristles if q is None else None)
        self._hold.forget()
        self._flight: Integration | None = None
        self._latest: tuple[float, State[Array]] | None = None
        self._growth = None
        # Times, states and inputs from which the flight of a while ago can be flown again.
        self._marks: list[tuple[float, Array, Array]] = []
        self._take()
        return self._seen()

    def prepare(self) -> None:
        """Compile now what steps through the scenario need, so that none of them waits for it."""
        self._integration().prepare(self._scenario.duration)
        if self._loop.sensors:
            self._loop.sensors.prepare()

    def step(self, u: ArrayLike, duration: float | None = None) -> Observation:
        """Fly on with inputs that are held.

        Args:
            u: Inputs (nu): thrusts, N, then torques and forces of the joints, N m and N; of a robot
                with motors and servos their commands.
            duration: How long, s; a period of the scenario's `control.rate` if None, 1 ms without.

        Returns:
            Readings of the sensors after that time, or at the end of the flight: see `stopped`.

        Raises:
            UsageError: If u or duration is not what it must be, or the flight has ended.
        """
        self.advance(u, duration)
        return self._seen()

    def advance(self, u: ArrayLike, duration: float | None = None) -> None:
        """Fly on as `step` does, without an observation, which takes most of the time of a step.

        Args:
            u: Inputs (nu).
            duration: How long, s.

        Raises:
            UsageError: As for `step`.
        """
        ahead = self._usual if duration is None else seconds("duration", duration)
        if fault := self._hold.fault(u):
            raise UsageError(f"u: is {fault}")
        if self.stopped:
            raise UsageError(f"the flight has ended, {self.stopped}; call reset to begin another")
        now = self.time
        self._hold.command(now, np.asarray(u, dtype=np.float64))
        self._flight = self._flight or self._integration()
        for instant in [*self._hold.instants(now, now + ahead), now + ahead]:
            self._fly(self._flight, float(instant))
            self._take()

    def _take(self) -> None:
        """Take the readings that are due now."""
        self._sensing.take(self.time, lambda: (self.q, self.v, self._measured))

    def _measured(self) -> Measured:
        """What is measured now without errors; readings of sensors alone, if all else is unread."""
        suite, reads_all = self._loop.sensors, self._sensing.estimator is not None
        if suite is None or suite.feels_contacts or self._flight is None or reads_all:
            return self.loop.measured(self.time, *self._at())
        none = np.zeros(0)
        return Measured(none, none, none, none, suite.measured(self.q, self.v, self.a))

    def _seen(self) -> Observation:
        """Observations of the sensors now, or of a while ago if they are late."""
        late = max(self.time - self._sensing.delay, 0.0)
        parts, inputs = self._at(late)
        measure = partial(self.loop.measured, late, parts, inputs)
        return self._sensing(self.time, parts.q, parts.v, measure)

    def _integration(self) -> Integration:
        """The flight at its start, with the inputs that were commanded, or none."""
        return self._integrated(self.state, 0.0)

    def _integrated(self, state: Array, begin: float) -> Integration:
        """A flight from a state at a time, s, on."""
        settings, duration = self._scenario.integration, self._scenario.duration
        integration = Integration(self._loop, state, settings, duration, begin, self._compiled)
        self._compiled = integration.compiled
        return integration

    def _fly(self, flight: Integration, end: float) -> None:
        """Fly on while the same inputs act."""
        begin, state = flight.time, flight.state
        flight.advance(end)
        if self._sensing.delay:
            # The flight may have ended before that time.
            oldest = max(flight.time - self._sensing.delay, 0.0)
            needed = [time <= oldest for time, _, _ in self._marks]
            self._marks = self._marks[max(sum(needed) - 1, 0) :]
            self._marks.append((begin, state, self._hold.inputs))

    @property
    def _now(self) -> State[Array]:
        """The state now; taken apart once."""
        if self._latest is None or self._latest[0] != self.time:
            self._latest = self.time, self._at()[0]
        return self._latest[1]

    def _at(self, time: float = math.inf) -> tuple[State[Array], Array]:
        """The state at a time, s, of those flown, the last if later, and the inputs held there."""
        hold = self._hold
        if self._flight is None:
            return self._loop.parts(self.state), hold.inputs
        state, held = self._flight.state, hold.inputs
        if time < self._flight.time - hold.same:
            begin, state, inputs = next(m for m in reversed(self._marks) if m[0] <= time)
            now, hold.inputs, held = held, inputs, inputs
            again = self._integrated(state, begin)
            again.advance(time)
            state = again.state
            hold.inputs = now
        return self._loop.parts(state), held

    def flight(self) -> Flight:
        """The flight so far, as `simulate` records it.

        Before the first step it is one sample, the start, with inputs of 0, or of their least
        values where these are above 0.
        """
        integration = self._flight or self._integration()
        return flight_of(self._loop, self._scenario, integration.history())
