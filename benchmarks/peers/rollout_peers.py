"""Peers of `rollout_times.py`: MuJoCo's `rollout`, and crazyflow in an environment of its own."""

from __future__ import annotations

import subprocess
import time
from pathlib import Path
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np
from our_rollouts import STEP, Machine, Measure
from peers.mujoco_peer import model_text
from peers.tree import tree_of

from gibbs_codegen.flight.rollouts.rollout import rollout

STATES, STEPS = 64, 100
CHECKED_STATES, CHECKED_STEPS, TOLERANCE = 8, 100, 1e-9
INTEGRATORS = {
    "euler": mujoco.mjtIntegrator.mjINT_EULER,
    "rk4": mujoco.mjtIntegrator.mjINT_RK4,
}

Array = np.ndarray


class MuJoCo:
    """A machine in MuJoCo, from the same states; raises `AssertionError` if it moves otherwise."""

    def __init__(self, ours: Machine, method: str) -> None:
        tree = tree_of(ours.robot)
        self.model = mujoco.MjModel.from_xml_string(model_text(tree))
        self.model.opt.timestep, self.model.opt.integrator = STEP, INTEGRATORS[method]
        self.order = list(tree.layout.order)
        self.rollouts = {n: mujoco.rollout.Rollout(nthread=n if n > 1 else 0) for n in (1, 2)}
        self.check(ours, method)
        self.start = self.whole(ours.q[:STATES], ours.v[:STATES])

    def whole(self, q: Array, v: Array) -> Array:
        """States (n, …) as MuJoCo has them: time, coordinates and velocities."""
        return np.concatenate([np.zeros((len(q), 1)), q[:, self.order], v[:, self.order]], axis=1)

    def states(self, start: Array, steps: int, threads: int = 1) -> Array:
        """States after each step, (n, steps, …)."""
        datas = [mujoco.MjData(self.model) for _ in range(threads)]
        return self.rollouts[threads].rollout(self.model, datas, start, nstep=steps)[0]

    def seconds(self, threads: int = 1) -> float:
        """Time of a step of one state, s."""
        begin = time.perf_counter()
        self.states(self.start, STEPS, threads)
        return (time.perf_counter() - begin) / (STATES * STEPS)

    def check(self, ours: Machine, method: str) -> None:
        """Raise `AssertionError` if states after some steps are not ours."""
        q, v = ours.q[:CHECKED_STATES], ours.v[:CHECKED_STATES] + 0.1
        options: Any = {"method": method, "every": CHECKED_STEPS}
        found = rollout(ours.module, q, v, np.zeros(ours.nu), CHECKED_STEPS, STEP, **options)
        theirs = self.states(self.whole(q, v), CHECKED_STEPS)[:, -1, 1:]
        worst = float(np.abs(self.whole(found.q[:, -1], found.v[:, -1])[:, 1:] - theirs).max())
        if not worst < TOLERANCE:
            raise AssertionError(f"{ours.robot.name}, {method}: MuJoCo's states are {worst} off")


class Crazyflow:
    """crazyflow in a process of another environment, which times steps when it is asked."""

    def __init__(self, python: str) -> None:
        command = [python, str(Path(__file__).parent / "crazyflow_peer.py")]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(
            command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, text=True
        )

    def steps(self, integrator: str) -> Measure:
        """What times steps of one world."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        told, answers = self.process.stdin, self.process.stdout

        def seconds() -> float:
            print(integrator, file=told, flush=True)
            return float(answers.readline())

        return seconds
