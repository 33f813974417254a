"""Rollouts on plain arrays: what one computes, and how, by NumPy, by JAX or by the module's C.

`Steps` says once more, as short as it can be said, what the compiled rollout computes, on arrays of
NumPy or of JAX: all states at once.

The C source of the rollout is compiled together with the robot's functions, once for each
precision, and kept in the cache of libraries. It takes blocks of states that stay in the
processor's cache.
"""

from __future__ import annotations

import ctypes
import functools
import math
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import wait
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.runtime.c_backend import Pool
from gibbs_codegen.runtime.c_library import Compiler, chosen_compiler, compiled_files, opened
from gibbs_codegen.runtime.rollout_source import rollout_files, rollout_text

Array = NDArray[np.float64]
Method = Literal["euler", "rk4"]
Precision = Literal["double", "single"]
REALS: dict[Precision, np.dtype[Any]] = {
    "double": np.dtype(np.float64),
    "single": np.dtype(np.float32),
}

# Why a state has ended: it has not, its numbers are not finite any more, or it is out of bounds.
RUNNING, DIVERGED, OUT_OF_BOUNDS = 0, 1, 2


@dataclass(frozen=True)
class Feedback:
    """Linear feedback: what is added to the inputs at the start of every step.

    It is `gain` (nu, 2 nv) times the displacement of q and v from the state to the desired one:
    difference(q, q_desired), then v_desired - v. Desired states are (1 or n, 1 or steps, nq) and
    (1 or n, 1 or steps, nv). What it is added to, `u` (1 or n, 1 or steps, nu), is what `rollout`
    makes the inputs of the problem, a number being for all of them; where there is a problem, those
    are looked at alone.
    """

    gain: Array
    q: Array
    v: Array
    u: Array | float = 0.0


@dataclass(frozen=True)
class Motors:
    """What becomes of the inputs that are commanded.

    They are brought within `least` and `most` (nu). Thrusts then follow them with the
    `time_constants` (1 or n, rotors), s, of which 0 is no lag: over a step, in which commands are
    held, they are u + (F - u) exp(-t / T), from `thrusts` (1 or n, rotors), N, at the start.
    Semi-implicit Euler applies the thrust at the start of a step, Runge and Kutta's method those at
    its stages.
    """

    least: Array
    most: Array
    time_constants: Array
    thrusts: Array


@dataclass(frozen=True)
class Problem:
    """A rollout of n states through `steps` steps of `dt` s.

    `constants` are what the module's `prepare` returned: None, those of one robot, or n of them.
    `q` (n, nq) and `v` (n, nv) are where it begins. `inputs` (1 or n, 1 or steps, nu) are held
    through each step, and `wrenches` (1 or n, 1 or steps, frames, 6) too. A state ends after the
    step that takes an entry of q and v beyond `bounds` (2, nq + nv), or makes it not finite; from
    then on it stays as it is, and changes no other. A sample is kept after every `every`-th step.
    The step is the module's step_euler or step_rk4.
    """

    module: ModuleType
    constants: Any
    q: Array
    v: Array
    inputs: Array
    steps: int
    dt: float
    method: Method = "rk4"
    every: int = 1
    feedback: Feedback | None = None
    motors: Motors | None = None
    wrenches: Array | None = None
    bounds: Array | None = None
    precision: Precision = "double"


@dataclass(frozen=True)
class Rollout:
    """States after every `every`-th step, and at the start, which is sample 0.

    `q` (n, samples, nq) and `v` (n, samples, nv) at `time` (samples), s; `thrusts` (n, samples,
    rotors), N, where motors lag, else None. Samples after the end of a state repeat its last one.
    `steps` (n) were taken before a state `ended` (n): RUNNING, DIVERGED or OUT_OF_BOUNDS. The
    state that a step made not finite is not kept: the last sample is the one before. Numbers are
    of the precision of the problem.
    """

    time: Array
    q: Array
    v: Array
    thrusts: Array | None
    steps: NDArray[np.int64]
    ended: NDArray[np.int8]


# States that a piece has, or a multiple: of those in a block, in either precision.
_STATES = 16
# Steps of single states in the first piece; later ones have as many as take the time of a call.
_FIRST = 16_384
_CALL_SECONDS = 0.05
# With fewer for each, further threads are not worth waking.
_LEAST = 65_536
_WAIT_SECONDS = 0.1


@dataclass(frozen=True)
class Piece:
    """Steps from `begin` to before `end`, of `count` states from `first` on."""

    first: int
    count: int
    begin: int
    end: int


def take_pieces(
    call: Callable[[Piece], None],
    count: int,
    steps: int,
    threads: int,
    progress: Callable[[float], None],
) -> None:
    """Call a function for all steps of all states, in pieces, those of one state in order.

    Threads call it at once for different states. `progress` is told between calls, in this thread,
    the share of all that is done, 0 to 1; what it raises ends the work.
    """
    threads = max(1, min(threads, count * steps // _LEAST))
    pieces = _Pieces(count, steps, threads)
    if threads == 1:
        for _ in pieces.taken(call):
            progress(pieces.share)
        return
    futures = [_pool(threads).executor().submit(pieces.take, call) for _ in range(threads)]
    try:
        while wait(futures, _WAIT_SECONDS).not_done:
            progress(pieces.share)
    finally:
        pieces.given_up = True
        wait(futures)
    for future in futures:
        future.result()
    progress(1.0)


class _Pieces:
    """States that wait for a thread, and how much is done."""

    def __init__(self, count: int, steps: int, threads: int) -> None:
        self._count, self._steps, self._threads = count, steps, threads
        self._lock = threading.Lock()
        self._first = self._done = 0
        self.given_up = False

    @property
    def share(self) -> float:
        """Share of the steps that is taken, 0 to 1."""
        return self._done / (self._count * self._steps)

    def take(self, call: Callable[[Piece], None]) -> None:
        """Take pieces until none are left, or the work is given up."""
        for _ in self.taken(call):
            if self.given_up:
                return

    def taken(self, call: Callable[[Piece], None]) -> Iterator[None]:
        """Take pieces until none are left, and stop after each of them."""
        size = _FIRST
        while (states := self._some_states(size)).count > 0:
            begin = 0
            while begin < self._steps:
                # States are rounded up to whole blocks, and take all their steps even so.
                end = min(self._steps, begin + max(1, 2 * size // states.count))
                started = time.perf_counter()
                call(Piece(states.first, states.count, begin, end))
                seconds = time.perf_counter() - started
                size = max(1, int(size * min(4.0, _CALL_SECONDS / max(seconds, 1e-9))))
                with self._lock:
                    self._done += (end - begin) * states.count
                begin = end
                yield

    def _some_states(self, size: int) -> Piece:
        """All steps of states that follow those taken already, about `size` steps of single states.

        No states are left where their number is 0.
        """
        with self._lock:
            left = self._count - self._first
            fair = left if self._threads == 1 else -(-left // (2 * self._threads))
            blocks = max(1, -(-min(size // self._steps, fair) // _STATES))
            piece = Piece(self._first, min(left, blocks * _STATES), 0, self._steps)
            self._first += piece.count
        return piece


# For each number of threads.
_pool = functools.cache(Pool)


State = tuple[Array, ...]


class Steps:
    """The steps of one problem, on states of coordinates, velocities and, with motors, thrusts."""

    def __init__(self, problem: Problem, xp: Any) -> None:
        """Take a problem, and the library of its arrays: NumPy, or JAX's."""
        self._problem, self._xp = problem, xp

    def begin(self) -> State:
        """Coordinates (n, nq), velocities (n, nv) and thrusts (n, rotors), N, at the start."""
        problem, motors = self._problem, self._problem.motors
        if motors is None:
            return problem.q, problem.v
        shape = len(problem.q), motors.thrusts.shape[-1]
        return problem.q, problem.v, self._xp.broadcast_to(motors.thrusts, shape)

    def beyond(self, q: Array, v: Array) -> Any:
        """Which states (n, nq), (n, nv) are out of bounds (n)."""
        if self._problem.bounds is None:
            return self._xp.zeros(len(q), dtype=bool)
        least, most = self._problem.bounds
        state = self._xp.concatenate([q, v], axis=1)
        return ((state < least) | (state > most)).any(axis=1)

    def commanded(self, number: Any, q: Array, v: Array) -> Array:
        """Inputs (n, nu) that are commanded in a step, within their limits."""
        problem, xp = self._problem, self._xp
        u = xp.broadcast_to(_of_step(problem.inputs, number), (len(q), problem.inputs.shape[-1]))
        if (feedback := problem.feedback) is not None:
            away = problem.module.difference(q, _of_step(feedback.q, number), problem.constants)
            slower = _of_step(feedback.v, number) - v
            u = u + xp.concatenate([away, slower], axis=1) @ feedback.gain.T
        motors = problem.motors
        return u if motors is None else xp.clip(u, motors.least, motors.most)

    def after(self, number: Any, q: Array, v: Array, *thrusts: Array) -> State:
        """Coordinates, velocities, and thrusts if motors lag (n, rotors), N, after a step.

        They may not be finite.
        """
        dt, commanded = self._problem.dt, self.commanded(number, q, v)
        method = self._euler if self._problem.method == "euler" else self._rk4
        moved = method(number, q, v, lambda time: self._acting(commanded, time, *thrusts))
        acting = self._acting(commanded, dt, *thrusts)
        return *moved, *(acting[:, : each.shape[1]] for each in thrusts)

    def _acting(self, commanded: Array, time: Any, *thrusts: Array) -> Array:
        """Inputs (n, nu) that act some time after the start of a step, at which thrusts are given.

        `commanded` (n, nu) is within limits.
        """
        if self._problem.motors is None:
            return commanded
        xp, lag, (before,) = self._xp, self._problem.motors.time_constants, thrusts
        decay = xp.where(lag > 0.0, xp.exp(-time / xp.where(lag > 0.0, lag, 1.0)), 0.0)
        settled, efforts = xp.split(commanded, [before.shape[1]], axis=1)
        return xp.concatenate([settled + (before - settled) * decay, efforts], axis=1)

    def _acceleration(self, number: Any, q: Array, v: Array, u: Array) -> Array:
        """Accelerations (n, nv) in a step, of inputs `u` (n, nu) that act."""
        module, constants = self._problem.module, self._problem.constants
        found: Array
        if self._problem.wrenches is None:
            found = module.forward_dynamics(q, v, u, constants)
        else:
            wrenches = _of_step(self._problem.wrenches, number)
            found = module.forward_dynamics_with_wrenches(q, v, u, wrenches, constants)
        return found

    def _moved(self, q: Array, displacement: Array) -> Array:
        """Coordinates (n, nq) after a displacement (n, nv)."""
        return self._problem.module.integrate(q, displacement, self._problem.constants)

    def _euler(self, number: Any, q: Array, v: Array, acting: Any) -> tuple[Array, Array]:
        """Coordinates and velocities after a semi-implicit Euler step.

        `acting` gives inputs (n, nu) by the time since its begin.
        """
        dt = self._problem.dt
        v_next = v + dt * self._acceleration(number, q, v, acting(0.0))
        return self._moved(q, dt * v_next), v_next

    def _rk4(self, number: Any, q: Array, v: Array, acting: Any) -> tuple[Array, Array]:
        """Coordinates and velocities after a step as the module's step_rk4 takes it."""
        dt, middle = self._problem.dt, acting(self._problem.dt / 2.0)
        a1 = self._acceleration(number, q, v, acting(0.0))
        half = self._moved(q, dt / 2.0 * v)
        rate = v + dt / 2.0 * a1
        a2 = self._acceleration(number, half, rate, middle)
        place = self._moved(q, dt / 2.0 * rate)
        rate = v + dt / 2.0 * a2
        a3 = self._acceleration(number, place, rate, middle)
        place = self._moved(half, dt * (rate - v / 2.0))
        a4 = self._acceleration(number, place, v + dt * a3, acting(dt))
        place = self._moved(q, dt / 2.0 * (v + dt / 6.0 * (a1 + a2 - a3)))
        q_next = self._moved(place, dt / 2.0 * (v + dt / 6.0 * (a1 + a2 + 3.0 * a3)))
        return q_next, v + dt / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)


def _of_step(values: Array, number: Any) -> Array:
    """Values (1 or n, …) that hold in a step, of those (1 or n, 1 or steps, …) of all steps."""
    return values[:, number if values.shape[1] > 1 else 0]


def numpy_rollout(
    problem: Problem, progress: Callable[[float], None] = lambda share: None
) -> Rollout:
    """Roll states out in NumPy, always in double precision.

    The module's back end is "numpy" or "c"; `progress` is told after every step the share done.
    """
    steps, count = Steps(problem, np), len(problem.q)
    state = steps.begin()
    samples = [state]
    taken, ended = np.zeros(count, dtype=np.int64), np.full(count, RUNNING, dtype=np.int8)
    for number in range(problem.steps):
        with np.errstate(all="ignore"):
            after = steps.after(number, *state)
        finite = np.isfinite(np.concatenate(after, axis=1)).all(axis=1)
        ended[(ended == RUNNING) & ~finite] = DIVERGED
        going = ended == RUNNING
        state = tuple(np.where(going[:, None], a, b) for a, b in zip(after, state, strict=True))
        taken += going
        ended[going & steps.beyond(*state[:2])] = OUT_OF_BOUNDS
        if (number + 1) % problem.every == 0:
            samples.append(state)
        progress((number + 1) / problem.steps)
    real = REALS[problem.precision]
    q, v, *thrusts = (
        np.stack(each, axis=1).astype(real, copy=False) for each in zip(*samples, strict=True)
    )
    time = np.arange(len(samples), dtype=np.float64) * (problem.dt * problem.every)
    lags = problem.motors is not None and np.any(problem.motors.time_constants)
    return Rollout(time, q, v, thrusts[0] if lags else None, taken, ended)


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
        *((name, ctypes.c_void_p) for name in ("q", "v", "thrusts", "steps", "ended")),
        ("samples", ctypes.c_size_t),
        *((name, ctypes.c_void_p) for name in ("q_samples", "v_samples", "thrust_samples")),
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
        by_state, by_step = width * steps if states > 1 else 0, width if steps > 1 else 0
        return _Rows(self._read(array), by_state, by_step)


def _constants(problem: Problem) -> Reals:
    """Constants (1 or n, constants) of the states."""
    constants = problem.constants
    if constants is None:
        return _default_constants(problem.module)
    if isinstance(constants, bytes):
        constants = np.frombuffer(constants)
    elif isinstance(constants, tuple):
        constants = np.stack(np.broadcast_arrays(*constants), axis=-1)
    return np.atleast_2d(constants)


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
    return _loaded(module, precision == "single", chosen_compiler(), flags)


@functools.lru_cache(maxsize=64)
def _loaded(
    module: ModuleType, single: bool, compiler: Compiler, flags: tuple[str, ...]
) -> Callable[..., None]:
    """The compiled function of a module of any back end.

    It takes settings, states, first state, number of states, first step and the step before which
    it ends.
    """
    name = module.NAME
    text = rollout_text(module)
    for called in text.functions:
        getattr(module, called)  # It says how the module is to be generated, if it lacks one.
    folder = Path(module.__path__[0])
    made = {file: source.encode() for file, source in rollout_files(text).items()}
    own = [file for file in made if (folder / file).is_file()]
    files = [*(f"{name}{ending}" for ending in (".h", ".c", "_each.c")), *own]
    extra = [*flags, f"-D{name.upper()}_FLOAT"] if single else flags
    path = compiled_files(
        folder,
        name,
        files,
        compiler,
        extra,
        {file: source for file, source in made.items() if file not in own},
        included=[f"{name}.c"],
        functions=text.functions,
    )
    function = opened(path)[f"{name}_rollout{'_float' if single else ''}"]
    function.argtypes = [ctypes.c_void_p, ctypes.c_void_p, *[ctypes.c_size_t] * 4]
    function.restype = None
    return function
