"""Print operation counts of the benchmark family and of other machines.

`python benchmarks/operation_counts.py` counts all of them, which takes minutes; names that
follow, of robots that ship, of robot files or `two_arms`, are counted instead. With `--derivatives`
functions that are generated on request are counted, of the family's members with 3 and 7 links.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from family import benchmark_robot, named_robot
from rich.console import Console
from rich.table import Table

from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.interface import derivatives_among
from gibbs_codegen.program.nodes import Operations, count_operations
from gibbs_codegen.robot.model import Robot

FUNCTIONS = ("mass_matrix_and_residual", "mass_matrix", "residual", "forward_dynamics")


def counts(robot: Robot) -> dict[str, Operations]:
    """Operations of each function of a robot."""
    program = derive(robot).program
    return {name: count_operations(program.function(name).nodes()) for name in FUNCTIONS}


def derivative_counts(robot: Robot, *names: str) -> dict[str, Operations]:
    """Operations of functions that are generated on request: of these, or of all that there are."""
    model = derive(robot, derivatives=names or "all")
    program = model.program
    chosen = derivatives_among(model.functions)
    return {name: count_operations(program.function(name).nodes()) for name in chosen}


def family() -> list[Robot]:
    """Members of the benchmark family."""
    robots = [
        benchmark_robot(links, 6, origin, attitude)
        for links in (3, 7, 30)
        for origin, attitude in (("centre", "xyz"), ("motor1", "xyz"), ("centre", "quaternion"))
    ]
    return [*robots, benchmark_robot(3, 4), benchmark_robot(3, 40)]


def print_counts(robots: Sequence[Robot], console: Console) -> None:
    """A row a robot, with all but the sine–cosine pairs, and the pairs."""
    table = Table(title="Operations, parameters symbolic (sine-cosine pairs apart)")
    for column in ("robot", "origin", "attitude", *FUNCTIONS, "pairs"):
        table.add_column(column, justify="right")
    for robot in robots:
        found = counts(robot)
        pairs = found["mass_matrix_and_residual"].sine_cosine_pairs
        totals = [str(found[name].total) for name in FUNCTIONS]
        table.add_row(robot.name, robot.base.origin, robot.base.attitude, *totals, str(pairs))
    console.print(table)


def print_derivative_counts(robots: Sequence[Robot], console: Console) -> None:
    """A row a function, a column a robot, sine–cosine pairs apart."""
    found = [derivative_counts(robot) for robot in robots]
    table = Table(title="Operations, parameters symbolic (sine-cosine pairs apart)")
    table.add_column("function")
    for robot in robots:
        table.add_column(f"{robot.name}, {robot.base.attitude}", justify="right")
    for name in dict.fromkeys(name for each in found for name in each):
        table.add_row(name, *(str(each[name].total) if name in each else "" for each in found))
    console.print(table)


def main() -> None:
    """Print one of the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("robots", nargs="*", metavar="ROBOT")
    parser.add_argument("--derivatives", action="store_true")
    options = parser.parse_args()
    named, console = [named_robot(name) for name in options.robots], Console(width=150)
    if options.derivatives:
        members = [
            benchmark_robot(links, attitude=attitude)
            for links in (3, 7)
            for attitude in ("xyz", "quaternion")
        ]
        print_derivative_counts(named or members, console)
    else:
        others = ("hextilt_flying_arm_5", "two_arms")
        print_counts(named or [*family(), *map(named_robot, others)], console)


if __name__ == "__main__":
    main()
