"""Linearisation: how small deviations from a state grow, and which of them inputs reach.

A deviation has 2 nv entries: δ, with q = q₀ ⊕ δ, and v − v₀. With attitude angles δ has the rate
v − v₀. With a quaternion δ is in the axes of the base, which move: from q̇₀ = q₀ ξ₀, where ξ₀ is the
velocity of the base, and q = q₀ exp(δ) follows δ̇ = ξ − ξ₀ − ad(ξ₀) δ to first order, where ad(ξ₀) δ
is the Lie bracket of ξ₀ and δ.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm, schur

from gibbs_codegen.errors import MissingFunctionError, UsageError
from gibbs_codegen.flight.analysis.arguments import coordinates, period, vector, vehicle_of
from gibbs_codegen.flight.analysis.trim import Trim
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle

_DERIVATIVES = "forward_dynamics_derivatives"
# Share of the largest influence below which one is rounding.
_RANK = 1e-9


class State(NamedTuple):
    """Where a robot is to be linearised; `wrenches` (f, 6) are as of `SteadyMotion`."""

    q: Array
    v: Array
    u: Array
    wrenches: Array


def given_state(
    vehicle: Vehicle, q: ArrayLike | Trim, v: ArrayLike | None, u: ArrayLike | None
) -> State:
    """The state that callers give, as a trim or by its parts; without a trim no wrenches act.

    Raises `UsageError` for what an argument must not be, or a trim of another robot.
    """
    wrenches = np.zeros((len(vehicle.frames), 6))
    if isinstance(q, Trim):
        if v is not None or u is not None:
            raise UsageError("v, u: a trim has its own; give them without a trim, or neither")
        if q.robot != vehicle.name:
            raise UsageError(f"q: the trim is of {q.robot}, not of {vehicle.name}")
        found = q
        q, v, u, wrenches = found.q, found.v, found.u, found.wrenches
    elif v is None or u is None:
        raise UsageError("q, v, u: give all three, or a trim in the place of q")
    size = vehicle.layout.v.size
    return State(
        coordinates(vehicle, q),
        vector("v", v, size),
        vector("u", u, len(vehicle.inputs)),
        wrenches,
    )


def linearise(
    robot: ModuleType | str | os.PathLike[str],
    q: ArrayLike | Trim,
    v: ArrayLike | None = None,
    u: ArrayLike | None = None,
    dt: float | None = None,
    *,
    parameters: Mapping[str, float] | None = None,
) -> tuple[Array, Array]:
    """A and B of deviations x from a state under deviations w of the inputs: ẋ = A x + B w.

    x = (δ, v − v₀), where q = q₀ ⊕ δ as `integrate` has it, so δ = `difference(q0, q)`. Where the
    state is not balanced, x is the deviation from the motion that begins there, and A and B hold
    for as long as that stays near.

    Args:
        robot: A generated module with derivatives, or the name or path of one, which is loaded.
        q: A trim, which has v and u as well, or coordinates (nq).
        v, u: Velocities (nv) and inputs (nu), without a trim.
        dt: None, or a period, s, for which inputs are held: then x' = A x + B w after it, exactly.
        parameters: Parameters of the module's `prepare`.

    Returns:
        A (2 nv, 2 nv) and B (2 nv, nu).

    Raises:
        MissingFunctionError: The module was generated without the derivatives.
        UsageError: An argument is not what it must be.
    """
    vehicle = vehicle_of(robot, parameters)
    if _DERIVATIVES not in vehicle.module.DERIVATIVES:
        raise MissingFunctionError(vehicle.name, _DERIVATIVES, vehicle.module.DERIVATIVES)
    dt, state = period(dt), given_state(vehicle, q, v, u)
    _, by_q, by_v, by_u = vehicle.function(_DERIVATIVES)(state.q, state.v, state.u)
    above = np.concatenate([_carried(vehicle, state.v), np.eye(len(state.v))], axis=1)
    a = np.concatenate([above, np.concatenate([by_q, by_v], axis=1)])
    b = np.concatenate([np.zeros_like(by_u), by_u])
    return (a, b) if dt is None else held(a, b, dt)


def held(a: Array, b: Array, dt: float) -> tuple[Array, Array]:
    """A and B of x' = A x + B w, exact for ẋ = A x + B w with held inputs (zero-order hold).

    `dt` is how long they are held, s.
    """
    size = len(a)
    both = np.zeros((size + b.shape[1],) * 2)
    both[:size] = np.concatenate([a, b], axis=1)
    grown = expm(dt * both)[:size]
    return grown[:, :size], grown[:, size:]


def _carried(vehicle: Vehicle, v: Array) -> Array:
    """−ad(ξ₀): the rate of δ (nv, nv) by δ itself, at velocities v (nv) of the base."""
    places = vehicle.layout.v
    rate = np.zeros((places.size, places.size))
    if vehicle.layout.is_quaternion:
        turning, moving = (_cross(v[part]) for part in (places.attitude, places.position))
        rate[places.position, places.position] = -turning
        rate[places.position, places.attitude] = -moving
        rate[places.attitude, places.attitude] = -turning
    return rate


def _cross(vector: Array) -> Array:
    """The matrix (3, 3) that multiplies by a vector (3) from the left, as ×."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def unreached(a: Array, b: Array, matters: Callable[[complex], bool]) -> Array:
    """Orthonormal combinations (n, k) that no input reaches, and whose eigenvalues matter.

    For a column w, wᵀ x goes its own way. Eigenvalues of the whole model would not serve: those of
    integrators are double, and rounding moves them by its square root. So what inputs reach is
    taken away first.
    """
    rest = _complement(_reached(a, b))
    if not rest.shape[1]:
        return rest
    _, vectors, count = schur((rest.T @ a @ rest).T, output="complex", sort=matters)
    mattering = vectors[:, :count]
    left, _, _ = np.linalg.svd(np.concatenate([mattering.real, mattering.imag], axis=1))
    combinations: Array = rest @ left[:, :count]
    return combinations


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


def _complement(columns: Array) -> Array:
    """Orthonormal columns of all that is orthogonal to given ones."""
    left, _, _ = np.linalg.svd(columns)
    complement: Array = left[:, columns.shape[1] :]
    return complement
