"""The inputs of the states that an integrator comes to, and their ranges."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.state_history import Acting, InputRanges
from gibbs_codegen.flight.plant.vehicle import Array

# States whose inputs are computed at once: bounds the memory.
_BATCH = 4096


class SeenInputs:
    """Gathers the inputs of the states that an integrator comes to while the same acts."""

    def __init__(self, loop: ClosedLoop, acting: Acting) -> None:
        self.loop, self.acting = loop, acting
        self._found = [InputRanges.none(len(loop.vehicle.inputs))]
        self._times: list[float] = []
        self._states: list[Array] = []

    def state(self, time: float, state: Array) -> None:
        """Take a state (size) at a time, s."""
        if np.all(np.isfinite(state)):
            self._times.append(time)
            self._states.append(state)
        if len(self._times) >= _BATCH:
            self._compute()

    def path(self, path: Callable[[float], Array], times: Array) -> None:
        """Take states of a path at times (k), s."""
        for time in times.tolist():
            self.state(time, path(time))

    def ranges(self, ranges: InputRanges) -> None:
        """Take ranges that are known already."""
        self._found.append(ranges)

    def found(self) -> InputRanges:
        """The ranges of all that was taken; a state is a stretch of its own."""
        if self._times:
            self._compute()
        return InputRanges.joined(self._found)

    def _compute(self) -> None:
        time, states = np.array(self._times), np.stack(self._states)
        parts = self.loop.parts(states)
        held = self.acting.held
        if held is None:
            commanded = self.loop.commanded(time, parts)
        else:
            commanded = np.tile(np.array(held), (len(time), 1))
        inputs = np.stack([commanded, self.loop.applied(commanded, parts.thrusts)], axis=1)
        self._found.append(InputRanges(time, np.stack([inputs, inputs], axis=2)))
        self._times.clear()
        self._states.clear()
