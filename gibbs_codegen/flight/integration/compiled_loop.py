"""Closed loops in compiled code, while the same acts on the robots: of one flight, or of many."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from gibbs_codegen.flight.integration.closed_loop import (
    DOUBLE,
    SINGLE,
    ClosedLoop,
    loop_program,
    loop_values,
)
from gibbs_codegen.flight.integration.state_history import NOTHING, InputRanges, Loads
from gibbs_codegen.flight.plant.vehicle import Array
from gibbs_codegen.runtime.blocks import ONE, Blocks
from gibbs_codegen.runtime.c_library import CompilerError
from gibbs_codegen.runtime.cache import CacheError
from gibbs_codegen.runtime.program_flow import ProgramFlow
from gibbs_codegen.runtime.program_steps import ProgramSteps

_log = logging.getLogger("gibbs_codegen")


def is_compiled(closed: ClosedLoop, loads: Loads) -> bool:
    """True if there is C of a module and a law: of any, and of inputs while they are held."""
    compiled = Path(closed.vehicle.module.__file__ or "").suffix == ".so"
    return compiled and (closed.controller.law != "own" or loads.inputs is not None)


def steps_of(
    closed: ClosedLoop,
    bounds: Array | float,
    loads: Loads = NOTHING,
    count: int = 1,
    blocks: Blocks = ONE,
) -> ProgramSteps:
    """Steps of `count` closed loops that share times, desired motion, and what surrounds them.

    One more leading axis of length `count` may be in `closed` on constants of plant and model,
    damping, wrenches and centre of the rotors, lag, limits, gains, and what the geometric law
    knows. `bounds` of errors, then their rates, are (2 nv), (count, 2 nv) or one number. Raises
    `CompilerError`, or `CacheError` where the cache of libraries cannot be used.
    """
    values = loop_values(closed, bounds, loads, SINGLE if blocks.single else DOUBLE)
    program = loop_program(closed, loads).step()
    shapes = {name: x.shape for name, x in zip(program.names, program.inputs, strict=True)}
    varying_inputs = [name for name in shapes if np.ndim(values.get(name, 0.0)) > len(shapes[name])]
    if varying_inputs:
        program = loop_program(closed, loads, varying_inputs).step()
    return ProgramSteps(
        closed.vehicle.module,
        program,
        values,
        _constants(closed),
        closed.controller.tables,
        closed.vehicle.rotors,
        count,
        blocks,
    )


def _constants(closed: ClosedLoop) -> dict[str, object]:
    """Constants by their owners in the program."""
    owners = {"plant": closed.vehicle, "model": closed.controller.vehicle}
    default = closed.vehicle.module.prepare({})
    return {
        name: default if vehicle.constants is None else vehicle.constants
        for name, vehicle in owners.items()
    }


class CompiledLoop:
    """One closed loop in compiled code, while the same acts on the robot.

    Where a wrench is asked for that the rotors cannot produce, Python says so. `goes_on`: whether
    the flight does from the last state. Raises as `steps_of` does.
    """

    def __init__(self, closed: ClosedLoop, bounds: Array | float, loads: Loads = NOTHING) -> None:
        self._closed, self._loads, self.goes_on = closed, loads, True
        self._steps = steps_of(closed, bounds, loads)
        self._inputs = len(closed.vehicle.inputs)

    def hold(self, inputs: Array | tuple[float, ...]) -> None:
        """Hold other inputs (nu) from now on, where inputs are held."""
        self._steps.arguments.arrays["held"][0] = inputs

    def __call__(
        self,
        time: float,
        state: Array,
        step: float,
        count: int,
        every: int = 1,
        number: int = 0,
        seen: Callable[[InputRanges], None] | None = None,
    ) -> tuple[int, Array, Array]:
        """Take steps, fewer where rotors cannot produce a wrench or the flight cannot go on.

        Returns how many were taken, samples (s, size), the last state. Each `every`-th step is a
        sample, where `number` steps came before; `seen` is given ranges of the inputs from sample
        to sample.
        """
        ranges = np.empty((count // every + 2, 2, 2, self._inputs))
        ranges[:, 0], ranges[:, 1] = np.inf, -np.inf
        outcome = self._steps(time, state[np.newaxis], step, count, every, number, ranges=ranges)
        taken, first = int(outcome.taken[0]), number // every
        self.goes_on = bool(outcome.goes_on[0])
        if seen:
            # The first stretch may begin after its sample, and the last one end before it.
            stretches = -(-(number + taken) // every) - first
            middle = time + ((first + 0.5 + np.arange(stretches)) * every - number) * step
            inside = np.maximum(middle, time + 0.25 * step)
            inside = np.minimum(inside, time + (taken - 0.25) * step)
            seen(InputRanges(inside, np.swapaxes(ranges[:stretches], 1, 2)))
        return taken, outcome.samples[0, : (number + taken) // every - first], outcome.last[0]


class CompiledSlope:
    """The time derivative of a closed loop in compiled code, and steps of adaptive size, `flow`.

    All while the same acts on the robot. Raises as `steps_of` does.
    """

    def __init__(self, closed: ClosedLoop, bounds: Array | float, loads: Loads = NOTHING) -> None:
        whole, values = loop_program(closed, loads), loop_values(closed, bounds, loads)
        programs = closed.vehicle.module, whole.slope(), whole.end()
        others = _constants(closed), closed.controller.tables, closed.vehicle.rotors
        self.flow = ProgramFlow(*programs, values, *others)

    def hold(self, inputs: Array | tuple[float, ...]) -> None:
        """Hold other inputs (nu) from now on, where inputs are held."""
        self.flow.arrays["held"][0] = inputs

    def __call__(self, time: float, state: Array) -> Array | None:
        """The derivative (size) of a state; None where the rotors cannot produce a wrench.

        `ClosedLoop.derivative` says more of that.
        """
        return self.flow.slope(time, state)


_Compiled = TypeVar("_Compiled", CompiledLoop, CompiledSlope)


class CompiledLoops:
    """The compiled loops of a closed loop: one for each of what may act, made when it does.

    For all inputs that are held it is the same, which holds those that were given last.
    """

    def __init__(self, closed: ClosedLoop, bounds: Array | float) -> None:
        self.closed, self.bounds = closed, bounds
        self._made: dict[Any, Any] = {}

    def at(self, loads: Loads) -> CompiledLoop | None:
        """The steps while something acts; None where module, law or loop is not compiled."""
        return self._of(CompiledLoop, loads)

    def slope(self, loads: Loads) -> CompiledSlope | None:
        """The derivative, and adaptive steps, while something acts; None as of `at`."""
        return self._of(CompiledSlope, loads)

    def derivative(self, loads: Loads) -> Callable[[float, Array], Array]:
        """The time derivative of states while something acts: compiled, where it can be."""
        slope = self.slope(loads)

        def derivative(time: float, state: Array) -> Array:
            rate = None if slope is None else slope(time, state)
            return self.closed.derivative(time, state, loads) if rate is None else rate

        return derivative

    def _of(self, kind: type[_Compiled], loads: Loads) -> _Compiled | None:
        key = kind, loads._replace(inputs=None), loads.inputs is None
        if key not in self._made:
            self._made[key] = None
            if is_compiled(self.closed, loads):
                try:
                    self._made[key] = kind(self.closed, self.bounds, loads)
                except (CompilerError, CacheError) as error:
                    _log.warning("steps are taken in Python instead of C: %s", error)
        compiled: _Compiled | None = self._made[key]
        if compiled is not None and loads.inputs is not None:
            compiled.hold(loads.inputs)
        return compiled
