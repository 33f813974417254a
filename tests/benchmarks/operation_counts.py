"""Print operation counts of the benchmark family: `python tests/benchmarks/operation_counts.py`."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from family import benchmark_robot
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


def main() -> None:
    """Print a table of all but the sine–cosine pairs, and the pairs."""
    table = Table(title="Operations, parameters symbolic (sine-cosine pairs apart)")
    for column in ("N", "n", "origin", *FUNCTIONS, "pairs"):
        table.add_column(column, justify="right")
    cases = [(6, n, origin) for n in (3, 7, 30) for origin in ("centre", "motor1")]
    for rotors, links, origin in [*cases, (4, 3, "centre"), (40, 3, "centre")]:
        found = counts(benchmark_robot(links, rotors, origin))
        pairs = found["mass_matrix_and_residual"].sine_cosine_pairs
        totals = [str(found[name].total) for name in FUNCTIONS]
        table.add_row(str(rotors), str(links), origin, *totals, str(pairs))
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
