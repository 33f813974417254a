"""Flights of one state in Python: what `emitted/flight.c` does where nothing is compiled.

Equal steps are by the classical method of Runge and Kutta, those of adaptive size by SciPy.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import scipy

from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.envelope import Envelope
from gibbs_codegen.flight.integration.state_history import SAME_TIME, InputRanges, Loads
from gibbs_codegen.flight.plant.vehicle import Array
from gibbs_codegen.runtime.program_flow import ENDED, GOES_ON, TOO_SHORT, TOO_SLOW, Flow, Leg

# States whose inputs are computed at once: bounds the memory.
_BATCH = 4096
# Shares of a step at which inputs are looked at.
_SHARES = np.array([0.25, 0.5, 0.75, 1.0])
# How often a step is halved, down to the time at which it comes to its end.
HALVINGS = 40
# Knots at which steps end before one across a knot is tried again.
_MOST_STOPS = 64


class PythonFlow:
    """A closed loop that Python flies while the same acts; `Flow` says how, and how far it came.

    From a state (size) it returns samples (s, size) and the last state.
    """

    def __init__(self, loop: ClosedLoop, envelope: Envelope, loads: Loads) -> None:
        self.loop, self.envelope, self.loads = loop, envelope, loads
        self._ranges: list[InputRanges] = []
        self._times: list[float] = []
        self._states: list[Array] = []

    def step(self, flow: Flow, leg: Leg, state: Array) -> tuple[Array, Array]:
        """One equal step."""
        before = leg.number + flow.done
        self._see(flow.time, state)
        begin, after = flow.time, partial(self.loop.step, flow.time, state, loads=self.loads)
        state = after(leg.step)
        flow.done += 1
        end, reached = leg.end, (before + 1) * leg.step
        flow.time = end if flow.done >= leg.count else min(reached, end)
        flow.reason = ENDED if self._ends(flow.time, state) else GOES_ON
        if flow.reason and flow.halvings:
            flow.time = self._first_end(lambda time: after(time - begin), begin, flow.time)
            return np.zeros((0, len(state))), after(flow.time - begin)
        return state[np.newaxis][: (before + 1) % leg.every == 0], state

    def steps(
        self,
        flow: Flow,
        leg: Leg,
        state: Array,
        scale: Array,
        times: Array,
        derivative: Callable[[float, Array], Array],
        progress: Callable[[float], None],
    ) -> tuple[Array, Array]:
        """Steps of adaptive size to the end of the leg; `progress` is called with the time, s.

        `scale` (size) is that of absolute tolerances, `times` are those of samples to come, s.
        """
        end = leg.end
        first = min(flow.step, end - flow.time)
        solver = scipy.integrate.DOP853(derivative, flow.time, state, end, first_step=first)
        samples, spent, stops, patience = [np.zeros((0, len(state)))], 0, 0, 1
        flow.reason = GOES_ON
        while flow.time < end and not flow.reason:
            rough = self._is_rough(flow, solver.y)
            solver.rtol, solver.atol = flow.relative[rough], flow.absolute[rough] * scale
            knot = _next_knot(flow)
            solver.t_bound, solver.status = (min(knot, end) if stops else end), "running"
            after = min(flow.time + solver.h_abs, solver.t_bound)
            with np.errstate(all="ignore"):
                solver.step()
            if solver.status == "failed":
                flow.reason = TOO_SHORT
                break
            path, before = solver.dense_output(), flow.time
            flow.time, state = solver.t, solver.y
            stops -= stops > 0 and flow.time >= knot
            if after > knot:
                patience = 1 if flow.time > knot else min(2 * patience, _MOST_STOPS)
                stops = 0 if flow.time > knot else patience
            if self._ends(flow.time, state):
                flow.time, flow.reason = self._first_end(path, before, flow.time), ENDED
                state = path(flow.time)
            flow.taken = flow.time - before
            for instant in (before + _SHARES * flow.taken).tolist():
                self._see(instant, path(instant))
            inside = times[(times > before) & (times <= flow.time)]
            if len(inside):
                samples.append(path(inside).T)
            flow.budget = min(flow.budget + flow.taken * flow.income, flow.most)
            flow.budget, spent = flow.budget - (solver.nfev - spent), solver.nfev
            if not flow.reason and flow.budget < 0.0:
                flow.reason = TOO_SLOW
            progress(flow.time)
        flow.step = solver.h_abs
        return np.concatenate(samples), state

    def _ends(self, time: float, state: Array) -> bool:
        """True if the flight cannot go on from a state, or comes to a stop."""
        reason = self.envelope.reason(time, state)
        return bool(reason) or self.loop.stopped(time, state, self.loads)

    def _first_end(self, path: Callable[[float], Array], good: float, bad: float) -> float:
        """A time, s, at which the flight ends, but for rounding the first one.

        `path` gives the state (size) at times of the step, from `good` to `bad`, s, where it ends.
        """
        for _ in range(HALVINGS):
            middle = 0.5 * (good + bad)
            if self._ends(middle, path(middle)):
                bad = middle
            else:
                good = middle
        return bad

    def _is_rough(self, flow: Flow, state: Array) -> bool:
        """True if rates have kinks where the flight is."""
        inside = flow.smooth == 2 and self.loop.saturated(flow.time, state)
        return flow.smooth == 0 or bool(inside)

    def _see(self, time: float, state: Array) -> None:
        """Look later at the inputs of a state (size) at a time, s, if it is finite."""
        if np.all(np.isfinite(state)):
            self._times.append(time)
            self._states.append(state)
        if len(self._times) >= _BATCH:
            self.ranges()

    def ranges(self) -> list[InputRanges]:
        """The ranges of inputs of the states that were come to, of which each is a stretch."""
        if not self._times:
            return self._ranges
        time, states = np.array(self._times), np.stack(self._states)
        both = self.loop.inputs(time, self.loop.parts(states), self.loads)
        inputs = np.stack(both, axis=1)
        self._times.clear()
        self._states.clear()
        self._ranges.append(InputRanges(time, np.stack([inputs, inputs], axis=2)))
        return self._ranges


def _next_knot(flow: Flow) -> float:
    """The first knot after a time: there the third derivatives of the desired motion jump."""
    if flow.piece <= 0.0:
        return math.inf
    pieces = math.floor((flow.time - flow.begin) / flow.piece + SAME_TIME) + 1
    return flow.begin + pieces * flow.piece
