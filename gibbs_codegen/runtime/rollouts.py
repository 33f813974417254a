"""Rollouts on plain arrays: their problems, and their computation by NumPy, by JAX or in C.

A step is the array program of `machine.rollout_steps`. `Steps` evaluates it on arrays of NumPy or
of JAX, all states at once. In C it is compiled together with the robot's functions that it calls,
once for each precision, and kept in the cache of libraries; it takes blocks of states that stay in
the processor's cache.
"""

from __future__ import annotations

import ctypes
import functools
import math
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import wait
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.arrays.evaluation import Evaluator
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Program
from gibbs_codegen.machine.contact import bristles_of
from gibbs_codegen.machine.inner_loop import InnerLoop
from gibbs_codegen.machine.machine import NO_SURROUNDINGS, Surroundings
from gibbs_codegen.machine.rollout_steps import (
    ALL,
    Parts,
    contact_program,
    rollout_inputs,
    rollout_step,
    sent,
)
from gibbs_codegen.machine.steps import METHODS
from gibbs_codegen.runtime.c_backend import Pool, default_constants
from gibbs_codegen.runtime.c_library import Compiler, chosen_compiler
from gibbs_codegen.runtime.loaded_module import gravity_of
from gibbs_codegen.runtime.programs import called, library
from gibbs_codegen.runtime.rollout_source import rollout_files, rollout_programs

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
    """Linear feedback, which is added to the inputs at the start of every step.

    It is `gain` (nu, nd + nv) times the displacement of q and v from the state to the desired one:
    `displacement`(q, q_desired), which has nd = nv entries or, with a drive, one more, then
    v_desired - v. Desired states are (1 or n, 1 or steps, nq) and (1 or n, 1 or steps, nv). What it
    is added to, `u` (1 or n, 1 or steps, nu), is what `rollout` makes the inputs of the problem, a
    number being for all of them; where there is a problem, those are looked at alone. Where
    actuators of the robot file have states, a gain (nu, nd + nv + nx) takes the way from these to
    `x` (1 or n, 1 or steps, nx) as well.
    """

    gain: Array
    q: Array
    v: Array
    u: Array | float = 0.0
    x: Array | None = None


@dataclass(frozen=True)
class MotorModel:
    """Limits and lag of commanded inputs.

    They are brought within `least` and `most` (nu), or (n, nu) of an inner loop. Thrusts then
    follow them with the `time_constants` (1 or n, rotors), s, of which 0 is no lag: over a step, in
    which commands are held, they are u + (F - u) exp(-t / T), from `thrusts` (1 or n, rotors), N,
    at the start.
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
    through each step, and `wrenches` (1 or n, 1 or steps, frames, 6) too. Where the robot file
    describes actuators, inputs are commands of motors and servos, motors have limits alone, and
    `x` (1 or n, nx) are states of the actuators, if they have any. A state ends after the
    step that takes an entry of q and v beyond `bounds` (2, nq + nv), or makes it not finite; from
    then on it stays as it is, and changes no other. `around` and `figures` are as of `Parts`,
    `bristles` (1 or n, 3 b) those of b contacts with friction at the start, not strained if None,
    and `loads` (1 or n, 1 or steps, …) wind, drag and payloads, as `rollout_inputs` names them. An
    `inner` loop has actions in place of inputs, and its other inputs among the loads. A sample is
    kept after every `every`-th step. The step is the module's step_euler or step_rk4.
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
    motors: MotorModel | None = None
    wrenches: Array | None = None
    bounds: Array | None = None
    precision: Precision = "double"
    x: Array | None = None
    around: Surroundings = NO_SURROUNDINGS
    figures: tuple[tuple[str, tuple[float, ...]], ...] = ()
    bristles: Array | None = None
    loads: Mapping[str, Array] = field(default_factory=dict)
    inner: InnerLoop | None = None

    @functools.cached_property
    def parts(self) -> Parts:
        """Parts of it besides inputs."""
        motors = self.motors
        return Parts(
            self.feedback is not None,
            motors is not None and bool(np.isfinite([motors.least, motors.most]).any()),
            motors is not None and (_may_lag(motors.time_constants) or self._tells_thrusts),
            self.bounds is not None,
            replace(self.around, pushes=self.wrenches is not None),
            self.figures,
            self.inner,
        )

    @property
    def _tells_thrusts(self) -> bool:
        """True where nothing else tells thrusts: of an inner loop, without commands of motors."""
        return self.inner is not None and functions_of(self.module).lagging > 0

    @property
    def strains(self) -> int:
        """The number of values of contacts' bristles, which end the state."""
        return bristles_of(self.around.contacts)

    def begin(self, parts: Parts, xp: Any = np) -> list[Array]:
        """Coordinates, velocities and, in states with such parts, what follows them: (n, k) each.

        These are thrusts or, where the robot file describes actuators, their states, and bristles.
        """
        actuated = self.motors.thrusts if parts.lag and self.motors is not None else self.x
        after = [] if actuated is None else [actuated]
        if self.strains:
            unstrained = xp.zeros((1, self.strains), self.q.dtype)
            after.append(unstrained if self.bristles is None else self.bristles)
        after = [xp.broadcast_to(part, (len(self.q), part.shape[-1])) for part in after]
        return [self.q, self.v, *([xp.concatenate(after, axis=-1)] if after else [])]

    def after(self, rest: Array | None) -> tuple[Array | None, Array | None]:
        """The parts of states (…, k) after q and v: that of motors or actuators, and bristles."""
        count = self.strains
        if rest is None or not count:
            return rest, None
        actuated = rest[..., : rest.shape[-1] - count]
        return (actuated if actuated.shape[-1] else None), rest[..., rest.shape[-1] - count :]

    def rollout(self, samples: Sequence[Array], steps: Any, ended: Any, xp: Any = np) -> Rollout:
        """The rollout of samples (n, samples, k) of what `begin` has."""
        q, v, *after = samples
        time = xp.arange(q.shape[1]) * (self.dt * self.every)
        actuators, bristles = self.after(after[0] if after else None)
        thrusts, x = (actuators, None) if self.x is None else (None, actuators)
        return Rollout(time, q, v, thrusts, steps, ended, x, bristles)


@dataclass(frozen=True)
class Rollout:
    """States after every `every`-th step, and at the start, which is sample 0.

    `q` (n, samples, nq) and `v` (n, samples, nv) at `time` (samples), s; `thrusts` (n, samples,
    rotors), N, where motors lag, else None, and `x` (n, samples, nx) where the robot file describes
    actuators that have states, `bristles` (n, samples, 3 b), m, of b contacts with friction, world
    axes, or None without any. Samples after the end of a state repeat its last one.
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
    x: Array | None = None
    bristles: Array | None = None


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

    Threads call it at once for different states. `progress` is called between calls, in this
    thread, with the share done, 0 to 1; what it raises ends the work.
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
        pieces.stopped = True
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
        self.stopped = False

    @property
    def share(self) -> float:
        """Share of the steps that is taken, 0 to 1."""
        return self._done / (self._count * self._steps)

    def take(self, call: Callable[[Piece], None]) -> None:
        """Take pieces until none are left, or the work is given up."""
        for _ in self.taken(call):
            if self.stopped:
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


@functools.lru_cache(maxsize=64)
def functions_of(module: ModuleType) -> Functions:
    """The functions of a module, for array programs."""
    return Functions(module)


@functools.lru_cache(maxsize=64)
def program_of(module: ModuleType, method: Method, parts: Parts) -> Program:
    """The program of a step. Raises `MissingFunctionError` if the module lacks what it calls."""
    return rollout_step(functions_of(module), method, parts)


@functools.lru_cache(maxsize=64)
def _contacts(module: ModuleType, parts: Parts) -> Evaluator:
    program = contact_program(functions_of(module), parts)
    return Evaluator(program, {"robot": module})


def touching(problem: Problem) -> Array:
    """Wrenches (n, frames, 6) of contacts on the frames where a problem begins, N and N m."""
    state = {"q": problem.q, "v": problem.v}
    if problem.bristles is not None:
        state["bristles"] = problem.bristles
    evaluator = _contacts(problem.module, problem.parts)
    found: Array = evaluator(state, {"robot": problem.constants})["wrenches"]
    return found


def _may_lag(time_constants: Any) -> bool:
    """True if any is not 0; those that JAX traces may be."""
    try:
        return bool(np.any(np.asarray(time_constants)))
    except TypeError:
        return True


def given_inputs(problem: Problem, parts: Parts, xp: Any) -> dict[str, Any]:
    """Inputs of programs with such parts, by name.

    What differs from state to state has axes (1 or n, 1 or steps) in front.
    """
    inputs = {
        "action" if problem.inner else sent(functions_of(problem.module)): problem.inputs,
        "wrenches": problem.wrenches,
        **problem.loads,
    }
    if problem.bounds is not None:
        inputs |= dict(zip(("lowest", "highest"), problem.bounds, strict=True))
    if (feedback := problem.feedback) is not None:
        states = functions_of(problem.module).actuator_states
        places = functions_of(problem.module).layout
        others = states + places.displaced.size + places.v.size - feedback.gain.shape[1]
        inputs |= {"gain": xp.pad(feedback.gain, ((0, 0), (0, others)))}
        inputs |= {"desired_q": feedback.q, "desired_v": feedback.v}
        inputs["desired_x"] = xp.zeros((1, 1, states)) if feedback.x is None else feedback.x
    if (motors := problem.motors) is not None:
        ends = {"least": motors.least, "most": motors.most}
        inputs |= {
            name: np.atleast_2d(x)[:, None] if problem.inner else x for name, x in ends.items()
        }
        lag = motors.time_constants[:, None, None]
        times = -problem.dt * xp.asarray([[0.0], [0.5], [1.0]])
        decay = xp.exp(times / xp.where(lag > 0.0, lag, 1.0))
        inputs["lag"] = xp.where(lag > 0.0, decay, 0.0)
    if parts.around.payloads:
        layout = functions_of(problem.module).layout
        upwards = gravity_of(problem.module, layout, problem.constants).reshape(-1, 1, 1)
        inputs["gravity"] = upwards * xp.asarray([0.0, 0.0, 1.0])
    if problem.inner:
        inputs["model"] = default_constants(problem.module)[np.newaxis, np.newaxis]
    return {name: inputs[name] for name in _inputs(problem.module, parts)}


@functools.lru_cache(maxsize=64)
def _inputs(module: ModuleType, parts: Parts) -> dict[str, bool]:
    """True for inputs of programs that are the same for all states, by name.

    With an inner loop those of its model are after them.
    """
    inputs = rollout_inputs(functions_of(module), parts)
    shared = {name: x.is_uniform for name, x in inputs.items()}
    return shared | ({"model": False} if parts.inner else {})


# States (n, nq + nv), or longer by what else they have, steps that each has taken, and why each has
# ended.
Carried = tuple[Array, NDArray[np.int64], NDArray[np.int8]]


class Steps:
    """The steps of one problem, in arrays of NumPy or JAX, of states as the problem begins with."""

    def __init__(self, problem: Problem, xp: Any, parts: Parts | None = None) -> None:
        """Take a problem, the library of its arrays, and what it has if that cannot be seen."""
        self._problem, self._xp = problem, xp
        self.parts = problem.parts if parts is None else parts
        self._program = program_of(problem.module, problem.method, self.parts)
        self._step = self._evaluator(self._program)
        self._values = given_inputs(problem, self.parts, xp)

    def begin(self) -> Carried:
        """States at the start."""
        xp, count = self._xp, len(self._problem.q)
        x = xp.concatenate(self._problem.begin(self.parts, xp), axis=1)
        return x, xp.zeros(count, int), xp.zeros(count, xp.int8)

    def after(self, number: Any, carried: Carried) -> Carried:
        """States after a step that the running ones have taken."""
        xp, (x, taken, ended) = self._xp, carried
        results = self._evaluated(self._step, number, x)
        runs, finite = ended == RUNNING, xp.isfinite(results["x_next"]).all(axis=1)
        going = runs & finite
        x = xp.where(going[:, None], results["x_next"], x)
        ended = xp.where(runs & ~finite, xp.int8(DIVERGED), ended)
        ended = xp.where(going & (results["ended"] > 0.0), xp.int8(OUT_OF_BOUNDS), ended)
        return x, taken + going, ended

    def commanded(self) -> Array:
        """Inputs (1 or n, nu) that are commanded at the start, within their limits."""
        program = self._program
        commands = Program("commands", program.inputs, {"inputs": program.outputs["inputs"]})
        now = self._evaluated(self._evaluator(commands), 0, self.begin()[0])
        commands_now: Array = now["inputs"]
        return commands_now

    def rollout(self, x: Any, taken: Any, ended: Any) -> Rollout:
        """The rollout of samples (n, samples, …)."""
        ends = np.cumsum([part.shape[1] for part in self._problem.begin(self.parts, self._xp)])
        samples = self._xp.split(x, ends[:-1], axis=2)
        return self._problem.rollout(samples, taken, ended, self._xp)

    def _evaluator(self, program: Program) -> Evaluator:
        return Evaluator(program, dict.fromkeys(("robot", "model"), self._problem.module), self._xp)

    def _evaluated(self, evaluator: Evaluator, number: Any, x: Array) -> dict[str, Any]:
        problem, values = self._problem, {"time": 0.0, "h": self._problem.dt, "x": x}
        for name, is_shared in _inputs(problem.module, self.parts).items():
            value = self._values[name]
            values[name] = value if is_shared else _of_step(value, number)
        values.pop("model", None)
        return evaluator(values, {"robot": problem.constants})


def _of_step(values: Array, number: Any) -> Array:
    """Values (1 or n, …) that hold in a step, of those (1 or n, 1 or steps, …) of all steps."""
    return values[:, number if values.shape[1] > 1 else 0]


def numpy_rollout(
    problem: Problem, progress: Callable[[float], None] = lambda share: None
) -> Rollout:
    """Roll states out in NumPy, always in double precision.

    The module's back end is "numpy" or "c"; `progress` is called after every step with the share
    done.
    """
    steps, real = Steps(problem, np), REALS[problem.precision]
    carried = steps.begin()
    samples = [carried[0].astype(real, copy=False)]
    for number in range(problem.steps):
        with np.errstate(all="ignore"):
            carried = steps.after(number, carried)
        if (number + 1) % problem.every == 0:
            samples.append(carried[0].astype(real, copy=False))
        progress((number + 1) / problem.steps)
    return steps.rollout(np.stack(samples, axis=1), *carried[1:])


Reals = NDArray[Any]


def compiled_rollout(
    problem: Problem,
    threads: int = 1,
    progress: Callable[[float], None] = lambda share: None,
    function: Callable[..., None] | None = None,
) -> Rollout:
    """Roll states out in C, in the precision of the problem, to which its numbers are rounded.

    `progress` is called with the share done between calls, which take some tenths of a second at
    most; what it raises ends the rollout. `function` is as of `rollout_function`, of programs that
    have all that the problem has, or is made for the problem. Raises `UsageError` without C source
    of the module, `CompilerError`, and `CacheError` if the library cannot be kept.
    """
    run = _Run(problem)
    if function is None:
        programs = (program_of(problem.module, problem.method, problem.parts),)
        function = rollout_function(problem.module, problem.precision, programs)
    read, written = (x.ctypes.data for x in (run.addresses, run.states))

    def call(piece: Piece) -> None:
        places = piece.first, piece.count, piece.begin, piece.end
        function(read, problem.dt, written, *places)

    take_pieces(call, len(problem.q), problem.steps, threads, progress)
    return run.rollout()


class _Run:
    """The arrays of a rollout; `given` and `states` are the structures of the header."""

    def __init__(self, problem: Problem) -> None:
        self._problem, parts = problem, problem.parts
        self._real = REALS[problem.precision]
        self._owned: list[Any] = []
        count, samples = len(problem.q), 1 + problem.steps // problem.every
        self._steps, self._ended = np.zeros(count, np.uintp), np.zeros(count, np.uint8)
        begin: list[Reals] = problem.begin(parts)
        self._samples = [np.empty((count, samples, x.shape[1]), self._real) for x in begin]
        absent = [0] * (3 - len(begin))
        self.states = np.array(
            [
                *(self._address(np.array(x, self._real, order="C")) for x in begin),
                *absent,
                *(self._steps.ctypes.data, self._ended.ctypes.data, problem.every, samples),
                *(x.ctypes.data for x in self._samples),
                *absent,
            ],
            np.uintp,
        )
        constants = np.ascontiguousarray(constants_of(problem), self._real)
        words = [self._address(constants), int(len(constants) > 1)]
        words.append([*METHODS].index(problem.method))
        values = given_inputs(problem, parts, np)
        inputs = _inputs(problem.module, ALL) | _inputs(problem.module, parts)
        for name, is_shared in inputs.items():
            words += self._rows(values[name], is_shared) if name in values else [0, 0, 0]
        self.addresses = np.array(words, np.uintp)

    def rollout(self) -> Rollout:
        """The rollout that the calls have left in the arrays."""
        steps, ended = self._steps.astype(np.int64), self._ended.view(np.int8)
        return self._problem.rollout(self._samples, steps, ended)

    def _address(self, array: Reals) -> int:
        """Address of an array, which lives as long as this."""
        self._owned.append(array)
        return int(array.ctypes.data)

    def _rows(self, values: Reals, is_shared: bool) -> list[int]:
        """Addresses of rows (1 or n, 1 or steps, …), and distances of those of states and steps.

        What is shared has one row.
        """
        array = np.ascontiguousarray(values, self._real)
        states, steps, *shape = (1, 1, array.size) if is_shared else array.shape
        width = math.prod(shape)
        return [
            self._address(array),
            width * steps if states > 1 else 0,
            width if steps > 1 else 0,
        ]


def constants_of(problem: Problem) -> Reals:
    """Constants (1 or n, constants) of the states."""
    constants = problem.constants
    if constants is None:
        return default_constants(problem.module)[np.newaxis]
    if isinstance(constants, bytes):
        constants = np.frombuffer(constants)
    elif isinstance(constants, tuple):
        constants = np.stack(np.broadcast_arrays(*constants), axis=-1)
    return np.atleast_2d(constants)


def rollout_function(
    module: ModuleType,
    precision: Precision,
    programs: tuple[Program, ...] = (),
    flags: tuple[str, ...] = (),
) -> Callable[..., None]:
    """The compiled function of programs, or of the source that was generated with a module.

    It is called as the header says. `flags` follow the compiler's own. Raises what
    `compiled_rollout` does.
    """
    return _loaded(module, programs, precision == "single", chosen_compiler(), flags)


@functools.lru_cache(maxsize=64)
def _loaded(
    module: ModuleType,
    programs: tuple[Program, ...],
    single: bool,
    compiler: Compiler,
    flags: tuple[str, ...],
) -> Callable[..., None]:
    """The result of `rollout_function`."""
    name, robot = module.NAME, functions_of(module)
    made: dict[str, str] = {}
    if programs:
        text = (Path(module.__path__[0]) / f"{name}.h").read_text(encoding="utf-8")
        header = [line[3:-3] for line in text.partition("\n\n")[0].splitlines()]
        made = rollout_files(robot, programs, header)
    functions = called(programs or rollout_programs(robot))
    files = [] if made else [f"{name}_rollout.h", f"{name}_rollout.c"]
    opened = library(
        module,
        functions,
        made,
        "a rollout",
        single=single,
        per_state=True,
        files=files,
        flags=flags,
    )
    function = opened[f"{name}_rollout{'_float' if single else ''}"]
    address, size = ctypes.c_void_p, ctypes.c_size_t
    function.argtypes = [address, ctypes.c_double, address, *[size] * 4]
    function.restype = None
    return function
