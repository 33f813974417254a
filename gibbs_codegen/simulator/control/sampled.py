"""Laws of control, and controllers of users, that are evaluated at a rate."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.scenario.scenario import Scenario
from gibbs_codegen.simulator.control.held import HeldInputs
from gibbs_codegen.simulator.control.integral import kept_from_winding
from gibbs_codegen.simulator.control.laws import ControlLaw
from gibbs_codegen.simulator.control.sensing import Observation, Sensing
from gibbs_codegen.simulator.plant.actuators import Actuators
from gibbs_codegen.simulator.plant.vehicle import Array

# Samples a second where a law has to be sampled and nobody says how often.
DEFAULT_RATE = 1000.0
# Of a controller, Hz.
_LOWEST_RATE = 0.1


class OwnController(Protocol):
    """A controller of a user: any callable that takes an observation and returns inputs.

    It may have attributes `rate`, Hz, and `delay`, s, which come before those of the scenario, and
    a method `reset()`, which is called before a flight.
    """

    def __call__(self, observation: Observation, /) -> Any:
        """Inputs u (nu) for an observation: thrusts, N, then torques and forces of the joints."""


class LawAsController:
    """A law of the simulator that is told observations, and remembers from sample to sample.

    While an input is at a limit of `actuators`, nothing that is remembered grows.
    """

    def __init__(self, law: ControlLaw, actuators: Actuators, rate: float) -> None:
        self._law, self._actuators, self._rate = law, actuators, rate
        self.reset()

    def reset(self) -> None:
        """Forget what was remembered."""
        self._memory = np.zeros(self._law.memory)

    def __call__(self, observation: Observation) -> Array:
        """Inputs u (nu) for an observation; what is remembered grows as in the period after it."""
        seen = observation.time, observation.q, observation.v, self._memory
        inputs = self._law(*seen)
        at_limit = np.any(self._actuators.reached(inputs))
        growth = kept_from_winding(self._law.growth(*seen), self._memory, at_limit)
        self._memory = self._memory + growth / self._rate
        return inputs


class Sampled(HeldInputs):
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
        self._taken = 0

    def start(self, q: Array, v: Array) -> None:
        """Begin a flight: forget what was, and take the first sample.

        Raises `UsageError` if the first command is not what inputs must be.
        """
        self.forget()
        self._taken = 0
        self._sensing.reset()
        reset = getattr(self._controller, "reset", None)
        if reset is not None:
            reset()
        if fault := self.begin(0.0, q, v):
            raise UsageError(fault)

    def instants(self, begin: float, end: float) -> Array:
        """Times after `begin` and before `end`, s, of samples and effects of commands, in order."""
        late = self._sensing.delay
        first = max(int((begin - self.delay) * self.rate) - 1, 0)
        last = int(np.ceil((end + late) * self.rate)) + 1
        samples = np.arange(first, last) / self.rate
        return self._inside(np.concatenate([samples - late, samples + self.delay]), begin, end)

    def begin(self, time: float, q: Array, v: Array) -> str:
        """Take due samples, and let due commands take effect; the fault of a command, "" if none.

        A sample is taken of the state that its observation tells, which is earlier by the delay of
        the sensors. Times must not decrease from call to call.
        """
        while (sampled := self._taken / self.rate) - self._sensing.delay <= time + self.same:
            self._taken += 1
            inputs = self._controller(self._sensing(sampled, q, v))
            if fault := self.fault(inputs):
                return f"at t = {sampled:.6g} s the controller returned {fault}"
            self.command(sampled, inputs)
        return super().begin(time, q, v)


def law_in_time(
    law: ControlLaw,
    scenario: Scenario,
    actuators: Actuators,
    controller: OwnController | None = None,
) -> ControlLaw:
    """A law as a scenario evaluates it: at all times, or at a rate.

    `controller`, if given, commands instead of the law. The law itself if nothing has a rate:
    neither scenario nor controller nor sensors. Raises `UsageError` if the controller is no
    callable, or its rate or delay is not what it must be.
    """
    control, sensors = scenario.control, scenario.sensors
    rate, delay = control.rate, control.delay
    if controller is None:
        if rate is None and sensors is None:
            return law
    else:
        if isinstance(controller, type):
            name = controller.__name__
            raise UsageError(f"controller: {name} is a class: give an instance, such as {name}()")
        if not callable(controller):
            raise UsageError(
                f"controller: {printable(repr(controller), 60)} cannot be called; give a function "
                "or an object that takes an Observation and returns inputs"
            )
        rate = _number(controller, "rate", rate, least=_LOWEST_RATE)
        delay = _number(controller, "delay", delay, least=0.0) or 0.0
    rate = rate or DEFAULT_RATE
    sensing = Sensing(law.vehicle, law.reference, sensors)
    if controller is None:
        return Sampled(law, rate, delay, sensing, LawAsController(law, actuators, rate), law.law)
    return Sampled(law, rate, delay, sensing, controller)


def _number(
    controller: OwnController, name: str, otherwise: float | None, least: float
) -> float | None:
    """A number that a controller may have as an attribute, `otherwise` if it has none.

    Raises `UsageError` if it is no number, or less than `least`.
    """
    found = getattr(controller, name, None)
    if found is None:
        return otherwise
    number = isinstance(found, int | float | np.number) and not isinstance(found, bool)
    if not (number and least <= found < np.inf):
        unit = {"rate": "Hz", "delay": "s"}[name]
        raise UsageError(
            f"controller: its {name} must be a number of {least:g} {unit} or more, not "
            f"{printable(repr(found), 60)}"
        )
    return float(found)
