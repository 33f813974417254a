"""Decisions of ten steps that environments take in a second of one processor, the best of three.

python benchmarks/environment_times.py [ROBOT ...]
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np

from gibbs_codegen import load
from gibbs_codegen.flight.rollouts.vector_env import VectorEnv
from gibbs_codegen.machine.inner_loop import ACTIONS

ROBOTS = "quadrotor", "quadrotor_arm_2link"
COUNT, DECISIONS, REPEATS = 4096, 20, 3
# Steps at their fastest, and as by default.
SETTINGS: dict[str, dict[str, Any]] = {
    "euler, single": {"method": "euler", "precision": "single"},
    "rk4, double": {},
}


def rate(robot: str, action: str, settings: dict[str, Any]) -> float:
    """Decisions a second."""
    made = VectorEnv(
        *(load(robot, "c"), COUNT),
        action=action,
        time_constants=0.03,
        limits=None if robot != "quadrotor" else (0.0, 8.0),
        normalised=False,
        terminated=lambda now: np.zeros(len(now.q), dtype=bool),
        **settings,
    )
    made.reset(seed=0)
    actions, least = np.zeros((COUNT, len(made.actions))), np.inf
    for _ in range(REPEATS):
        begin = time.process_time()
        for _ in range(DECISIONS):
            made.step(actions)
        least = min(least, time.process_time() - begin)
        made.reset()
    return COUNT * DECISIONS / least


def main() -> None:
    """Print a table for each robot."""
    for robot in sys.argv[1:] or ROBOTS:
        tip = "tip" in load(robot, "c").FRAMES
        print(f"{robot}, 1000 decisions a second: {', '.join(SETTINGS)}")
        for action in ("inputs", *ACTIONS):
            if action != "tip" or tip:
                found = [rate(robot, action, settings) / 1e3 for settings in SETTINGS.values()]
                print(f"  {action:9}", *(f"{x:8.0f}" for x in found))


if __name__ == "__main__":
    main()
