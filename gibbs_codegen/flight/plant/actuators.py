"""Limits and lag of motors and joints: those of a scenario, and else those of the robot file.

They enter no function of a module, which has them as constants.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass, fields, replace
from functools import partial
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from gibbs_codegen.errors import UsageError, check_all, near, printable
from gibbs_codegen.flight.plant.vehicle import Array, Flags, RobotData, Vehicle

if TYPE_CHECKING:
    from gibbs_codegen.flight.scenario.parts import Motors
    from gibbs_codegen.flight.scenario.scenario import Scenario

_NO_LIMITS = (-math.inf, math.inf)
# Share of the largest input, or of 1, that may be missing; and how often more is wanted till then.
_SMALL, _TRIES = 1e-12, 64
# How far rounding takes what is at a limit off it.
_EXACT = 1e-9


@dataclass(frozen=True)
class Actuators:
    """Limits and lag of N motors and n joints; limits are infinite where there are none.

    - `thrusts` (2, N): least and greatest thrust, N; `lag` (N): time constants, s, 0 for none
    - `joints` (2, n): least and greatest coordinates, rad or m; `velocities` (n): greatest desired
      rates, rad/s or m/s; `efforts` (nu − N): greatest torques or forces of joints and then of
      driven wheels, N m or N
    - `spins` (N): angular momentum of rotors about their thrusts by the square root of the thrust,
      kg m²/s/√N, 0 for none
    - `commands` (2, nu): least and greatest commands of motors and servos; `times` (2, nu): time
      constants, s, with which these follow greater and lesser commands, 0 for none; None of a robot
      whose inputs are commanded
    - `span`: from when to when motors run, s
    """

    thrusts: Array
    lag: Array
    joints: Array
    efforts: Array
    velocities: Array
    spins: Array
    commands: Array | None = None
    times: Array | None = None
    span: tuple[float, float] = (0.0, math.inf)

    @classmethod
    def unlimited(cls, vehicle: RobotData) -> Actuators:
        """Those of a robot without limits and lag."""
        rotors, joints = vehicle.rotors, vehicle.joints
        return cls(
            np.tile(np.transpose([_NO_LIMITS]), rotors),
            np.zeros(rotors),
            np.tile(np.transpose([_NO_LIMITS]), joints),
            np.full(len(vehicle.inputs) - rotors, math.inf),
            np.full(joints, math.inf),
            np.zeros(rotors),
        )

    @property
    def inputs(self) -> Array:
        """Least and greatest inputs (2, nu): thrusts, N, then torques and forces, N m or N."""
        efforts = np.stack([-self.efforts, self.efforts], axis=-2)
        before = np.broadcast_shapes(self.thrusts.shape[:-1], efforts.shape[:-1])
        parts = (np.broadcast_to(x, (*before, x.shape[-1])) for x in (self.thrusts, efforts))
        return np.concatenate(list(parts), axis=-1)

    @property
    def pushes(self) -> Array:
        """Least and greatest (2, N + w) of what moves the base: thrusts, and torques of wheels."""
        wheels = self.inputs[..., self.thrusts.shape[-1] + self.joints.shape[-1] :]
        return np.concatenate([self.thrusts, wheels], axis=-1)

    @property
    def values(self) -> dict[str, Array]:
        """Limits of the inputs (nu) as array programs take them, and what counts as at them."""
        least, most = self.inputs[..., 0, :], self.inputs[..., 1, :]
        return {"least": least, "most": most, "margin": _margin(self.inputs)}

    @property
    def of_commands(self) -> dict[str, Array]:
        """Limits and time constants of commands (nu) as array programs take them."""
        if self.commands is None or self.times is None:
            return {}
        names = ("least_command", "most_command", "time_up", "time_down")
        return dict(zip(names, (*self.commands, *self.times), strict=True))

    @property
    def sent(self) -> Array:
        """Least and greatest (2, nu) of what is sent: commands of motors and servos, or inputs."""
        return self.inputs if self.commands is None else self.commands

    @property
    def idling(self) -> Array:
        """Thrusts (…, N), N, of motors that do not run, or their commands: the nearest to 0."""
        least, most = (self.sent[..., k, : self.thrusts.shape[-1]] for k in range(2))
        return np.clip(0.0, least, most)

    def idles(self, time: float | Array) -> Flags:
        """True if motors do not run at times (…), s."""
        times, (begin, end) = np.asarray(time), self.span
        return (times < begin) | (times >= end)


def at_limits(commanded: Array, limits: Array) -> Flags:
    """True for commanded inputs (nu) that are at one of their limits (2, nu), or beyond."""
    (least, most), margin = limits, _margin(limits)
    return (commanded <= least + margin) | (commanded >= most - margin)


def _margin(limits: Array) -> Array:
    """How far from limits (…, 2, nu) inputs (…, nu) are that allocation takes there: roundoff."""
    span = limits[..., 1, :] - limits[..., 0, :]
    return _EXACT * np.where(np.isfinite(span), span, 0.0)


def actuators_of(vehicle: RobotData, scenario: Scenario) -> Actuators:
    """Limits and lag in a flight; what the scenario does not say is that of the robot file.

    Raises `UsageError` for a joint that the robot does not have, or for a module of an earlier
    version.
    """
    motors, arm = scenario.motors, scenario.arm
    actuators = replace(module_actuators(vehicle), span=(motors.begin, motors.end))
    named = [(key, name) for key in ("limits", "effort", "velocity") for name in getattr(arm, key)]
    checks = [partial(joint_place, vehicle, name, f"arm.{key}") for key, name in named]
    lag = [] if motors.time_constant is None else ["motors.time_constant"]
    range_check = partial(_check_limits, vehicle, motors.limits, actuators.thrusts)
    lags = (partial(check_lag, vehicle.module, key) for key in lag)
    check_all([partial(_check_rotors, vehicle, motors), *checks, range_check, *lags])
    if scenario.control.law == "off":  # Motors that are off have no thrust, not their least.
        actuators.thrusts[:] = np.transpose([_NO_LIMITS])
    if motors.limits is not None:
        actuators.thrusts[:] = np.transpose([motors.limits])
    if motors.time_constant is not None:
        actuators.lag[:] = motors.time_constant
    for name, limits in arm.limits.items():
        actuators.joints[:, joint_place(vehicle, name)] = limits
    for key, values in (("effort", actuators.efforts), ("velocity", actuators.velocities)):
        for name, most in getattr(arm, key).items():
            place = joint_place(vehicle, name)
            if key == "effort" and has_servo(vehicle, place):
                raise UsageError(
                    f"arm.effort.{name}: a servo drives the joint within the torque of the robot "
                    "file; leave it out, or vary the parameters of the servo"
                )
            values[place] = most
    return actuators


def _check_rotors(vehicle: RobotData, motors: Motors) -> None:
    """Raise `UsageError` for keys of motors that mean nothing without rotors."""
    plain, keys = type(motors)(), [key.name for key in fields(motors)]
    settings = [f"motors.{key}" for key in keys if getattr(motors, key) != getattr(plain, key)]
    if settings and not vehicle.rotors:
        raise UsageError(f"{', '.join(settings)}: {vehicle.name} has no rotors; leave it out")


def _check_limits(vehicle: RobotData, limits: tuple[float, float] | None, thrusts: Array) -> None:
    """Raise `UsageError` for limits beyond those of thrusts (2, N), N, that every rotor makes."""
    low, high = thrusts[0].max(initial=-math.inf), thrusts[1].min(initial=math.inf)
    beyond = limits is not None and (limits[0] < low - _EXACT or limits[1] > high + _EXACT)
    if vehicle.is_driven and beyond:
        span = f"from {low:.4g} to {high:.4g} N; give limits within these"
        if low > high:
            span = (
                f"none, since one makes at least {low:.4g} N and one at most {high:.4g} N; leave "
                "it out"
            )
        raise UsageError(
            f"motors.limits: the rotors of {vehicle.name} can all make thrusts {span}, or change "
            "the rotors in its robot file"
        )


def check_lag(module: ModuleType, key: str) -> None:
    """Raise `UsageError` for a lag of thrusts, by its key, beside that of the robot file."""
    if getattr(module, "COMMANDS", ()):
        raise UsageError(
            f"{key}: the robot file of {module.NAME} has motors and servos with time constants, "
            "which are parameters of the module; leave it out"
        )


def commands_for(vehicle: Vehicle, q: Array, v: Array, u: Array, limits: Array) -> Array:
    """Values to send for inputs (…, nu): themselves, or commands for them within limits."""
    return vehicle.command_of(q, v, np.clip(u, *limits)) if vehicle.is_driven else u


def has_servo(vehicle: RobotData, place: int) -> bool:
    """True if a servo pushes a joint, by its place among the joints, from 0."""
    k = vehicle.rotors + place
    return vehicle.commands[k] != vehicle.inputs[k]


def holds(vehicle: RobotData, place: int) -> bool:
    """True if a servo holds a joint where it is commanded to be, by its place among the joints."""
    name = f"{vehicle.joint_names[place]}_position"
    return has_servo(vehicle, place) and vehicle.commands[vehicle.rotors + place] == name


def has_battery(vehicle: RobotData) -> bool:
    """True if the last state of the actuators is the charge of a battery."""
    return vehicle.actuator_states[-1:] == ("charge",)


def check_charge(vehicle: RobotData, charge: float) -> None:
    """Raise `UsageError` for a charge that is not from 0 to 1, or not 1 without a battery."""
    if not 0.0 <= charge <= 1.0:
        raise UsageError(f"charge: must be from 0 to 1, not {charge:g}")
    if charge != 1.0 and not has_battery(vehicle):
        raise UsageError(
            f"charge: {vehicle.name} has no battery; leave it out, or give [battery] in its robot "
            "file"
        )


def joint_place(vehicle: RobotData, name: str, table: str = "") -> int:
    """The place of a joint among the joints, from 0.

    Raises `UsageError`, with the scenario's `table` that names it, if there is no such joint.
    """
    if name not in vehicle.joint_names:
        joints = ", ".join(vehicle.joint_names) or "none"
        where = f"{table}.{name}: {vehicle.name}" if table else f"{vehicle.name}:"
        hint = near(name, vehicle.joint_names) or ";"
        if f"joint_{name}" in vehicle.points:
            hint = ": that link moves by a gear, or its joint has another name;"
        raise UsageError(f"{where} has no joint {printable(name, 60)}{hint} its joints: {joints}")
    return vehicle.joint_names.index(name)


def module_actuators(vehicle: RobotData) -> Actuators:
    """Limits and lag that the robot file says, as its module does.

    Raises `UsageError` for a module of an earlier version, which does not say.
    """
    actuators, joints = Actuators.unlimited(vehicle), vehicle.joint_names
    for k, name in enumerate(vehicle.inputs):
        low, high = _ends(vehicle.description("INPUT_LIMITS").get(name))
        if k < vehicle.rotors:
            actuators.thrusts[:, k] = low, high
            actuators.lag[k] = vehicle.description("TIME_CONSTANTS").get(name, 0.0)
            actuators.spins[k] = vehicle.description("SPINS").get(name, 0.0)
        else:
            actuators.efforts[k - vehicle.rotors] = high
    for k, name in enumerate(joints):
        actuators.joints[:, k] = _ends(vehicle.description("COORDINATE_LIMITS").get(name))
        actuators.velocities[k] = _ends(vehicle.description("VELOCITY_LIMITS").get(name))[1]
    if not vehicle.is_driven:
        return actuators
    times = vehicle.description("ACTUATOR_TIMES")
    return replace(
        actuators,
        lag=np.zeros(vehicle.rotors),
        commands=command_limits(vehicle.module),
        times=np.transpose([times.get(name, (0.0, 0.0)) for name in vehicle.commands]),
    )


def followed(state: str, commands: Collection[str]) -> str:
    """The command that a state of an actuator follows, by their names; the charge follows none."""
    joint = state.removesuffix("_reference")
    choices = (state, f"{joint}_position", f"{joint}_rate")
    return next((name for name in choices if name in commands), state)


def command_limits(module: ModuleType) -> Array:
    """Least and greatest commands (2, nu) of motors and servos, infinite where there are none."""
    return np.transpose([_ends(module.COMMAND_LIMITS.get(name)) for name in module.COMMANDS])


def beyond_limits(
    names: Iterable[str], units: Iterable[str], values: Array, limits: Array
) -> tuple[str, ...]:
    """Values (n) that are beyond their limits (2, n), in words."""
    clauses = []
    for name, unit, value, low, high in zip(names, units, values, *limits, strict=True):
        if not low - _EXACT <= value <= high + _EXACT:
            side, limit = ("below", low) if value < low else ("above", high)
            size, end = (
                f"{number:.4g} {unit}".removesuffix(" 1")
                + (f" ({math.degrees(number):.4g}°)" * (unit == "rad"))
                for number in (value, limit)
            )
            clauses.append(f"{name} is {size}, {side} its limit of {end}")
    return tuple(clauses)


def commands_beyond(module: ModuleType, commands: Array) -> str:
    """Commands (…, nu) that are beyond their limits most, in words; "" if none is."""
    limits, rows = command_limits(module), commands.reshape(-1, len(module.COMMANDS))
    worst = np.argmax(np.maximum(limits[0] - rows, rows - limits[1]), axis=0)
    values = np.take_along_axis(rows, worst[np.newaxis], axis=0)[0]
    return "; ".join(beyond_limits(module.COMMANDS, module.COMMAND_UNITS, values, limits))


def kept_commands(vehicle: Vehicle, q: Array, v: Array, u: Array) -> tuple[Array, Array]:
    """Commands (nu) and states of the actuators (nx), battery full, under which inputs (nu) stay.

    As far as actuators can: `inputs_of` gives the inputs again, and what follows commands rests.
    """
    states, names = vehicle.actuator_states, vehicle.commands
    wanted, small = u, _SMALL * np.abs(u).max(initial=1.0)
    for _ in range(_TRIES):
        command = vehicle.command_of(q, v, wanted)
        x = vehicle.actuator_state_of(command)
        acting = vehicle.inputs_of(q, v, x, command)
        missing = np.where(np.abs(u - acting) > small, u - acting, 0.0)
        if not missing.any():
            break
        # Backlash takes its share, and all as long as it is not known how large it is.
        wanted = wanted + np.where(missing == u, wanted, missing)
    levels = [k for k, name in enumerate(states) if name in names]
    if levels:
        # Throttles make up for what the battery's voltage has fallen. Rates are linear in each
        # command as long as they keep their sign.
        places = [names.index(states[k]) for k in levels]
        rates = vehicle.actuator_rates(x, command)[levels]
        step, aside = np.sign(rates), command.copy()
        aside[places] += step
        slope = vehicle.actuator_rates(x, aside)[levels] - rates
        command[places] -= np.where(step == 0.0, 0.0, rates * step / np.where(step, slope, 1.0))
    return command, x


def _ends(limits: tuple[float | None, float | None] | None) -> tuple[float, float]:
    low, high = limits or (None, None)
    return -math.inf if low is None else low, math.inf if high is None else high
