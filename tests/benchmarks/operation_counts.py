"""Print operation counts of the benchmark family and of other machines.

`python tests/benchmarks/operation_counts.py` counts all of them, which takes minutes; names that
follow, of robots that ship, of robot files or `two_arms`, are counted instead.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from family import benchmark_robot, named_robot
from rich.console import Console
from rich.table import Table

from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.program.operations import Operations, count_operations
from gibbs_codegen.robot.model import Robot

FUNCTIONS = ("mass_matrix_and_residual", "mass_matrix", "residual", "forward_dynamics")


def counts(robot: Robot) -> dict[str, Operations]:
    """Operations of each function of a robot."""
    program = derive(robot).program
    return {name: count_operations(program.function(name).nodes()) for name in FUNCTIONS}


def family() -> list[Robot]:
    """Members of the benchmark family."""
    robots = [
        benchmark_robot(links, 6, origin, attitude)
        for links in (3, 7, 30)
        for origin, attitude in (("centre", "xyz"), ("motor1", "xyz"), ("centre", "quaternion"))
    ]
    return [*robots, benchmark_robot(3, 4), benchmark_robot(3, 40)]


def main() -> None:
    """Print a table of all but the sine–cosine pairs, and the pairs."""
    table = Table(title="Operations, parameters symbolic (sine-cosine pairs apart)")
    for column in ("robot", "origin", "attitude", *FUNCTIONS, "pairs"):
        table.add_column(column, justify="right")
    others = sys.argv[1:] or ["hextilt_flying_arm_5", "two_arms"]
    for robot in [*([] if sys.argv[1:] else family()), *map(named_robot, others)]:
        found = counts(robot)
        pairs = found["mass_matrix_and_residual"].sine_cosine_pairs
        totals = [str(found[name].total) for name in FUNCTIONS]
        table.add_row(robot.name, robot.base.origin, robot.base.attitude, *totals, str(pairs))
    Console(width=150).print(table)


if __name__ == "__main__":
    main()
