"""Time rollouts beside those of MuJoCo and crazyflow: `python benchmarks/rollout_times.py`.

What users call is timed, from arrays to arrays: steps of 1 ms of many states, on one core unless a
row says otherwise. MuJoCo's `rollout` takes the same steps of the same machine, in the same
coordinates and without contacts; both must agree to 1e-9 before any is timed. crazyflow flies
quadrotors whose rotors lag, in single precision; beside it is a quadrotor of ours, with lag and
limits. It needs an environment of its own, and its row is left out without:

    python -m venv crazyflow && crazyflow/bin/pip install crazyflow
    python benchmarks/rollout_times.py --crazyflow crazyflow/bin/python

Rounds go through all that is timed in turn, so that a slow moment of the machine hits all alike;
numbers are medians over the rounds, ratios with 10th and 90th percentiles. The tables are printed
as Markdown. `--only` takes words of which a row's name has
one, in which case what rows are compared with is timed too.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import mujoco
import numpy as np

sys.path[:0] = [
    str(Path(__file__).parent),
    str(Path(__file__).parents[1]),
    str(Path(__file__).parents[1] / "tests"),
]

from c_times import machine  # noqa: E402
from family import benchmark_robot  # noqa: E402
from our_rollouts import (  # noqa: E402
    Machine,
    Measure,
    closed_loop,
    environment,
    gpu,
    lazily,
    on_gpu,
)
from peers.rollout_peers import Crazyflow, MuJoCo  # noqa: E402

from gibbs_codegen.robot.file import read_robot  # noqa: E402

ROUNDS = 15
QUADROTOR = "quadrotor"
GPU = "RK4 by JAX on a GPU, single, parameters per state"
FLIGHTS = "10 000 flights"
OVERHEAD = "Python on top"
Array = np.ndarray


@dataclass(frozen=True)
class Row:
    """What is timed on each machine, by its name, and what it is compared with.

    `cores` is how many it may have.
    """

    name: str
    measures: dict[str, Measure]
    against: str = ""
    cores: int = 1


def our_rows(machines: dict[str, Machine]) -> list[Row]:
    """Rollouts of all machines."""
    rows = []
    for method, words in (("euler", "Euler"), ("rk4", "RK4")):
        double, single = f"{words}, double", f"{words}, single"
        for name, against, options in (
            (double, f"MuJoCo, {words}", {}),
            (single, double, {"precision": "single"}),
            (f"{words}, parameters per state", double, {"masses": True}),
            (f"{words}, feedback, limits, lag", double, {"commanded": True}),
            (
                f"{single}, feedback, limits, lag",
                single,
                {"precision": "single", "commanded": True},
            ),
            (f"{words}, two cores", double, {"threads": 2}),
        ):
            measures = {each: made.steps(method, **options) for each, made in machines.items()}
            rows.append(Row(name, measures, against, options.get("threads", 1)))
    return rows


def built_rows(machines: dict[str, Machine]) -> list[Row]:
    """What is built on rollouts, or beside them, of machines with an arm."""

    def each(make: Callable[[Machine], Measure]) -> dict[str, Measure]:
        return {name: lazily(partial(make, made)) for name, made in machines.items()}

    double, torque = "RK4, double", "RK4, computed torque, limits, lag"
    return [
        Row(torque, each(partial(closed_loop, compensation=False)), double),
        Row(f"{torque} compensated", each(partial(closed_loop, compensation=True)), double),
        Row(
            f"{torque}, the tip on a wall",
            each(partial(closed_loop, compensation=False, touching=True)),
            torque,
        ),
        Row("RK4, environment of Gymnasium", each(environment), double),
        Row(GPU, each(on_gpu) if gpu() else {}, "RK4, parameters per state"),
    ]


def peer_rows(machines: dict[str, Machine], python: str | None) -> list[Row]:
    """MuJoCo on machines with an arm, and crazyflow on its quadrotor."""
    rows = []
    for method, words in (("euler", "Euler"), ("rk4", "RK4")):
        peers = {each: cache(partial(MuJoCo, made, method)) for each, made in machines.items()}
        measures = {
            each: partial(lambda peer: peer().seconds(), peer) for each, peer in peers.items()
        }
        rows.append(Row(f"MuJoCo, {words}", measures))
    crazyflow = Crazyflow(python) if python else None
    for method, words in (("symplectic_euler", "Euler"), ("rk4", "RK4")):
        measures = {QUADROTOR: crazyflow.steps(method)} if crazyflow else {}
        rows.append(Row(f"crazyflow, {words}", measures, f"{words}, single, feedback, limits, lag"))
    return rows


def chosen(rows: list[Row], only: list[str]) -> list[Row]:
    """Rows whose names have one of the words, and those that they are compared with."""
    if not only:
        return rows
    named = {row.name: row for row in rows}
    names = {row.name for row in rows if any(word in row.name for word in only)}
    while missing := {named[n].against for n in names if named[n].against} - names:
        names |= missing
    return [row for row in rows if row.name in names]


def timed(rows: list[Row]) -> dict[tuple[str, str], Array]:
    """Seconds of a step in each round, by row and machine."""
    found: dict[tuple[str, str], list[float]] = {}
    every = os.sched_getaffinity(0)
    for _ in range(1 + ROUNDS):
        for row in rows:
            os.sched_setaffinity(0, {max(every)} if row.cores == 1 else every)
            for name, measure in row.measures.items():
                found.setdefault((row.name, name), []).append(measure())
    os.sched_setaffinity(0, every)
    # The first round compiles, and wakes threads.
    return {key: np.array(seconds[1:]) for key, seconds in found.items()}


def print_rows(rows: list[Row], found: dict[tuple[str, str], Array], names: list[str]) -> None:
    """The table of steps a second."""
    print(f"\n| million steps a second: ratio | {' | '.join(names)} | ratio to |")
    print(f"|---|{'---:|' * len(names)}---|")
    for row in rows:
        cells = []
        for name in names:
            seconds, against = (found.get((key, name)) for key in (row.name, row.against))
            cell = "" if seconds is None else f"{1e-6 / np.median(seconds):.3g}"
            if seconds is not None and against is not None:
                low, middle, high = np.percentile(against / seconds, (10, 50, 90))
                cell += f": {middle:.3g} ({low:.3g}–{high:.3g})"
            cells.append(cell)
        remark = "no GPU here" if row.name == GPU and not row.measures else row.against
        print(f"| {row.name} | {' | '.join(cells)} | {remark} |")


def print_figures(machines: dict[str, Machine], only: list[str]) -> None:
    """The table of what is no row of the other."""
    figures = []
    if chosen([Row(OVERHEAD, {})], only):
        for name, made in machines.items():
            share = np.median([made.overhead() for _ in range(3 * ROUNDS)])
            figures.append((f"{OVERHEAD} of 100 RK4 steps of 1000 states, {name}", f"{share:.1%}"))
    if chosen([Row(FLIGHTS, {})], only):
        command = [sys.executable, str(Path(__file__).parent / "monte_carlo.py")]
        said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        flown = json.loads(said)
        what = f"{FLIGHTS} of 10 s, computed torque, masses ± 20 %, lag, two cores"
        early = f"{flown['ended_early']} ended early"
        figures.append((what, f"{flown['seconds']:.1f} s, {flown['peak_mb']:.0f} MB, {early}"))
    if figures:
        print("\n| what | figure |\n|---|---:|")
        for what, figure in figures:
            print(f"| {what} | {figure} |")


def main() -> None:
    """Build, check, time, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", default=[], metavar="ROW")
    parser.add_argument("--crazyflow", metavar="PYTHON", help="of an environment with crazyflow")
    options = parser.parse_args()
    robots = {"n = 3": benchmark_robot(3), "n = 7": benchmark_robot(7)}
    robots[QUADROTOR] = read_robot(QUADROTOR)[0]
    with tempfile.TemporaryDirectory() as folder:
        machines = {name: Machine(robot, Path(folder)) for name, robot in robots.items()}
        arms = {name: made for name, made in machines.items() if name != QUADROTOR}
        every = our_rows(machines) + built_rows(arms) + peer_rows(arms, options.crazyflow)
        rows = chosen(every, options.only)
        print(f"{machine()}; MuJoCo {mujoco.__version__} as its wheel has it")
        print_rows(rows, timed(rows), [*machines])
        print_figures(arms, options.only)


if __name__ == "__main__":
    main()
