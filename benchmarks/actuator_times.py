"""Time rollouts of motors, servos and a battery: `python benchmarks/actuator_times.py`.

The robot is that of docs/howto/actuators.md, in air. Beside it stands the same machine with thrusts
that lag and torques of joints; in between the one on whose rotors no air acts; and one whose rotors
lose another force along their axes than across, so that it matters how they are turned. Rows are
timed and printed as those of `rollout_times.py`.
"""

from __future__ import annotations

import re
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "tests")]

from c_times import machine  # noqa: E402
from our_rollouts import STATES, STEP, STEPS, Measure  # noqa: E402
from rollout_times import Row, print_rows, timed  # noqa: E402

from gibbs_codegen import Feedback, load, rollout, trim  # noqa: E402
from gibbs_codegen.pipeline import generate_robot  # noqa: E402
from gibbs_codegen.robot.file import parse_robot  # noqa: E402
from gibbs_codegen.robot.model import Robot  # noqa: E402
from gibbs_codegen.robot.parts.rotor import Rotor  # noqa: E402
from gibbs_codegen.robot.text import robot_text  # noqa: E402

ROOT = Path(__file__).parents[1]
LAG = 0.03  # s
LAGGING, WITHOUT_AIR, WHOLE = "thrusts that lag", "actuators, without air", "actuators"
UNLIKE = "actuators, with another inflow than hub drag"


def robots() -> dict[str, Robot]:
    """The machine with thrusts that lag, with actuators without air, and with air of two kinds."""
    page = (ROOT / "docs" / "howto" / "actuators.md").read_text(encoding="utf-8")
    calm = parse_robot(re.findall(r"```toml\n(.*?)```", page, re.DOTALL)[0])

    def in_air(inflow: float) -> Robot:
        rotors = (replace(each, hub_drag=1e-4, inflow=inflow) for each in calm.thrusters)
        return replace(calm, thrusters=tuple(rotors))

    lagging = replace(
        calm,
        thrusters=tuple(
            Rotor(
                on=each.on,
                name=each.name,
                position=each.position,
                direction=each.direction,
                drag=each.drag,
                limits=each.drive.thrust_limits,
                time_constant=each.time_constant,
            )
            for each in calm.thrusters
        ),
        links=tuple(replace(link, servo=None, friction=None) for link in calm.links),
        battery=None,
    )
    return {LAGGING: lagging, WITHOUT_AIR: calm, WHOLE: in_air(1e-4), UNLIKE: in_air(2e-4)}


def measure(module: ModuleType, method: str) -> Measure:
    """What times rollouts about hover, with feedback of the whole state and limits."""
    hover = trim(module)
    rng = np.random.default_rng(18)
    q = module.integrate(hover.q, 0.01 * rng.standard_normal((STATES, len(hover.v))))
    options: dict[str, Any] = {"method": method, "threads": 1, "every": STEPS}
    u = hover.u
    if hover.command is None:
        options |= {"limits": hover.limits, "time_constants": LAG}
    else:
        u, options = hover.command, options | {"x0": hover.x}
    width = 2 * len(hover.v) + len(hover.x if hover.x is not None else ())
    law = Feedback(np.full((len(u), width), 1e-9), hover.q, hover.v, u, hover.x)

    def seconds() -> float:
        begin = time.perf_counter()
        found = rollout(module, q, np.zeros_like(hover.v), law, STEPS, STEP, **options)
        passed = time.perf_counter() - begin
        if np.any(found.ended):
            raise RuntimeError(f"{module.NAME}: {np.count_nonzero(found.ended)} states ended")
        return passed / (STATES * STEPS)

    return seconds


def main() -> None:
    """Build, time, print."""
    with tempfile.TemporaryDirectory() as folder:
        rows = []
        modules = {}
        for name, robot in robots().items():
            own = replace(robot, name=f"machine_{len(modules)}")
            modules[name] = load(generate_robot(own, robot_text(own), Path(folder))[1], "c")
        for method, words in (("euler", "Euler"), ("rk4", "RK4")):
            for name, module in modules.items():
                against = "" if name == LAGGING else f"{words}, {LAGGING}"
                times = {"courier": measure(module, method)}
                rows.append(Row(f"{words}, {name}", times, against))
        print(machine())
        print_rows(rows, timed(rows), ["courier"])


if __name__ == "__main__":
    main()
