"""Surroundings of the states of a rollout: walls, and the wind, payloads and push of a scenario."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from types import ModuleType
from typing import Any

import numpy as np

from gibbs_codegen.arrays import Program, variable
from gibbs_codegen.arrays.evaluation import Evaluator
from gibbs_codegen.arrays.nodes import zeros
from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.integration.envelope import drag_modes, wall_modes
from gibbs_codegen.flight.plant.environment import Environment, surrounding
from gibbs_codegen.flight.plant.vehicle import Array, Flags, Vehicle
from gibbs_codegen.flight.rollouts.arguments import RolloutArguments
from gibbs_codegen.flight.scenario.file import AnyScenario
from gibbs_codegen.flight.scenario.walls import Wall
from gibbs_codegen.machine.machine import NO_SURROUNDINGS, Surroundings
from gibbs_codegen.machine.surroundings import wind_velocity
from gibbs_codegen.runtime.load import load
from gibbs_codegen.runtime.rollouts import Method


@dataclass(frozen=True)
class RolloutSurroundings:
    """Forces on the states, and their figures, which are in the program of a step.

    Those of an environment of which `at` tells are arrays: `wind` (1 or n, 3), m/s, is steady,
    and `masses` (1 or n, p), kg, are of payloads.
    """

    around: Surroundings = NO_SURROUNDINGS
    figures: tuple[tuple[str, tuple[float, ...]], ...] = ()
    walls: tuple[Wall, ...] = ()
    environment: Environment | None = None
    wind: Any = None
    masses: Any = None

    def at(self, begin: Array, steps: int, dt: float) -> dict[str, Any]:
        """Inputs (1 or n, 1 or steps, …) of so many steps of dt s from times (1 or n), s, on.

        A push or payload acts in a step if it does in the middle of it.
        """
        environment, loads = self.environment, dict[str, Any]()
        if environment is None:
            return loads
        times = begin[:, np.newaxis] + dt * np.arange(steps)
        middle = times + 0.5 * dt
        if environment.wind is not None:
            loads["drag"] = environment.figures["drag"][np.newaxis, np.newaxis]
            loads["wind"] = self.wind[:, np.newaxis]
        if self.around.gusts:
            stages = times[..., np.newaxis] + dt * np.array([0, 0.5, 1])
            loads["gusts"] = _gusts(environment.figures["gusts"], stages)
        if environment.payload:
            carried = _shortest(environment.carries(middle))
            loads["payloads"] = self.masses[:, np.newaxis] * carried
        if environment.push is not None:
            acts = _shortest(environment.push_acts(middle)[..., np.newaxis, np.newaxis])
            loads["wrenches"] = acts * environment.pushing
        return loads


def _gusts(gusts: Array, times: Array) -> Array:
    """Velocities (…, 3) of gusts (g, 5) at times (1 or n, steps, 3), s."""
    blown: Array = _wind(len(gusts))({"time": times, "gusts": gusts})["wind"]
    return blown


@lru_cache
def _wind(count: int) -> Evaluator:
    """The evaluator of the velocity of a number of gusts."""
    time, gusts = variable("time"), variable("gusts", count, 5, uniform=True)
    outputs = {"wind": wind_velocity(time, zeros(3), gusts)}
    return Evaluator(Program("gusts", (time, gusts), outputs), {})


def _shortest(x: Flags) -> Flags:
    """Values (1 or n, steps, …) of one step where all steps have the same."""
    return x[:, :1] if np.array_equal(x, np.broadcast_to(x[:, :1], x.shape)) else x


def rollout_surroundings(
    arguments: RolloutArguments,
    walls: Sequence[Wall],
    scenario: AnyScenario | None,
    figures: tuple[Any, Any],
    states: tuple[Any, Mapping[str, Any]],
    steps: tuple[float, Method],
) -> RolloutSurroundings:
    """Surroundings of states with coordinates (n, nq) and parameters, numbers or arrays.

    `figures` are the wind and payloads' masses in the place of those of the scenario. Raises
    `UsageError` for what are no walls, for what does not fit the robot, and for steps (dt, method)
    that are too long for a wall.
    """
    module, (q, parameters), (dt, method) = arguments.module, states, steps
    if not (isinstance(walls, list | tuple) and all(isinstance(member, Wall) for member in walls)):
        raise UsageError("walls: must be walls as read_scenario(…).walls has them")
    if scenario is None:
        for name, value in zip(("wind", "payloads"), figures, strict=True):
            if value is not None:
                raise UsageError(f"{name}: replaces that of `surroundings`; give these too")
        if not walls:
            return RolloutSurroundings()
    vehicle = with_parameters(module, {})
    surroundings = surrounding(vehicle, scenario)
    if surroundings is not None and surroundings.hold:
        raise UsageError(
            "surroundings: rollouts do not support holds; leave them out, and name constraints "
            "in `constraints`"
        )
    environment = (surroundings or Environment(vehicle)).with_walls(walls)
    _check_steps(environment, q, parameters, dt, method)
    frames = tuple(vehicle.frames.index(payload.frame) for payload in environment.payload)
    fixed = tuple(
        (name, tuple(np.ravel(x).tolist()))
        for name, x in environment.figures.items()
        if name.startswith("wall_") or name == "spins"
    )
    wind, masses = figures
    if environment.wind is None and wind is not None:
        raise UsageError("wind: the surroundings have no [wind]; add it there")
    if environment.wind is not None:
        steady = environment.figures["wind"] if wind is None else wind
        wind = arguments.states("wind", steady, 3)
    if masses is not None and not frames:
        raise UsageError("payloads: the surroundings have no [[payload]]; add it there")
    if frames and "gravity" in parameters and 2 not in vehicle.layout.own_axes[0]:
        raise UsageError(
            f"{vehicle.name}: the base does not rise, so payloads use the gravity of the robot "
            "file; leave out parameters.gravity or the payloads"
        )
    if frames:
        usual = [payload.mass for payload in environment.payload]
        masses = arguments.masses("payloads", usual if masses is None else masses, len(frames))
    around = replace(environment.around, payloads=frames)
    return RolloutSurroundings(around, fixed, environment.wall, surroundings, wind, masses)


def _check_steps(
    environment: Environment, q: Any, parameters: Mapping[str, Any], dt: float, method: Method
) -> None:
    """Raise `UsageError` for frames that there are not, and steps too long for walls or drag."""
    vehicle, walls = environment.vehicle, environment.wall
    for k, wall in enumerate(walls, start=1):
        for frame in wall.frames:
            vehicle.frame_place(frame, f"walls: wall {k}: frame")
    try:
        places = np.asarray(q, dtype=np.float64)
        vehicle = with_parameters(vehicle.module, parameters)
    except TypeError:  # What is traced by JAX has no values.
        places = vehicle.neutral[np.newaxis]
    modes = wall_modes(vehicle, walls, places) if walls else []
    if environment.wind is not None:
        modes += drag_modes(vehicle, environment.figures["drag"], places)
    for mode in sorted(modes, reverse=True):
        if words := mode.fault(dt, method):
            raise UsageError(f"dt: {words}")


def with_parameters(module: ModuleType, parameters: Mapping[str, Any]) -> Vehicle:
    """The robots, on NumPy's arrays, with parameters, numbers or arrays (n) that are known."""
    values = {name: np.squeeze(np.asarray(value)) for name, value in parameters.items()}
    return Vehicle(on_arrays(module), values)


def on_arrays(module: ModuleType) -> ModuleType:
    """A module that works on arrays of NumPy."""
    return load(module.__path__[0]) if getattr(module, "backend", "") == "jax" else module
