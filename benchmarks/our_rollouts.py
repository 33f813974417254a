"""What `rollout_times.py` times of ours: rollouts, also on a GPU, closed loops, environments."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gibbs_codegen.flight.integration.compiled_loop import steps_of
from gibbs_codegen.flight.integration.state_history import NOTHING
from gibbs_codegen.flight.rollouts.rollout import rollout
from gibbs_codegen.flight.rollouts.vector_env import VectorEnv
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.scenario import ArmTask
from gibbs_codegen.flight.scenario.walls import Plane
from gibbs_codegen.flight.simulation import flight_start
from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.runtime.blocks import Blocks
from gibbs_codegen.runtime.load import load
from gibbs_codegen.runtime.rollouts import Feedback

# Steps of so many s, states, and steps that each of them takes in a call.
STEP, STATES, STEPS = 1e-3, 1024, 500
FLOWN_STEPS = 100
DECISIONS, DECISION_STEPS = 10, 10
GPU_STATES, GPU_STEPS = 65_536, 1000
LAG = 0.02  # s

# Seconds that a step of one state takes.
Measure = Callable[[], float]


class Machine:
    """A robot, its compiled module, and states to begin with."""

    def __init__(self, robot: Robot, folder: Path) -> None:
        self.robot = robot
        _, self.made = generate_robot(robot, robot_text(robot), folder)
        self.module = load(self.made, backend="c")
        self.nu, self.nv = len(self.module.INPUTS), len(self.module.VELOCITIES)
        rng = np.random.default_rng(18)
        neutral = [float(name == "qw") for name in self.module.COORDINATES]
        away = 0.1 * rng.standard_normal((STATES, self.nv))
        self.q = self.module.integrate(np.array(neutral), away)
        self.v = np.zeros((STATES, self.nv))
        self.masses = {
            name: value * rng.uniform(0.8, 1.2, STATES)
            for name, value in self.module.PARAMETERS.items()
            if "mass" in name and "inertia" not in name
        }

    def steps(
        self, method: str, masses: bool = False, commanded: bool = False, **options: Any
    ) -> Measure:
        """What times steps of all states, with masses of their own, or with what commands them."""
        options = {"control": np.zeros(self.nu), "threads": 1, "method": method, **options}
        if masses:
            options["parameters"] = self.masses
        if commanded:
            options |= self.commanded()
        return lambda: self.seconds(STATES, STEPS, **options) / (STATES * STEPS)

    def overhead(self) -> float:
        """Share of the time of a call that does not grow with its steps.

        Calls of 100 and of 1100 RK4 steps of 1000 states follow each other.
        """
        options = {"control": np.zeros(self.nu), "threads": 1}
        short, long = (self.seconds(1000, steps, **options) for steps in (100, 1100))
        return 1.0 - 100 * (long - short) / 1000 / short

    def seconds(self, states: int, steps: int, **options: Any) -> float:
        """Time of one call, of which the last sample is kept."""
        begin = time.perf_counter()
        rollout(
            *(self.module, self.q[:states], self.v[:states]),
            **options,
            steps=steps,
            dt=STEP,
            every=steps,
        )
        return time.perf_counter() - begin

    def commanded(self) -> dict[str, Any]:
        """Linear feedback, within limits that are reached and with motors that lag."""
        gain = np.zeros((self.nu, 2 * self.nv))
        gain[:, : self.nu], gain[:, self.nv : self.nv + self.nu] = np.eye(self.nu), np.eye(self.nu)
        feedback = Feedback(gain, self.q[:1, np.newaxis], self.v[:1, np.newaxis])
        return {"control": feedback, "limits": (-0.05, 0.05), "time_constants": LAG}


def lazily(make: Callable[[], Measure]) -> Measure:
    """What times what is made when it is first asked."""
    made = functools.cache(make)
    return lambda: made()()


def environment(ours: Machine) -> Measure:
    """What times decisions of a vector environment, by the steps in them."""
    made = VectorEnv(ours.module, STATES, limits=(-5.0, 5.0), dt=STEP, steps=DECISION_STEPS)
    made.reset(seed=0)
    actions = np.zeros((STATES, ours.nu))

    def seconds() -> float:
        begin = time.perf_counter()
        for _ in range(DECISIONS):
            made.step(actions)
        return (time.perf_counter() - begin) / (DECISIONS * DECISION_STEPS * STATES)

    return seconds


def closed_loop(ours: Machine, compensation: bool, touching: bool = False) -> Measure:
    """What times flights by computed torque within limits, with motors that lag.

    While they are `touching` the tip slides on a plane with friction.
    """
    scenario = read_scenario("paper")
    if ours.nv != 9:  # The path of the tip is for the arm of the paper.
        scenario = replace(scenario, arm=ArmTask())
    motors = replace(
        scenario.motors, limits=(-1e3, 1e3), time_constant=LAG, compensation=compensation
    )
    begin = flight_start(
        ours.module, replace(scenario, motors=motors), lambda what, share: None, custom_law=False
    )
    if touching:
        tip = ours.module.frame_poses(begin.q)[ours.module.FRAMES.index("tip"), :3, 3]
        place = tuple(np.add(tip, [0.0, 0.0, 0.05]).tolist())
        # So soft that it hardly disturbs the flight.
        wall = Plane("tip", place, (0, 0, 1), 1.0, dissipation=0.5, friction=0.5)
        scenario = replace(scenario, walls=(wall,))
        begin = flight_start(
            ours.module,
            replace(scenario, motors=motors),
            lambda what, share: None,
            custom_law=False,
        )
    loop = steps_of(begin.loop, np.inf, NOTHING, STATES, Blocks.widest())
    states = np.tile(begin.loop.start(begin.q, begin.v), (STATES, 1))

    def seconds() -> float:
        start = time.perf_counter()
        taken = loop(0.0, states, STEP, FLOWN_STEPS, FLOWN_STEPS).taken
        passed = time.perf_counter() - start
        if np.any(taken != FLOWN_STEPS):
            raise RuntimeError(f"{ours.robot.name}: flights end after {taken.min()} steps")
        return passed / (STATES * FLOWN_STEPS)

    return seconds


def gpu() -> Any:
    """The GPU that JAX has, or None."""
    import jax

    try:
        return jax.devices("gpu")[0]
    except RuntimeError:
        return None


def on_gpu(ours: Machine) -> Measure:
    """What times steps by JAX on a GPU, in single precision, each state with its own masses."""
    import jax

    module, repeated = load(ours.made, backend="jax"), GPU_STATES // STATES
    with jax.default_device(gpu()):
        state = [jax.numpy.tile(each, (repeated, 1)) for each in (ours.q, ours.v)]
        masses = {name: jax.numpy.tile(each, repeated) for name, each in ours.masses.items()}

    def seconds() -> float:
        begin = time.perf_counter()
        with jax.default_device(gpu()):
            found = rollout(
                *(module, *state, np.zeros(ours.nu), GPU_STEPS, STEP),
                parameters=masses,
                every=GPU_STEPS,
            )
            jax.block_until_ready(found.q)
        return (time.perf_counter() - begin) / (GPU_STATES * GPU_STEPS)

    return seconds
