"""Closed loops in compiled code, while the same acts on the robots: of one flight, or of many."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gibbs_codegen.arrays.nodes import Program
from gibbs_codegen.flight.control.laws import program_of
from gibbs_codegen.flight.integration.closed_loop import (
    DOUBLE,
    SINGLE,
    ClosedLoop,
    loop_program,
    loop_values,
    sample_program,
)
from gibbs_codegen.flight.integration.state_history import NOTHING, Loads
from gibbs_codegen.flight.plant.vehicle import Array
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.runtime.blocks import Blocks
from gibbs_codegen.runtime.c_library import CompilerError
from gibbs_codegen.runtime.cache import CacheError
from gibbs_codegen.runtime.program_flow import Flow, Leg, ProgramFlow, flow_library
from gibbs_codegen.runtime.program_steps import ProgramSteps

_log = logging.getLogger("gibbs_codegen")


def is_compiled(closed: ClosedLoop, loads: Loads) -> bool:
    """True if there is C of a module and a law: of any, and of inputs while they are held."""
    compiled = Path(closed.vehicle.module.__file__ or "").suffix == ".so"
    return compiled and (closed.controller.law != "own" or loads.inputs is not None)


def steps_of(
    closed: ClosedLoop,
    bounds: Array | float,
    loads: Loads,
    count: int,
    blocks: Blocks,
) -> ProgramSteps:
    """Steps of `count` closed loops that share times, desired motion, and what surrounds them.

    One more leading axis of length `count` may be in `closed` on constants of plant and model,
    damping, wrenches and centre of the rotors, lag, limits, gains, and what the geometric law
    knows. `bounds` of errors, then their rates, are (2 nv), (count, 2 nv) or one number. Raises
    `CompilerError`, or `CacheError` where the cache of libraries cannot be used.
    """
    values = loop_values(closed, bounds, loads, SINGLE if blocks.single else DOUBLE)
    program = program_of(loop_program(closed, loads), "step")
    shapes = {name: x.shape for name, x in zip(program.names, program.inputs, strict=True)}
    varying_inputs = tuple(
        name for name in shapes if np.ndim(values.get(name, 0.0)) > len(shapes[name])
    )
    if varying_inputs:
        program = program_of(loop_program(closed, loads, varying_inputs), "step")
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


def _programs(closed: ClosedLoop, loads: Loads, method: str) -> dict[str, Program]:
    """The programs of a closed loop by their names, while something acts."""
    whole = loop_program(closed, loads)
    last = whole.end() if method == "adaptive" else whole.step()
    programs = {program.name: program for program in (whole.slope(), last)}
    if closed.sampled and closed.sampled.sampled:
        programs["sample"] = sample_program(closed, closed.sampled.sampled, loads)
    return programs


def compiled_ahead(closed: ClosedLoop, scenario: Scenario) -> Callable[[], object]:
    """What compiles the loop with which the flight of a scenario begins."""
    loads = next(closed.smooth_intervals(0.0, scenario.duration)).loads
    if closed.hold is not None:
        loads = loads._replace(inputs=closed.hold.inputs)
    programs = _programs(closed, loads, scenario.integration.method)
    return partial(flow_library, closed.vehicle.module, programs)


class CompiledLoop:
    """One closed loop in compiled code, while the same acts on the robot, by one method.

    `flow` flies it from leg to leg; of a law that is sampled it takes the samples too. Where a
    wrench is asked for that the rotors cannot produce, Python says so. Raises as `steps_of` does.
    """

    def __init__(
        self,
        closed: ClosedLoop,
        bounds: Array | float,
        loads: Loads = NOTHING,
        method: str = "rk4",
    ) -> None:
        programs, values = _programs(closed, loads, method), loop_values(closed, bounds, loads)
        law = (closed.sampled and closed.sampled.sampled) or closed.controller
        if sample := programs.get("sample"):
            inputs = zip(sample.names, sample.inputs, strict=True)
            values = {**{name: np.zeros(x.shape) for name, x in inputs}, **law.values, **values}
        others = _constants(closed), law.tables, closed.vehicle.rotors
        self.flow = ProgramFlow(closed.vehicle.module, programs, values, *others)

    def __call__(
        self, time: float, state: Array, step: float, count: int, every: int = 1, number: int = 0
    ) -> tuple[int, Array, Array]:
        """Take equal steps, fewer where rotors cannot produce a wrench or the flight cannot go on.

        Returns how many were taken, samples (s, size), the last state. Each `every`-th step is a
        sample, where `number` steps came before.
        """
        leg = (Leg * 1)(Leg(time, time + count * step, step, count, every, number))
        flow, times = (
            Flow(time, steps=count + 1),
            np.zeros((number + count) // every - number // every),
        )
        flown = self.flow(flow, leg, state, times)
        return flow.done, flown.samples, flown.last

    def slope(self, time: float, state: Array) -> Array | None:
        """The time derivative (size) of a state; None where the rotors cannot produce a wrench.

        `ClosedLoop.derivative` says more of that.
        """
        return self.flow.slope(time, state)


class CompiledLoops:
    """The compiled loops of a closed loop: one for each of what may act, made when it does.

    For all inputs that are held it is the same, which holds those that were given last.
    """

    def __init__(self, closed: ClosedLoop, bounds: Array | float, method: str = "rk4") -> None:
        self.closed, self.bounds, self.method = closed, bounds, method
        self._made: dict[Any, CompiledLoop | None] = {}

    def at(self, loads: Loads) -> CompiledLoop | None:
        """The loop while something acts, which holds its inputs; None where it is not compiled."""
        key = loads.push, loads.payloads, loads.idle, loads.holds, loads.inputs is None
        if key not in self._made:
            self._made[key] = None
            if is_compiled(self.closed, loads):
                try:
                    made = CompiledLoop(self.closed, self.bounds, loads, self.method)
                    self._made[key] = made
                except (CompilerError, CacheError) as error:
                    _log.warning("steps run in Python instead of C: %s", error)
        compiled = self._made[key]
        if compiled is not None and loads.inputs is not None:
            compiled.flow.hold(loads.inputs)
        return compiled

    def derivative(self, loads: Loads) -> Callable[[float, Array], Array]:
        """The time derivative of states while something acts: compiled, where it can be."""
        compiled = self.at(loads)

        def derivative(time: float, state: Array) -> Array:
            rate = None if compiled is None else compiled.slope(time, state)
            return self.closed.derivative(time, state, loads) if rate is None else rate

        return derivative
