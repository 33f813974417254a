"""Rollouts: many states of one robot in fixed steps, by the back end of its module."""

from __future__ import annotations

import functools
import logging
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import ModuleType
from typing import Any, get_args

import numpy as np

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.flight.rollouts.arguments import Controller, Given, seconds, whole
from gibbs_codegen.flight.rollouts.closed_loop import flown_rollout
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.runtime.c_library import CompilerError
from gibbs_codegen.runtime.cache import CacheError
from gibbs_codegen.runtime.load import BACKENDS, load
from gibbs_codegen.runtime.rollouts import (
    REALS,
    RUNNING,
    Array,
    Method,
    Precision,
    Problem,
    Rollout,
    Steps,
    compiled_rollout,
    plain_rollout,
    rollout_function,
)

Roll = Callable[[Problem], Rollout]
_log = logging.getLogger("gibbs_codegen")


def asked_rollout(
    problem: Problem,
    controller: Controller,
    read: Callable[[Any], Array],
    roll: Roll,
    progress: Callable[[float], None],
) -> Rollout:
    """Roll states out under a controller of time, s, and states (n, nq), (n, nv).

    `problem` has the inputs (1 or n, 1, nu) that it gave first; `read` makes such of what it gives,
    and `roll` rolls states out whose inputs are known. A state that has ended is shown to the
    controller as it ended.
    """
    count, every = len(problem.q), problem.every
    taken, ended = np.zeros(count, dtype=np.int64), np.full(count, RUNNING, dtype=np.int8)
    inputs, samples = problem.inputs, [_begin(problem)]
    for first in range(0, problem.steps, every):
        state = samples[-1]
        if first:
            inputs = read(controller(first * problem.dt, state[0].copy(), state[1].copy()))
        found = roll(_piece(problem, first, inputs, state))
        after = [each[:, -1] for each in (found.q, found.v, found.thrusts) if each is not None]
        runs = ended == RUNNING
        samples.append([np.where(runs[:, None], a, b) for a, b in zip(after, state, strict=True)])
        taken += np.where(runs, found.steps, 0)
        ended = np.where(runs, found.ended, ended)
        progress((first + every) / problem.steps)
    q, v, *thrusts = (np.stack(each, axis=1) for each in zip(*samples, strict=True))
    time = np.arange(len(samples), dtype=np.float64) * (problem.dt * every)
    return Rollout(time, q, v, thrusts[0] if thrusts else None, taken, ended)


def _begin(problem: Problem) -> list[Array]:
    """Coordinates, velocities and, where motors lag, thrusts at the start."""
    real, motors = REALS[problem.precision], problem.motors
    state = [problem.q.astype(real), problem.v.astype(real)]
    if motors is not None and np.any(motors.time_constants):
        shape = len(problem.q), motors.thrusts.shape[1]
        state.append(np.broadcast_to(motors.thrusts, shape).astype(real))
    return state


def _piece(problem: Problem, first: int, inputs: Array, state: list[Array]) -> Problem:
    """The problem from one sample to the next, with inputs (1 or n, 1, nu) that are commanded.

    `first` is the number of its first step; `state` is coordinates, velocities and, where motors
    lag, thrusts at its begin.
    """
    q, v, *thrusts = state
    wrenches, motors = problem.wrenches, problem.motors
    if wrenches is not None and wrenches.shape[1] > 1:
        wrenches = wrenches[:, first : first + problem.every]
    if motors is not None and thrusts:
        motors = replace(motors, thrusts=thrusts[0])
    steps = problem.every
    return replace(problem, q=q, v=v, inputs=inputs, steps=steps, wrenches=wrenches, motors=motors)


def rollout(
    robot: ModuleType | str | os.PathLike[str],
    q0: Any,
    v0: Any,
    control: Any,
    steps: int,
    dt: float,
    *,
    parameters: Mapping[str, Any] | None = None,
    method: Method = "rk4",
    every: int = 1,
    wrenches: Any = None,
    limits: Any = None,
    time_constants: Any = None,
    thrusts: Any = None,
    bounds: Any = None,
    precision: Precision = "double",
    threads: int | None = None,
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> Rollout:
    """Roll out n states of a robot, in fixed steps, each with its own inputs and parameters.

    What is said of a state may be given once for all. See docs/howto/rollouts.md.

    Args:
        robot: A generated module with the back end "c", "numpy" or "jax", or the name or path of
            one, which is loaded with the C back end.
        q0, v0: Coordinates (nq) or (n, nq) and velocities (nv) or (n, nv) at the start; None for
            those with which a scenario begins.
        control: Inputs u that are held through each step, N, then N m or N of the joints: (nu),
            (steps, nu) or (1 or n, 1 or steps, nu). Or a `Feedback`. Or a callable that takes the
            time, s, and coordinates (n, nq) and velocities (n, nv), and returns inputs (nu) or
            (n, nu), which are held until the next sample. Or a scenario, or the name or path of
            one, whose law controls a plant with these parameters, in its surroundings.
        steps: Number of steps.
        dt: Size of a step, s.
        parameters: Parameters of the module's `prepare`: numbers, or arrays (n).
        method: "rk4", or "euler", which is semi-implicit.
        every: A sample is kept after every so many steps; it must divide them.
        wrenches: Wrenches on the frames, held through each step, in N and N m as
            `forward_dynamics_with_wrenches` takes them: (f, 6), (steps, f, 6) or
            (1 or n, 1 or steps, f, 6).
        limits: The least and the greatest inputs, each a number or an array (nu).
        time_constants: Those of the motors' lag, s, 0 for none: a number, (rotors) or (n, rotors).
        thrusts: Thrusts of lagging motors at the start, N, in the same shapes; those that are
            commanded first, if None.
        bounds: The least and the greatest q and v, each a number or an array (nq + nv); a state
            ends where it is beyond them.
        precision: "double", or "single": of the arrays that come out and, with the C back end, of
            what is computed. JAX has its own.
        threads: How many threads of the C back end share the states; all processors if None.
        progress: Is told what is being done, and the share of it that is done, 0 to 1.

    Returns:
        The states at the samples, NumPy's arrays or JAX's, and why states have ended.

    Raises:
        UsageError: An argument is not what it must be, or the module is of an older version.
    """
    module = _module(robot)
    given = _given(module, whole("steps", steps))
    check_settings(given.steps, every, dt, method, precision)
    if precision == "single" and getattr(module, "backend", "") == "jax":
        raise UsageError("precision: with JAX it is what JAX is set to; leave it out")
    workers, told = _threads(threads), functools.partial(progress, "rolling out")
    if isinstance(control, Scenario | str | os.PathLike):
        own = (wrenches, limits, thrusts, bounds)
        _check_scenario(method, precision, own)
        varied = parameters or {}, time_constants
        return flown_rollout(given, control, (q0, v0), (dt, every), varied, workers, progress)
    motors = given.motors(limits, time_constants, thrusts)
    settings: dict[str, Any] = {"steps": given.steps, "dt": float(dt), "method": method}
    settings |= {"every": int(every), "motors": motors, "precision": precision}
    around = parameters or {}, wrenches, bounds
    problem = _problem(given, (q0, v0), control, around, settings)
    if motors is not None and thrusts is None:
        first = Steps(problem, given.xp).commanded(0, problem.q, problem.v)[:, : given.rotors]
        problem = replace(problem, motors=replace(motors, thrusts=first))
    return _rolled(problem, given, control, workers, told)


def _problem(
    given: Given,
    begin: tuple[Any, Any],
    control: Any,
    around: tuple[Mapping[str, Any], Any, Any],
    settings: Mapping[str, Any],
) -> Problem:
    """What is computed, in arrays, with the inputs that a controller gives first.

    `begin` are q0 and v0, `around` parameters, wrenches and bounds, as of `rollout`. Raises
    `UsageError`.
    """
    (q, v), (parameters, wrenches, bounds) = given.start(*begin), around
    constants, frames = given.constants(parameters), len(given.module.FRAMES)
    width = q.shape[1] + v.shape[1]
    inputs, feedback = given.control(control)
    found: dict[str, Any] = {
        "wrenches": None if wrenches is None else given.in_time("wrenches", wrenches, frames, 6),
        "bounds": None if bounds is None else given.range("bounds", bounds, width),
    }
    q, v = (given.xp.repeat(each, given.count() // len(each), 0) for each in (q, v))
    if callable(control):
        inputs = given.asked(control(0.0, q.copy(), v.copy()))
    module = given.module
    return Problem(module, constants, q, v, inputs, feedback=feedback, **found, **settings)


def _given(module: ModuleType, steps: int) -> Given:
    """What reads arguments of a rollout as arrays of NumPy, or of JAX.

    Raises `UsageError` for a back end that has no rollouts.
    """
    backend = getattr(module, "backend", None)
    if backend == "jax":
        from gibbs_codegen.flight.rollouts.jax_rollout import given_to_jax

        return given_to_jax(module, steps)
    if backend not in BACKENDS:
        known = ", ".join((*BACKENDS, "jax"))
        raise UsageError(f"robot: rollouts are of modules with the back ends {known}")
    return Given(module, steps)


def _rolled(
    problem: Problem,
    given: Given,
    control: Any,
    threads: int,
    told: Callable[[float], None],
) -> Rollout:
    """What comes out of a problem that `given` has read; `control` was given for the inputs."""
    if given.module.backend == "jax":
        from gibbs_codegen.flight.rollouts.jax_rollout import traced_rollout

        return traced_rollout(problem, control if callable(control) else None)
    if not callable(control):
        return known_inputs(problem, threads, told)
    roll = functools.partial(known_inputs, threads=threads)
    return asked_rollout(problem, control, given.asked, roll, told)


def known_inputs(
    problem: Problem, threads: int, told: Callable[[float], None] = lambda share: None
) -> Rollout:
    """A rollout whose inputs are known, in C where that can be had."""
    module = problem.module
    in_c = getattr(module, "backend", "numpy") == "c"
    if in_c and _compiles(module, problem.precision, os.environ.get("CC")):
        return compiled_rollout(problem, threads, told)
    return plain_rollout(problem, told)


@functools.lru_cache(maxsize=64)
def _compiles(module: ModuleType, precision: Precision, chosen: str | None) -> bool:
    """Whether a module's rollout compiles, which is tried once; a warning tells that it does not.

    `chosen` is the value of CC. Raises `UsageError` without C source of a rollout.
    """
    try:
        rollout_function(module, precision)
    except (CompilerError, CacheError) as error:
        _log.warning("%s: NumPy rolls out instead of C: %s", module.NAME, printable(error, 400))
        return False
    return True


def _module(robot: Any) -> ModuleType:
    """The module that is rolled out, of a module, or a name or path of one."""
    if isinstance(robot, ModuleType):
        return robot
    if not isinstance(robot, str | os.PathLike):
        words = printable(repr(robot), 60)
        raise UsageError(f"robot: must be a module, or the name or path of one, not {words}")
    return load(robot, "c")


def check_settings(steps: int, every: int, dt: float, method: str, precision: str) -> None:
    """Raise `UsageError` for what is none of the numbers and names that it must be."""
    if steps % whole("every", every):
        raise UsageError(f"every: must divide the {steps} steps, not {every}")
    seconds("dt", dt)
    for name, value, known in (
        ("method", method, get_args(Method)),
        ("precision", precision, get_args(Precision)),
    ):
        if value not in known:
            words = ", ".join(known)
            raise UsageError(f"{name}: {printable(repr(value), 60)} is unknown; known: {words}")


def _check_scenario(method: str, precision: str, others: Sequence[Any]) -> None:
    """Raise `UsageError` for what is not said of a rollout of a scenario. `others` must be None."""
    if method != "rk4" or precision != "double" or any(each is not None for each in others):
        raise UsageError(
            "control: a scenario is rolled out by rk4 in double precision, with limits, wrenches "
            "and bounds of its own: leave out method, precision, wrenches, limits, thrusts, bounds"
        )


def _threads(threads: int | None) -> int:
    """How many threads share the states: as many as there are processors, if None."""
    return (os.cpu_count() or 1) if threads is None else whole("threads", threads)
