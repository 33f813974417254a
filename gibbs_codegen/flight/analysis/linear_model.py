"""Linearisation: how small deviations from a state grow, and which of them inputs reach.

A deviation has 2 nv entries: δ, with q = q₀ ⊕ δ, and v − v₀. With attitude angles δ has the rate
v − v₀. With a quaternion δ is in the axes of the base, which move: from q̇₀ = q₀ ξ₀, where ξ₀ is the
velocity of the base, and q = q₀ exp(δ) follows δ̇ = ξ − ξ₀ − ad(ξ₀) δ to first order, where ad(ξ₀) δ
is the Lie bracket of ξ₀ and δ. With a drive δ has an entry sideways too, which no velocity has.

Where the robot file describes actuators, inputs are made of commands, and the states x of the
actuators are part of a deviation, after the others; or the thrusts of motors that lag. The model is
that of the machine that flies, differentiated. Frames that are in a wall with friction stick to it
by bristles, which have no load there, and whose displacements come last.

`lqr` finds the linear regulator of least quadratic cost for such a model.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from types import ModuleType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

from gibbs_codegen.arrays import Functions, Program, jacobian, variable
from gibbs_codegen.arrays.evaluation import Evaluator
from gibbs_codegen.arrays.nodes import Node, constant, join, zeros
from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.analysis.arguments import coordinates, vehicle_of
from gibbs_codegen.flight.analysis.trim import Trim
from gibbs_codegen.flight.arguments import numbers, vector
from gibbs_codegen.flight.plant.actuators import check_lag, commands_beyond, has_battery
from gibbs_codegen.flight.plant.allocation import listed
from gibbs_codegen.flight.plant.environment import Environment, surrounding
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.scenario.file import AnyScenario
from gibbs_codegen.flight.scenario.walls import surface_at
from gibbs_codegen.flight.vectors import skew
from gibbs_codegen.machine.contact import Contact, bristles_of
from gibbs_codegen.machine.machine import NO_SURROUNDINGS, Machine, Surroundings
from gibbs_codegen.machine.state import State
from gibbs_codegen.robot.wrenches import directions, null_space

# Share of a command to both sides of which its derivatives are looked at.
_NEAR = 1e-9
# Share of the largest influence below which one is rounding.
_RANK = 1e-9


class OperatingPoint(NamedTuple):
    """A state in which a robot is to be linearised; `wrenches` (f, 6) are as of `SteadyMotion`.

    `x` (nx) and `command` (nu) are of actuators that the robot file describes.
    """

    q: Array
    v: Array
    u: Array
    wrenches: Array
    x: Array | None = None
    command: Array | None = None


def checked_state(
    vehicle: Vehicle,
    q: ArrayLike | Trim,
    v: ArrayLike | None,
    u: ArrayLike | None,
    x: ArrayLike | None = None,
) -> OperatingPoint:
    """The state that callers give, as a trim or by its parts; without a trim no wrenches act.

    Raises `UsageError` for what an argument must not be, or a trim of another robot.
    """
    wrenches = np.zeros((len(vehicle.frames), 6))
    if isinstance(q, Trim):
        if not v is u is x is None:
            raise UsageError("v, u: a trim already has them; leave them out")
        if q.robot != vehicle.name:
            raise UsageError(f"q: the trim belongs to {q.robot}, not to {vehicle.name}")
        trim = q
        q, v, x, wrenches = trim.q, trim.v, trim.x, trim.wrenches
        u = trim.u if trim.command is None else trim.command
    elif v is None or u is None:
        raise UsageError("q, v, u: give all three, or a trim as q")
    q, places = coordinates(vehicle, q), vehicle.layout.v
    v = vector(f"v ({', '.join(places.names)})", v, places.size)
    u = vector(f"u ({', '.join(vehicle.commands)})", u, len(vehicle.commands))
    states = vehicle.actuator_states
    if x is not None:
        x = vector(f"x ({', '.join(states) or 'there are none'})", x, len(states))
    if not vehicle.is_driven:
        return OperatingPoint(q, v, u, wrenches)
    if x is None:
        x = vehicle.actuator_state_of(u)
    return OperatingPoint(q, v, vehicle.inputs_of(q, v, x, u), wrenches, x, u)


def linearise(
    robot: ModuleType | str | os.PathLike[str],
    q: ArrayLike | Trim,
    v: ArrayLike | None = None,
    u: ArrayLike | None = None,
    dt: float | None = None,
    *,
    x: ArrayLike | None = None,
    parameters: Mapping[str, float] | None = None,
    time_constants: ArrayLike | None = None,
    surroundings: AnyScenario | None = None,
) -> tuple[Array, Array]:
    """A and B of deviations x from a state under deviations w of the inputs: ẋ = A x + B w.

    x = (δ, v − v₀), where q = q₀ ⊕ δ as `integrate` has it, so δ = `difference(q0, q)`. Where the
    state is not balanced, x is the deviation from the motion that begins there, and A and B hold
    for as long as that stays near.

    Where the robot file describes actuators, x ends with the deviations of their states, and w are
    deviations of commands; else x ends with those of thrusts of motors that lag, if there are any.

    Args:
        robot: A generated module with derivatives, or the name or path of one, which is loaded.
        q: A trim, which has v and u as well, or coordinates (nq).
        v, u: Velocities (nv) and inputs or, where the file describes actuators, commands (nu),
            without a trim.
        dt: None, or a period, s, for which inputs are held: then x' = A x + B w after it, exactly.
        x: States of the actuators (nx), without a trim; those that commands keep, if None.
        parameters: Parameters of the module's `prepare`.
        time_constants: Those of the motors' lag, s, a number or (rotors), 0 for none; no motor lags
            if None.
        surroundings: A scenario, or the name or path of one, whose steady wind acts, and spinning
            rotors, walls that frames are in, and the push, payloads and constraints that act at its
            start.

    Returns:
        A (2 nv, 2 nv) and B (2 nv, nu), or with nx more rows, and columns of A. The last are of
        bristles, three for each frame that is in a wall with friction. With a drive there is one
        more of each, since δ has an entry sideways, between those ahead and about z.

    Raises:
        MissingFunctionError: The module was generated without the derivatives.
        UsageError: An argument is not what it must be.
    """
    vehicle = vehicle_of(robot, parameters)
    state = checked_state(vehicle, q, v, u, x)
    dt = _period(dt)
    a, b, _ = _model(vehicle, state, time_constants, surroundings)
    return (a, b) if dt is None else held(a, b, dt)


def displacement(robot: ModuleType | str | os.PathLike[str], q0: ArrayLike, q: ArrayLike) -> Array:
    """The displacement δ from coordinates to others, q = q₀ ⊕ δ, as in deviations of `linearise`.

    It is `difference(q0, q)`, where with a drive what is sideways follows what is ahead.

    Args:
        robot: A generated module, or the name or path of one, which is loaded.
        q0, q: Coordinates (nq).

    Returns:
        δ (nv), m and rad, or with a drive (nv + 1).

    Raises:
        MissingFunctionError: The module was generated without `difference`, and needs it.
        UsageError: An argument is not what it must be.
    """
    vehicle = vehicle_of(robot)
    return vehicle.displacement(coordinates(vehicle, q0), coordinates(vehicle, q))


def _period(dt: float | None) -> float | None:
    """A period that a caller gives, if it does."""
    if dt is not None:
        wanted = "a period above zero, s"
        dt = float(numbers("dt", dt, wanted, ()))
        if dt <= 0.0:
            raise UsageError(f"dt: must be {wanted}, not {dt:g}")
    return dt


def _model(
    vehicle: Vehicle,
    state: OperatingPoint,
    time_constants: ArrayLike | None,
    surroundings: AnyScenario | None,
) -> tuple[Array, Array, Array]:
    """A and B of a continuous model as of `linearise`, and accelerations (nv) in the state."""
    vehicle.check_wheels()
    u = state.u if state.command is None else state.command
    if state.command is not None and (words := commands_beyond(vehicle.module, u)):
        words = f"{vehicle.name}: u: {words}, where motors do not follow commands"
        warnings.warn(words, RuntimeWarning, stacklevel=3)
    times = _lag_times(vehicle, time_constants)
    lagging = tuple(np.flatnonzero(times).tolist())
    around, figures = _around(vehicle, state.q, surroundings)
    _warn_of_open_loops(vehicle, figures)
    actuators = u[: len(times)][list(lagging)] if state.x is None else state.x
    x = np.concatenate([actuators, np.zeros(bristles_of(around.contacts))])
    values = {"q": state.q, "v": state.v, "x": x, "u": u, **figures}
    values["time_constants"] = times[list(lagging)]
    evaluate = _differentiated(vehicle.module, around, lagging)
    # Levels at rest would speed up and slow down in different times: the mean of both sides.
    near = _NEAR * np.maximum(1.0, np.abs(u)) if state.x is not None and len(state.x) else 0.0
    sides = [
        evaluate({**values, "u": u + side}, {"robot": vehicle.constants})
        for side in ((-near, near) if np.any(near) else (0.0,))
    ]
    derivatives = {name: sum(side[name] for side in sides) / len(sides) for name in sides[0]}
    layout, places = vehicle.layout, vehicle.layout.displaced
    carried = np.zeros((places.size, places.size))  # −ad(ξ₀): the rate of δ by δ itself.
    led = np.eye(places.size)[:, layout.paired]  # The rate of δ by velocities.
    if layout.turns_with_base:
        along, about = layout.own_axes
        parts, twist = np.zeros((2, 3)), led @ state.v
        parts[0, about], parts[1, along] = twist[places.attitude], twist[places.position]
        turning, moving = map(skew, parts)
        carried[places.position, places.position] = -turning[np.ix_(along, along)]
        carried[places.position, places.attitude] = -moving[np.ix_(along, about)]
        carried[places.attitude, places.attitude] = -turning[np.ix_(about, about)]
    still = np.zeros((places.size, len(x) + len(u)))
    names = ["q", "v", *(["x"] if len(x) else []), "u"]
    rows = [[derivatives[f"{y}_by_{x}"] for x in names] for y in ("a", "rates") if y in derivatives]
    both = np.block([[carried, led, still], *rows])
    a, b = np.split(both, [len(both)], axis=1)
    return a, b, derivatives["a"]


def _lag_times(vehicle: Vehicle, time_constants: ArrayLike | None) -> Array:
    """Time constants (rotors), s, 0 where there is no lag, of what callers give."""
    count = vehicle.rotors
    if time_constants is not None:
        check_lag(vehicle.module, "time_constants")
    wanted = f"a number or {count} numbers, 0 or more, in s"
    lag = 0.0 if time_constants is None else time_constants
    times = numbers("time_constants", lag, wanted, (), (count,))
    if np.any(times < 0.0):
        raise UsageError(f"time_constants: must be {wanted}")
    return np.broadcast_to(times, count)


def _around(
    vehicle: Vehicle, q: Array, surroundings: AnyScenario | None
) -> tuple[Surroundings, dict[str, Array]]:
    """Surroundings at the start of a scenario, in steady wind, at coordinates; their figures."""
    environment = surrounding(vehicle, surroundings, vehicle.smooth_place)
    if environment is None:
        return NO_SURROUNDINGS, {}
    if environment.idles(0.0):
        raise UsageError(
            "surroundings: a hold stops the motors at its start, so there is nothing to "
            "regulate; leave it out"
        )
    if np.any(environment.restitution(0.0) >= 0.0):
        raise UsageError(
            "surroundings: a hold with a restitution has no linear model; leave out the "
            "restitution if the frame rests there, else the hold"
        )
    starts = environment.push_acts(0.0), environment.carries(0.0), environment.holding(0.0)
    around, figures = environment.under(*starts)
    return replace(around, gusts=0, contacts=_pressing(environment, q)), figures


def _warn_of_open_loops(vehicle: Vehicle, figures: Mapping[str, Array]) -> None:
    """Warn of loops of a mechanism that no hold closes, by which the model would differ."""
    module, active = vehicle.module, figures.get("active", ())
    if loops := getattr(module, "LOOPS", ()):
        held = {x for x, holds in zip(module.CONSTRAINTS, active, strict=False) if holds}
        if opened := [name for name in loops if name not in held]:
            words = f"{vehicle.name}: the model leaves these loops open: {listed(opened)}; give"
            words += " surroundings with a [[hold]] for each"
            warnings.warn(words, RuntimeWarning, stacklevel=4)


def _pressing(environment: Environment, q: Array) -> tuple[Contact, ...]:
    """Contacts of frames that are in a wall at coordinates; others do nothing nearby."""
    origins = environment.vehicle.frame_poses(q[np.newaxis])[0, :, :3, 3]
    return tuple(
        contact
        for contact in environment.around.contacts
        if (wall := environment.wall[contact.wall])
        and surface_at(wall.kind, np.array(wall.figures), origins[contact.frame])[0]
        > -wall.ball_radius
    )


@lru_cache(maxsize=64)
def _differentiated(
    module: ModuleType, around: Surroundings, lagging: tuple[int, ...]
) -> Evaluator:
    """Evaluation of `motion_program` with the derivatives by state and inputs."""
    program = motion_program(Functions(module), around, lagging)
    by = [name for name in ("q", "v", "x", "u") if name in program.names]
    return Evaluator(jacobian(program, by), {"robot": module})


def motion_program(robot: Functions, around: Surroundings, lagging: tuple[int, ...]) -> Program:
    """Accelerations `a` and `rates` of x, of state, inputs and figures of what acts.

    x are states of actuators, then of bristles.
    """
    figures = dict[str, Node]()

    def figure(name: str, *shape: int) -> Node:
        return figures.setdefault(name, variable(name, *shape, uniform=True))

    machine = Machine(robot, figure, around, lagging=lagging)
    layout = machine.layout()
    count, size = layout.actuators, layout.actuators + layout.bristles
    x = variable("x", size) if size else zeros(0)
    (q, v), u = robot.state(), variable("u", robot.inputs)
    state = State(q, v, zeros(0), x[:count], zeros(0), x[count:])
    rates = machine.rates(constant(0.0), state, machine.inputs(state, u), u)
    outputs = {"a": rates.a}
    outputs |= {"rates": join(rates.actuators, rates.bristles)} if size else {}
    inputs = (q, v, *([x] if size else []), u, *figures.values())
    return Program("motion", inputs, outputs)


def held(a: Array, b: Array, dt: float) -> tuple[Array, Array]:
    """A and B of x' = A x + B w, exact for ẋ = A x + B w with held inputs (zero-order hold).

    `dt` is how long they are held, s.
    """
    size = len(a)
    both = np.zeros((size + b.shape[1],) * 2)
    both[:size] = np.hstack([a, b])
    grown = linalg.expm(dt * both)[:size]
    return grown[:, :size], grown[:, size:]


def unreached(a: Array, b: Array, matters: Callable[[complex], bool]) -> Array:
    """Orthonormal combinations (n, k) that no input reaches, and whose eigenvalues matter.

    For a column w, wᵀ x goes its own way. Eigenvalues of the whole model would not serve: those of
    integrators are double, and rounding moves them by its square root. So what inputs reach is
    taken away first.
    """
    rest = null_space(_reached(a, b).T)
    if not rest.shape[1]:
        return rest
    _, vectors, count = linalg.schur((rest.T @ a @ rest).T, output="complex", sort=matters)
    mattering = vectors[:, :count]
    left, _, _ = np.linalg.svd(np.concatenate([mattering.real, mattering.imag], axis=1))
    return rest @ left[:, :count]


def _reached(a: Array, b: Array) -> Array:
    """Orthonormal columns (n, r) that span B, A B, A² B and so on."""
    reached = np.zeros((len(a), 0))
    added, scale = b, np.linalg.norm(b, 2) if b.size else 0.0
    while added.shape[1]:
        # Twice, since once leaves rounding.
        for _ in range(2):
            added = added - reached @ (reached.T @ added)
        left, values, _ = np.linalg.svd(added, full_matrices=False)
        fresh = left[:, values > _RANK * scale]
        reached = np.concatenate([reached, fresh], axis=1)
        added, scale = a @ fresh, np.linalg.norm(a, 2)
    return reached


# How far an eigenvalue may be from where motions neither grow nor decay, as a share of the model's.
_MARGINAL = 1e-7
# Accelerations, m/s² or rad/s², that a robot may have where a regulator is to keep it.
_STEADY = 1e-3
# What gains are, as shares of the largest, that nothing but rounding is left in.
_ROUNDING = 1e-13


@dataclass(frozen=True, eq=False)
class Regulator:
    """The inputs u = u₀ − K x for deviations x = (`displacement(robot, q0, q)`, v − v₀).

    - `gain` (nu, 2 nv): K; with a drive one more column, and so below
    - `cost` (2 nv, 2 nv): P; xᵀ P x is the cost from x on
    - `eigenvalues` (2 nv): of A − B K, the slowest first; 1/s, or by period
    - `a` (2 nv, 2 nv), `b` (2 nv, nu): the model, continuous or by period

    Where the robot file describes actuators, u are commands, and x ends with the deviations of
    their nx states; with `time_constants`, with those of thrusts that lag. `Feedback` takes the
    gain but in that last case, in which a controller of one's own applies it. A battery drains
    whatever is commanded: its charge counts as constant, so that its entries of gain and cost are
    0, and it has no eigenvalue. Nor have bristles, which go along with the frames that stick.
    """

    gain: Array
    cost: Array
    eigenvalues: NDArray[np.complex128]
    a: Array
    b: Array


def lqr(
    robot: ModuleType | str | os.PathLike[str],
    q: ArrayLike | Trim,
    v: ArrayLike | None = None,
    u: ArrayLike | None = None,
    Q: ArrayLike | None = None,  # noqa: N803 - the names of the field
    R: ArrayLike | None = None,  # noqa: N803
    dt: float | None = None,
    *,
    x: ArrayLike | None = None,
    parameters: Mapping[str, float] | None = None,
    time_constants: ArrayLike | None = None,
    surroundings: AnyScenario | None = None,
) -> Regulator:
    """The regulator that keeps a robot at a state with the least cost ∫ (xᵀ Q x + wᵀ R w) dt.

    A warning gives the acceleration of a state that is not balanced, above 1e-3 m/s²
    or rad/s².

    Args:
        robot: A generated module with derivatives, or the name or path of one, which is loaded.
        q: A trim, which has v and u as well, or coordinates (nq).
        v, u: Velocities (nv) and inputs or, where the file describes actuators, commands (nu),
            without a trim, after which Q and R may come at once.
        Q: Weights of the deviations x of `linearise`, (2 nv, 2 nv), or their diagonal (2 nv), with
            the states of actuators and bristles; the weight of a battery's charge has no effect.
        R: Weights of deviations w of the inputs, (nu, nu), or their diagonal (nu); weights of
            joints whose effort is 0 have no effect.
        dt: None, or a period, s, for which inputs are held; the cost is then a sum over periods.
        x: States of the actuators (nx), without a trim; those that commands keep, if None.
        parameters: Parameters of the module's `prepare`.
        time_constants, surroundings: As of `linearise`; gains are also of thrusts that lag.

    Returns:
        The regulator.

    Raises:
        UsageError: The module has no derivatives; an argument is not what it must be, such as
            weights of wrong shape or sign; or there is no regulator, with the motions that cannot
            be stabilised or that Q leaves free.
    """
    vehicle = vehicle_of(robot, parameters)
    if isinstance(q, Trim) and R is None and u is not None:  # lqr(robot, trim, Q, R, dt)
        dt = dt if Q is None else float(numbers("dt", Q, "a period above zero, s", ()))
        v, u, Q, R = None, None, v, u  # noqa: N806
    if Q is None or R is None:
        raise UsageError("Q, R: missing; give weights of deviations (Q) and of inputs (R)")
    state = checked_state(vehicle, q, v, u, x)
    dt = _period(dt)
    all_a, all_b, acceleration = _model(vehicle, state, time_constants, surroundings)
    limits = vehicle.description("INPUT_LIMITS")
    # Nothing drives joints whose effort is 0.
    able = [k for k, name in enumerate(vehicle.inputs) if limits.get(name) != (0.0, 0.0)]
    if not able:
        raise UsageError(f"{vehicle.name}: has no inputs, so there is no regulator")
    moved = state.q, state.v, state.u
    by_wrenches = vehicle.forward_dynamics_with_wrenches(*moved, state.wrenches)
    balance = by_wrenches - vehicle.forward_dynamics(*moved)
    _warn_if_unbalanced(vehicle, acceleration + balance)
    names = deviation_names(vehicle, np.flatnonzero(_lag_times(vehicle, time_constants)).tolist())
    # No command brings the charge of a battery back, and bristles go along with what sticks.
    size, kept, nv = len(all_a), len(names) - has_battery(vehicle), vehicle.layout.v.size
    along = np.eye(size, kept)
    along[len(names) :, :nv] = all_a[len(names) :, nv : 2 * nv]
    a, b = all_a[:kept] @ along, all_b[:kept]
    if dt is not None:
        (a, b), (all_a, all_b) = held(a, b, dt), held(all_a, all_b, dt)
    states = along.T @ _weights("Q", Q, size, False) @ along
    inputs = _weights("R", R, b.shape[1], True)[np.ix_(able, able)]
    b = b[:, able]
    _check_solvable(vehicle, a, b, states, dt, names[:kept])
    solve = linalg.solve_continuous_are if dt is None else linalg.solve_discrete_are
    try:
        cost = solve(a, b, states, inputs)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise UsageError(
            f"{vehicle.name}: SciPy does not solve the Riccati equation ({error}); try weights "
            "of more similar size"
        ) from None
    if dt is None:
        gain = linalg.solve(inputs, b.T @ cost, assume_a="pos")
    else:
        gain = linalg.solve(inputs + b.T @ cost @ b, b.T @ cost @ a, assume_a="pos")
    gain[np.abs(gain) <= _ROUNDING * np.abs(gain).max()] = 0.0
    values = np.linalg.eigvals(a - b @ gain)
    slowest = np.argsort(-(values.real if dt is None else np.abs(values)))
    rest = (0, size - kept)
    gains = np.zeros((all_b.shape[1], size))
    gains[able, :kept] = gain
    return Regulator(gains, np.pad(cost, (rest, rest)), values[slowest], all_a, all_b)


def _warn_if_unbalanced(vehicle: Vehicle, acceleration: Array) -> None:
    """Warn, with the accelerations by name, where a robot does not keep its velocities."""
    rates = vehicle.layout.v
    changes = [
        f"{name} by {value:.3g} {unit}²"
        for name, value, unit in zip(rates.names, acceleration, rates.units, strict=True)
        if abs(value) > _STEADY
    ]
    if changes:
        warnings.warn(
            f"{vehicle.name}: the state is not an equilibrium: velocities change, "
            f"{listed(changes)}. Give a trim without acceleration",
            RuntimeWarning,
            stacklevel=3,
        )


def _weights(name: str, entries: ArrayLike, size: int, definite: bool) -> Array:
    """A matrix (size, size) of weights, given whole or by its diagonal.

    Raises `UsageError` for a wrong shape or sign; if `definite`, every deviation must cost.
    """
    wanted = f"a symmetric matrix ({size}, {size}) or its diagonal ({size})"
    matrix = numbers(name, entries, wanted, (size, size), (size,))
    matrix = np.diag(matrix) if matrix.ndim == 1 else matrix
    if not np.allclose(matrix, matrix.T):
        raise UsageError(f"{name}: must be {wanted}")
    values = np.linalg.eigvalsh(matrix)
    least, noise = values[0], 1e-12 * np.abs(values).max()
    if least < -noise or (definite and least <= noise):
        wanted = "positive definite" if definite else "positive semidefinite"
        raise UsageError(f"{name}: must be {wanted}; its least eigenvalue is {least:.3g}")
    return matrix


def _check_solvable(
    vehicle: Vehicle,
    a: Array,
    b: Array,
    weights: Array,
    dt: float | None,
    names: Sequence[str],
) -> None:
    """Raise `UsageError` that names the motions for which there is no regulator.

    Inputs do not reach a motion that does not decay, or Q one that neither grows nor decays.
    `weights` are of the states, as many as A has, with `names`; `dt` is None for a continuous
    model.
    """
    tolerance = _MARGINAL * max(1.0, float(np.linalg.norm(a, 2)))

    def growth(value: complex) -> float:
        return value.real if dt is None else abs(value) - 1.0

    stuck = unreached(a, b, lambda value: growth(value) > -tolerance)
    if stuck.shape[1]:
        # Rows of rigid loops are states that nothing changes.
        loops = getattr(vehicle.module, "LOOPS", ())
        raise UsageError(
            f"{vehicle.name}: cannot be stabilised here: no input changes "
            f"{listed(directions(stuck, names))}"
            + "; keep loops closed by constraints with a frequency"
            * bool(loops)
        )
    unseen = unreached(a.T, weights, lambda value: abs(growth(value)) <= tolerance)
    if unseen.shape[1]:
        raise UsageError(
            f"{vehicle.name}: Q gives no weight to states that do not decay by themselves: "
            f"{listed(directions(unseen, names))}; give them weight"
        )


def deviation_names(vehicle: Vehicle, lagging: Sequence[int] = ()) -> tuple[str, ...]:
    """Names of the entries of a deviation: of δ, then velocities, then states of actuators.

    Without such actuators these are thrusts of `lagging` rotors.
    """
    places = vehicle.layout.displaced
    names = [*places.names[: places.size]]
    states = vehicle.actuator_states or [f"the thrust {vehicle.inputs[k]}" for k in lagging]
    names[places.joints] = vehicle.joint_names
    if vehicle.layout.turns_with_base:
        along, about = vehicle.layout.own_axes
        names[places.position] = [f"place along the base's {'xyz'[axis]}" for axis in along]
        names[places.attitude] = [f"attitude about the base's {'xyz'[axis]}" for axis in about]
        return (*names, *vehicle.layout.v.names, *states)
    return (*names, *(f"the rate of {name}" for name in names), *states)
