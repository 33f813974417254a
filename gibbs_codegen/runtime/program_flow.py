"""Steps of adaptive size of a closed loop in C, of one state: `emitted/adaptive.c` takes them."""

from __future__ import annotations

import ctypes
import itertools
from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.arrays.contents import owners_of
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Node, Program
from gibbs_codegen.files.verbatim import c_source
from gibbs_codegen.runtime.program_steps import ProgramArguments
from gibbs_codegen.runtime.programs import c_text, called, library, take_slope

Array = NDArray[np.float64]
# Why a call returns, as C numbers it.
GOES_ON, REFUSED, ENDED, TOO_SHORT, TOO_SLOW = range(5)
# What a call takes on at most, so that progress shows and Ctrl-C is heard; inputs that it looks at.
_STEPS_A_CALL, _INSTANTS_A_STEP = 100, 4


class Flow(ctypes.Structure):
    """State of an integration, and how far it came: the members that `emitted/adaptive.c` has."""

    _fields_ = [
        *((name, ctypes.c_double) for name in ("time", "end", "step", "taken")),
        *((name, ctypes.c_double) for name in ("budget", "income", "most", "begin", "piece")),
        *((name, 2 * ctypes.c_double) for name in ("relative", "absolute")),
        *((name, ctypes.c_int) for name in ("patience", "stops", "smooth", "steps")),
        *((name, ctypes.c_int) for name in ("samples", "instants", "reason")),
    ]


class Flown(NamedTuple):
    """Samples (s, size), the last state, and inputs (k, 2, nu) at `instants` (k), s."""

    samples: Array
    last: Array
    instants: Array
    inputs: Array


def flow_source(slope: Program, end: Program, robot: Functions) -> str:
    """C that takes steps of adaptive size of a closed loop by its programs."""
    engine = [*take_slope(slope, end, [*_inputs(slope, end)]), c_source("adaptive.c")]
    return c_text([slope, end], robot, engine=engine)


def _inputs(slope: Program, end: Program) -> dict[str, Node]:
    """The inputs of both programs by name, but for time and state."""
    pairs = (zip(program.names[2:], program.inputs[2:], strict=True) for program in (slope, end))
    return dict(itertools.chain(*pairs))


class ProgramFlow:
    """A closed loop by its programs `slope` and `end`, whose inputs are time, x, and what is given.

    `values`, `constants` by owner, `tables` and `guesses` are as of `ProgramSteps`. `arrays` has
    the inputs by name.

    Raises `CompilerError`, or `CacheError` where the cache cannot be used.
    """

    def __init__(
        self,
        module: ModuleType,
        slope: Program,
        end: Program,
        values: Mapping[str, Any],
        constants: Mapping[str, Any],
        tables: Sequence[Array],
        guesses: int,
    ) -> None:
        """Compile the programs, and lay out what they are given."""
        inputs = _inputs(slope, end)
        text = flow_source(slope, end, Functions(module))
        compiled = library(module, called([slope, end]), {"_flow.c": text}, blocks=False)
        self._slope, self._flow = compiled.flow_slope, compiled.flow_steps
        self._slope.argtypes = [ctypes.c_void_p, ctypes.c_double, *[ctypes.c_void_p] * 3]
        self._flow.argtypes = [ctypes.c_void_p] * 8
        self._slope.restype = self._flow.restype = None
        self.size, self.ranged = slope.inputs[1].size, slope.outputs["inputs"].size
        owners = sorted({*owners_of(slope), *owners_of(end)})
        robots = [constants[owner] for owner in owners]
        arguments = ProgramArguments(inputs, values, robots, tables, guesses)
        self.arrays, self._owned = arguments.arrays, arguments
        self._arguments = arguments.addresses.ctypes.data
        self._refused = ctypes.c_int()

    def slope(self, time: float, state: Array) -> Array | None:
        """The time derivative (size) of a state; None where it is refused."""
        x, rate = np.ascontiguousarray(state, dtype=np.float64), np.empty(self.size)
        refused = ctypes.addressof(self._refused)
        self._slope(self._arguments, time, x.ctypes.data, rate.ctypes.data, refused)
        return None if self._refused.value else rate

    def __call__(self, flow: Flow, state: Array, scale: Array, times: Array) -> Flown:
        """Take steps from a state (size), as many as a call takes, or until `flow` says why not.

        `scale` (size) is that of absolute tolerances, `times` are those of the samples to come, s.
        """
        flow.steps, flow.samples = _STEPS_A_CALL, len(times)
        count = _INSTANTS_A_STEP * _STEPS_A_CALL
        last, samples = np.array(state, dtype=np.float64), np.empty((len(times), self.size))
        instants, inputs = np.empty(count), np.empty((count, 2, self.ranged // 2))
        arrays = scale, last, times, samples, instants, inputs
        self._flow(self._arguments, ctypes.addressof(flow), *(x.ctypes.data for x in arrays))
        seen = flow.instants
        return Flown(samples[: flow.samples], last, instants[:seen].copy(), inputs[:seen].copy())
