"""The closed loop compiled from C: its derivative, and calls that take many steps of a flight.

`native/rk4.c` is compiled once for all robots; it is given the addresses of the functions in the
compiled library of a module.
"""

from __future__ import annotations

import ctypes
import functools
import logging
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gibbs_codegen import emitted
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.loop_parts import LAWS, POINTER, Loop, filled
from gibbs_codegen.flight.integration.state_history import NOTHING, Acting, InputRanges
from gibbs_codegen.flight.plant.vehicle import Array
from gibbs_codegen.runtime.c_library import Compiler, CompilerError, announced, find_compiler
from gibbs_codegen.runtime.cache import CacheError, cached_library

_log = logging.getLogger("gibbs_codegen")
# Where the C of the closed loop is.
NATIVE = Path(__file__).parent.parent / "native"


@dataclass(frozen=True)
class CompiledLoop:
    """One closed loop in compiled code, while the same acts on the robot.

    Where a wrench is asked for that the rotors cannot produce, Python says so.
    """

    library: ctypes.CDLL
    structure: Loop
    size: int
    # Inputs (nu) that are commanded all through, where they are held.
    held: Array
    # What the structure points to, so that it lives as long.
    owned: list[Any]

    @classmethod
    def of(
        cls, closed: ClosedLoop, bounds: Array | float, acting: Acting = NOTHING
    ) -> CompiledLoop | None:
        """The compiled loop of a closed loop; None where module, law or loop is not compiled.

        The geometric law is for a base with a quaternion. `bounds` of errors, then their rates, are
        (2 nv) or one number.
        """
        vehicle = closed.vehicle
        law = closed.controller.law if acting.held is None else "held"
        library_file = Path(vehicle.module.__file__ or "")
        if library_file.suffix != ".so" or law not in LAWS:
            return None
        if law == "geometric" and not vehicle.layout.is_quaternion:
            return None
        try:
            rk4 = compiled_steps(find_compiler(os.environ.get("CC") or None))
        except (CompilerError, CacheError) as error:
            _log.warning("steps are taken in Python instead of C: %s", error)
            return None
        library = ctypes.CDLL(str(library_file))
        structure, arrays = filled(closed, bounds, acting, library)
        guesses = np.zeros(vehicle.rotors)
        structure.guesses = guesses.ctypes.data
        scratch = np.empty(rk4.gibbs_codegen_loop_room(ctypes.byref(structure)))
        structure.scratch = scratch.ctypes.data
        owned = [library, arrays, guesses, scratch]
        return cls(rk4, structure, closed.size, arrays["", "held"], owned)

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
        last = np.array(state, dtype=np.float64)
        samples = np.empty((count // every + 1, self.size))
        ranges = np.empty((len(samples) + 1, 2, 2, len(self.held)))
        ranges[:, :, 0], ranges[:, :, 1] = np.inf, -np.inf
        progress = _Progress(going=1)
        self.library.gibbs_codegen_rk4(
            ctypes.byref(self.structure),
            time,
            step,
            count,
            every,
            number,
            last.ctypes.data,
            samples.ctypes.data,
            ranges.ctypes.data if seen else None,
            ctypes.byref(progress),
        )
        taken = progress.taken
        first = number // every
        if seen:
            # The first stretch may begin after its sample, and the last one end before it.
            stretches = -(-(number + taken) // every) - first
            middle = time + ((first + 0.5 + np.arange(stretches)) * every - number) * step
            inside = np.clip(middle, time + 0.25 * step, time + (taken - 0.25) * step)
            seen(InputRanges(inside, ranges[:stretches]))
        return taken, samples[: (number + taken) // every - first], last

    def rate(self, time: float, state: Array) -> Array | None:
        """Time derivative of a state (size); None where the rotors cannot produce a wrench.

        `ClosedLoop.derivative` says more of that.
        """
        rate, state = np.empty(self.size), np.ascontiguousarray(state, dtype=np.float64)
        going = ctypes.c_int(1)
        self.library.gibbs_codegen_rate(
            ctypes.byref(self.structure),
            time,
            ctypes.byref(going),
            state.ctypes.data,
            rate.ctypes.data,
        )
        return rate if going else None


class CompiledLoops:
    """The compiled loops of a closed loop: one for each of what may act, made when it does."""

    def __init__(self, closed: ClosedLoop, bounds: Array | float) -> None:
        self.closed, self.bounds = closed, bounds
        self._made: dict[tuple[Acting, bool], CompiledLoop | None] = {}

    def at(self, acting: Acting) -> CompiledLoop | None:
        """The compiled loop while something acts; None where there is none (`CompiledLoop.of`).

        For all inputs that are held it is the same loop, which holds those that were given last.
        """
        key = replace(acting, held=None), acting.held is None
        if key not in self._made:
            self._made[key] = CompiledLoop.of(self.closed, self.bounds, acting)
        loop = self._made[key]
        if loop is not None and acting.held is not None:
            loop.held[:] = acting.held
        return loop

    def derivative(self, acting: Acting) -> Callable[[float, Array], Array]:
        """The time derivative of states while something acts: compiled, where there is a loop."""
        loop = self.at(acting)

        def derivative(time: float, state: Array) -> Array:
            rate = None if loop is None else loop.rate(time, state)
            return self.closed.derivative(time, state, acting) if rate is None else rate

        return derivative


class _Progress(ctypes.Structure):
    """`Progress` of `native/rk4.c`, of one state."""

    _fields_ = (
        *(("going", ctypes.c_int), ("refused", ctypes.c_int)),
        ("taken", ctypes.c_ssize_t),
    )


@functools.cache
def compiled_steps(compiler: Compiler, *flags: str) -> ctypes.CDLL:
    """`native/rk4.c`, compiled with flags such as LANES and LAYOUT.

    LANES is how many states a number has, LAYOUT that of all robots, if it is the same. Raises
    `CompilerError`, or `CacheError` where the cache of libraries cannot be used.
    """
    source = NATIVE / "rk4.c"
    read = [source, *sorted(NATIVE.glob("*.h")), *sorted(Path(emitted.__path__[0]).glob("*.c"))]
    # Nobody asks what square roots leave in errno; with it they are not taken side by side.
    options = (*flags, "-fno-math-errno")

    def make(output: Path) -> None:
        with announced("compiling the closed loop; the library is kept for the next time"):
            compiler.library([source], output, options)

    texts = [path.read_text(encoding="utf-8") for path in read]
    library = ctypes.CDLL(
        str(cached_library("\n".join([compiler.identity, *options, *texts]), make))
    )
    real, size = ctypes.c_double, ctypes.c_ssize_t
    library.gibbs_codegen_loop_room.argtypes = [POINTER]
    library.gibbs_codegen_loop_room.restype = size
    library.gibbs_codegen_rk4.argtypes = [
        *(POINTER, real, real),
        *(size, size, size),
        *(POINTER, POINTER, POINTER, POINTER),
    ]
    library.gibbs_codegen_rk4.restype = None
    library.gibbs_codegen_rate.argtypes = [POINTER, real, POINTER, POINTER, POINTER]
    library.gibbs_codegen_rate.restype = None
    return library
