"""Rollouts by the module's own C source: blocks of states that stay in the cache.

The C source of the rollout is compiled together with the robot's functions, once for each
precision, and kept in the cache of libraries.
"""

from __future__ import annotations

import ctypes
import functools
import math
import os
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.rollouts.pieces import Piece, take_pieces
from gibbs_codegen.rollouts.problem import REALS, Precision, Problem, Rollout
from gibbs_codegen.runtime.c_library import compiled_files
from gibbs_codegen.runtime.compiler import Compiler, CompilerError, find_compiler

Reals = NDArray[Any]
_METHODS = ("rk4", "euler")


class _Rows(ctypes.Structure):
    """An array with a row for each state and step."""

    _fields_ = (
        ("entries", ctypes.c_void_p),
        ("by_state", ctypes.c_size_t),
        ("by_step", ctypes.c_size_t),
    )


class _States(ctypes.Structure):
    """Where states are read and written."""

    _fields_ = (
        ("q", ctypes.c_void_p),
        ("v", ctypes.c_void_p),
        ("thrusts", ctypes.c_void_p),
        ("steps", ctypes.c_void_p),
        ("ended", ctypes.c_void_p),
        ("samples", ctypes.c_size_t),
        ("q_samples", ctypes.c_void_p),
        ("v_samples", ctypes.c_void_p),
        ("thrust_samples", ctypes.c_void_p),
    )


def _settings_type(real: type[ctypes.c_float] | type[ctypes.c_double]) -> type[ctypes.Structure]:
    """What is computed, as a structure of numbers of a type."""

    class Settings(ctypes.Structure):
        _fields_ = (
            ("constants", ctypes.c_void_p),
            ("constants_by_state", ctypes.c_size_t),
            ("dt", real),
            ("method", ctypes.c_int),
            ("every", ctypes.c_size_t),
            ("inputs", _Rows),
            ("gain", ctypes.c_void_p),
            ("desired_q", _Rows),
            ("desired_v", _Rows),
            ("least", ctypes.c_void_p),
            ("most", ctypes.c_void_p),
            ("time_constants", _Rows),
            ("wrenches", _Rows),
            ("bounds", ctypes.c_void_p),
        )

    return Settings


_SETTINGS = {
    "double": _settings_type(ctypes.c_double),
    "single": _settings_type(ctypes.c_float),
}


def compiled_rollout(
    problem: Problem,
    threads: int = 1,
    progress: Callable[[float], None] = lambda share: None,
    flags: tuple[str, ...] = (),
) -> Rollout:
    """Roll states out in C, in the precision of the problem, to which its numbers are rounded.

    `progress` is told the share done between calls, which take some tenths of a second at most;
    what it raises ends the rollout. `flags` follow the compiler's own. Raises `UsageError` without
    C source of a rollout, `CompilerError`, and `CacheError` if the library cannot be kept.
    """
    run = _Run(problem)
    function = rollout_function(problem.module, problem.precision, flags)
    by_reference = ctypes.byref(run.settings), ctypes.byref(run.states)

    def call(piece: Piece) -> None:
        function(*by_reference, piece.first, piece.count, piece.begin, piece.end)

    take_pieces(call, len(problem.q), problem.steps, threads, progress)
    return run.rollout()


class _Run:
    """A rollout's structures, and the arrays that they point to."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self._real = REALS[problem.precision]
        self._owned: list[Any] = []
        count, samples = len(problem.q), 1 + problem.steps // problem.every
        self._steps, self._ended = np.zeros(count, np.uintp), np.zeros(count, np.uint8)
        self._q = np.empty((count, samples, problem.q.shape[1]), self._real)
        self._v = np.empty((count, samples, problem.v.shape[1]), self._real)
        self._thrusts: Reals | None = None
        self.settings = self._settings()
        self.states = _States(
            q=self._written(problem.q),
            v=self._written(problem.v),
            steps=self._steps.ctypes.data,
            ended=self._ended.ctypes.data,
            samples=samples,
            q_samples=self._q.ctypes.data,
            v_samples=self._v.ctypes.data,
        )
        motors = problem.motors
        if motors is not None and np.any(motors.time_constants):
            rotors = motors.thrusts.shape[1]
            self._thrusts = np.empty((count, samples, rotors), self._real)
            self.settings.time_constants = self._rows(motors.time_constants[:, None])
            self.states.thrusts = self._written(np.broadcast_to(motors.thrusts, (count, rotors)))
            self.states.thrust_samples = self._thrusts.ctypes.data

    def _settings(self) -> ctypes.Structure:
        """What is computed, but for the lag of thrusts."""
        problem, motors, feedback = self._problem, self._problem.motors, self._problem.feedback
        constants = _constants(problem)
        settings = _SETTINGS[problem.precision](
            constants=self._read(constants),
            constants_by_state=len(constants) > 1,
            dt=problem.dt,
            method=_METHODS.index(problem.method),
            every=problem.every,
            inputs=self._rows(problem.inputs),
            bounds=self._read(problem.bounds),
        )
        if problem.wrenches is not None:
            settings.wrenches = self._rows(problem.wrenches)
        if feedback is not None:
            settings.gain = self._read(feedback.gain)
            settings.desired_q = self._rows(feedback.q)
            settings.desired_v = self._rows(feedback.v)
        if motors is not None:
            settings.least = self._read(motors.least)
            settings.most = self._read(motors.most)
        return settings

    def rollout(self) -> Rollout:
        """What the calls have left in the arrays."""
        time = np.arange(self._q.shape[1]) * (self._problem.dt * self._problem.every)
        steps, ended = self._steps.astype(np.int64), self._ended.view(np.int8)
        return Rollout(time, self._q, self._v, self._thrusts, steps, ended)

    def _read(self, array: Reals | None) -> int | None:
        """Address of an array that is read, in the precision of the problem."""
        if array is None:
            return None
        self._owned.append(np.ascontiguousarray(array, self._real))
        return int(self._owned[-1].ctypes.data)

    def _written(self, array: Reals) -> int:
        """Address of a copy of an array, to which is written."""
        self._owned.append(np.array(array, self._real, order="C"))
        return int(self._owned[-1].ctypes.data)

    def _rows(self, array: Reals) -> _Rows:
        """An array (1 or n, 1 or steps, …) as rows of states and steps."""
        states, steps, *shape = array.shape
        width = math.prod(shape)
        return _Rows(
            self._read(array),
            width * steps if states > 1 else 0,
            width if steps > 1 else 0,
        )


def _constants(problem: Problem) -> Reals:
    """Constants (1 or n, constants) of the states."""
    constants = problem.constants
    if constants is None:
        return _default_constants(problem.module)
    if isinstance(constants, bytes):
        constants = np.frombuffer(constants)
    elif isinstance(constants, tuple):
        constants = np.stack(np.broadcast_arrays(*constants), axis=-1)
    rows: Reals = np.atleast_2d(constants)
    return rows


@functools.lru_cache(maxsize=64)
def _default_constants(module: ModuleType) -> Reals:
    """Constants (1, constants) of the parameters of the robot file."""
    constants = module.prepare({})
    return np.array([np.frombuffer(constants) if isinstance(constants, bytes) else constants])


def rollout_function(
    module: ModuleType, precision: Precision, flags: tuple[str, ...] = ()
) -> Callable[..., None]:
    """The compiled function of a module of any back end, as of `_loaded`.

    Raises what `compiled_rollout` does.
    """
    compiler = find_compiler(os.environ.get("CC") or None)
    return _loaded(module, precision == "single", compiler, flags)


@functools.lru_cache(maxsize=64)
def _loaded(
    module: ModuleType, single: bool, compiler: Compiler, flags: tuple[str, ...]
) -> Callable[..., None]:
    """The compiled function of a module of any back end.

    It takes settings, states, first state, number of states, first step and the step before which
    it ends.
    """
    name = module.NAME
    files = [f"{name}{ending}" for ending in (".h", ".c", "_each.c", "_rollout.h", "_rollout.c")]
    extra = [*flags, f"-D{name.upper()}_FLOAT"] if single else flags
    folder = Path(module.__path__[0])
    path = compiled_files(folder, name, files, compiler, extra, included=[f"{name}.c"])
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        raise CompilerError(f"{path.name} cannot be loaded: {error}") from None
    function = library[f"{name}_rollout{'_float' if single else ''}"]
    function.argtypes = [ctypes.c_void_p, ctypes.c_void_p, *[ctypes.c_size_t] * 4]
    function.restype = None
    return function
