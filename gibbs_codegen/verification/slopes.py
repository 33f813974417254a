"""Derivatives of a module's equations of motion, by differences of functions verified before.

Inverse dynamics M a − R and the input matrix are sums of products of sines, cosines and what the
coordinates count, so that differences of eighth order lose few digits. Accelerations may change
fast. Their derivatives are those of M a = R + B u at the accelerations: M ∂a = ∂(R + B u − M a).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gibbs_codegen.verification.comparison import Evaluation
from gibbs_codegen.verification.differences import QUADRATIC, STEP, WEIGHTS, gradient
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.vectors import Array, times

# Arrays (…, width): coordinates, velocities, and accelerations or inputs.
State = tuple[Array, Array, Array]
OfState = Callable[[Array, Array, Array], Array]


@dataclass(frozen=True)
class Units:
    """What one of each quantity is of the order of: by velocity, (nv,), and by input, (nu,)."""

    q: Array
    v: Array
    a: Array
    u: Array

    @classmethod
    def of(cls, tree: Tree) -> Units:
        """Of a robot: displacements and their rates, and inputs as random states have them."""
        scales = tree.scales[tree.free]
        levers = np.where(tree.turns[tree.arm], tree.reach, 1.0)
        force = tree.mass * tree.reach * tree.tempo**2
        inputs = force * np.concatenate([np.ones(len(tree.motors)), levers])
        return cls(scales, scales * tree.tempo, scales * tree.tempo**2, inputs)


class Slopes:
    """Derivatives at states (…), by differences along the units of what is varied."""

    def __init__(self, call: Evaluation, units: Units) -> None:
        self.call = call
        self.units = units

    def along_q(self, function: Callable[[Array], Array], q: Array, share: float = 1.0) -> Array:
        """Derivatives (…, ·, nv) by displacements along each velocity, at q (…, nq).

        `function` takes (…, nv, nq) and returns (…, nv, ·); `share` multiplies the usual steps.
        """

        def moved(steps: Array) -> Array:
            return function(self.call("integrate", q[..., None, :], steps))

        return gradient(moved, share * STEP * self.units.q, q.ndim - 1)

    def by_all(
        self, function: OfState, state: State, last: Array, share: float | None = None
    ) -> Array:
        """Derivatives (…, ·, columns) by q, v and the last argument, one after the other.

        The function's arguments have one axis more than `state` (…, width), before the last. `last`
        has the units of the last argument's entries. `share` multiplies the usual steps; it is None
        of a function that is quadratic in v and in the last argument.
        """
        q, v, x = (y[..., None, :] for y in state)
        axis = state[0].ndim - 1
        step, weights = (1.0, QUADRATIC) if share is None else (share * STEP, WEIGHTS)
        parts = [
            self.along_q(lambda moved: function(moved, v, x), state[0], share or 1.0),
            gradient(lambda d: function(q, v + d, x), step * self.units.v, axis, weights),
            gradient(lambda d: function(q, v, x + d), step * last, axis, weights),
        ]
        return np.concatenate(parts, axis=-1)


class Inverse:
    """Derivatives of M a − R by (q, v, a)."""

    name = "inverse_dynamics"

    def __init__(self, slopes: Slopes) -> None:
        self._slopes = slopes
        units = slopes.units
        self._last = units.a
        self.units = np.concatenate([units.q, units.v, units.a])

    def jacobian(self, state: State) -> Array:
        """Derivatives (…, nv, columns) of generalised forces, at q, v and accelerations."""

        def forces(q: Array, v: Array, a: Array) -> Array:
            return self._slopes.call("inverse_dynamics", q, v, a)

        return self._slopes.by_all(forces, state, self._last)

    def multipliers(self, q: Array, w: Array) -> Array:
        """What multiplies the forces where w (…, nv) weighs the results: w itself."""
        return w

    def hessian(self, state: State, w: Array, share: float | None) -> Array:
        """Second derivatives (…, columns, columns) of the results weighed by w (…, nv).

        `share` is as of `Slopes.by_all`. Displacements follow one another in the differences; half
        the sum of both orders belongs to the two at once.
        """

        def slope(q: Array, v: Array, x: Array) -> Array:
            multipliers = self.multipliers(q, w[..., None, :])
            return times(np.swapaxes(self.jacobian((q, v, x)), -1, -2), multipliers)

        found = self._slopes.by_all(slope, state, self._last, share)
        return 0.5 * (found + np.swapaxes(found, -1, -2))


class Forward(Inverse):
    """Derivatives of R + B u − M a by (q, v, u), at the accelerations a that it is zero for."""

    name = "forward_dynamics"

    def __init__(self, slopes: Slopes) -> None:
        super().__init__(slopes)
        units = slopes.units
        self._last = units.u
        self.units = np.concatenate([units.q, units.v, units.u])

    def jacobian(self, state: State) -> Array:
        """Derivatives (…, nv, columns) of forces: M times those of the accelerations."""
        call = self._slopes.call
        a = call("forward_dynamics", *state)[..., None, :]

        def lacking(q: Array, v: Array, u: Array) -> Array:
            return times(call("input_matrix", q), u) - call("inverse_dynamics", q, v, a)

        return self._slopes.by_all(lacking, state, self._last)

    def multipliers(self, q: Array, w: Array) -> Array:
        """What multiplies the forces where w (…, nv) weighs the accelerations: M⁻¹ w."""
        matrices = self._slopes.call("mass_matrix", q)
        return solved(matrices, np.broadcast_to(w, matrices.shape[:-1])[..., None])[..., 0]


def solved(matrices: Array, columns: Array) -> Array:
    """Solutions (…, n, m) of linear equations, or NaN where one matrix has none."""
    try:
        return np.linalg.solve(matrices, columns)
    except np.linalg.LinAlgError:
        return np.full_like(columns, np.nan)
