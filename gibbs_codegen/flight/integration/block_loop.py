"""Many flights of one robot side by side, in compiled code."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.compiled_loop import is_compiled, steps_of
from gibbs_codegen.flight.integration.envelope import Envelope
from gibbs_codegen.flight.integration.integrators import StepGrid, whole_history
from gibbs_codegen.flight.integration.state_history import (
    InputRanges,
    Loads,
    SmoothInterval,
    StateHistory,
)
from gibbs_codegen.flight.plant.vehicle import Array, Flags
from gibbs_codegen.flight.scenario.parts import Settings
from gibbs_codegen.runtime.blocks import Blocks
from gibbs_codegen.runtime.c_library import CompilerError
from gibbs_codegen.runtime.cache import CacheError
from gibbs_codegen.runtime.program_steps import ProgramSteps, Taken

_log = logging.getLogger("gibbs_codegen")
# Steps that a call takes on at most, so that progress shows and Ctrl-C is heard: the same however
# many flights there are, since each call rounds the time anew.
_STEPS_A_CALL = 1000


@dataclass(frozen=True)
class BlockIntegration:
    """Many flights that differ in parameters of the plant, in lag and in where they start.

    `loop` is the closed loop of all, whose arrays have an axis of the flights where these differ.
    `one` gives the closed loop of a flight by its number. With `single` C computes in single
    precision.
    """

    loop: ClosedLoop
    one: Callable[[int], ClosedLoop]
    settings: Settings
    duration: float
    threads: int = 1
    single: bool = False

    def __call__(
        self, starts: Array, progress: Callable[[float], None] = lambda time: None
    ) -> list[StateHistory | None]:
        """Histories from states (n, size) at time 0 on, as `integrate` gives them.

        None for a flight to be integrated by itself: its law refuses a state, or there are no
        compiled blocks. `progress` is told the time reached, s.
        """
        states = _BlockStates(self, starts)
        for interval in self.loop.smooth_intervals(0.0, self.duration):
            states.advance(interval, progress)
        return states.histories()

    def block(self, bounds: Array | float, loads: Loads, count: int) -> ProgramSteps | None:
        """The steps of all while something acts; None where module, law or loop is not compiled."""
        try:
            if is_compiled(self.loop, loads):
                return steps_of(self.loop, bounds, loads, count, Blocks.widest(single=self.single))
        except (CompilerError, CacheError) as error:
            _log.warning("flights are taken one by one: %s", error)
        return None

    def envelope(self, loop: ClosedLoop) -> Envelope:
        """Where control counts as lost, of all flights or of one."""
        return Envelope(loop, self.settings.divergence, self.duration)


class _BlockStates:
    """How far flights have come, and their samples."""

    def __init__(self, plan: BlockIntegration, starts: Array) -> None:
        self._plan, self._grid = plan, StepGrid(plan.settings)
        self._bounds = plan.envelope(plan.loop).bounds
        count = len(starts)
        self._times, self._samples = [np.zeros(1)], [starts[:, np.newaxis]]
        self._kept = np.ones(count, dtype=np.int64)
        self._last, self._ends = starts.copy(), np.zeros(count)
        # Flights that are still under way, and those that must be integrated by themselves.
        self._flies, self._alone = np.ones(count, dtype=bool), np.zeros(count, dtype=bool)
        self._reasons: dict[int, str] = {}
        for i in np.flatnonzero(~self._goes_on()).tolist():
            self._end(i)

    def advance(self, interval: SmoothInterval, progress: Callable[[float], None]) -> None:
        """Integrate over an interval, which begins where the last one ended."""
        plan, count = self._plan, len(self._last)
        block = plan.block(self._bounds, interval.loads, count)
        if block is None:
            self._alone[:] = True
            return
        self._times.append(self._grid.sample_times(interval))
        time = interval.begin
        for stretch in self._grid.stretches(interval):
            for done in range(0, stretch.steps, _STEPS_A_CALL):
                if not self._flies.any():
                    return
                steps, number = min(_STEPS_A_CALL, stretch.steps - done), stretch.first + done
                found = block(
                    time,
                    self._last,
                    stretch.step,
                    steps,
                    stretch.every,
                    number,
                    going=self._flies,
                    threads=plan.threads,
                )
                taken = found.taken
                self._kept += (number + taken) // stretch.every - number // stretch.every
                self._samples.append(found.samples)
                time = min((number + steps) * self._grid.size, interval.end)
                ends = np.where(taken < steps, (number + taken) * self._grid.size, time)
                self._go_on(found, np.minimum(ends, interval.end), taken == steps)
                progress(time)

    def histories(self) -> list[StateHistory | None]:
        """The histories; None of flights that must be integrated by themselves."""
        loop = self._plan.loop
        time, states = np.concatenate(self._times), np.concatenate(self._samples, axis=1)
        envelope, ranges = self._plan.envelope(loop), InputRanges.none(len(loop.vehicle.inputs))
        found: list[StateHistory | None] = []
        for i, kept in enumerate(self._kept.tolist()):
            reason, end = self._reasons.get(i, ""), float(self._ends[i])
            history = StateHistory(time[:kept], states[i, :kept], reason, ranges)
            # Of a flight that went on to the end, all samples have been looked at.
            if reason or end > time[kept - 1]:
                history = whole_history(history, end, self._last[i], envelope)
            found.append(None if self._alone[i] else history)
        return found

    def _go_on(self, found: Taken, ends: Array, finished: Flags) -> None:
        """Take the states to which flights under way have come, at times `ends` (n), s.

        `finished` (n) says whether all steps were taken.
        """
        flies = self._flies
        self._last[flies], self._ends[flies] = found.last[flies], ends[flies]
        self._alone |= flies & found.refused
        self._flies = flies & ~found.refused
        for i in np.flatnonzero(self._flies & ~(finished & self._goes_on())).tolist():
            self._end(i)

    def _goes_on(self) -> Flags:
        """Which flights can go on from where they are."""
        return self._plan.envelope(self._plan.loop).goes_on(self._ends, self._last)

    def _end(self, i: int) -> None:
        """End a flight, with the reason; one without any is integrated by itself."""
        envelope = self._plan.envelope(self._plan.one(i))
        self._reasons[i] = envelope.reason(float(self._ends[i]), self._last[i])
        self._alone[i], self._flies[i] = not self._reasons[i], False
