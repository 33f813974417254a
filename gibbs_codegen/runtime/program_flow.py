"""Flights of one state in C: `emitted/flight.c` flies them, in equal steps or by `adaptive.c`."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.arrays.c_text import c_functions
from gibbs_codegen.arrays.contents import owners_of
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Node, Program
from gibbs_codegen.files.verbatim import c_source
from gibbs_codegen.runtime.c_library import FLIGHT
from gibbs_codegen.runtime.program_steps import ProgramArguments
from gibbs_codegen.runtime.programs import STEP, c_text, called, entry, library, sizes

Array = NDArray[np.float64]
# Why a call returns, as C numbers it.
GOES_ON, REFUSED, ENDED, TOO_SHORT, TOO_SLOW = range(5)
# Inputs that differ from sample to sample of a law, as `flight.c` names their places in capitals.
_OF_SAMPLES = "held", "errors", "learns", "memory"
# In C functions of what is sampled have names of their own.
_SAMPLED = "sampled_"


class Leg(ctypes.Structure):
    """A leg, through which the same acts on the robot: the members that `emitted/flow.c` has."""

    _fields_ = [
        *((name, ctypes.c_double) for name in ("begin", "end", "step")),
        *((name, ctypes.c_int) for name in ("count", "every", "number", "samples", "command")),
    ]


class Flow(ctypes.Structure):
    """State of a flight, and how far it came: the members that `emitted/flow.c` has."""

    _fields_ = [
        *((name, ctypes.c_double) for name in ("time", "step", "taken", "budget", "income")),
        *((name, ctypes.c_double) for name in ("extra", "most", "begin", "piece")),
        *((name, 2 * ctypes.c_double) for name in ("relative", "absolute")),
        ("scale", ctypes.c_void_p),
        *((name, ctypes.c_int) for name in ("patience", "stops", "smooth", "steps", "wanted")),
        *((name, ctypes.c_int) for name in ("samples", "leg", "legs", "done", "begun")),
        *((name, ctypes.c_int) for name in ("sampled", "reason", "halvings")),
    ]


class Kept(ctypes.Structure):
    """Addresses of what a call reads and leaves: the members that `emitted/flow.c` has."""

    _fields_ = [(name, ctypes.c_void_p) for name in ("times", "samples", "ranges", "begins")]


class Flown(NamedTuple):
    """Samples (s, size), the last state, and ranges (s + 1, 2, 2, nu) of inputs up to each sample.

    The last one is of the time since then. They are the least and the greatest of inputs that are
    commanded and of those that act.
    """

    samples: Array
    last: Array
    ranges: Array


class Samples(NamedTuple):
    """Samples of a law at the begins of intervals: inputs of each, and where C leaves commands.

    So many samples are `due` (k) at times `begins` (k), s, and the command at a place of `acting`
    (k) then acts. `times` (n) and `learns` (n), s, `errors` (n, …), what the law remembers, and
    `commands` (before + n, nu), of which those of `before` the first sample are there.
    """

    begins: Array
    due: NDArray[np.intp]
    acting: NDArray[np.intp]
    times: Array
    learns: Array
    errors: Array
    memory: Array
    commands: Array


def flow_source(programs: Mapping[str, Program], robot: Functions) -> str:
    """C that flies a closed loop by its programs.

    They are its `slope`, its `step` or else its `end`, and `sample`, if its law is sampled.
    """
    names, owners = [*_inputs(programs)], _owners(programs)
    flown = [programs[name] for name in ("step", "slope", "end") if name in programs]
    engine, by_hand = sizes(programs["slope"]), ["flow.c", "adaptive.c", "flight.c"]
    for program in flown:
        outputs = STEP if program.name == "step" else [*program.outputs]
        engine += entry(program.name, [program], owners, names, outputs)
    if "step" in programs:
        by_hand = ["flow.c", "engine.c", "fixed.c", "flight.c"]
    if "sample" in programs:
        sample = programs["sample"]
        first = len(owners) + 1
        numbers = [f"{x.upper()}_AT = {first + names.index(x)}" for x in _OF_SAMPLES]
        engine += [
            "#define SAMPLED",
            f"enum {{ {', '.join(numbers)} }};",
            f"enum {{ OBSERVED = {_inputs(programs)['errors'].size} }};",
            f"enum {{ LEARNT = {sample.outputs['learnt'].size} }};",
            f"enum {{ HELD_WIDTH = {sample.outputs['commands'].size} }};",
            *c_functions([sample], _SAMPLED, "static "),
            *entry("sample", [sample], owners, names, [*sample.outputs], _SAMPLED),
        ]
    return c_text(flown, robot, engine=[*engine, *map(c_source, by_hand)], beside=_beside(programs))


def _beside(programs: Mapping[str, Program]) -> list[Program]:
    """Programs that need what is written by hand, besides those of the loop."""
    return [programs["sample"]] if "sample" in programs else []


def _owners(programs: Mapping[str, Program]) -> list[str]:
    return sorted(set().union(*map(owners_of, programs.values())))


def _inputs(programs: Mapping[str, Program]) -> dict[str, Node]:
    """The inputs of programs by name, but for those up to the state."""
    inputs: dict[str, Node] = {}
    for program in programs.values():
        first = program.names.index("x") + 1
        inputs |= dict(zip(program.names[first:], program.inputs[first:], strict=True))
    return inputs


def flow_library(module: ModuleType, programs: Mapping[str, Program]) -> ctypes.CDLL:
    """The library of `flow_source`. Raises as `library` does."""
    text, functions = flow_source(programs, Functions(module)), called([*programs.values()])
    return library(module, functions, {"_flow.c": text}, FLIGHT, blocks=False)


class ProgramFlow:
    """A closed loop by its programs, as of `flow_source`.

    `values`, `constants` by owner, `tables` and `guesses` are as of `ProgramArguments`. `arrays`
    has the inputs by name.

    Raises `CompilerError`, or `CacheError` where the cache cannot be used.
    """

    def __init__(
        self,
        module: ModuleType,
        programs: Mapping[str, Program],
        values: Mapping[str, Any],
        constants: Mapping[str, Any],
        tables: Sequence[Array],
        guesses: int,
    ) -> None:
        """Compile the programs, and lay out what they are given."""
        inputs, compiled = _inputs(programs), flow_library(module, programs)
        self._slope, self._legs = compiled.flow_slope, compiled.flow_legs
        self._slope.argtypes = [ctypes.c_void_p, ctypes.c_double, *[ctypes.c_void_p] * 3]
        self._legs.argtypes = [ctypes.c_void_p] * 6
        self._slope.restype = self._legs.restype = None
        slope = programs["slope"]
        self.size, self.ranged = slope.inputs[1].size, slope.outputs["inputs"].size
        robots = [constants[owner] for owner in _owners(programs)]
        arguments = ProgramArguments(inputs, values, robots, tables, guesses)
        self.arrays, self._owned = arguments.arrays, arguments
        self._arguments = arguments.addresses.ctypes.data
        # The place of the address of held inputs, which is elsewhere while a law is sampled.
        self._held = len(robots) + 1 + [*inputs].index("held") if "held" in inputs else None
        self._held_at = self.arrays["held"].ctypes.data if "held" in inputs else 0
        self._kept, self._refused = Kept(), ctypes.c_int()

    def hold(self, inputs: Array | tuple[float, ...]) -> None:
        """Hold other inputs (nu) from now on, where inputs are held."""
        self.arrays["held"][0] = inputs
        if self._held is not None:
            self._owned.addresses[0, self._held] = self._held_at

    def slope(self, time: float, state: Array) -> Array | None:
        """The time derivative (size) of a state; None where it is refused."""
        x, rate = np.ascontiguousarray(state, dtype=np.float64), np.empty(self.size)
        refused = ctypes.addressof(self._refused)
        self._slope(self._arguments, time, x.ctypes.data, rate.ctypes.data, refused)
        return None if self._refused.value else rate

    def __call__(
        self,
        flow: Flow,
        legs: ctypes.Array[Leg],
        state: Array,
        times: Array,
        law: Samples | None = None,
        begins: Array | None = None,
    ) -> Flown:
        """Fly legs from a state (size), as many steps as a call takes, or until `flow` says why.

        `times` are those of the samples to come, s. `law` has the samples of a law; `begins` (legs,
        size), if given, takes the states at the begin of legs.
        """
        count, size = len(times), self.size
        flow.legs, flow.wanted = len(legs), count
        # In one array, since to make arrays, and to ask where they are, takes long: the samples,
        # the last state, and the ranges.
        room = np.empty((count + 1) * (size + 2 * self.ranged))
        states = room[: (count + 1) * size].reshape(count + 1, size)
        ranges = room[(count + 1) * size :].reshape(count + 1, 2, 2, self.ranged // 2)
        states[count], ranges[:, 0], ranges[:, 1] = state, np.inf, -np.inf
        at, kept = room.ctypes.data, self._kept
        last = at + count * size * room.itemsize
        kept.samples, kept.ranges = at, last + size * room.itemsize
        kept.times = times.ctypes.data if count else None
        kept.begins = None if begins is None else begins.ctypes.data
        sampling = None
        if law is not None:
            arrays = law.times, law.errors, law.learns, law.memory, law.commands
            before = len(law.commands) - len(law.times)
            sampling = np.array([*(x.ctypes.data for x in arrays), before], dtype=np.uint64)
        self._legs(
            self._arguments,
            ctypes.addressof(flow),
            ctypes.addressof(legs),
            last,
            ctypes.addressof(kept),
            None if sampling is None else sampling.ctypes.data,
        )
        taken = flow.samples
        return Flown(states[:taken], states[count], ranges[: taken + 1].swapaxes(1, 2))
