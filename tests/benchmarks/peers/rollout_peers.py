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

from gibbs_codegen.rollouts.rollout import rollout

STATES, STEPS = 64, 100
CHECKED_STATES, CHECKED_STEPS, TOLERANCE = 8, 100, 1e-9
INTEGRATORS = {
    "euler": mujoco.mjtIntegrator.mjINT_EULER,
    "rk4": mujoco.mjtIntegrator.mjINT_RK4,
}

Array = np.ndarray


class MuJoCo:
    """The same machine in MuJoCo, from the same states."""

    def __init__(self, ours: Machine, method: str) -> None:
        tree = tree_of(ours.robot)
        self.order = list(tree.layout.order)
        self.model = mujoco.MjModel.from_xml_string(model_text(tree))
        self.model.opt.timestep, self.model.opt.integrator = STEP, INTEGRATORS[method]
        self.start = np.zeros((STATES, mujoco.mj_stateSize(self.model, self._all)))
        self.start[:, 1 : 1 + ours.nv] = ours.q[:STATES, self.order]
        self.rollouts = {n: mujoco.rollout.Rollout(nthread=n if n > 1 else 0) for n in (1, 2)}

    _all = mujoco.mjtState.mjSTATE_FULLPHYSICS

    def states(self, count: int, steps: int, threads: int = 1) -> Array:
        """States after each step, (count, steps, 1 + 2 nv): time, coordinates and velocities."""
        datas = [mujoco.MjData(self.model) for _ in range(threads)]
        return self.rollouts[threads].rollout(self.model, datas, self.start[:count], nstep=steps)[0]

    def steps(self, threads: int = 1) -> Measure:
        """What times steps of all states."""

        def seconds() -> float:
            begin = time.perf_counter()
            self.states(STATES, STEPS, threads)
            return (time.perf_counter() - begin) / (STATES * STEPS)

        return seconds

    def check(self, ours: Machine, method: str) -> None:
        """Raise `AssertionError` if states after some steps are not ours."""
        options: Any = {"method": method, "every": CHECKED_STEPS}
        state = ours.q[:CHECKED_STATES], ours.v[:CHECKED_STATES] + 0.1
        self.start[:, 1 + ours.nv :] = 0.1
        found = rollout(ours.module, *state, np.zeros(ours.nu), CHECKED_STEPS, STEP, **options)
        theirs = self.states(CHECKED_STATES, CHECKED_STEPS)[:, -1, 1:]
        mine = np.concatenate([found.q[:, -1, self.order], found.v[:, -1, self.order]], axis=1)
        worst = float(np.abs(mine - theirs).max())
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
