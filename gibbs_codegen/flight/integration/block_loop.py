"""Many flights of one robot side by side, in compiled code."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.compiled_loop import is_compiled, steps_of
from gibbs_codegen.flight.integration.envelope import Envelope, Instant
from gibbs_codegen.flight.integration.integrators import StepGrid, whole_history
from gibbs_codegen.flight.integration.state_history import (
    Impact,
    InputRanges,
    Loads,
    StateHistory,
)
from gibbs_codegen.flight.plant.vehicle import Array, Flags
from gibbs_codegen.flight.scenario.parts import Settings
from gibbs_codegen.runtime.blocks import Blocks
from gibbs_codegen.runtime.c_library import CompilerError
from gibbs_codegen.runtime.cache import CacheError
from gibbs_codegen.runtime.program_steps import ProgramSteps

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
        compiled blocks. `progress` is called with the time reached, s.
        """
        envelope, grid, count = self._envelope(self.loop), StepGrid(self.settings), len(starts)
        around = self.loop.environment
        intervals = [*self.loop.smooth_intervals(0.0, self.duration)]
        times = np.concatenate([np.zeros(1), *map(grid.sample_times, intervals)])
        states = np.empty((count, len(times), starts.shape[1]))
        states[:, 0], filled = starts, 1
        kept, last, ends = np.ones(count, dtype=np.int64), starts.copy(), np.zeros(count)
        # Flights that are still under way, and those that must be integrated by themselves.
        flies, alone = np.ones(count, dtype=bool), np.zeros(count, dtype=bool)
        reasons = dict.fromkeys(range(count), "")
        impacts: list[list[Impact]] = [[] for _ in range(count)]

        def end(which: Flags) -> None:
            """End flights, with the reason; one without any is integrated by itself."""
            for i in np.flatnonzero(which).tolist():
                one = self._envelope(self.one(i), (0.0, starts[i]))
                reasons[i] = one.reason(float(ends[i]), last[i])
                alone[i], flies[i] = not reasons[i], False

        end(~envelope.goes_on(ends, last))
        for interval in intervals:
            block = self._block(envelope.bounds, interval.loads, count)
            if block is None:
                return [None] * count
            time = interval.begin
            if around and around.takes_hold(time):
                # Flights that have ended stay as they were, and may have no numbers.
                with np.errstate(invalid="ignore"):
                    held, *did = self.loop.struck(last, interval.loads.holds)
                last[flies] = held[flies]
                # A sample of now is after the impact.
                if flies.any() and times[filled - 1] == time:
                    states[flies, filled - 1] = last[flies]
                for i in np.flatnonzero(flies).tolist():
                    lost, left, impulses = (x[i] for x in did)
                    impacts[i].append((time, float(lost), float(left), impulses))
            parts = [
                (part, done)
                for part in grid.stretches(interval)
                for done in range(0, part.steps, _STEPS_A_CALL)
            ]
            for stretch, done in parts:
                if not flies.any():
                    break
                steps, number = min(_STEPS_A_CALL, stretch.steps - done), stretch.first + done
                every, going = stretch.every, flies.copy()
                before, filled = filled, filled + (number + steps) // every - number // every
                taken = block(
                    time,
                    last,
                    stretch.step,
                    steps,
                    every,
                    number,
                    going=going,
                    threads=self.threads,
                    samples=states[:, before:filled],
                )
                kept += (number + taken.taken) // every - number // every
                time = min((number + steps) * grid.size, interval.end)
                reached = np.where(taken.taken < steps, (number + taken.taken) * grid.size, time)
                last[going] = taken.last[going]
                ends[going] = np.minimum(reached, interval.end)[going]
                alone |= going & taken.refused
                flies &= ~taken.refused
                end(flies & ~((taken.taken == steps) & envelope.goes_on(ends, last)))
                progress(time)
        ranges = InputRanges.none(len(self.loop.vehicle.inputs))
        histories: list[StateHistory | None] = [None] * count
        for i in np.flatnonzero(~alone).tolist():
            rows, reason, until = slice(kept[i]), reasons[i], float(ends[i])
            hits = tuple(impacts[i])
            history = StateHistory(times[rows], states[i, rows], reason, ranges, hits)
            # A flight that went on to the end has no sample that is not looked at.
            if reason or until > history.time[-1]:
                history = whole_history(history, until, last[i], envelope)
            histories[i] = history
        return histories

    def _block(self, bounds: Array | float, loads: Loads, count: int) -> ProgramSteps | None:
        """The steps of all while something acts; None where module, law or loop is not compiled.

        Nor are there any where frames come to stops, each at a time of its own.
        """
        try:
            if is_compiled(self.loop, loads) and not np.any(loads.stops):
                return steps_of(self.loop, bounds, loads, count, Blocks.widest(single=self.single))
        except (CompilerError, CacheError) as error:
            _log.warning("flights are computed one by one: %s", error)
        return None

    def _envelope(self, loop: ClosedLoop, start: Instant | None = None) -> Envelope:
        """The envelope beyond which control counts as lost, of all flights or of one."""
        return Envelope(loop, self.settings.divergence, self.duration, start)
