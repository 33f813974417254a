"""Rollouts: many states of one robot in fixed steps, by the back end of its module."""

from __future__ import annotations

import functools
import logging
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import ModuleType
from typing import Any, get_args

import numpy as np

from gibbs_codegen.errors import UsageError, printable, written
from gibbs_codegen.flight.arguments import seconds, whole
from gibbs_codegen.flight.integration.envelope import hard_impacts, joint_modes, lag_modes
from gibbs_codegen.flight.plant.actuators import commands_beyond
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.rollouts.arguments import Controller, RolloutArguments
from gibbs_codegen.flight.rollouts.scenario_rollout import scenario_rollout
from gibbs_codegen.flight.rollouts.surroundings import (
    on_arrays,
    rollout_surroundings,
    with_parameters,
)
from gibbs_codegen.flight.scenario.file import AnyScenario
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.scenario.walls import Wall
from gibbs_codegen.machine.rollout_steps import Parts
from gibbs_codegen.runtime import rollouts
from gibbs_codegen.runtime.c_library import CompilerError
from gibbs_codegen.runtime.cache import CacheError
from gibbs_codegen.runtime.load import BACKENDS, load

Roll = Callable[[rollouts.Problem], rollouts.Rollout]
_log = logging.getLogger("gibbs_codegen")


def callback_rollout(
    problem: rollouts.Problem,
    controller: Controller,
    read: Callable[[Any], rollouts.Array],
    roll: Roll,
    progress: Callable[[float], None],
) -> rollouts.Rollout:
    """Roll states out under a controller of time, s, and states (n, nq), (n, nv).

    `problem` has the inputs (1 or n, 1, nu) that it gave first; `read` makes such of what it gives,
    and `roll` rolls states out whose inputs are known. A state that has ended is shown to the
    controller as it ended.
    """
    count, every = len(problem.q), problem.every
    taken, ended = np.zeros(count, dtype=np.int64), np.full(count, rollouts.RUNNING, dtype=np.int8)
    inputs, real = problem.inputs, rollouts.REALS[problem.precision]
    samples = [[part.astype(real) for part in problem.begin(problem.parts)]]
    for first in range(0, problem.steps, every):
        state = samples[-1]
        if first:
            inputs = read(controller(first * problem.dt, state[0].copy(), state[1].copy()))
        piece = roll(_piece(problem, first, inputs, state))
        rest = [series for series in (piece.thrusts, piece.x, piece.bristles) if series is not None]
        after = [piece.q[:, -1], piece.v[:, -1]]
        after += [np.concatenate([series[:, -1] for series in rest], axis=-1)] if rest else []
        runs = ended == rollouts.RUNNING
        samples.append([np.where(runs[:, None], a, b) for a, b in zip(after, state, strict=True)])
        taken += np.where(runs, piece.steps, 0)
        ended = np.where(runs, piece.ended, ended)
        progress((first + every) / problem.steps)
    stacked = [np.stack(sample, axis=1) for sample in zip(*samples, strict=True)]
    return problem.rollout(stacked, taken, ended)


def _piece(
    problem: rollouts.Problem, first: int, inputs: rollouts.Array, state: list[rollouts.Array]
) -> rollouts.Problem:
    """The problem from one sample to the next, with inputs (1 or n, 1, nu) that are commanded.

    `first` is the number of its first step; `state` is at its begin what the problem's `begin` has.
    """
    q, v, *rest = state
    actuators, bristles = problem.after(rest[0] if rest else None)
    wrenches, motors = problem.wrenches, problem.motors

    def now(x: rollouts.Array) -> rollouts.Array:
        return x[:, first : first + problem.every] if x.shape[1] > 1 else x

    wrenches = None if wrenches is None else now(wrenches)
    loads = {name: now(x) for name, x in problem.loads.items()}
    if actuators is not None and problem.x is not None:
        problem = replace(problem, x=actuators)
    elif actuators is not None and motors is not None:
        motors = replace(motors, thrusts=actuators)
    problem, steps = replace(problem, bristles=bristles, loads=loads), problem.every
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
    method: rollouts.Method = "rk4",
    every: int = 1,
    wrenches: Any = None,
    walls: Sequence[Wall] = (),
    surroundings: AnyScenario | None = None,
    wind: Any = None,
    payloads: Any = None,
    constraints: Sequence[str] = (),
    limits: Any = None,
    time_constants: Any = None,
    thrusts: Any = None,
    x0: Any = None,
    bounds: Any = None,
    precision: rollouts.Precision = "double",
    threads: int | None = None,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> rollouts.Rollout:
    """Roll out n states of a robot, in fixed steps, each with its own inputs and parameters.

    What is said of a state may be given once for all. See docs/howto/rollouts.md.

    Args:
        robot: A generated module with the back end "c", "numpy" or "jax", or the name or path of
            one, which is loaded with the C back end.
        q0, v0: Coordinates (nq) or (n, nq) and velocities (nv) or (n, nv) at the start; None for
            those with which a scenario begins.
        control: Inputs u that are held through each step, N, then N m or N of the joints: (nu),
            (steps, nu) or (1 or n, 1 or steps, nu); where the robot file describes actuators,
            commands of motors and servos. Or a `Feedback`. Or a callable that takes the
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
        walls: What frames touch, with friction and without, as a scenario has it:
            `read_scenario(…).walls`.
        surroundings: A scenario, or the name or path of one, whose wind, payloads, push and walls
            act, and spinning rotors.
        wind: Velocity of the steady wind, m/s, world axes, (3) or (n, 3); replaces that of the
            surroundings.
        payloads: Masses of the payloads, kg, (p) or (n, p); replace those of the surroundings.
        constraints: Names of the constraints that hold, of the module's CONSTRAINTS; each step ends
            where they are met. Start there: `integrate` and `constraint_projection`, `impact`.
        limits: The least and the greatest inputs, each a number or an array (nu); of commands those
            of the robot file, if None.
        time_constants: Those of the motors' lag, s, 0 for none: a number, (rotors) or (n, rotors).
        thrusts: Thrusts of lagging motors at the start, N, in the same shapes; those that are
            commanded first, if None.
        x0: States of the actuators that the robot file describes at the start, (nx) or (n, nx);
            those that the first commands keep, if None.
        bounds: The least and the greatest q and v, each a number or an array (nq + nv); a state
            ends where it is beyond them.
        precision: "double", or "single": of the arrays that come out and, with the C back end, of
            what is computed. JAX has its own.
        threads: How many threads of the C back end share the states; all processors if None.
        progress: Called with the name of the work and the share done, 0 to 1.

    Returns:
        The states at the samples, NumPy's arrays or JAX's, and why states have ended.

    Raises:
        UsageError: An argument is not what it must be, or the module is of an older version.
    """
    if not isinstance(robot, ModuleType | str | os.PathLike):
        words = written(robot)
        raise UsageError(f"robot: must be a module, or the name or path of one, not {words}")
    module = robot if isinstance(robot, ModuleType) else load(robot, "c")
    count, backend = whole("steps", steps), getattr(module, "backend", None)
    if backend not in (backends := (*BACKENDS, "jax")):
        raise UsageError(f"robot: rollouts need a module with back end {', '.join(backends)}")
    if backend == "jax":
        from gibbs_codegen.flight.rollouts import jax_rollout

        arguments = jax_rollout.jax_arguments(module, count)
    else:
        arguments = RolloutArguments(module, count)
    check_settings(arguments.steps, every, dt, method, precision)
    if precision == "single" and backend == "jax":
        raise UsageError("precision: JAX has its own setting; leave it out")
    workers = (os.cpu_count() or 1) if threads is None else whole("threads", threads)
    tell = functools.partial(progress, "rolling out")
    if isinstance(control, Scenario | str | os.PathLike | Mapping):
        others_given = wrenches, limits, thrusts, x0, bounds, surroundings, wind, payloads
        others = any(option is not None for option in others_given)
        if others or walls or constraints or method != "rk4":
            raise UsageError(
                "control: a scenario has its own method, wrenches, limits, thrusts, x0, bounds, "
                "walls, constraints, surroundings, wind and payloads; leave these out"
            )
        varied = parameters or {}, time_constants
        return scenario_rollout(
            arguments, control, (q0, v0), (dt, every), varied, (precision, workers), progress
        )
    active = tuple(float(name in constraints) for name in getattr(module, "CONSTRAINTS", ()))
    if sum(active) != len(constraints):
        names = ", ".join(getattr(module, "CONSTRAINTS", ())) or "the robot has none"
        raise UsageError(f"constraints: must be names of CONSTRAINTS, each once; known: {names}")
    motors, x = arguments.motors(limits, time_constants, thrusts), arguments.actuators(x0)
    (q, v), constants = arguments.start(q0, v0), arguments.constants(parameters or {})
    if constraints and backend == "jax" and q.dtype != np.float64:
        raise UsageError(
            "constraints: with JAX they need double precision; set jax_enable_x64, or load the "
            "module with the back end c"
        )
    inputs, feedback = arguments.control(control)
    states = arguments.xp.repeat(q, arguments.count() // len(q), 0), parameters or {}
    taken = float(dt), method
    varied = wind, payloads
    surrounded = rollout_surroundings(arguments, walls, surroundings, varied, states, taken)
    warn_of_long_steps(module, dt, method, parameters or {})
    in_limits_of_file = arguments.is_driven and limits is None and isinstance(inputs, np.ndarray)
    alone = feedback is None and not callable(control)
    if in_limits_of_file and alone and (beyond := commands_beyond(module, inputs)):
        beyond = f"{module.NAME}: control: commands are held within their limits: {beyond}"
        warnings.warn(beyond, RuntimeWarning, stacklevel=2)
    if wrenches is not None:
        wrenches = arguments.in_time("wrenches", wrenches, len(module.FRAMES), 6)
    loads = surrounded.at(np.zeros(1), arguments.steps, float(dt))
    if (push := loads.pop("wrenches", None)) is not None:
        wrenches = push if wrenches is None else wrenches + push
    if bounds is not None:
        bounds = arguments.range("bounds", bounds, q.shape[1] + v.shape[1])
    # Wind and payloads, too, may be of more states.
    q, v = (arguments.xp.repeat(part, arguments.count() // len(part), 0) for part in (q, v))
    if callable(control):
        inputs = arguments.commands(control(0.0, q.copy(), v.copy()))
    around, figures = surrounded.around, surrounded.figures
    if constraints:
        around, figures = replace(around, holds=True), (*figures, ("active", active))
    problem = rollouts.Problem(
        module,
        constants,
        q,
        v,
        inputs,
        steps=arguments.steps,
        dt=float(dt),
        method=method,
        every=int(every),
        feedback=feedback,
        motors=motors,
        wrenches=wrenches,
        bounds=bounds,
        precision=precision,
        x=x,
        around=around,
        figures=figures,
        loads=loads,
    )
    if x is not None and x0 is None:
        first = rollouts.Steps(problem, arguments.xp).commanded()
        problem = replace(problem, x=module.actuator_state_of(first, constants=constants))
    elif motors is not None and thrusts is None:
        first = rollouts.Steps(problem, arguments.xp).commanded()[:, : arguments.rotors]
        problem = replace(problem, motors=replace(motors, thrusts=first))
    roll = functools.partial(array_rollout, threads=workers)
    if backend == "jax":
        done = jax_rollout.jax_rollout(problem, control if callable(control) else None)
    elif callable(control):
        done = callback_rollout(problem, control, arguments.commands, roll, tell)
    else:
        done = roll(problem, tell=tell)
    for words in _hard_impacts(done, module, surrounded.walls, parameters or {}, float(dt), method):
        warnings.warn(f"{module.NAME}: dt: {words}", RuntimeWarning, stacklevel=2)
    return done


def _hard_impacts(
    done: rollouts.Rollout,
    module: ModuleType,
    walls: Sequence[Wall],
    parameters: Mapping[str, Any],
    dt: float,
    method: rollouts.Method,
) -> list[str]:
    """Sentences on impacts for which steps of `dt` s were too long; none of what JAX traces."""
    if not walls:
        return []
    try:
        vehicle = with_parameters(module, parameters)
        q, v = (np.swapaxes(np.asarray(x, np.float64), 0, 1) for x in (done.q, done.v))
        return list(hard_impacts(vehicle, walls, (q, v), np.asarray(done.time), dt, method))
    except TypeError:  # It has no values.
        return []


def array_rollout(
    problem: rollouts.Problem, threads: int, tell: Callable[[float], None] = lambda share: None
) -> rollouts.Rollout:
    """A rollout whose inputs are known, in C where that can be had."""
    module = problem.module
    in_c = getattr(module, "backend", "numpy") == "c"
    asked = module, problem.method, problem.parts, problem.precision
    if in_c and _compiles(*asked, os.environ.get("CC")):
        return rollouts.compiled_rollout(problem, threads, tell)
    return rollouts.numpy_rollout(problem, tell)


@functools.lru_cache(maxsize=64)
def _long_steps(
    module: ModuleType, dt: float, method: rollouts.Method, fixed: tuple[tuple[str, float], ...]
) -> str:
    """Why steps are too long for servos and friction with parameters, "" if they are not."""
    try:
        vehicle = Vehicle(on_arrays(module), dict(fixed))
        modes = lag_modes(vehicle) + joint_modes(vehicle, vehicle.neutral[np.newaxis])
    except UsageError:  # A module of few functions does not tell.
        return ""
    return "".join(mode.fault(dt, method) for mode in modes)


@functools.lru_cache(maxsize=64)
def _compiles(
    module: ModuleType,
    method: rollouts.Method,
    parts: Parts,
    precision: rollouts.Precision,
    chosen: str | None,
) -> bool:
    """True if a module's rollout compiles, which is tried once; else there is a warning.

    `chosen` is the value of CC. Raises `UsageError` without C source of the module.
    """
    try:
        program = rollouts.program_of(module, method, parts)
        rollouts.rollout_function(module, precision, (program,))
    except (CompilerError, CacheError) as error:
        _log.warning(
            "%s: rollouts run in NumPy instead of C: %s", module.NAME, printable(error, 400)
        )
        return False
    return True


def check_settings(steps: int, every: int, dt: float, method: str, precision: str) -> None:
    """Raise `UsageError` for what is none of the numbers and names that it must be."""
    if steps % whole("every", every):
        raise UsageError(f"every: must divide the {steps} steps, not {every}")
    seconds("dt", dt)
    for name, value, choices in (
        ("method", method, get_args(rollouts.Method)),
        ("precision", precision, get_args(rollouts.Precision)),
    ):
        if value not in choices:
            words = ", ".join(choices)
            raise UsageError(f"{name}: {written(value)} is unknown; known: {words}")


def warn_of_long_steps(
    module: ModuleType, dt: float, method: rollouts.Method, parameters: Mapping[str, Any]
) -> None:
    """Warn of steps that are too long for servos and dry friction, of the first state's numbers."""
    if not getattr(module, "COMMANDS", ()):
        return
    try:
        fixed = tuple((name, float(np.ravel(value)[0])) for name, value in parameters.items())
    except (TypeError, ValueError):  # What JAX traces has no values.
        return
    if words := _long_steps(module, float(dt), method, fixed):
        warnings.warn(f"{module.NAME}: dt: {words}", RuntimeWarning, stacklevel=3)
