"""What derivatives of the generalised forces B u should be, from the input matrix."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from gibbs_codegen.verification.derivative_row import (
    CURVATURE,
    EXACT,
    SLOPE,
    DerivativeRow,
    Point,
)
from gibbs_codegen.verification.vectors import Array, times


def input_rows(point: Point, values: Mapping[str, Array]) -> Iterator[DerivativeRow]:
    """The forces, and their derivatives by q."""
    call, states = point.call, point.states
    (force, ours), (slope, matrix) = values.items()
    size = _size(point)
    plain = times(call("input_matrix", states.q), states.u)
    yield DerivativeRow(force, ours, plain, size, EXACT)
    theirs = point.slopes.along_q(
        lambda q: times(call("input_matrix", q), states.u[:, None]), states.q
    )
    yield DerivativeRow(slope, matrix, theirs, size[:, :, None] / point.slopes.units.q, SLOPE)


def input_hessian_rows(point: Point, values: Mapping[str, Array]) -> Iterator[DerivativeRow]:
    """Second derivatives of the weighed forces, of which those by q and u are first ones of B."""
    call, units = point.call, point.slopes.units
    first = point.first(1)
    states, q = first.states, first.states.q
    (by_q, ours), (by_u, mixed) = values.items()
    weighed = np.sum(np.abs(states.w) * _size(first), axis=-1)[:, None, None]

    def forces(q: Array) -> Array:
        matrix = np.swapaxes(call("input_matrix", q), -1, -2)
        return times(matrix, states.w[(slice(None), *[None] * (q.ndim - 2))])

    def slopes(q: Array) -> Array:
        found: Array = np.einsum(
            "...uj,...u->...j",
            point.slopes.along_q(forces, q),
            states.u[(slice(None), *[None] * (q.ndim - 2))],
        )
        return found

    theirs = point.slopes.along_q(slopes, q)
    # Displacements of the attitude do not commute: it is the mean of both orders.
    theirs = 0.5 * (theirs + np.swapaxes(theirs, -1, -2))
    size = weighed / (units.q[:, None] * units.q)
    yield DerivativeRow(by_q, ours[: len(q)], theirs, size, CURVATURE)
    theirs = np.swapaxes(point.slopes.along_q(forces, q), -1, -2)
    size = weighed / (units.q[:, None] * units.u)
    yield DerivativeRow(by_u, mixed[: len(q)], theirs, size, SLOPE)


def _size(point: Point) -> Array:
    """Sizes of the forces, from the largest terms that they are summed from, (s, nv)."""
    matrix = np.abs(point.call("input_matrix", point.states.q))
    forces = times(matrix, np.abs(point.states.u))
    units = point.slopes.units.q
    size: Array = (units * forces).max(axis=-1, keepdims=True) / units
    return size
