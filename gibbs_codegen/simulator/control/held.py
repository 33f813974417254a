"""Inputs that are held from one command to the next.

A command takes effect a delay after it was given. Until the first one does, its value acts already:
a flight begins as if it had been commanded for long. All commands are recorded, since whoever gave
them may not be asked again.
"""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np

from gibbs_codegen.errors import printable
from gibbs_codegen.simulator.control.laws import ControlLaw, Gains
from gibbs_codegen.simulator.plant.allocation import Allocation
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle
from gibbs_codegen.simulator.reference import Reference

# Instants are the same, to this share of a millisecond, and of the time between two samples.
_SAME = 1e-6


class HeldInputs:
    """A law of control that commands what it was last told.

    A command takes effect `delay`, s, later; `rate` is commands a second, Hz, 0 if they come when
    they come. `law` knows the robot, the desired motion and the decay of errors.
    """

    # Nothing that is remembered is integrated with the state.
    memory = 0

    def __init__(self, law: ControlLaw, name: str, delay: float = 0.0, rate: float = 0.0) -> None:
        self.vehicle: Vehicle = law.vehicle
        self.reference: Reference = law.reference
        self.allocation: Allocation = law.allocation
        self.gains: Gains = law.gains
        self.law: str = name
        self.delay, self.rate = delay, rate
        # Time, s, by which instants may differ that count as the same.
        self.same = _SAME * min(1e-3, 1.0 / rate if rate else 1.0)
        # The inputs (nu) that act.
        self.held: Array = np.zeros(len(law.vehicle.inputs))
        self._pending: deque[tuple[float, Array]] = deque()
        self._times: list[float] = []
        self._commands: list[Array] = []

    def fault(self, command: Any) -> str:
        """What is wrong with a command that should be inputs u (nu), "" if nothing is."""
        names = self.vehicle.inputs
        wanted = f"{len(names)} inputs: {', '.join(names)}"
        if command is None:
            return f"None, and not {wanted}"
        try:
            numbers = np.asarray(command, dtype=np.float64)
        except (TypeError, ValueError):
            return f"{printable(repr(command), 60)}, and not {wanted}"
        if numbers.shape != (len(names),):
            return f"an array of shape {numbers.shape}, and not {wanted}"
        wrong = np.flatnonzero(~np.isfinite(numbers))
        return f"{numbers[wrong[0]]} for {names[wrong[0]]}" if len(wrong) else ""

    def command(self, time: float, inputs: Array) -> None:
        """Give a command u (nu), which takes effect later by the delay."""
        self._pending.append((time + self.delay, np.array(inputs, dtype=np.float64)))
        if not self._times:
            self._act(-np.inf, self._pending[0][1])

    def start(self, q: Array, v: Array) -> None:
        """Begin a flight, for which a first command was given."""

    def forget(self) -> None:
        """Forget all commands, before a flight."""
        self._pending.clear()
        self._times, self._commands = [], []
        self.held = np.zeros_like(self.held)

    def instants(self, begin: float, end: float) -> Array:
        """Times after `begin` and before `end`, s, at which a command takes effect, in order."""
        times = np.array([time for time, _ in self._pending], dtype=np.float64)
        return self._inside(times, begin, end)

    def _inside(self, times: Array, begin: float, end: float) -> Array:
        """Times between two others, in order and without those that count as the same."""
        times = np.unique(times[(times > begin + self.same) & (times < end - self.same)])
        return times[np.diff(times, prepend=-np.inf) > self.same]

    def begin(self, time: float, q: Array, v: Array) -> str:
        """Let the commands that are due take effect; why the flight cannot go on, "" if it can.

        Times must not decrease from call to call.
        """
        while self._pending and self._pending[0][0] <= time + self.same:
            self._act(*self._pending.popleft())
        return ""

    def _act(self, time: float, command: Array) -> None:
        self.held = command
        self._times.append(time)
        self._commands.append(command)

    def __call__(self, time: float | Array, q: Array, v: Array, memory: Array) -> Array:
        """Inputs u (…, nu) that were commanded at times (…), s, whatever state and memory were.

        They are 0 where no command was given.
        """
        places = np.searchsorted(self._times, np.asarray(time) + self.same, side="right") - 1
        commanded: Array = np.array(self._commands or [self.held])[places]
        return commanded

    def growth(self, time: float | Array, q: Array, v: Array, memory: Array) -> Array:
        """The time derivative (…, 0) of a memory of nothing."""
        return memory
