"""LQR: the linear regulator of least quadratic cost about a state."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.analysis.arguments import numbers, vehicle_of
from gibbs_codegen.flight.analysis.linear_model import State, given_state, linearise, unreached
from gibbs_codegen.flight.analysis.trim import Trim
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.robot.wrenches import directions

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
    parameters: Mapping[str, float] | None = None,
) -> Regulator:
    """The regulator that keeps a robot at a state with the least cost ∫ (xᵀ Q x + wᵀ R w) dt.

    A warning tells how the robot accelerates if the state is not balanced, by more than 1e-3 m/s²
    or rad/s².

    Args:
        robot: A generated module with derivatives, or the name or path of one, which is loaded.
        q: A trim, which has v and u as well, or coordinates (nq).
        v, u: Velocities (nv) and inputs (nu), without a trim.
        Q: Weights of the deviations x of `linearise`, (2 nv, 2 nv), or their diagonal (2 nv).
        R: Weights of deviations w of the inputs, (nu, nu), or their diagonal (nu).
        dt: None, or a period, s, for which inputs are held; the cost is then a sum over periods.
        parameters: Parameters of the module's `prepare`.

    Returns:
        The regulator.

    Raises:
        UsageError: The module has no derivatives; an argument is not what it must be, such as
            weights of wrong shape or sign; or there is no regulator, with the motions that cannot
            be stabilised or that Q leaves free.
    """
    vehicle = vehicle_of(robot, parameters)
    if Q is None or R is None:
        raise UsageError("Q, R: give the weights of deviations and those of inputs")
    a, b = linearise(vehicle.module, q, v, u, dt, parameters=parameters)
    if not vehicle.inputs:
        raise UsageError(f"{vehicle.name}: has no inputs, so there is no regulator")
    _warn_if_unbalanced(vehicle, given_state(vehicle, q, v, u))
    states, inputs = _weights("Q", Q, len(a), False), _weights("R", R, b.shape[1], True)
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
    return Regulator(gain, cost, values[slowest], a, b)


def _warn_if_unbalanced(vehicle: Vehicle, state: State) -> None:
    """Warn, with the accelerations by name, where a robot does not keep its velocities."""
    acceleration = vehicle.forward_dynamics_with_wrenches(*state)
    rates = vehicle.layout.v
    told = [
        f"{name} by {value:.3g} {unit}²"
        for name, value, unit in zip(rates.names, acceleration, rates.units, strict=True)
        if abs(value) > _STEADY
    ]
    if told:
        warnings.warn(
            f"{vehicle.name}: the state is not balanced, so the regulator cannot hold it: "
            f"velocities change, {_listed(told)}. Give a trim without acceleration",
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
    `weights` (2 nv, 2 nv) are of the states; `dt` is None for a continuous model.
    """
    tolerance = _MARGINAL * max(1.0, float(np.linalg.norm(a, 2)))

    def growth(value: complex) -> float:
        return value.real if dt is None else abs(value) - 1.0

    names = deviation_names(vehicle)
    stuck = unreached(a, b, lambda value: growth(value) > -tolerance)
    if stuck.shape[1]:
        raise UsageError(
            f"{vehicle.name}: cannot be stabilised here: no input changes "
            f"{_listed(directions(stuck, names))}"
        )
    unseen = unreached(a.T, weights, lambda value: abs(growth(value)) <= tolerance)
    if unseen.shape[1]:
        raise UsageError(
            f"{vehicle.name}: Q leaves free what does not decay by itself: "
            f"{_listed(directions(unseen, names))}; give it weight"
        )


def deviation_names(vehicle: Vehicle) -> tuple[str, ...]:
    """Names (2 nv) of the entries of a deviation: those of δ, then those of velocities."""
    places, names = vehicle.layout.v, list(vehicle.layout.v.names)
    names[places.joints] = vehicle.joint_names
    if vehicle.layout.is_quaternion:
        names[places.position] = [f"place along the base's {axis}" for axis in "xyz"]
        names[places.attitude] = [f"attitude about the base's {axis}" for axis in "xyz"]
        return (*names, *vehicle.layout.v.names)
    return (*names, *(f"the rate of {name}" for name in names))


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
