"""What derivatives of frames, displacements and time steps should be, and the steps themselves."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from gibbs_codegen.verification.comparison import Evaluation
from gibbs_codegen.verification.derivative_row import (
    AGREEMENT,
    CURVATURE,
    EXACT,
    SLOPE,
    DerivativeRow,
    Point,
    scaled_size,
)
from gibbs_codegen.verification.differences import STEP, gradient
from gibbs_codegen.verification.slopes import State
from gibbs_codegen.verification.vectors import Array

# Lengths of differences of steps, as shares of the usual ones.
_SHARES = (0.02, 0.01)


def frame_rows(point: Point, values: Mapping[str, Array]) -> Iterator[DerivativeRow]:
    """Poses or velocities of frames, their derivatives by q, and those of velocities by v."""
    call, states, sizes = point.call, point.states, point.sizes
    (of_frames, by_q, *by_v), n = values, states.v.shape[-1]
    name = "frame_" + of_frames.rpartition(".")[2]
    if by_v:
        natural = np.repeat([point.tree.reach, 1.0], 3) * sizes.rate[:, None, None]
        rows = [states.v[:, None]]
        theirs = call(name, states.q, states.v)
    else:
        natural = np.ones((len(states), 1, 4, 4))
        natural[..., :3, 3] = sizes.reach[:, None, None]
        rows = []
        theirs = call(name, states.q)
    natural = np.broadcast_to(natural, theirs.shape)
    yield DerivativeRow(of_frames, values[of_frames], theirs, natural, EXACT)
    slopes = point.slopes.along_q(lambda q: call(name, q, *rows), states.q)
    size = natural[..., None] / point.slopes.units.q
    yield DerivativeRow(by_q, values[by_q], slopes, size, SLOPE)
    for what in by_v:
        jacobians = call("frame_jacobians", states.q)
        size = np.repeat([point.tree.reach, 1.0], 3)[:, None] / point.slopes.units.q
        size = np.broadcast_to(size, (len(states), *jacobians.shape[1:-2], 6, n))
        yield DerivativeRow(what, values[what], jacobians, size, EXACT)


def integrate_rows(point: Point, values: Mapping[str, Array]) -> Iterator[DerivativeRow]:
    """Derivatives of a displacement's result by where it begins, and by the displacement."""
    call, units, states = point.call, point.slopes.units, point.states
    after = call("integrate", states.q, states.v)[:, None]
    v = states.v[:, None]

    def moved(q: Array, displacement: Array) -> Array:
        return call("difference", after, call("integrate", q, displacement))

    by_q = point.slopes.along_q(lambda q: moved(q, v), states.q)
    steps, q = STEP * units.q, states.q[:, None]
    by_v = gradient(lambda step: moved(q, v + step), steps, 1)
    for (what, ours), theirs in zip(values.items(), (by_q, by_v), strict=True):
        size = scaled_size(theirs, units.q, units.q)
        yield DerivativeRow(what, ours, theirs, size, SLOPE)


def euler_step(call: Evaluation, state: State, h: Array) -> tuple[Array, Array]:
    """Coordinates and velocities after a semi-implicit Euler step of length h from q, v and u."""
    q, v, u = state
    after = v + h * call("forward_dynamics", q, v, u)
    return call("integrate", q, h * after), after


def rk4_step(call: Evaluation, state: State, h: Array) -> tuple[Array, Array]:
    """Coordinates and velocities after a step of the classical Runge–Kutta method from q, v and u.

    It moves on the manifold by exponentials alone (Celledoni, Marthinsen and Owren, 2003).
    """
    q, k1, u = state

    def accelerations(q: Array, v: Array) -> Array:
        return call("forward_dynamics", q, v, u)

    a1 = accelerations(q, k1)
    second, k2 = call("integrate", q, 0.5 * h * k1), k1 + 0.5 * h * a1
    a2 = accelerations(second, k2)
    third, k3 = call("integrate", q, 0.5 * h * k2), k1 + 0.5 * h * a2
    a3 = accelerations(third, k3)
    fourth, k4 = call("integrate", second, h * (k3 - 0.5 * k1)), k1 + h * a3
    a4 = accelerations(fourth, k4)
    half = call("integrate", q, h / 12 * (3 * k1 + 2 * k2 + 2 * k3 - k4))
    whole = call("integrate", half, h / 12 * (-k1 + 2 * k2 + 2 * k3 + 3 * k4))
    return whole, k1 + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


Step = Callable[[Evaluation, State, Array], tuple[Array, Array]]


def step_rows(point: Point, values: Mapping[str, Array], step: Step) -> Iterator[DerivativeRow]:
    """The state after a step, and its derivatives where the function returns them."""
    call, states, units = point.call, point.call.stepping(point.states), point.slopes.units
    state, h = (states.q, states.v, states.u), states.h[:, None]
    after = step(call, state, h)
    for (what, ours), theirs in zip(values.items(), after, strict=False):
        size = np.abs(theirs).max(axis=-1, keepdims=True) * np.ones_like(theirs)
        yield DerivativeRow(what, ours, theirs, size, EXACT)
    if len(values) == len(after):
        return

    def moved(q: Array, v: Array, u: Array) -> Array:
        q, v = step(call, (q, v, u), h[:, None])
        return np.concatenate([call("difference", after[0][:, None], q), v], axis=-1)

    longer, theirs = (point.slopes.by_all(moved, state, units.u, share) for share in _SHARES)
    rows = np.concatenate([units.q, units.v])
    columns = np.concatenate([rows, units.u])
    # Accelerations may change fast: differences are no better than they agree with longer ones.
    apart = scaled_size(longer - theirs, rows, columns) / AGREEMENT
    size = scaled_size(theirs, rows, columns) + apart
    parts = (np.split(x, [len(rows)], axis=-1) for x in (theirs, size))
    for (what, ours), expected, part in zip(list(values.items())[2:], *parts, strict=True):
        yield DerivativeRow(what, ours, expected, part, CURVATURE)
