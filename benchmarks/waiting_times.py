"""Time what people wait for, as whole processes: `python benchmarks/waiting_times.py`.

The robot and the flight are those of docs/start/first-robot.md. Rounds go through all rows in turn,
so that a slow moment of the machine hits all alike; rows are medians over the rounds, and ratios
are to the imports of NumPy, SciPy and Matplotlib in the same round. What is first has an empty
cache of compiled libraries. `--page` writes the table to docs/explanation/waiting-times.md.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

sys.path[:0] = [str(Path(__file__).parent)]

from family import benchmark_robot  # noqa: E402

from gibbs_codegen.robot.text import robot_text  # noqa: E402

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "explanation" / "waiting-times.md"
MARKS = "<!-- measured -->\n", "<!-- end of what was measured -->\n"
ROUNDS = 5
COMMAND = [sys.executable, "-m", "gibbs_codegen"]
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


@dataclass(frozen=True)
class Row:
    """What is waited for, its command, and whether the cache is empty before it."""

    name: str
    command: Sequence[str]
    first: bool = False


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
    if importlib.util.find_spec("viser"):
        view = [*COMMAND, "view", "--html", "view.html", "camera_drone"]
        listed.append(Row("`view --html camera_drone`", view))
    if importlib.util.find_spec("mujoco"):
        row = Row("MuJoCo, a loop in Python over `mj_step`", [sys.executable, "-c", MUJOCO])
        listed.append(row)
    return listed


def prepare(folder: Path) -> None:
    """Write the files that rows read."""
    text = (ROOT / "docs" / "start" / "first-robot.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    for name, block in zip(("camera_drone.toml", "look.toml"), blocks, strict=False):
        (folder / name).write_text(block, encoding="utf-8")
    (folder / "benchmark_30.toml").write_text(robot_text(benchmark_robot(30)), encoding="utf-8")
    for words in (
        ["generate", "camera_drone.toml"],
        ["export", "camera_drone.toml", "--format", "mjcf", "--out", "camera_drone.xml"],
    ):
        subprocess.run([*COMMAND, *words], cwd=folder, check=True, stdout=subprocess.DEVNULL)


def timed(row: Row, folder: Path, number: int) -> tuple[float, float]:
    """Seconds that a process takes, and those of processors that it and its children use."""
    cache = folder / (f"cache_{number}_{row.name}" if row.first else "cache")
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache)}
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(row.command, cwd=folder, env=environment, capture_output=True, text=True)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise SystemExit(f"{row.name}: {done.stderr}")
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return wall, used


def table(names: Sequence[str], times: dict[str, list[tuple[float, float]]]) -> str:
    """The table of medians, as Markdown; ratios are of seconds of processors."""
    lines = [
        "| what you wait for | s | s of processors | times the imports |",
        "|---|---:|---:|---:|",
    ]
    for name in names:
        walls, used = zip(*times[name], strict=True)
        ratios = [a / b for a, (_, b) in zip(used, times[IMPORTS], strict=True)]
        cells = [name, *(f"{median(values):.2f}" for values in (walls, used, ratios))]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Print the table, or write it to its page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--rows", nargs="+", help="words of names of rows; default: all rows")
    parser.add_argument("--page", action="store_true", help=f"write {PAGE.relative_to(ROOT)}")
    options = parser.parse_args()
    chosen = [
        row
        for row in rows()
        if row.name == IMPORTS or any(word in row.name for word in options.rows or [""])
    ]
    times: dict[str, list[tuple[float, float]]] = {row.name: [] for row in chosen}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prepare(folder)
        for row in chosen:  # Not counted: what is compiled and read once.
            if not row.first:
                timed(row, folder, 0)
        for number in range(options.rounds):
            for row in chosen:
                times[row.name].append(timed(row, folder, number))
    text = table([*times], times)
    if not options.page:
        print(text, end="")
        return
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(MARKS[0])
    after = rest.partition(MARKS[1])[2]
    PAGE.write_text(f"{before}{MARKS[0]}{text}{MARKS[1]}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
