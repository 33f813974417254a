"""Linearisation: how small deviations from a state grow, and which of them inputs reach.

A deviation has 2 nv entries: δ, with q = q₀ ⊕ δ, and v − v₀. With attitude angles δ has the rate
v − v₀. With a quaternion δ is in the axes of the base, which move: from q̇₀ = q₀ ξ₀, where ξ₀ is the
velocity of the base, and q = q₀ exp(δ) follows δ̇ = ξ − ξ₀ − ad(ξ₀) δ to first order, where ad(ξ₀) δ
is the Lie bracket of ξ₀ and δ.

Where the robot file describes actuators, inputs are made of commands, and the states x of the
actuators are part of a deviation, after the others.

Of such a model `lqr` finds the linear regulator of least quadratic cost about a state.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.analysis.arguments import coordinates, vehicle_of
from gibbs_codegen.flight.analysis.trim import Trim, null_space
from gibbs_codegen.flight.arguments import numbers, vector
from gibbs_codegen.flight.plant.actuators import commands_beyond, has_battery
from gibbs_codegen.flight.plant.allocation import listed
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.vectors import skew
from gibbs_codegen.robot.wrenches import directions
from gibbs_codegen.runtime.loaded_module import require_functions

_DERIVATIVES = "forward_dynamics_derivatives"
# Share of a command to both sides of which its derivatives are looked at.
_NEAR = 1e-9
# Share of the largest influence below which one is rounding.
_RANK = 1e-9


class State(NamedTuple):
    """Where a robot is to be linearised; `wrenches` (f, 6) are as of `SteadyMotion`.

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
) -> State:
    """The state that callers give, as a trim or by its parts; without a trim no wrenches act.

    Raises `UsageError` for what an argument must not be, or a trim of another robot.
    """
    wrenches = np.zeros((len(vehicle.frames), 6))
    if isinstance(q, Trim):
        if not v is u is x is None:
            raise UsageError(
                "v, u: a trim has its own, and x; give them without a trim, or neither"
            )
        if q.robot != vehicle.name:
            raise UsageError(f"q: the trim is of {q.robot}, not of {vehicle.name}")
        found = q
        q, v, x, wrenches = found.q, found.v, found.x, found.wrenches
        u = found.u if found.command is None else found.command
    elif v is None or u is None:
        raise UsageError("q, v, u: give all three, or a trim in the place of q")
    q, places = coordinates(vehicle, q), vehicle.layout.v
    v = vector(f"v ({', '.join(places.names)})", v, places.size)
    u = vector(f"u ({', '.join(vehicle.commands)})", u, len(vehicle.commands))
    states = vehicle.actuator_states
    if x is not None:
        x = vector(f"x ({', '.join(states) or 'there are none'})", x, len(states))
    if not vehicle.is_driven:
        return State(q, v, u, wrenches)
    if x is None:
        x = vehicle.actuator_state_of(u) if states else np.zeros(0)
    return State(q, v, vehicle.inputs_of(q, v, x, u), wrenches, x, u)


def linearise(
    robot: ModuleType | str | os.PathLike[str],
    q: ArrayLike | Trim,
    v: ArrayLike | None = None,
    u: ArrayLike | None = None,
    dt: float | None = None,
    *,
    x: ArrayLike | None = None,
    parameters: Mapping[str, float] | None = None,
) -> tuple[Array, Array]:
    """A and B of deviations x from a state under deviations w of the inputs: ẋ = A x + B w.

    x = (δ, v − v₀), where q = q₀ ⊕ δ as `integrate` has it, so δ = `difference(q0, q)`. Where the
    state is not balanced, x is the deviation from the motion that begins there, and A and B hold
    for as long as that stays near.

    Where the robot file describes actuators, x ends with the deviations of their states, and w are
    deviations of commands.

    Args:
        robot: A generated module with derivatives, or the name or path of one, which is loaded.
        q: A trim, which has v and u as well, or coordinates (nq).
        v, u: Velocities (nv) and inputs or, where the file describes actuators, commands (nu),
            without a trim.
        dt: None, or a period, s, for which inputs are held: then x' = A x + B w after it, exactly.
        x: States of the actuators (nx), without a trim; those that commands keep, if None.
        parameters: Parameters of the module's `prepare`.

    Returns:
        A (2 nv, 2 nv) and B (2 nv, nu), or with nx more rows, and columns of A.

    Raises:
        MissingFunctionError: The module was generated without the derivatives.
        UsageError: An argument is not what it must be.
    """
    vehicle = vehicle_of(robot, parameters)
    module = vehicle.module
    of_actuators = ["inputs_of_derivatives"] if vehicle.is_driven else []
    of_actuators += ["actuator_rates_derivatives"] if vehicle.actuator_states else []
    require_functions(module, [_DERIVATIVES, *of_actuators])
    state = checked_state(vehicle, q, v, u, x)
    if state.command is not None and (words := commands_beyond(module, state.command)):
        words = f"{vehicle.name}: u: {words}, beyond which nothing follows the command"
        warnings.warn(words, RuntimeWarning, stacklevel=2)
    if dt is not None:
        wanted = "a period above zero, s"
        dt = float(numbers("dt", dt, wanted, ()))
        if dt <= 0.0:
            raise UsageError(f"dt: must be {wanted}, not {dt:g}")
    _, by_q, by_v, by_u = vehicle.function(_DERIVATIVES)(state.q, state.v, state.u)
    places = vehicle.layout.v
    carried = np.zeros((places.size, places.size))  # −ad(ξ₀): the rate of δ by δ itself.
    if vehicle.layout.is_quaternion:
        turning, moving = (skew(state.v[part]) for part in (places.attitude, places.position))
        carried[places.position, places.position] = -turning
        carried[places.position, places.attitude] = -moving
        carried[places.attitude, places.attitude] = -turning
    a = np.block([[carried, np.eye(places.size)], [by_q, by_v]])
    b = np.concatenate([np.zeros_like(by_u), by_u])
    if state.command is not None:
        a, b = _with_actuators(vehicle, state, a, b)
    return (a, b) if dt is None else held(a, b, dt)


def _with_actuators(vehicle: Vehicle, state: State, a: Array, b: Array) -> tuple[Array, Array]:
    """The model of motion and actuators under commands, of that of the motion under inputs."""
    q, v, x, command = state.q, state.v, np.asarray(state.x), np.asarray(state.command)
    _, by_q, by_v, by_x, by_command = vehicle.function("inputs_of_derivatives")(q, v, x, command)
    motion = a + b @ np.concatenate([by_q, by_v], axis=1)
    if not len(x):
        return motion, b @ by_command
    # Levels at rest would speed up and slow down in different times: the mean of both sides.
    near = _NEAR * np.maximum(1.0, np.abs(command))
    of_rates = vehicle.function("actuator_rates_derivatives")
    sides = [of_rates(x, command + side) for side in (-near, near)]
    rates, forced = (0.5 * (low + high) for low, high in zip(*(s[1:] for s in sides), strict=True))
    still = np.zeros((len(x), len(a)))
    return np.block([[motion, b @ by_x], [still, rates]]), np.concatenate([b @ by_command, forced])


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


@dataclass(frozen=True, eq=False)
class Regulator:
    """The inputs u = u₀ − K x for deviations x = (`difference(q0, q)`, v − v₀).

    - `gain` (nu, 2 nv): K
    - `cost` (2 nv, 2 nv): P; xᵀ P x is the cost from x on
    - `eigenvalues` (2 nv): of A − B K, the slowest first; 1/s, or by period
    - `a` (2 nv, 2 nv), `b` (2 nv, nu): the model, continuous or by period

    Where the robot file describes actuators, u are commands, and x ends with the deviations of
    their nx states. A battery drains whatever is commanded: its charge counts as constant, so that
    its entries of gain and cost are 0, and it has no eigenvalue.
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
) -> Regulator:
    """The regulator that keeps a robot at a state with the least cost ∫ (xᵀ Q x + wᵀ R w) dt.

    A warning tells how the robot accelerates if the state is not balanced, by more than 1e-3 m/s²
    or rad/s².

    Args:
        robot: A generated module with derivatives, or the name or path of one, which is loaded.
        q: A trim, which has v and u as well, or coordinates (nq).
        v, u: Velocities (nv) and inputs or, where the file describes actuators, commands (nu),
            without a trim, after which Q and R may come at once.
        Q: Weights of the deviations x of `linearise`, (2 nv, 2 nv), or their diagonal (2 nv), with
            the states of actuators (2 nv + nx); that of a battery's charge counts for nothing.
        R: Weights of deviations w of the inputs, (nu, nu), or their diagonal (nu).
        dt: None, or a period, s, for which inputs are held; the cost is then a sum over periods.
        x: States of the actuators (nx), without a trim; those that commands keep, if None.
        parameters: Parameters of the module's `prepare`.

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
        raise UsageError("Q, R: give the weights of deviations and those of inputs")
    whole = linearise(vehicle.module, q, v, u, dt, x=x, parameters=parameters)
    if not vehicle.inputs:
        raise UsageError(f"{vehicle.name}: has no inputs, so there is no regulator")
    _warn_if_unbalanced(vehicle, checked_state(vehicle, q, v, u, x))
    size = len(whole[0])
    kept = size - has_battery(vehicle)  # No command brings its charge back.
    a, b = whole[0][:kept, :kept], whole[1][:kept]
    states = _weights("Q", Q, size, False)[:kept, :kept]
    inputs = _weights("R", R, b.shape[1], True)
    _check_solvable(vehicle, a, b, states, dt)
    solve = linalg.solve_continuous_are if dt is None else linalg.solve_discrete_are
    try:
        cost = solve(a, b, states, inputs)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise UsageError(
            f"{vehicle.name}: SciPy does not solve the Riccati equation ({error}); weights nearer "
            "to each other may help"
        ) from None
    if dt is None:
        gain = linalg.solve(inputs, b.T @ cost, assume_a="pos")
    else:
        gain = linalg.solve(inputs + b.T @ cost @ b, b.T @ cost @ a, assume_a="pos")
    values = np.linalg.eigvals(a - b @ gain)
    slowest = np.argsort(-(values.real if dt is None else np.abs(values)))
    rest = (0, size - kept)
    gain, cost = np.pad(gain, ((0, 0), rest)), np.pad(cost, (rest, rest))
    return Regulator(gain, cost, values[slowest], *whole)


def _warn_if_unbalanced(vehicle: Vehicle, state: State) -> None:
    """Warn, with the accelerations by name, where a robot does not keep its velocities."""
    acceleration = vehicle.forward_dynamics_with_wrenches(*state[:4])
    rates = vehicle.layout.v
    told = [
        f"{name} by {value:.3g} {unit}²"
        for name, value, unit in zip(rates.names, acceleration, rates.units, strict=True)
        if abs(value) > _STEADY
    ]
    if told:
        warnings.warn(
            f"{vehicle.name}: the state is not balanced, so the regulator cannot hold it: "
            f"velocities change, {listed(told)}. Give a trim without acceleration",
            RuntimeWarning,
            stacklevel=3,
        )


def _weights(name: str, given: ArrayLike, size: int, definite: bool) -> Array:
    """A matrix (size, size) of weights, given whole or by its diagonal.

    Raises `UsageError` for a wrong shape or sign; if `definite`, every deviation must cost.
    """
    wanted = f"a symmetric matrix ({size}, {size}) or its diagonal ({size})"
    matrix = numbers(name, given, wanted, (size, size), (size,))
    matrix = np.diag(matrix) if matrix.ndim == 1 else matrix
    if not np.allclose(matrix, matrix.T):
        raise UsageError(f"{name}: must be {wanted}")
    values = np.linalg.eigvalsh(matrix)
    least, noise = values[0], 1e-12 * np.abs(values).max()
    if least < -noise or (definite and least <= noise):
        wanted = "positive definite" if definite else "positive semidefinite"
        raise UsageError(f"{name}: must be {wanted}; its least eigenvalue is {least:.3g}")
    return matrix


def _check_solvable(vehicle: Vehicle, a: Array, b: Array, weights: Array, dt: float | None) -> None:
    """Raise `UsageError` that names the motions for which there is no regulator.

    Inputs do not reach a motion that does not decay, or Q one that neither grows nor decays.
    `weights` are of the states, as many as A has; `dt` is None for a continuous model.
    """
    tolerance = _MARGINAL * max(1.0, float(np.linalg.norm(a, 2)))

    def growth(value: complex) -> float:
        return value.real if dt is None else abs(value) - 1.0

    names = deviation_names(vehicle)[: len(a)]
    stuck = unreached(a, b, lambda value: growth(value) > -tolerance)
    if stuck.shape[1]:
        raise UsageError(
            f"{vehicle.name}: cannot be stabilised here: no input changes "
            f"{listed(directions(stuck, names))}"
        )
    unseen = unreached(a.T, weights, lambda value: abs(growth(value)) <= tolerance)
    if unseen.shape[1]:
        raise UsageError(
            f"{vehicle.name}: Q leaves free what does not decay by itself: "
            f"{listed(directions(unseen, names))}; give it weight"
        )


def deviation_names(vehicle: Vehicle) -> tuple[str, ...]:
    """Names of the entries of a deviation: of δ, then velocities, then states of actuators."""
    places, names = vehicle.layout.v, list(vehicle.layout.v.names)
    states = vehicle.actuator_states
    names[places.joints] = vehicle.joint_names
    if vehicle.layout.is_quaternion:
        names[places.position] = [f"place along the base's {axis}" for axis in "xyz"]
        names[places.attitude] = [f"attitude about the base's {axis}" for axis in "xyz"]
        return (*names, *vehicle.layout.v.names, *states)
    return (*names, *(f"the rate of {name}" for name in names), *states)
