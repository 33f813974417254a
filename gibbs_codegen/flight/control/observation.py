"""Observations for controllers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.plant.estimator import Estimate
from gibbs_codegen.flight.plant.sensors import Reading
from gibbs_codegen.flight.plant.vehicle import Array


class Measured(NamedTuple):
    """Accelerations (nv), wrenches (f, 6) on the frames, and the state of the actuators.

    Then the forces (l) of constraints, what the robot's sensors measure (m) without errors, the
    inputs (nu) that act, and desired coordinates (k, nq) ahead.
    """

    a: Array
    wrenches: Array
    actuators: Array
    constraint_forces: Array
    sensors: Array = np.zeros(0)
    inputs: Array = np.zeros(0)
    q_ahead: Array = np.zeros(0)


def _unknown() -> Measured:
    raise UsageError(
        "observation: accelerations, wrenches and actuators are missing; they must be given "
        "when it is made"
    )


@dataclass(frozen=True)
class Observation:
    """An observation for a controller; its arrays are read-only.

    - `time`: of the sample, s
    - `q` (nq) and `v` (nv): the state as the sensors measure it
    - `q_desired` (nq), `v_desired` and `a_desired` (nv): the desired motion at `time`
    - `a` (nv): accelerations, the derivatives of v, under the inputs that acted before the sample
    - `wrenches` (f, 6): what walls and the push do to each frame of `FRAMES`: force, N, and torque
      about its origin, N m, world axes
    - `actuators`: thrusts of motors that lag, N, or the state that `ACTUATOR_STATES` names
    - `constraint_forces`: those of the constraints of `CONSTRAINT_ROWS`, N and N m, in the axes of
      their anchors; 0 of constraints that do not hold
    - `q_ahead` (3, nq): desired coordinates in 0.1, 0.2 and 0.4 s, at most at the flight's end

    - `sensors`: by the names of the robot's sensors what they read last, a tuple of the `time` at
      which that was measured, s, and the `values`, which `SensorSuite` describes; NaN before
    - `estimate`: with `control.estimate`, what the filter knows of q and v, an `Estimate`
      with deviations; else None

    All from `a` to `q_ahead` are computed when they are first asked for.
    """

    time: float
    q: Array
    v: Array
    q_desired: Array
    v_desired: Array
    a_desired: Array
    measure: Callable[[], Measured] = field(default=_unknown, repr=False, compare=False)
    sensors: Mapping[str, Reading] = field(default_factory=dict, repr=False, compare=False)
    estimate: Estimate | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        for array in (self.q, self.v, self.q_desired, self.v_desired, self.a_desired):
            array.setflags(write=False)

    @property
    def a(self) -> Array:
        """Accelerations (nv)."""
        return self._measured.a

    @property
    def wrenches(self) -> Array:
        """Wrenches (f, 6) on the frames."""
        return self._measured.wrenches

    @property
    def actuators(self) -> Array:
        """State of the actuators."""
        return self._measured.actuators

    @property
    def constraint_forces(self) -> Array:
        """Forces (l) of constraints."""
        return self._measured.constraint_forces

    @property
    def q_ahead(self) -> Array:
        """Desired coordinates (k, nq) at times ahead."""
        return self._measured.q_ahead

    @cached_property
    def _measured(self) -> Measured:
        measured = self.measure()
        for array in measured:
            array.setflags(write=False)
        return measured

    def __getstate__(self) -> dict[str, Any]:
        # The measuring function holds the whole flight, which must not be carried along.
        measured = {} if self.measure is _unknown else {"_measured": self._measured}
        return {**self.__dict__, **measured, "measure": _unknown}
