"""What a controller observes: the state with white noise, after a delay, and the desired motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.scenario.attitude import rate_matrix
from gibbs_codegen.scenario.sensors import Sensors
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle
from gibbs_codegen.simulator.reference import Reference


@dataclass(frozen=True)
class Observation:
    """What a controller is told; its arrays are read-only.

    - `time`: of the sample, s
    - `q` (nq) and `v` (nv): the state as the sensors measure it
    - `q_desired` (nq), `v_desired` and `a_desired` (nv): the desired motion at `time`
    """

    time: float
    q: Array
    v: Array
    q_desired: Array
    v_desired: Array
    a_desired: Array

    def __post_init__(self) -> None:
        for array in (self.q, self.v, self.q_desired, self.v_desired, self.a_desired):
            array.setflags(write=False)


class Sensing:
    """Observations of states, each with noise of its own; a state as it is by default."""

    def __init__(
        self, vehicle: Vehicle, reference: Reference, sensors: Sensors | None = None
    ) -> None:
        found = sensors or Sensors()
        self._vehicle, self._reference = vehicle, reference
        self.delay = found.delay
        self._seed: int | np.integer = found.seed
        places = vehicle.layout.v
        # Standard deviations of displacements, and of velocities (2, nv).
        self._deviations = np.zeros((2, places.size))
        self._deviations[:, places.attitude] = [[found.attitude], [found.angular_velocity]]
        self._deviations[:, places.position] = [[found.position], [found.velocity]]
        self._deviations[:, places.joints] = [[found.joints], [found.joint_rates]]
        self.reset()

    def reset(self, seed: int | None = None) -> None:
        """Draw the noise of a flight again from its begin, with another seed if given.

        Raises `UsageError` if it is no integer, or less than 0.
        """
        wanted = self._seed if seed is None else seed
        if not (isinstance(wanted, int | np.integer) and wanted >= 0):
            shown = printable(repr(seed), 60)
            raise UsageError(f"seed: must be an integer of 0 or more, not {shown}")
        self._seed, self._noise = wanted, np.random.default_rng(wanted)

    def __call__(self, time: float, q: Array, v: Array) -> Observation:
        """What a controller is told of a state.

        The attitude is turned by a random rotation vector; rates of attitude angles are off by
        those of a random angular velocity.
        """
        return Observation(time, *self._measured(q, v), *self._reference(time))

    def _measured(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Coordinates (nq) and velocities (nv) with noise, in new arrays."""
        if not np.any(self._deviations):
            return q.copy(), v.copy()
        moved, faster = self._deviations * self._noise.standard_normal(self._deviations.shape)
        layout = self._vehicle.layout
        if not layout.is_quaternion:
            rates = rate_matrix(layout.attitude, q[layout.q.attitude])
            for noise in (moved, faster):
                noise[layout.v.attitude] = np.linalg.solve(rates, noise[layout.v.attitude])
        return np.asarray(self._vehicle.integrate(q, moved)), v + faster
