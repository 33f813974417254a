"""Control allocation of rotors that joints move: another one at every configuration."""

from __future__ import annotations

import numpy as np

from gibbs_codegen.simulator.plant.allocation import RANK, Allocation, unproduced
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle


class MovingAllocation(Allocation):
    """Thrusts for wrenches at configurations, each by the allocation that holds there.

    As an allocation by itself it is that of configuration `q` (nq), of which `missing` tells.
    `limits`, N, are (2, N) or one pair for all.
    """

    def __init__(
        self, vehicle: Vehicle, q: Array, limits: Array | tuple[float, float] | None = None
    ) -> None:
        super().__init__(vehicle.thrust_wrenches(q), limits)
        self.vehicle = vehicle

    def thrusts_at(self, q: Array, wrenches: Array) -> Array:
        """Thrusts (…, N), N, that produce wrenches (…, 6) at `q`, or come nearest to them."""
        matrices, inverses = self._at(q)
        thrusts: Array = (inverses @ wrenches[..., np.newaxis])[..., 0]
        doubtful = self.refuses & (unproduced(matrices, inverses, wrenches) > 0.0)
        if self.limits is not None:
            least, most = self.limits
            doubtful |= np.any((thrusts < least) | (thrusts > most), axis=-1)
        for index in np.argwhere(doubtful):
            place = tuple(index)
            here = Allocation(matrices[place], self.limits)
            here.refuses = self.refuses
            thrusts[place] = here.thrusts(wrenches[place])
        return thrusts

    def residual_at(self, q: Array, wrenches: Array) -> Array:
        """Norm (…), N and N m, of the part of wrenches (…, 6) that no thrusts produce at `q`."""
        return unproduced(*self._at(q), wrenches)

    def _at(self, q: Array) -> tuple[Array, Array]:
        """Wrenches of unit thrusts (…, 6, N) at configurations, and their pseudo-inverses."""
        matrices = self.vehicle.thrust_wrenches(q)
        return matrices, np.asarray(np.linalg.pinv(matrices, rcond=RANK), dtype=np.float64)


def allocation_of(
    vehicle: Vehicle, q: Array | None = None, limits: Array | tuple[float, float] | None = None
) -> Allocation:
    """The allocation of a robot's rotors, which serves at every configuration.

    Of `q` (nq), or zero, it is told what the rotors cannot command, if they move. `limits`, N, are
    (2, N) or one pair for all.
    """
    if not vehicle.rotors_move:
        return Allocation(vehicle.thrust_wrenches(), limits)
    return MovingAllocation(vehicle, vehicle.neutral if q is None else q, limits)
