"""Control allocation: the thrusts that produce a desired wrench on the base.

The wrench is force and torque about the base centre in the base's frame, which is arm 1's if there
are arms. A unit thrust of a rotor on the base produces the same wrench at every configuration, so
one matrix serves; of rotors that joints move, `moving_rotors` tells.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from gibbs_codegen.errors import UsageError
from gibbs_codegen.robot.wrenches import directions

Array = NDArray[np.float64]

# Singular values below this share of the largest belong to directions that rotors cannot command.
RANK = 1e-9
# Share of a wrench that thrusts may fail to produce and still count as exact.
EXACT = 1e-9
# Weight of small thrusts against the wrench, as a share of the norm of all wrenches. It picks one
# of many solutions; of a wrench that takes great thrusts it costs a share that is its square.
_PREFERENCE = 1e-5


class AllocationError(UsageError):
    """A wrench that the rotors cannot produce; `missing` names the directions they lack."""

    def __init__(self, message: str, missing: Sequence[str]) -> None:
        self.missing = tuple(missing)
        super().__init__(message)


class Allocation:
    """Thrusts for wrenches: exact for six rotors, of minimum norm for more, within limits if given.

    Where these exceed the limits, thrusts are taken whose wrench is nearest to the desired one: of
    least |Δforce|² + |Δtorque / lever|², with the mean lever arm of the thrusts, m. `wrenches` (6,
    N) are those of unit thrusts, as `Vehicle.thrust_wrenches` has them; `limits`, N, are (2, N) or
    one pair for all.
    """

    # Whether a wrench that no thrusts produce is refused.
    refuses = True

    def __init__(self, wrenches: Array, limits: Array | tuple[float, float] | None = None) -> None:
        self.wrenches = wrenches
        self.limits = limits
        left, rank = np.linalg.svd(wrenches)[0], int(ranks(wrenches))
        self.missing = directions(left[:, rank:])
        self.inverse = np.asarray(np.linalg.pinv(wrenches, rcond=RANK), dtype=np.float64)
        # Torque is divided by the mean lever arm, so that it compares with force.
        force, torque = (float(np.linalg.norm(part)) for part in (wrenches[:3], wrenches[3:]))
        self._weights = np.repeat([1.0, force / torque if force and torque else 1.0], 3)
        weighted = self._weights[:, np.newaxis] * wrenches
        preference = _PREFERENCE * np.linalg.norm(weighted) * np.eye(wrenches.shape[1])
        self._weighted = np.vstack([weighted, preference])

    def in_flight(self) -> Self:
        """The same, which refuses no wrench but comes as near to it as thrusts can.

        What rotors lack is looked at before a flight. In flight, what thrusts do not produce is
        rounding, next to which the wrenches of a machine that tumbles are great.
        """
        found = copy.copy(self)
        found.refuses = False
        return found

    def thrusts(self, wrenches: Array) -> Array:
        """Thrusts (…, N), N, that produce wrenches (…, 6), or within limits come nearest to them.

        Raises `AllocationError` for a wrench in a direction that the rotors cannot command.
        """
        found = np.asarray(wrenches @ self.inverse.T, dtype=np.float64)
        if self.missing and self.refuses:
            self._check_produced(wrenches)
        if self.limits is None:
            return found
        least, most = self.limits
        beyond = np.any((found < least) | (found > most), axis=-1)
        beyond &= np.all(np.isfinite(wrenches), axis=-1)
        for index in np.argwhere(beyond):
            place = tuple(index)
            desired = np.concatenate([self._weights * wrenches[place], np.zeros(found.shape[-1])])
            nearest = lsq_linear(self._weighted, desired, bounds=self.limits, method="bvls")
            found[place] = np.clip(nearest.x, least, most)
        return found

    def thrusts_at(self, q: Array, wrenches: Array) -> Array:
        """`thrusts` (…, N) for wrenches (…, 6); the configurations (…, nq) make no difference."""
        return self.thrusts(wrenches)

    def residual_at(self, q: Array, wrenches: Array) -> Array:
        """`residual` (…) of wrenches (…, 6); the configurations (…, nq) make no difference."""
        return self.residual(wrenches)

    def residual(self, wrenches: Array) -> Array:
        """Norm (…), N and N m, of the part of wrenches (…, 6) that no thrusts produce.

        Limits make no difference; 0 where thrusts are exact but for rounding.
        """
        return unproduced(self.wrenches, self.inverse, wrenches)

    def _check_produced(self, wrenches: Array) -> None:
        if np.any(missed := self.residual(wrenches)):
            raise AllocationError(
                f"the motion needs {listed(self.missing)} (in the base's frame, about the base "
                f"centre), up to {np.max(missed):.3g} N or N m, which the rotors cannot command; "
                "tilt some thrusts in the robot file, or add rotors",
                self.missing,
            )


def ranks(matrices: Array) -> NDArray[np.int64]:
    """How many directions rotors command (…), by wrenches of unit thrusts (…, m, N).

    These may be some components only.
    """
    values = np.linalg.svd(matrices, compute_uv=False)
    largest = values.max(axis=-1, initial=0.0, keepdims=True)
    found: NDArray[np.int64] = np.sum(values > RANK * largest, axis=-1)
    return found


def unproduced(wrenches_of_thrusts: Array, inverse: Array, wrenches: Array) -> Array:
    """Norm (…), N and N m, of the part of wrenches (…, 6) that no thrusts produce.

    Limits make no difference; 0 where thrusts are exact but for rounding. `inverse` (…, N, 6) is
    the pseudo-inverse of `wrenches_of_thrusts` (…, 6, N), of unit thrusts.
    """
    left = np.eye(6) - wrenches_of_thrusts @ inverse
    norm = np.linalg.norm((left @ wrenches[..., np.newaxis])[..., 0], axis=-1)
    exact = EXACT * (1.0 + np.linalg.norm(wrenches, axis=-1))
    residual: Array = np.where(norm > exact, norm, 0.0)
    return residual


def listed(names: Sequence[str]) -> str:
    """Names, one at least, with commas, and "and" before the last."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
