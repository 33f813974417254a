"""Time the C target against its peers in one run: `python benchmarks/c_times.py`.

Pinocchio, MuJoCo, CasADi-generated C and the project's C compute the same machines from 1024
different states, on one core. All must agree to 1e-9 before any is timed. Rounds go through all
contenders in turn, so that a slow moment of the machine hits all alike; what is reported is the
median over the rounds, of times and of ratios, the latter with their 10th and 90th percentiles.
`--links 3 7` limits the family's machines; `--robots` takes others instead: `two_arms` and
`two_benchmark_arms` of `family.py`, robots that ship, or robot files. `--picture FILE` draws the
times; `--summary FILE` draws those of the first machine for readers who do not know it, such as
those of README; `--folder DIR` keeps what is built, since Pinocchio takes minutes to compile.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import platform
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

sys.path[:0] = [
    str(Path(__file__).parent),
    str(Path(__file__).parents[1]),
    str(Path(__file__).parents[1] / "tests"),
]

from family import benchmark_robot, named_robot  # noqa: E402
from our_c import BATCH, ONE, our_contenders  # noqa: E402
from peers.contender import TASKS, Contender, States, packed  # noqa: E402
from peers.peers import STATES, check, contenders, random_states  # noqa: E402
from peers.timing import Timer, timer  # noqa: E402

from gibbs_codegen.figures.appearance import COLOURS  # noqa: E402
from gibbs_codegen.figures.style import style  # noqa: E402
from gibbs_codegen.robot.model import Robot  # noqa: E402

ROUNDS = 60
SECONDS_PER_MEASUREMENT = 1e-3

Times = dict[tuple[str, str], np.ndarray]


def measurement(time_calls: Timer, contender: Contender, states: States) -> Callable[[], float]:
    """A function that measures nanoseconds per state, over at least one pass through the states."""
    blocks = [packed(rows, contender.width) for rows in contender.inputs(states)]
    first, second = contender.memory(states[1].shape[1])
    given = [number for block in blocks for number in (block.ctypes.data, block[0].size)]
    pointer = ctypes.cast(contender.function, ctypes.c_void_p)
    around = len(blocks[0])

    def mean(calls: int) -> float:
        return time_calls(pointer, calls, around, *given, first.ctypes.data, second.ctypes.data)

    rounds = max(1, round(SECONDS_PER_MEASUREMENT * 1e9 / mean(around) / around))

    def measure(keep: tuple[object, ...] = (blocks, first, second)) -> float:
        return mean(rounds * around) / contender.width

    return measure


def times(name: str, robot: Robot, folder: Path, time_calls: Timer, console: Console) -> Times:
    """Nanoseconds per state of every contender in every round, for one machine."""
    with console.status(f"{name}: building and checking"):
        found = [*contenders(robot, folder), *our_contenders(robot, folder)]
        worst = max(check(contender, robot) for contender in found)
        console.print(f"{name}: {len(found)} contenders agree to {worst:.0e}")
    with console.status(f"{name}: timing"):
        return in_rounds(found, random_states(robot, STATES), time_calls)


def in_rounds(found: Sequence[Contender], states: States, time_calls: Timer) -> Times:
    """Nanoseconds per state of every contender in every round, each round through all of them."""
    measures = {(c.task, c.name): measurement(time_calls, c, states) for c in found}
    rounds = [{key: measure() for key, measure in measures.items()} for _ in range(ROUNDS)]
    return {key: np.array([r[key] for r in rounds]) for key in measures}


def ratio_text(peer: np.ndarray, ours: np.ndarray) -> str:
    """Median of a ratio with its 10th and 90th percentiles."""
    low, middle, high = np.percentile(peer / ours, (10, 50, 90))
    return f"{middle:.3g} ({low:.3g}–{high:.3g})"


def print_tables(
    measured: dict[str, Times], console: Console, tasks: Sequence[str] = TASKS
) -> None:
    """A table a task: nanoseconds per state, and how many times that of ours it is."""
    for task in tasks:
        table = Table(title=f"{task.capitalize()}: ns per state, and times ours (10–90 %)")
        table.add_column("who")
        for name in measured:
            table.add_column(name, justify="right")
            table.add_column("÷ one state", justify="right")
            table.add_column("÷ batch", justify="right")
        for who in _names(measured, task):
            cells = []
            for found in measured.values():
                if (task, who) not in found:
                    cells += ["", "", ""]
                    continue
                own = found[task, who]
                one, batch = found[task, ONE], found[task, BATCH]
                cells.append(f"{np.median(own):.1f}")
                cells.append("" if who in (ONE, BATCH) else ratio_text(own, one))
                cells.append("" if who == BATCH else ratio_text(own, batch))
            table.add_row(who, *cells)
        console.print(table)


def _names(measured: dict[str, Times], task: str) -> list[str]:
    """Contenders at a task, some of which may not have all machines."""
    every = (who for found in measured.values() for one, who in found if one == task)
    return list(dict.fromkeys(every))


def draw(measured: dict[str, Times], file: str, tasks: Sequence[str] = TASKS) -> None:
    """Bars of nanoseconds per state on a logarithmic scale, a panel a task."""
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(1, 2, figsize=(11, 5), sharey=True, layout="constrained")
    colours = plt.get_cmap("tab10").colors
    for panel, task in zip(panels, tasks, strict=True):
        names = _names(measured, task)
        width = 0.86 / len(names)
        for i, who in enumerate(names):
            places = np.arange(len(measured)) + (i - (len(names) - 1) / 2) * width
            heights = [np.median(found.get((task, who), np.nan)) for found in measured.values()]
            ours = who in (ONE, BATCH)
            bars = panel.bar(
                places,
                heights,
                width,
                label=who,
                color="black" if who == ONE else "dimgrey" if ours else colours[i],
            )
            texts = [f"{h:.0f}" if h >= 100 else f"{h:.3g}" for h in heights]
            panel.bar_label(bars, texts, fontsize=7, rotation=90, padding=2)
        panel.set_yscale("log")
        panel.set_xticks(range(len(measured)), [name.replace(", ", "\n") for name in measured])
        panel.set_title(task)
        panel.grid(axis="y", which="major", alpha=0.4)
        panel.set_axisbelow(True)
    panels[0].set_ylabel("time per state, ns")
    panels[0].set_ylim(top=2 * panels[0].get_ylim()[1])
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4, fontsize=9)
    figure.savefig(file, dpi=150)


# Those of the summary, as bars from top to bottom, in words for readers.
SUMMARY = {
    "Pinocchio, free-flyer": "Pinocchio (C++)",
    "MuJoCo": "MuJoCo (C)",
    "CasADi C": "CasADi, generated C",
    "CasADi C, eight at once": "the same, 8 states at once",
    ONE: "gibbs_codegen",
    BATCH: "the same, many states at once",
}


def draw_summary(measured: dict[str, Times], file: str) -> None:
    """Bars of nanoseconds per state of the first machine, those of ours in a colour of its own."""
    name, found = next(iter(measured.items()))
    links = name.replace("n = ", "an arm of ") + " joints" if name.startswith("n = ") else name
    with style():
        figure = Figure(figsize=(5.4, 4.9), layout="constrained")
        figure.suptitle(f"Nanoseconds per state: six rotors, {links}", fontsize=11)
        for panel, task in zip(figure.subplots(2, 1, sharex=True), TASKS, strict=True):
            shown = [who for who in SUMMARY if (task, who) in found]
            heights = [np.median(found[task, who]) for who in shown]
            colours = [COLOURS[1] if who in (ONE, BATCH) else "0.7" for who in shown]
            places = range(len(shown))
            bars = panel.barh(places, heights, color=colours)
            panel.set_yticks(places, [SUMMARY[who] for who in shown])
            panel.bar_label(bars, [f"{height:.0f}" for height in heights], padding=4, fontsize=10)
            panel.set_title(task, fontsize=10, loc="left")
            panel.invert_yaxis()
            panel.tick_params(labelsize=10, length=0)
            panel.grid(visible=False)
            panel.spines[:].set_visible(False)
            panel.set(xticks=[], xlim=(0.0, 1.12 * max(heights)))
        figure.savefig(file, metadata={"Date": None})


def machine() -> str:
    """Processor and compiler, as far as the system tells."""
    cpu = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        lines = info.read_text(encoding="utf-8").splitlines()
        cpu = next((x.split(":")[1].strip() for x in lines if x.startswith("model name")), cpu)
        wide = any("avx512f" in line for line in lines)
        cpu += ", AVX-512" if wide else ""
    return f"{cpu}; one core; gcc -O3 -march=native; Python {platform.python_version()}"


def main() -> None:
    """Build, check, time, print; draw if asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--links", type=int, nargs="+", default=[3, 7, 30])
    parser.add_argument("--robots", nargs="+", metavar="ROBOT")
    parser.add_argument("--picture", metavar="FILE")
    parser.add_argument("--summary", metavar="FILE")
    parser.add_argument("--folder", metavar="DIR")
    options = parser.parse_args()
    console = Console(width=None if sys.stdout.isatty() else 150, highlight=False)
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    robots = {f"n = {links}": benchmark_robot(links) for links in options.links}
    if options.robots:
        robots = {robot.name: robot for robot in map(named_robot, options.robots)}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(options.folder or name)
        folder.mkdir(exist_ok=True)
        time_calls = timer(folder)
        measured = {
            name: times(name, robot, folder, time_calls, console) for name, robot in robots.items()
        }
        console.print(machine())
        print_tables(measured, console)
        if options.picture:
            draw(measured, options.picture)
        if options.summary:
            draw_summary(measured, options.summary)


if __name__ == "__main__":
    main()
