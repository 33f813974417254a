"""What derivatives of inverse and forward dynamics should be, and the Coriolis matrix.

Derivatives of accelerations are compared as forces, multiplied by the mass matrix, since that does
not depend on how well-conditioned it is; where w multiplies them, they cannot be.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from gibbs_codegen.verification.derivative_row import (
    AGREEMENT,
    CURVATURE,
    EXACT,
    SLOPE,
    DerivativeRow,
    Point,
)
from gibbs_codegen.verification.slopes import Forward, Inverse, solved
from gibbs_codegen.verification.vectors import Array, times

# Digits that accelerations lose for each of the condition of the mass matrix in its units.
_ROUNDING = 1e-13
# Lengths of second differences as shares of the usual ones, of inverse and of forward dynamics.
_SHARES = {False: (None,), True: (0.3, 0.15)}
# Rounding of 1e-16 in differences of differences, as a share of the error that these may have.
_LOST = 0.01


class Dynamics:
    """Inverse or forward dynamics at some states, with all that its derivatives need."""

    def __init__(self, point: Point, forward: bool) -> None:
        """Compute what derivatives of forward (else inverse) dynamics are compared with."""
        self.point, self.forward = point, forward
        states, sizes, call = point.states, point.sizes, point.call
        self.slopes = (Forward if forward else Inverse)(point.slopes)
        self.name = self.slopes.name
        self.state = states.q, states.v, states.u if forward else states.a
        self.jacobian = self.slopes.jacobian(self.state)
        self.mass_matrix = call("mass_matrix", states.q)
        self.value = call(self.name, *self.state)
        if not forward:
            self.effort = sizes.free_inertial_effort
            self.loss = np.zeros(len(states))
            return
        self.effort = sizes.balance(self.value)
        scaled = self.mass_matrix / sizes.free_matrix
        finite = np.isfinite(scaled).all(axis=(1, 2))
        condition = np.linalg.cond(np.where(finite[:, None, None], scaled, 0.0))
        self.loss = condition * _ROUNDING / SLOPE

    @property
    def size(self) -> Array:
        """Sizes of the entries of the Jacobian as forces, (s, nv, columns)."""
        size: Array = self.effort[:, :, None] / self.slopes.units * (1 + self.loss[:, None, None])
        return size

    def as_forces(self, matrix: Array) -> Array:
        """Derivatives of the results, (s, nv, n) or (s, nv), as those of forces."""
        if not self.forward:
            return matrix
        columns = math.prod(matrix.shape[2:])
        with np.errstate(invalid="ignore"):
            product: Array = self.mass_matrix @ matrix.reshape(*matrix.shape[:2], columns)
        return product.reshape(matrix.shape)

    def inertial(self, matrix: Array) -> Array:
        """Sizes of forces that derivatives of accelerations stand for; 0 of inverse dynamics.

        `matrix` (s, nv, n) has the derivatives times the mass matrix.
        """
        units = self.point.sizes.free_units[:, :, None]
        if not self.forward:
            return np.zeros_like(matrix)
        accelerations = solved(self.mass_matrix, matrix)
        largest = np.abs(units * accelerations).max(axis=1, keepdims=True)
        size: Array = units * largest * (1 + self.loss[:, None, None])
        return size

    @property
    def multipliers(self) -> Array:
        """What multiplies forces where w weighs results, (s, nv)."""
        return self.slopes.multipliers(self.state[0], self.point.states.w)

    @property
    def weights(self) -> Array:
        """Sizes of the multipliers; in rounding the largest counts for all, (s, nv)."""
        multipliers, units = np.abs(self.multipliers), self.point.sizes.free_units
        largest = (units * multipliers).max(axis=-1, keepdims=True) / units
        size: Array = multipliers + self.loss[:, None] * largest
        return size


def jacobian_rows(
    point: Point, values: Mapping[str, Array], forward: bool
) -> Iterator[DerivativeRow]:
    """The value and the Jacobians of `…_dynamics_derivatives`."""
    kind = Dynamics(point, forward)
    (value, *_), ours = values, list(values.values())
    plain = kind.as_forces(kind.value)
    yield DerivativeRow(value, kind.as_forces(ours[0]), plain, kind.effort, EXACT)
    size = kind.size + kind.inertial(kind.jacobian)
    ends = np.cumsum([matrix.shape[-1] for matrix in ours[1:]])[:-1]
    parts = (np.split(x, ends, axis=-1) for x in (kind.jacobian, size))
    for what, matrix, theirs, part in zip(list(values)[1:], ours[1:], *parts, strict=True):
        yield DerivativeRow(what, kind.as_forces(matrix), theirs, part, SLOPE)


def jvp_rows(point: Point, values: Mapping[str, Array], forward: bool) -> Iterator[DerivativeRow]:
    """The product of the Jacobians with a direction."""
    kind, states = Dynamics(point, forward), point.states
    last = states.u_dot if forward else states.a_dot
    direction = np.concatenate([states.q_dot, states.v_dot, last], axis=-1)
    theirs = times(kind.jacobian, direction)
    size = times(kind.size, np.abs(direction)) + kind.inertial(theirs[..., None])[..., 0]
    for what, ours in values.items():
        yield DerivativeRow(what, kind.as_forces(ours), theirs, size, SLOPE)


def vjp_rows(point: Point, values: Mapping[str, Array], forward: bool) -> Iterator[DerivativeRow]:
    """The gradients: products of weights with the Jacobians."""
    kind = Dynamics(point, forward)
    transposed = np.swapaxes(kind.jacobian, -1, -2)
    theirs = times(transposed, kind.multipliers)
    size = times(np.swapaxes(kind.size, -1, -2), kind.weights)
    ends = np.cumsum([array.shape[-1] for array in values.values()])[:-1]
    parts = (np.split(x, ends, axis=-1) for x in (theirs, size))
    for (what, ours), expected, part in zip(values.items(), *parts, strict=True):
        yield DerivativeRow(what, ours, expected, part, SLOPE)


def hessian_rows(
    point: Point, values: Mapping[str, Array], forward: bool
) -> Iterator[DerivativeRow]:
    """Second derivatives of weighed results, by blocks."""
    # Differences of differences take many evaluations.
    kind = Dynamics(point.first(1), forward)
    states, units = kind.point.states, kind.slopes.units
    found = [kind.slopes.hessian(kind.state, states.w, share) for share in _SHARES[forward]]
    theirs = found[-1]
    weighed = np.sum(kind.weights * kind.effort, axis=-1)
    scale = units[:, None] * units
    # Entries are as large as those of their rows and columns, and what rounding leaves of forces.
    rows = np.abs(theirs * scale).max(axis=-1)
    natural = np.sqrt(rows[:, :, None] * rows[:, None, :]) + _LOST * weighed[:, None, None]
    # Accelerations may change fast: differences are no better than they agree with longer ones.
    size = natural / scale + np.abs(found[0] - theirs) / AGREEMENT
    every = slice(None)
    n = states.v.shape[-1]
    of = {"q": slice(n), "v": slice(n, 2 * n), "a": slice(2 * n, None)}
    for what, ours in values.items():
        name = what.rpartition(".")[2]
        rows, columns = (every, every) if forward else (of[letter] for letter in name)
        expected, part = (x[:, rows, columns] for x in (theirs, size))
        yield DerivativeRow(what, ours[: len(states)], expected, part, CURVATURE)


def coriolis_rows(point: Point, values: Mapping[str, Array]) -> Iterator[DerivativeRow]:
    """C v is what velocities add to the forces, and Ṁ − 2 C is skew-symmetric."""
    states, sizes, call, tree = point.states, point.sizes, point.call, point.tree
    ((what, coriolis),) = values.items()
    damped = tree.passive.damping[tree.free] * states.v
    still = call("residual", states.q, 0.0 * states.v)
    forces = still - call("residual", states.q, states.v) - damped
    yield DerivativeRow(
        f"{what}.product", times(coriolis, states.v), forces, sizes.free_effort, EXACT
    )
    slopes = point.slopes.along_q(lambda q: call("mass_matrix", q), states.q)
    rate = times(slopes, states.v[:, None])
    size = sizes.free_matrix * sizes.rate[:, None, None]
    both = coriolis + np.swapaxes(coriolis, -1, -2)
    yield DerivativeRow(f"{what}.symmetric_part", both, rate, size, SLOPE)
