"""Control allocation of rotors that joints move: another one at every configuration."""

from __future__ import annotations

import numpy as np

from gibbs_codegen.simulator.plant.allocation import Allocation
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle


class MovingAllocation(Allocation):
    """Thrusts for wrenches at configurations, each by the allocation that holds there.

    As an allocation by itself it is that of one configuration.

    Args:
        vehicle: the robot.
        q: the configuration (nq) of which `missing` tells.
        limits: least and greatest thrusts, N, (2, N) or one pair for all; None for no limits.
    """

    def __init__(
        self, vehicle: Vehicle, q: Array, limits: Array | tuple[float, float] | None = None
    ) -> None:
        super().__init__(vehicle.thrust_wrenches(q), limits)
        self.vehicle = vehicle

    def thrusts_at(self, q: Array, wrenches: Array) -> Array:
        """Thrusts that produce wrenches at configurations, or come nearest to them.

        Args:
            q: Coordinates (…, nq).
            wrenches: Desired wrenches (…, 6).

        Returns:
            Thrusts (…, N), N.
        """
        thrusts = np.empty((*wrenches.shape[:-1], self.vehicle.rotors))
        matrices = self.vehicle.thrust_wrenches(q)
        for place in np.ndindex(wrenches.shape[:-1]):
            thrusts[place] = Allocation(matrices[place], self.limits).thrusts(wrenches[place])
        return thrusts

    def residual_at(self, q: Array, wrenches: Array) -> Array:
        """The part of wrenches that no thrusts produce at configurations.

        Args:
            q: Coordinates (…, nq).
            wrenches: Desired wrenches (…, 6).

        Returns:
            Its norm (…), N and N m.
        """
        residual = np.empty(wrenches.shape[:-1])
        matrices = self.vehicle.thrust_wrenches(q)
        for place in np.ndindex(wrenches.shape[:-1]):
            residual[place] = Allocation(matrices[place]).residual(wrenches[place])
        return residual


def allocation_of(
    vehicle: Vehicle, q: Array | None = None, limits: Array | tuple[float, float] | None = None
) -> Allocation:
    """The allocation of a robot's rotors.

    Args:
        vehicle: The robot.
        q: A configuration (nq) of which it is told what the rotors cannot command, if they move;
            None for that of zero.
        limits: Least and greatest thrusts, N, (2, N) or one pair for all; None for no limits.

    Returns:
        One that serves at every configuration.
    """
    if not vehicle.rotors_move:
        return Allocation(vehicle.thrust_wrenches(), limits)
    return MovingAllocation(vehicle, vehicle.neutral if q is None else q, limits)
