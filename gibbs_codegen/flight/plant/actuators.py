"""Limits and lag of motors and joints: those of a scenario, and else those of the robot file.

They enter no function of a module, which therefore does not have them; but its folder keeps the
robot file that it was generated from.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.flight.plant.vehicle import Array, Flags, Vehicle
from gibbs_codegen.flight.scenario.scenario import Scenario

_NO_LIMITS = (-math.inf, math.inf)


@dataclass(frozen=True)
class Actuators:
    """Limits and lag of N motors and n joints; limits are infinite where there are none.

    - `thrusts` (2, N): least and greatest thrust, N; `lag` (N): time constants, s, 0 for none
    - `joints` (2, n): least and greatest coordinates, rad or m; `efforts` (n): greatest torques or
      forces, N m or N; `velocities` (n): greatest desired rates, rad/s or m/s
    - `spins` (N): angular momentum of rotors about their thrusts by the square root of the thrust,
      kg m²/s/√N, 0 for none
    """

    thrusts: Array
    lag: Array
    joints: Array
    efforts: Array
    velocities: Array
    spins: Array

    @classmethod
    def unlimited(cls, vehicle: Vehicle) -> Actuators:
        """Those of a robot without limits and lag."""
        rotors, joints = vehicle.rotors, vehicle.joints
        return cls(
            np.tile(np.transpose([_NO_LIMITS]), rotors),
            np.zeros(rotors),
            np.tile(np.transpose([_NO_LIMITS]), joints),
            np.full(joints, math.inf),
            np.full(joints, math.inf),
            np.zeros(rotors),
        )

    @property
    def inputs(self) -> Array:
        """Least and greatest inputs (2, nu): thrusts, N, then torques and forces of the joints."""
        efforts = np.stack([-self.efforts, self.efforts], axis=-2)
        before = np.broadcast_shapes(self.thrusts.shape[:-1], efforts.shape[:-1])
        parts = (np.broadcast_to(x, (*before, x.shape[-1])) for x in (self.thrusts, efforts))
        return np.concatenate(list(parts), axis=-1)

    def reached(self, commanded: Array) -> Flags:
        """Which commanded inputs (nu) are at a limit, or beyond."""
        least, most = self.inputs
        # Allocation within limits comes to them but for roundoff.
        margin = 1e-9 * np.where(np.isfinite(most - least), most - least, 0.0)
        reached: Flags = (commanded <= least + margin) | (commanded >= most - margin)
        return reached


def actuators_of(vehicle: Vehicle, scenario: Scenario) -> Actuators:
    """Limits and lag in a flight; what the scenario does not say is that of the robot file.

    Raises `UsageError` for a joint that the robot does not have, or if the robot file is not the
    module's.
    """
    found = robot_file_actuators(vehicle)
    motors, arm = scenario.motors, scenario.arm
    if scenario.control.law == "off":  # Motors that are off have no thrust, not their least.
        found.thrusts[:] = np.transpose([_NO_LIMITS])
    if motors.limits is not None:
        found.thrusts[:] = np.transpose([motors.limits])
    if motors.time_constant is not None:
        found.lag[:] = motors.time_constant
    for name, limits in arm.limits.items():
        found.joints[:, joint_place(vehicle, name, "arm.limits")] = limits
    for key, values in (("effort", found.efforts), ("velocity", found.velocities)):
        for name, most in getattr(arm, key).items():
            values[joint_place(vehicle, name, f"arm.{key}")] = most
    return found


def joint_place(vehicle: Vehicle, name: str, table: str = "") -> int:
    """The place of a joint among the joints, from 0.

    Raises `UsageError`, with the scenario's `table` that names it, if there is no such joint.
    """
    if name not in vehicle.joint_names:
        known = ", ".join(vehicle.joint_names) or "none"
        where = f"{table}.{name}: {vehicle.name}" if table else f"{vehicle.name}:"
        raise UsageError(f"{where} has no joint {name}; its joints: {known}")
    return vehicle.joint_names.index(name)


def robot_file_actuators(vehicle: Vehicle) -> Actuators:
    """Limits and lag that a module's robot file says; none without such a file.

    Raises `UsageError` if it is not the module's.
    """
    found = Actuators.unlimited(vehicle)
    for folder in getattr(vehicle.module, "__path__", ()):
        path = Path(folder) / "robot.toml"
        try:
            document = tomllib.loads(path.read_text(encoding="utf-8"))
            _fill(found, document.get("rotor", []), document.get("link", []))
        except FileNotFoundError:
            continue
        except (OSError, TypeError, ValueError, AttributeError, IndexError) as error:
            raise UsageError(
                f"{printable(path)}: is not the robot file that the module was generated from "
                f"({printable(error)}); generate the module again"
            ) from None
    return found


def _fill(
    found: Actuators, rotors: list[Mapping[str, Any]], links: list[Mapping[str, Any]]
) -> None:
    """Put what [[rotor]], one for each or none, and [[link]] say in place of no limits or lag."""
    for k, rotor in enumerate(rotors):
        found.thrusts[:, k] = rotor.get("limits", _NO_LIMITS)
        found.lag[k] = rotor.get("time_constant", 0.0)
        # A rotor spins against the torque that its drag does to the robot.
        spin = rotor.get("spin_inertia", 0.0) * rotor.get("speed_per_sqrt_thrust", 0.0)
        found.spins[k] = -math.copysign(spin, rotor.get("drag", 0.0))
    moving = (link for link in links if link.get("joint") != "fixed")
    for k, link in enumerate(moving):
        found.joints[:, k] = link.get("limits", np.radians(link.get("limits_deg", _NO_LIMITS)))
        found.efforts[k] = link.get("effort", math.inf)
        found.velocities[k] = link.get("velocity", math.inf)
