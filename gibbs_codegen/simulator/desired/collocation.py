"""Collocation: thrust axes and positions at knots along which no force is missing.

A base whose rotors push along one axis cannot choose its attitude: its lateral force is zero. Where
the centre of mass is off the base centre that is a differential equation of the thrust axis, which
as a rule swings for ever or grows without bounds when it is integrated from the start. So all knots
are solved for at once. Of the motions without lateral force that one is taken whose base centre is
nearest to its path and whose thrust axis is smoothest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import spsolve

from gibbs_codegen.errors import UsageError

Array = NDArray[np.float64]
# Thrust axis and its first two derivatives, and the acceleration that is added to the path's, all
# (s, 3), to lateral force as a share of the weight (s, 2).
LateralForce = Callable[[Array, Array, Array, Array], Array]

# Knots that a finite difference takes: of fourth order inside, of the third at least at the ends.
STENCIL = 5
# Order of the derivative of the thrust axis that is to be small.
_ROUGHNESS = 3
# Frequency above which the path is left rather than the axis made to swing, at most, rad/s; else it
# is that with which the machine swings about its base centre, so that it does not swing for long.
_FASTEST = 60.0
# Steps of differences of the lateral force, for the four arguments.
_STEPS = (1e-6, 1e-4, 1e-2, 1e-2)
# Newton's method: most steps, and the change of the axis and the lateral force that end it.
_MOST_STEPS = 25
_CONVERGED = 1e-7


@dataclass(frozen=True)
class Grid:
    """Knots (s) at equal steps of time, s, and the finite differences on them."""

    time: Array

    @property
    def count(self) -> int:
        """How many knots there are."""
        return len(self.time)

    @property
    def step(self) -> float:
        """Distance of knots, s."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)

    @cached_property
    def rate(self) -> sparse.csr_array:
        """Matrix (count, count) of the first derivative."""
        return differences(1, self.count, self.step)

    @cached_property
    def growth(self) -> sparse.csr_array:
        """Matrix (count, count) of the second derivative."""
        return differences(2, self.count, self.step)


def differences(order: int, count: int, step: float) -> sparse.csr_array:
    """Matrix (count, count) of finite differences at knots `step` apart, of 4th order inside."""
    width = min(count, STENCIL + (order > 2))
    weights: dict[int, Array] = {}
    rows: list[int] = []
    columns: list[int] = []
    values = []
    for knot in range(count):
        first = min(max(knot - width // 2, 0), count - width)
        if (place := knot - first) not in weights:
            powers = np.vander(np.arange(width) - float(place), increasing=True).T
            wanted = np.zeros(width)
            wanted[order] = np.prod(np.arange(1, order + 1)) / step**order
            weights[place] = np.linalg.solve(powers, wanted)
        rows += [knot] * width
        columns += range(first, first + width)
        values.append(weights[place])
    return sparse.csr_array((np.concatenate(values), (rows, columns)), shape=(count, count))


def nearest_motion(
    lateral: LateralForce,
    axis: Array,
    shift: Array,
    grid: Grid,
    gravity: float,
    held: NDArray[np.bool_],
) -> tuple[Array, Array]:
    """Unit thrust axes, and shifts of the base centre from its path, m, without lateral force.

    Both are (s, 3) in world axes, and `held` (s) tells the knots at which they stay as given.
    Raises `UsageError`, with the time where most force is missing, if none is found.
    """
    count = len(axis)
    found = np.concatenate([axis.ravel(), shift.ravel()])
    free = np.flatnonzero(~np.tile(np.repeat(held, 3), 2))
    # Where all of the knots that derivatives take are held, there is nothing to solve.
    fixed = ~(abs(grid.growth) @ ~held > 0.0)
    bound = np.flatnonzero(~np.concatenate([np.repeat(fixed, 2), held]))
    cost = None
    for _ in range(_MOST_STEPS):
        residual, slopes = _linear(lateral, found[: 3 * count], found[3 * count :], grid)
        if cost is None:
            cost = _cost(slopes, grid, gravity)[free]
        normal = found[: 3 * count].reshape(-1, 3)
        residual = np.concatenate([residual.ravel(), 0.5 * (np.sum(normal**2, axis=-1) - 1.0)])
        jacobian = _jacobian(slopes, normal, grid)[bound][:, free]
        system = sparse.block_array([[cost[:, free], jacobian.T], [jacobian, None]], format="csc")
        right = -np.concatenate([cost @ found, residual[bound]])
        step = spsolve(system, right)[: len(free)]
        found[free] += step
        if not np.all(np.isfinite(step)):
            break
        if np.abs(step).max(initial=0.0) < _CONVERGED:
            normal, shift = found.reshape(2, count, 3)
            return normal / np.linalg.norm(normal, axis=-1, keepdims=True), shift
    worst = grid.time[np.argmax(np.abs(residual[: 2 * count]).reshape(-1, 2).max(axis=-1))]
    # Before a flight begins its path rests: what fails there is how it sets out.
    raise UsageError(
        f"at t = {max(worst, 0.0):.6g} s no tilt is found with which the base follows its path, "
        "since its rotors push along one axis only; choose a gentler motion"
    )


def _linear(
    lateral: LateralForce, axis: Array, shift: Array, grid: Grid
) -> tuple[Array, list[Array]]:
    """Lateral force (s, 2), and its derivatives (s, 2, 3) by its four arguments, by differences."""
    axis, shift = axis.reshape(-1, 3), shift.reshape(-1, 3)
    at = [axis, grid.rate @ axis, grid.growth @ axis, grid.growth @ shift]
    slopes = []
    for place, step in enumerate(_STEPS):
        columns = []
        for unit in step * np.eye(3):
            ahead, behind = [*at], [*at]
            ahead[place], behind[place] = at[place] + unit, at[place] - unit
            columns.append((lateral(*ahead) - lateral(*behind)) / (2.0 * step))
        slopes.append(np.stack(columns, axis=-1))
    return lateral(*at), slopes


def _jacobian(slopes: list[Array], axis: Array, grid: Grid) -> sparse.csr_array:
    """Derivatives (3 s, 6 s) of what is to be zero by axes, then shifts.

    Rows are lateral forces, then how far axes are from unit length.
    """
    rate, growth = (sparse.kron(each, sparse.eye_array(3)) for each in (grid.rate, grid.growth))
    by_axis, by_rate, by_growth, by_push = (_blocks(slope) for slope in slopes)
    turned = by_axis + by_rate @ rate + by_growth @ growth
    rows = [[turned, by_push @ growth], [_blocks(axis[:, np.newaxis]), None]]
    return sparse.block_array(rows, format="csr")


def _blocks(blocks: Array) -> sparse.csr_array:
    """The matrix with blocks (s, r, c) along its diagonal."""
    places = np.arange(len(blocks))
    return sparse.csr_array(sparse.bsr_array((blocks, places, np.arange(len(blocks) + 1))))


def _cost(slopes: list[Array], grid: Grid, gravity: float) -> sparse.csr_array:
    """The quadratic form (6 s, 6 s) of axes and shifts that is to be least.

    Both parts are without dimension: the roughness of the axis, and the shift against the
    acceleration of gravity, at the frequency where the one begins to outweigh the other.
    """
    # A pendulum of length l, whose lateral force is −n − l n̈ / g, swings with √(g / l).
    swing = np.abs(slopes[2]).max() ** -0.5 if np.any(slopes[2]) else np.inf
    frequency = min(swing, _FASTEST)
    rough = differences(_ROUGHNESS, grid.count, grid.step) / frequency**_ROUGHNESS
    near = (frequency**2 / gravity) ** 2 * sparse.eye_array(grid.count)
    parts = sparse.block_diag([rough.T @ rough, near])
    return sparse.csr_array(sparse.kron(parts, sparse.eye_array(3)))
