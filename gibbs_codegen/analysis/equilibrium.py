"""Where a steady motion can be held: coordinates at which thrusts balance what acts on the base.

Joints balance themselves, since each has an input. The base is balanced where the wrench that it
needs has no part that thrusts cannot produce, which is a condition on the attitude, and on the
joints of robots whose rotors they move.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle

# Singular values below this share of the largest belong to directions that rotors cannot command.
RANK = 1e-9
# Share of the wrench that may be missing.
EXACT = 1e-9
# Share of the wrench below which coordinates are left as they are, and SciPy's tolerances.
_BALANCED, _CONVERGED = 1e-12, 1e-15
# Of displacements beside what is missing; its square is what it leaves missing.
_PULL = 1e-3


@dataclass(frozen=True, eq=False)
class SteadyMotion:
    """A motion in which nothing turns and no joint moves, and what acts besides gravity.

    - `velocity`, `acceleration` (3): of the base, world axes, m/s and m/s²
    - `wrenches` (f, 6): on the frames, in the order of `FRAMES`, world axes, N and N m
    """

    vehicle: Vehicle
    velocity: Array
    acceleration: Array
    wrenches: Array

    def rates(self, q: Array) -> tuple[Array, Array]:
        """Velocities and accelerations (nv) at coordinates."""
        vehicle = self.vehicle
        base = vehicle.layout.v.base
        jacobian = vehicle.function("frame_jacobians")(q)[vehicle.frames.index("base")]
        moved = np.zeros((2, vehicle.layout.v.size))
        # Without turning, the velocity and the acceleration of the base's frame are J v and J a.
        twists = np.zeros((6, 2))
        twists[:3] = np.transpose([self.velocity, self.acceleration])
        moved[:, base] = np.linalg.lstsq(jacobian[:, base], twists, rcond=None)[0].T
        return moved[0], moved[1]

    def force(self, q: Array) -> Array:
        """Generalised force (nv) that the inputs must produce at coordinates."""
        acting = self.vehicle.wrench_forces(q, self.wrenches)
        return self.vehicle.inverse_dynamics(q, *self.rates(q)) - acting

    def missing(self, q: Array) -> Array:
        """The least part (6) that thrusts leave of the wrench that the base needs.

        Force, N, and torque about the base centre, N m, in the base's axes.
        """
        needed, columns = (
            self.vehicle.base_wrench(q, self.force(q)),
            self.vehicle.thrust_wrenches(q),
        )
        missing: Array = needed - columns @ (np.linalg.pinv(columns, rcond=RANK) @ needed)
        return missing

    def size(self, q: Array) -> float:
        """The largest component of the wrenches on the base, needed and acting, N or N m; or 1."""
        parts = self.force(q), self.vehicle.wrench_forces(q, self.wrenches)
        return max(float(np.abs(self.vehicle.base_wrench(q, x)).max()) for x in parts) or 1.0


def equilibrium(motion: SteadyMotion, q: Array, free: list[int], bounds: Array) -> Array:
    """Coordinates (nq), near given ones, at which thrusts balance the base best.

    Something may be missing still. `free` are places in v of what may differ, by displacements
    within `bounds` (2, len(free)), rad or m.
    """
    size = motion.size(q)
    if not free or np.abs(motion.missing(q)).max() <= _BALANCED * size:
        return q

    def moved(displacement: Array) -> Array:
        whole = np.zeros(motion.vehicle.layout.v.size)
        whole[free] = displacement
        return motion.vehicle.integrate(q, whole)

    def residual(displacement: Array, pull: float) -> Array:
        return np.append(motion.missing(moved(displacement)) / size, pull * displacement)

    displacement = np.zeros(len(free))
    # Of all that balances, such as every heading, the nearest: the pull leads there, and its traces
    # are taken away. Differences serve: derivatives of a module lack those of B u and of the
    # wrenches' forces, and what is missing is in the end computed exactly.
    for pull in (_PULL, 0.0):
        displacement = least_squares(
            residual,
            displacement,
            jac="3-point",
            bounds=bounds,
            ftol=_CONVERGED,
            xtol=_CONVERGED,
            gtol=_CONVERGED,
            args=(pull,),
        ).x
    return moved(displacement)
