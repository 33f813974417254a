"""Control allocation: the thrusts that produce a desired wrench on the base.

The wrench is force and torque about the base centre in the base's frame, which is arm 1's if there
are arms. A unit thrust of a rotor on the base produces the same wrench at every configuration, so
one matrix serves; of rotors that joints move, `MovingAllocation` has one for each configuration.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import Self

import numpy as np
import scipy
from numpy.typing import NDArray

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.plant.vehicle import RobotData, Vehicle
from gibbs_codegen.flight.vectors import Array, times, transposed
from gibbs_codegen.robot.wrenches import RANK, directions, leans

# Share of a wrench that thrusts may fail to produce and still count as exact.
EXACT = 1e-9
# Weight of small thrusts against the wrench, as a share of the norm of all wrenches. It picks one
# of many solutions; of a wrench that takes great thrusts it costs a share that is its square.
_PREFERENCE = 1e-5
# Iterations of bounded least squares at most, for each rotor. SciPy ends after one for each by
# default, which may be before the nearest wrench: each takes a thrust to a limit or off it.
_ITERATIONS = 100
# A basis of all wrenches.
_ANY = np.eye(6)
# Why a base that leans cannot fly without thrust.
LEANS_BY_THRUST = "the direction of the thrust determines how the base leans"


class AllocationError(UsageError):
    """A wrench that the rotors cannot produce; `missing` names the directions they lack."""

    def __init__(self, message: str, missing: Sequence[str]) -> None:
        self.missing = tuple(missing)
        super().__init__(message)


class Allocation:
    """Thrusts for wrenches: exact for six rotors, of minimum norm for more, within limits if given.

    Where these exceed the limits, thrusts are taken whose wrench is nearest to the desired one: of
    least |Δforce|² + |Δtorque / lever|², with the mean lever arm of the thrusts, m. `wrenches` (6,
    N) are those of unit thrusts, as `Vehicle.input_wrenches` has them; `limits`, N, are (2, N) or
    one pair for all. `asked` (6, n) are a basis of the wrenches that a motion may ask for.
    """

    # Whether a wrench that no thrusts produce is refused.
    refuses = True

    def __init__(
        self,
        wrenches: Array,
        limits: Array | tuple[float, float] | None = None,
        asked: Array = _ANY,
    ) -> None:
        self.wrenches = wrenches
        self.limits = limits
        of_thrusts = asked.T @ wrenches
        left, rank = np.linalg.svd(of_thrusts)[0], int(ranks(of_thrusts))
        self.missing = directions(asked @ left[:, rank:])
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
        allocation = copy.copy(self)
        allocation.refuses = False
        return allocation

    def thrusts(self, wrenches: Array) -> Array:
        """Thrusts (…, N), N, that produce wrenches (…, 6), or within limits come nearest to them.

        Raises `AllocationError` for a wrench in a direction that the rotors cannot command.
        """
        if self.refuses:
            self._check_produced(wrenches)
        smallest = np.asarray(wrenches @ self.inverse.T, dtype=np.float64)
        return smallest if self.limits is None else self._nearest(smallest, wrenches)

    def _nearest(self, smallest: Array, wrenches: Array, *others: Array) -> Array:
        """Thrusts (…, N) within limits, of the smallest (…, N) of wrenches (…, 6)."""
        thrusts, (least, most) = smallest.copy(), self._limits
        beyond = np.any((thrusts < least) | (thrusts > most), axis=-1)
        beyond &= np.all(np.isfinite(wrenches), axis=-1)
        for index in np.argwhere(beyond):
            place = tuple(index)
            desired = np.concatenate([self._weights * wrenches[place], np.zeros(thrusts.shape[-1])])
            nearest = scipy.optimize.lsq_linear(
                self._weighted,
                desired,
                bounds=self._limits,
                method="bvls",
                max_iter=_ITERATIONS * thrusts.shape[-1],
            )
            thrusts[place] = np.clip(nearest.x, least, most)
        return thrusts

    @property
    def _limits(self) -> Array | tuple[float, float]:
        return (-np.inf, np.inf) if self.limits is None else self.limits

    @property
    def externals(self) -> dict[str, Callable[..., Array]]:
        """Functions that programs of laws call: see `machine.laws.inputs_of`."""
        return {"nearest_thrusts": self._nearest}

    def check(self, q: Array, wrenches: Array) -> None:
        """Raise `AllocationError` if no thrusts at `q` (…, nq) produce a wrench (…, 6)."""
        self._check_produced(wrenches)

    def residual_at(self, q: Array, wrenches: Array) -> Array:
        """Norm (…), N and N m, of the part of wrenches (…, 6) that no thrusts produce at q (…, nq).

        Limits make no difference; 0 where thrusts are exact but for rounding.
        """
        return _unproduced(*self._at(q), wrenches)

    def _at(self, q: Array) -> tuple[Array, Array]:
        """Wrenches of unit thrusts (…, 6, N) at configurations, and their pseudo-inverses."""
        return self.wrenches, self.inverse

    def _check_produced(self, wrenches: Array) -> None:
        missed = _unproduced(self.wrenches, self.inverse, wrenches)
        if self.missing and np.any(missed):
            raise AllocationError(
                f"the motion needs {listed(self.missing)} (in the base's frame, about the base "
                f"centre), up to {np.max(missed):.3g} N or N m, which the rotors cannot command; "
                "tilt some thrusts in the robot file, or add rotors",
                self.missing,
            )


def ranks(matrices: Array) -> NDArray[np.int64]:
    """The number of directions that rotors command (…), by wrenches of unit thrusts (…, m, N).

    These may be some components only.
    """
    values = np.linalg.svd(matrices, compute_uv=False)
    largest = values.max(axis=-1, initial=0.0, keepdims=True)
    return np.sum(values > RANK * largest, axis=-1)


def _unproduced(wrenches_of_thrusts: Array, inverse: Array, wrenches: Array) -> Array:
    """As `residual_at`, with the pseudo-inverse (…, N, 6) of wrenches (…, 6, N) of unit thrusts."""
    left = np.eye(6) - wrenches_of_thrusts @ inverse
    norm = np.linalg.norm((left @ wrenches[..., np.newaxis])[..., 0], axis=-1)
    exact = EXACT * (1.0 + np.linalg.norm(wrenches, axis=-1))
    return np.where(norm > exact, norm, 0.0)


def listed(names: Sequence[str]) -> str:
    """Names, one at least, with commas, and "and" before the last."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


class MovingAllocation(Allocation):
    """Thrusts for wrenches at configurations, each by the allocation that holds there.

    As an allocation by itself it is that of the neutral configuration, of which `missing` tells.
    `limits`, N, are (2, N) or one pair for all.
    """

    def __init__(self, vehicle: Vehicle, limits: Array | tuple[float, float] | None = None) -> None:
        super().__init__(vehicle.input_wrenches(), limits, asked_of(vehicle, vehicle.neutral))
        self.vehicle = vehicle

    @property
    def externals(self) -> dict[str, Callable[..., Array]]:
        """Functions that programs of laws call, with the wrenches of unit thrusts somewhere."""
        return {
            "nearest_thrusts": self._nearest_there,
            "smallest_thrusts": _smallest,
            "force_axis": lambda columns: force_axis(transposed(columns)),
        }

    def _nearest_there(
        self, smallest: Array, wrenches: Array, columns: Array, *limits: Array
    ) -> Array:
        """Thrusts (…, N) within limits, where unit thrusts make the columns (…, N, 6)."""
        thrusts, (least, most) = smallest.copy(), self._limits
        for index in np.argwhere(np.any((thrusts < least) | (thrusts > most), axis=-1)):
            place = tuple(index)
            here = Allocation(columns[place].T, self.limits)
            thrusts[place] = here._nearest(smallest[place], wrenches[place])
        return thrusts

    def check(self, q: Array, wrenches: Array) -> None:
        """Raise `AllocationError` if no thrusts at `q` (…, nq) produce a wrench (…, 6)."""
        matrices = self._at(q)[0]
        for index in np.argwhere(self.residual_at(q, wrenches) > 0.0):
            place = tuple(index)
            asked = asked_of(self.vehicle, q[place])
            Allocation(matrices[place], asked=asked)._check_produced(wrenches[place])

    def _at(self, q: Array) -> tuple[Array, Array]:
        """The same, which differ from one configuration to the next."""
        matrices = self.vehicle.input_wrenches(q)
        return matrices, np.asarray(np.linalg.pinv(matrices, rcond=RANK), dtype=np.float64)


def _smallest(columns: Array, wrenches: Array) -> Array:
    """The smallest thrusts (…, N) of wrenches (…, 6), where unit thrusts make columns (…, N, 6)."""
    inverses = np.linalg.pinv(transposed(columns), rcond=RANK)
    return times(np.asarray(inverses, dtype=np.float64), wrenches)


def least_inputs(vehicle: Vehicle, q: Array, force: Array, columns: Array) -> Array:
    """Inputs (…, nu) of a generalised force (…, nv), of least thrust, whatever their limits.

    `columns` (…, 6, N + w) are the wrenches of unit inputs at `q`, of `Vehicle.input_wrenches`.
    What these cannot produce is left out.
    """
    inverses = np.asarray(np.linalg.pinv(columns, rcond=RANK), dtype=np.float64)
    pushes, rotors = times(inverses, vehicle.base_wrench(q, force)), vehicle.rotors
    thrusts, torques = pushes[..., :rotors], pushes[..., rotors:]
    loads = vehicle.input_matrix(q)[..., vehicle.arm_rates, :rotors]
    efforts = force[..., vehicle.arm_rates] - times(loads, thrusts)
    return np.concatenate([thrusts, efforts, torques], axis=-1)


def allocation_of(
    vehicle: Vehicle, limits: Array | tuple[float, float] | None = None
) -> Allocation:
    """The allocation of a robot's rotors, which serves at every configuration.

    `limits`, N, are (2, N) or one pair for all.
    """
    if not vehicle.wrenches_vary:
        return Allocation(vehicle.input_wrenches(), limits, asked_of(vehicle, vehicle.neutral))
    return MovingAllocation(vehicle, limits)


def asked_of(vehicle: RobotData, q: Array) -> Array:
    """An orthonormal basis (6, n) of the wrenches that motions of a base at `q` (nq) ask for.

    They are as many as the base has velocities.
    """
    base, (along, about) = vehicle.layout.v.base, vehicle.layout.driven_axes
    if vehicle.layout.carries_wrenches or not isinstance(vehicle, Vehicle):
        return _ANY[:, [*along, *sorted(3 + axis for axis in about)]]
    wrenches = vehicle.base_wrench(np.tile(q, (len(base), 1)), np.eye(vehicle.layout.v.size)[base])
    return np.linalg.qr(wrenches.T)[0]


def commands_all(vehicle: RobotData, q: Array) -> bool:
    """True if rotors command at configurations (…, nq) all that moves of the base."""
    return bool(np.all(ranks(vehicle.input_wrenches(q)) == len(vehicle.layout.v.base)))


def thrust_axis(vehicle: RobotData, q: Array) -> Array | None:
    """The axis along which rotors push, if they command a force along it and turn it all around.

    Unit vectors (…, 3) in the base's frame, along what equal thrusts of all rotors make; None if at
    some configuration (…, nq) the rotors command other wrenches, or the base has no other
    directions.
    """
    wrenches, (along, about) = vehicle.thrust_wrenches(q), vehicle.layout.own_axes
    if commands_all(vehicle, q) or np.any(ranks(wrenches) != 1 + len(about)):
        return None
    if np.any(ranks(wrenches[..., :3, :]) != 1):
        return None
    axis = force_axis(wrenches)
    return axis if leans(axis, along, about) else None


def force_axis(wrenches: Array) -> Array:
    """Unit vectors (…, 3), base's frame, along which rotors push, as equal thrusts of all do.

    `wrenches` (…, 6, N) are those of unit thrusts.
    """
    forces = wrenches[..., :3, :]
    sizes = np.linalg.norm(forces, axis=-2, keepdims=True)
    largest = np.argmax(sizes, axis=-1, keepdims=True)
    force = np.take_along_axis(forces, largest, axis=-1)
    # Rotors may push either way; where as many push up as down, the greatest one decides.
    along = np.sum(forces * force, axis=(-2, -1), keepdims=True)
    return (force / np.copysign(np.max(sizes, axis=-1, keepdims=True), along))[..., 0]
