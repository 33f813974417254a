"""The closed loop: a controller at work on the robot's own module, in finer steps."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from gibbs_codegen.analysis.given import numbers
from gibbs_codegen.errors import UsageError
from gibbs_codegen.examples.controller import Controller, Solution, SolverStuckError
from gibbs_codegen.simulator.plant.vehicle import Array

# Steps of the plant in a step of the controller, and how much of its fastest decay one covers: a
# Runge–Kutta method of fourth order is stable up to 2.7.
_FEWEST_STEPS, _DECAY = 20, 1.0


@dataclass(frozen=True)
class TrackedPath:
    """What was flown, a row for each step of the controller.

    - `time` (s): ends of the steps, s
    - `point`, `wanted` (s, 3): where the point was then, and was to be, m, world axes
    - `q` (s, nq), `v` (s, nv): states then; `u` (s, nu): inputs during the step, N and N m
    - `ended`: why the flight ended before its time, in words, or None
    """

    time: Array
    point: Array
    wanted: Array
    q: Array
    v: Array
    u: Array
    solutions: tuple[Solution, ...]
    ended: str | None

    @property
    def error(self) -> Array:
        """Distance of the point from its path (s), m."""
        return np.asarray(np.linalg.norm(self.point - self.wanted, axis=-1))


def fly(plant: ModuleType, controller: Controller, duration: float) -> TrackedPath:
    """Fly a controller's task, until its time is over or the robot is lost.

    It is lost where its point is further from the circle than that is wide, or the solver is stuck.
    `plant` is the robot's module, with `step_rk4`. Raises `UsageError` if the flight is shorter
    than a step, and `SolverStuckError` if the solver is stuck at the first one.
    """
    task, h = controller.task, controller.h
    q, v, place = task.q, task.v, plant.FRAMES.index(task.frame)
    steps = _steps(plant, (q, v), h)
    rows: list[tuple[Any, ...]] = []
    ended = None
    for k in range(control_steps(duration, h)):
        try:
            u = controller.inputs(k * h, q, v)
        except SolverStuckError as error:
            if not rows:
                raise
            ended = str(error)
            break
        for _ in range(steps):
            q, v = plant.step_rk4(q, v, u, h / steps)
        now, point = (k + 1) * h, plant.frame_poses(q)[place, :3, 3]
        rows.append((now, point, q, v, u))
        # Comparisons with what is no number are false.
        if not np.linalg.norm(point - task.path(np.asarray(now))) <= task.path.radius:
            ended = f"after {now:.2f} s the point is off its path by more than the circle's radius"
            break
    time, point, qs, vs, us = (np.array(column) for column in zip(*rows, strict=True))
    solutions = tuple(controller.solutions[-len(rows) :])
    return TrackedPath(time, point, task.path(time), qs, vs, us, solutions, ended)


def control_steps(duration: float, h: float) -> int:
    """How many steps of `h`, s, a flight has. Raises `UsageError` if there is none."""
    wanted = f"at least one step of the controller, {h:g} s, and finite"
    steps = round(float(numbers("duration of the flight", duration, wanted, ())) / h)
    if steps < 1:
        raise UsageError(f"duration of the flight: must be {wanted}, not {duration:g} s")
    return steps


def _steps(plant: ModuleType, start: tuple[Array, Array], h: float) -> int:
    """How many steps of the plant a step of the controller takes, so that they are stable."""
    q, v = start
    u = np.zeros(len(plant.INPUTS))
    turned = plant.forward_dynamics(q, v + np.eye(len(v)), u)
    rates = np.linalg.eigvals(turned - plant.forward_dynamics(q, v, u))
    fastest = float(np.abs(rates).max())
    return max(_FEWEST_STEPS, math.ceil(h * fastest / _DECAY))
