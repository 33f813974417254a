"""Time derivatives in C against peers in one run: `python benchmarks/derivative_times.py`.

Timed are inverse dynamics with its derivatives by q and v and the mass matrix, and forward dynamics
with its derivatives by q, v and u, on attitude angles and on a quaternion, in the rounds of
`c_times.py`. Peers are Pinocchio's `computeRNEADerivatives` and `computeABADerivatives` in C++, and
compiled C of CasADi's algorithmic differentiation in SX, both with derivatives by generalised
forces in place of u. For the free-flyer, Pinocchio's best, the states are converted beforehand,
and its derivatives are by the free-flyer's velocities. Before any tool is timed, all that it gives
must agree to 1e-9 with Pinocchio's Python module in the tool's coordinates. From ten joints on
there is no CasADi C of forward dynamics' derivatives, nor any for eight states at once, since gcc
would take too long. GRiD is not in the package index. CppADCodeGen is (`cmeel-cppadcodegen`), but
no peer is made with it: tracing Pinocchio's derivatives takes g++ over 3 GB and several minutes.

`--links 3 7` limits the machines; `--attitude xyz` the roots; `--robots` takes other machines, as
for `c_times.py`; `--picture FILE` draws the times; `--folder DIR` keeps what is built, since
Pinocchio takes minutes to compile.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
from pathlib import Path

from rich.console import Console
from rich.table import Table

sys.path[:0] = [
    str(Path(__file__).parent),
    str(Path(__file__).parents[1]),
    str(Path(__file__).parents[1] / "tests"),
]

from c_times import Times, draw, in_rounds, machine, print_tables  # noqa: E402
from family import benchmark_robot, named_robot  # noqa: E402
from operation_counts import derivative_counts  # noqa: E402
from our_derivatives import NAMES, compile_seconds, our_derivatives  # noqa: E402
from peers.casadi_derivatives import casadi_derivatives  # noqa: E402
from peers.derivatives import DERIVATIVE_TASKS  # noqa: E402
from peers.peers import CHECKED_STATES, STATES, agreement, random_states  # noqa: E402
from peers.pinocchio_derivatives import pinocchio_derivatives  # noqa: E402
from peers.timing import Timer, timer  # noqa: E402

from gibbs_codegen.robot.model import Robot  # noqa: E402

ATTITUDES = ("xyz", "quaternion")


def times(name: str, robot: Robot, folder: Path, time_calls: Timer, console: Console) -> Times:
    """Nanoseconds per state of every contender in every round, for one machine."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    with console.status(f"{name}: building and checking"):
        makers = (pinocchio_derivatives, casadi_derivatives, our_derivatives)
        found = [contender for make in makers for contender in make(robot, folder)]
        states = random_states(robot, CHECKED_STATES, seed=1)
        worst = max(agreement(one, robot, states, one.right(states)) for one in found)
        console.print(f"{name}: {len(found)} contenders agree to {worst:.0e}")
    with console.status(f"{name}: timing"):
        return in_rounds(found, random_states(robot, STATES), time_calls)


def print_sizes(robots: dict[str, Robot], folder: Path, console: Console) -> None:
    """Operations of our functions, sine–cosine pairs apart, and what gcc takes for both."""
    table = Table(title="Operations of ours, and seconds of gcc -O3 for both functions")
    for column in ("robot", *DERIVATIVE_TASKS, "gcc, s"):
        table.add_column(column, justify="right")
    for name, robot in robots.items():
        counted = derivative_counts(robot, *NAMES.values())
        totals = [str(counted[called].total) for called in NAMES.values()]
        table.add_row(name, *totals, f"{compile_seconds(robot, folder):.1f}")
    console.print(table)


def main() -> None:
    """Build, check, time, print; draw if asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--links", type=int, nargs="+", default=[3, 7, 30])
    parser.add_argument("--attitude", nargs="+", choices=ATTITUDES, default=ATTITUDES)
    parser.add_argument("--robots", nargs="+", metavar="ROBOT")
    parser.add_argument("--picture", metavar="FILE")
    parser.add_argument("--folder", metavar="DIR")
    options = parser.parse_args()
    console = Console(width=None if sys.stdout.isatty() else 180, highlight=False)
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    robots = {
        f"n = {links}, {attitude}": benchmark_robot(links, attitude=attitude)
        for attitude in options.attitude
        for links in options.links
    }
    if options.robots:
        robots = {robot.name: robot for robot in map(named_robot, options.robots)}
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(options.folder or temporary)
        folder.mkdir(exist_ok=True)
        time_calls = timer(folder)
        measured = {
            name: times(name, robot, folder / name.replace(" ", ""), time_calls, console)
            for name, robot in robots.items()
        }
        console.print(machine())
        print_tables(measured, console, DERIVATIVE_TASKS)
        if options.picture:
            draw(measured, options.picture, DERIVATIVE_TASKS)
        print_sizes(robots, folder, console)


if __name__ == "__main__":
    main()
