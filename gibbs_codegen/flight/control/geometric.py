"""The geometric law on SE(3), for a base whose rotors push along one axis (Lee, Leok, McClamroch).

What moves the centre of mass is the force of all rotors less the weight, whatever the arms do. So
the law tracks the centre of mass: its errors and the desired motion tell the force, the direction
of the force tells how the base must lean, and angular accelerations make it lean so. Together with
those of the joints they are turned into inputs by inverse dynamics. That leaves the acceleration of
the base itself: it is what the force along the thrust axis gives, since across it there is none.
Without errors the inputs are those of the desired motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.control.laws import Controller, curve_tables
from gibbs_codegen.flight.plant.allocation import LEANS_BY_THRUST, force_axis
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.reference import Motion, Reference
from gibbs_codegen.flight.vectors import Array, times

# Share of the greatest thrust of a motion that is none.
_NO_THRUST = 1e-9


@dataclass(frozen=True)
class LeaningController(Controller):
    """Inputs by which centre of mass, attitude and joints follow a reference: the base leans.

    The gains of position are those of the centre of mass, and of the heading, by which the base is
    turned about its thrust axis; those of attitude are of the thrust axis.
    """

    def check_thrust(self) -> None:
        """Raise `UsageError` with the first time at which the motion needs no thrust."""
        time = self.reference.knots
        size = np.linalg.norm(self.vehicle.mass * self.centre(time)[2] + self.weight, axis=-1)
        none = size <= _NO_THRUST * np.max(size)
        if np.any(none):
            raise UsageError(
                f"{self.vehicle.name}: at t = {time[none][0]:.6g} s the desired motion needs no "
                f"thrust, and {LEANS_BY_THRUST}; choose another motion, or gravity other than 0"
            )

    @cached_property
    def values(self) -> dict[str, Any]:
        """Those of any law, and what it knows of the robot as a whole."""
        return {**super().values, **leaning_figures(self.vehicle)}

    @cached_property
    def externals(self) -> dict[str, Callable[..., Any]]:
        """Those of any law, and how the centre of mass is to move."""
        return {**super().externals, "centre": self.centre.curves}

    @property
    def tables(self) -> list[Array]:
        """Those of any law, and of how the centre of mass is to move."""
        return curve_tables(self.reference, self.centre)

    @cached_property
    def weight(self) -> Array:
        """The force (3) that holds the robot, N, world axes."""
        return np.asarray(leaning_figures(self.vehicle)["weight"])

    @cached_property
    def centre(self) -> Reference:
        """Desired position, velocity and acceleration (…, 3) of the centre of mass in time."""
        time = self.reference.knots
        q, v, a = self.reference(time)
        acceleration = (_force(self.vehicle, q, v, a) - self.weight) / self.vehicle.mass
        velocity = times(self.vehicle.centre_of_mass_jacobian(q), v)
        return Reference(Motion(time, self.vehicle.centre_of_mass(q), velocity, acceleration))


def leaning_figures(vehicle: Vehicle) -> dict[str, Any]:
    """What laws know of a robot as a whole: mass, kg, weight (3), N, thrust axis (3)."""
    weight = _force(vehicle, vehicle.neutral, *np.zeros((2, vehicle.layout.v.size)))
    axis = force_axis(vehicle.thrust_wrenches())
    return {"mass": float(vehicle.mass), "weight": weight, "axis": axis}


def _force(vehicle: Vehicle, q: Array, v: Array, a: Array) -> Array:
    """Force (…, 3) of all rotors, of coordinates, velocities and accelerations; world axes."""
    wrench = vehicle.base_wrench(q, vehicle.inverse_dynamics(q, v, a))
    return times(vehicle.base_rotation(q), wrench[..., :3])
