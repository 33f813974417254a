"""Time what people wait for, as whole processes: `python benchmarks/waiting_times.py`.

The robot and the flight are those of docs/start/first-robot.md. Rounds go through all rows in turn,
so that a slow moment of the machine hits all alike; rows are medians over the rounds, and ratios
are to the imports of NumPy, SciPy and Matplotlib in the same round. What is first has an empty
cache of compiled libraries. `--beside` runs the same commands of another checkout in turn with
these. `--scenarios` times flights of the robots that ship instead, under every scenario that ships
and that they can fly. `--page` writes the table to benchmarks/waiting_times.md.
"""

from __future__ import annotations

import argparse
import ctypes
import importlib.util
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import NamedTuple

sys.path[:0] = [str(Path(__file__).parent)]

from family import benchmark_robot  # noqa: E402

from gibbs_codegen.flight.scenario.file import shipped_scenarios  # noqa: E402
from gibbs_codegen.robot.file import shipped_robots  # noqa: E402
from gibbs_codegen.robot.text import robot_text  # noqa: E402

ROOT = Path(__file__).parents[1]
PAGE = Path(__file__).with_suffix(".md")
# What stands for the interpreter of a checkout in commands.
PYTHON = "python"
COMMAND = [PYTHON, "-m", "gibbs_codegen"]
# PR_SET_CHILD_SUBREAPER of Linux.
_SUBREAPER = 36
IMPORTS = "imports of NumPy, SciPy and Matplotlib"
# The flight's duration in steps of 1 ms, with the series that a flight is looked at by.
MUJOCO = """
import mujoco, numpy as np
model = mujoco.MjModel.from_xml_path("camera_drone.xml")
model.opt.timestep, model.opt.integrator = 1e-3, mujoco.mjtIntegrator.mjINT_RK4
data = mujoco.MjData(model)
steps = 6000
q, v, u = (np.empty((steps, n)) for n in (model.nq, model.nv, model.nu))
for step in range(steps):
    data.ctrl[:4] = 4.782
    mujoco.mj_step(model, data)
    q[step], v[step], u[step] = data.qpos, data.qvel, data.ctrl
np.savez("mujoco.npz", q=q, v=v, u=u)
"""
# As its documentation flies one.
ROTORPY = """
from rotorpy.controllers.quadrotor_control import SE3Control
from rotorpy.environments import Environment
from rotorpy.trajectories.hover_traj import HoverTraj
from rotorpy.vehicles.hummingbird_params import quad_params
from rotorpy.vehicles.multirotor import Multirotor
Environment(Multirotor(quad_params), SE3Control(quad_params), HoverTraj()).run(t_final=6)
"""
# 10 s under a stand-in for ArduPilot, in steps of 4 ms.
SITL = f"""
import subprocess, sys
stand_in = ["{ROOT}/tests/support/autopilot.py", "ardupilot", "9002", "2500"]
flight = ["-m", "gibbs_codegen", "sitl", "quadrotor_arm_2link", "--ardupilot", "--speed", "0"]
flight += ["--set", "duration=10", "--no-figures", "--out", "sitl"]
with subprocess.Popen([sys.executable, *flight], stdout=subprocess.PIPE, text=True) as flown:
    while (line := flown.stdout.readline()) and not line.startswith("waiting"):
        pass
    subprocess.run([sys.executable, *stand_in], check=True)
    print(flown.stdout.read())
sys.exit(flown.returncode)
"""


class Times(NamedTuple):
    """Seconds that a process takes, and those of processors that it and its children use.

    `pace` is how many times as fast as real time a flight under an autopilot was, 0 of others.
    """

    wall: float
    used: float
    pace: float


# Times of each round, by names of rows.
Measured = dict[str, list[Times]]


@dataclass(frozen=True)
class Row:
    """What is waited for, its command, and whether the cache is empty before it.

    A robot and a scenario are those of a flight that may be refused.
    """

    name: str
    command: Sequence[str]
    first: bool = False
    robot: str = ""
    scenario: str = ""


@dataclass(frozen=True)
class Checkout:
    """The interpreter of a checkout, and a folder in which its commands run."""

    python: str
    folder: Path

    def prepare(self) -> None:
        """Write the files that rows read."""
        self.folder.mkdir()
        text = (ROOT / "docs" / "start" / "first-robot.md").read_text(encoding="utf-8")
        blocks = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
        for name, block in zip(("camera_drone.toml", "look.toml"), blocks, strict=False):
            (self.folder / name).write_text(block, encoding="utf-8")
        robot = robot_text(benchmark_robot(30))
        (self.folder / "benchmark_30.toml").write_text(robot, encoding="utf-8")
        for words in (
            ["generate", "camera_drone.toml"],
            ["export", "camera_drone.toml", "--format", "mjcf", "--out", "camera_drone.xml"],
        ):
            command = [self.python, *COMMAND[1:], *words]
            subprocess.run(command, cwd=self.folder, check=True, stdout=subprocess.DEVNULL)

    def timed(self, row: Row, number: int) -> Times | None:
        """The times of a row in a round; None of a flight that is refused."""
        own = row.name if row.first else ""
        cache = f"cache_{number}_{row.robot}_{row.scenario or own}" if row.robot or own else "cache"
        # Python keeps what it compiles, as it does for users.
        environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": ""}
        environment["XDG_CACHE_HOME"] = str(self.folder / cache)
        command = [self.python if word == PYTHON else word for word in row.command]
        before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        done = subprocess.run(
            command, cwd=self.folder, env=environment, capture_output=True, text=True
        )
        wall = time.perf_counter() - begin
        with suppress(ChildProcessError):  # Processes that it has started end after it.
            while os.wait():
                pass
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode and row.robot:
            return None
        if done.returncode:
            raise SystemExit(f"{row.name}: {done.stderr}")
        used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        pace = re.search(r"([\d.]+) times real time", done.stdout)
        return Times(wall, used, float(pace[1]) if pace else 0.0)


def rows() -> list[Row]:
    """All rows, in the order in which they need each other's files."""
    fly = [*COMMAND, "simulate", "camera_drone", "--scenario", "look.toml", "--out", "flight"]
    robot = [*COMMAND, "generate"]
    verify = [*COMMAND, "verify", "camera_drone"]
    listed = [
        Row(IMPORTS, [sys.executable, "-c", "import numpy, scipy.integrate, matplotlib.pyplot"]),
        Row("import of SymPy", [sys.executable, "-c", "import sympy"]),
        Row("`--help`", [*COMMAND, "--help"]),
        Row("`info camera_drone.toml`", [*COMMAND, "info", "camera_drone.toml"]),
        Row("`generate camera_drone.toml`", [*robot, "camera_drone.toml"]),
        Row("`generate hexarotor_3link`", [*robot, "hexarotor_3link"]),
        Row("`generate`, 30 joints", [*robot, "benchmark_30.toml"]),
        Row("`generate`, 40 rotors", [*robot, "--rotors", "40", "--links", "3"]),
        Row("`verify camera_drone`, first", verify, first=True),
        Row("`verify camera_drone`, again", verify),
        Row("`simulate camera_drone`, first", fly, first=True),
        Row("`simulate camera_drone`, again", fly),
        Row("`simulate … --no-figures`", [*fly, "--no-figures"]),
    ]
    listed.append(Row("`sitl`, 10 s in steps of 4 ms", [PYTHON, "-c", SITL]))
    if importlib.util.find_spec("viser"):
        view = [*COMMAND, "view", "--html", "view.html", "camera_drone"]
        listed.append(Row("`view --html camera_drone`", view))
    if importlib.util.find_spec("mujoco"):
        row = Row("MuJoCo, a loop in Python over `mj_step`", [sys.executable, "-c", MUJOCO])
        listed.append(row)
    if importlib.util.find_spec("rotorpy"):
        row = Row("RotorPy, a quadrotor without an arm", [sys.executable, "-c", ROTORPY])
        listed.append(row)
    return listed


def flights() -> list[Row]:
    """The first and the second flight of each robot under each scenario."""
    return [
        Row(f"{robot} {scenario}, {word}", command, word == "first", robot, scenario)
        for robot in shipped_robots()
        for scenario in shipped_scenarios()
        for command in [[*COMMAND, "simulate", robot, "--scenario", scenario, "--no-figures"]]
        for word in ("first", "again")
    ]


def measured(chosen: Sequence[Row], checkouts: Sequence[Checkout], rounds: int) -> list[Measured]:
    """Times of rows, by their names, of each checkout; without flights that are refused."""
    times: list[Measured] = [{} for _ in checkouts]
    for row in chosen:  # Not counted: what is compiled and read once.
        for checkout in checkouts:
            if not (row.first or row.robot):
                checkout.timed(row, 0)
    for number in range(rounds):
        for row in chosen:
            for checkout, of in zip(checkouts, times, strict=True):
                # What is no command of ours is the same in all.
                if checkout is checkouts[0] or PYTHON in row.command:
                    taken = checkout.timed(row, number)
                    if taken is not None:
                        of.setdefault(row.name, []).append(taken)
    return times


def table(names: Sequence[str], times: Sequence[Measured]) -> str:
    """The table of medians, as Markdown; ratios are of seconds of processors."""
    heads = ["what you wait for", "s", "s of processors", "times the imports"]
    heads += ["s of processors before"] * (len(times) - 1)
    lines = [heads, ["---", *["---:"] * (len(heads) - 1)]]
    for name in names:
        walls, used, paces = zip(*times[0][name], strict=True)
        ratios = [a / b.used for a, b in zip(used, times[0][IMPORTS], strict=True)]
        pace = f", {median(paces):.3g} times as fast as real time" if any(paces) else ""
        cells = [name + pace, *(f"{median(values):.2f}" for values in (walls, used, ratios))]
        for before in times[1:]:
            cells.append(f"{median(t.used for t in before[name]):.2f}" if name in before else "")
        lines.append(cells)
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def table_of_flights(times: Sequence[Measured]) -> str:
    """Seconds of processors of the first flight and the next; in brackets those of before."""
    lines = [["robot", *shipped_scenarios()], ["---", *["---:"] * len(shipped_scenarios())]]
    for robot in shipped_robots():
        cells = [f"`{robot}`"]
        for scenario in shipped_scenarios():
            names = [f"{robot} {scenario}, {word}" for word in ("first", "again")]
            pairs = [[median(t.used for t in of[n]) for n in names if n in of] for of in times]
            words = [" / ".join(f"{value:.1f}" for value in pair) for pair in pairs]
            before = f" ({words[1]})" if words[1:] and words[1] else ""
            cells.append(f"{words[0]}{before}" or "–")
        if {*cells[1:]} != {"–"}:  # Rows that were asked for.
            lines.append(cells)
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def write(name: str, text: str) -> None:
    """Put a table into its place on the page."""
    begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->\n"
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(begin)
    after = rest.partition(end)[2]
    PAGE.write_text(f"{before}{begin}{text}{end}{after}", encoding="utf-8")


def main() -> None:
    """Print the tables, or write them to their page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--rows", nargs="+", help="words of names of rows; default: all rows")
    parser.add_argument("--scenarios", action="store_true", help="robots and scenarios that ship")
    parser.add_argument("--beside", type=Path, help="another checkout, with a .venv")
    parser.add_argument("--page", action="store_true", help=f"write {PAGE.relative_to(ROOT)}")
    options = parser.parse_args()
    # Processes whose parents have ended are children of this one, so that their times count.
    ctypes.CDLL(None).prctl(_SUBREAPER, 1, 0, 0, 0)
    pythons = [sys.executable]
    if options.beside:
        pythons.append(str(options.beside.absolute() / ".venv" / "bin" / "python"))
    words = options.rows or [""]
    chosen = [
        row
        for row in (flights() if options.scenarios else rows())
        if row.name == IMPORTS or any(word in row.name for word in words)
    ]
    with tempfile.TemporaryDirectory() as name:
        checkouts = [Checkout(python, Path(name) / str(k)) for k, python in enumerate(pythons)]
        for checkout in checkouts:
            checkout.prepare()
        times = measured(chosen, checkouts, options.rounds)
    place = "flights" if options.scenarios else "measured"
    text = table_of_flights(times) if options.scenarios else table([*times[0]], times)
    if options.page:
        write(place, text)
    else:
        print(text, end="")


if __name__ == "__main__":
    main()
