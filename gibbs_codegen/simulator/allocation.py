"""Control allocation: the thrusts that put a wanted wrench on the base.

The wrench is force and torque about the base centre in arm 1's frame; a unit thrust of each rotor
makes the same wrench at every configuration, so one matrix serves.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from gibbs_codegen.errors import UsageError

Array = NDArray[np.float64]

_DIRECTIONS = (
    "force along x",
    "force along y",
    "force along z",
    "torque about x",
    "torque about y",
    "torque about z",
)
# A singular value below this share of the largest is a direction that thrusts cannot command.
_RANK = 1e-9
# What is left of a wrench, as a share of it, where thrusts count as making it exactly.
_EXACT = 1e-9
# Weight of small thrusts against the wrench, as a share of the smallest singular value: picks one
# of many answers, at the cost of its square of the wrench.
_PREFERENCE = 1e-4


class AllocationError(UsageError):
    """A wrench that the rotors cannot make; `missing` names the directions they do not command."""

    def __init__(self, message: str, missing: Sequence[str]) -> None:
        self.missing = tuple(missing)
        super().__init__(message)


class Allocation:
    """Thrusts for wrenches: exact for six rotors, of minimum norm for more, within limits if given.

    Within limits that a wrench is beyond, the thrusts whose wrench is nearest to it: of least
    |Δforce|² + |Δtorque / lever|², with the lever that thrusts have on the whole, m.
    `wrenches` (6, N) is what a unit thrust of each rotor makes; `limits` are the least and the
    greatest thrust of every rotor, N.
    """

    def __init__(self, wrenches: Array, limits: tuple[float, float] | None = None) -> None:
        self.wrenches = wrenches
        self.limits = limits
        left, values, _ = np.linalg.svd(wrenches)
        rank = int(np.sum(values > _RANK * values[0]))
        self.missing = _named(left[:, rank:])
        self.inverse = np.asarray(np.linalg.pinv(wrenches, rcond=_RANK), dtype=np.float64)
        # Torque by the lever that thrusts have on the whole, so that it compares with force.
        force, torque = (float(np.linalg.norm(part)) for part in (wrenches[:3], wrenches[3:]))
        self._weights = np.repeat([1.0, force / torque if force and torque else 1.0], 3)
        weighted = self._weights[:, np.newaxis] * wrenches
        least = np.linalg.svd(weighted, compute_uv=False)[rank - 1]
        preference = _PREFERENCE * least * np.eye(wrenches.shape[1])
        self._weighted = np.vstack([weighted, preference])

    def require_all_directions(self, purpose: str) -> None:
        """Raise `AllocationError` where there are wrenches that no thrusts make."""
        if self.missing:
            raise AllocationError(
                f"{purpose}, but the rotors cannot command {_listed(self.missing)} "
                "(arm 1's frame, about the base centre); tilt some thrusts in the robot file, add "
                'rotors, or set control.law to "open_loop"',
                self.missing,
            )

    def thrusts(self, wrenches: Array) -> Array:
        """Thrusts (…, N) that make wrenches (…, 6), or within limits come nearest to them.

        Raises `AllocationError` for a wrench in a direction that the rotors do not command.
        """
        found = np.asarray(wrenches @ self.inverse.T, dtype=np.float64)
        if self.missing:
            self._check_made(wrenches)
        if self.limits is None:
            return found
        least, most = self.limits
        beyond = np.any((found < least) | (found > most), axis=-1)
        for index in np.argwhere(beyond):
            place = tuple(index)
            wanted = np.concatenate([self._weights * wrenches[place], np.zeros(found.shape[-1])])
            nearest = lsq_linear(self._weighted, wanted, bounds=self.limits, method="bvls")
            found[place] = np.clip(nearest.x, least, most)
        return found

    def shortfall(self, wrenches: Array) -> Array:
        """What thrusts without limits leave of wrenches (…, 6), N and N m; (…), 0 where exact."""
        left = np.linalg.norm(wrenches @ (np.eye(6) - self.wrenches @ self.inverse).T, axis=-1)
        exact = _EXACT * (1.0 + np.linalg.norm(wrenches, axis=-1))
        short: Array = np.where(left > exact, left, 0.0)
        return short

    def _check_made(self, wrenches: Array) -> None:
        if np.any(short := self.shortfall(wrenches)):
            raise AllocationError(
                f"the motion needs {_listed(self.missing)} (arm 1's frame, about the base centre), "
                f"up to {np.max(short):.3g} N or N m, which the rotors cannot command; tilt some "
                "thrusts in the robot file, or add rotors",
                self.missing,
            )


def _named(basis: Array) -> tuple[str, ...]:
    """Directions that span the columns of `basis` (6, k), in words."""
    count = basis.shape[1]
    if count == 0:
        return ()
    # Reduced so that each direction has a component of its own, and is that alone if it can be.
    pivots = np.sort(scipy.linalg.qr(basis.T, mode="r", pivoting=True)[1][:count])
    reduced = basis @ np.linalg.inv(basis[pivots])
    return tuple(_in_words(direction) for direction in reduced.T)


def _in_words(direction: Array) -> str:
    parts: list[str] = []
    for component, name in zip(direction, _DIRECTIONS, strict=True):
        if abs(component) > 1e-6:
            factor = "" if abs(abs(component) - 1.0) < 1e-6 else f"{abs(component):.3g} × "
            sign = ("− " if component < 0 else "+ ") if parts else ("−" if component < 0 else "")
            parts.append(f"{sign}{factor}{name}")
    return " ".join(parts)


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
