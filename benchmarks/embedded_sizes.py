"""Print code size and stack of the shipped robots on Cortex-M, compiled with -O2:
`python benchmarks/embedded_sizes.py` (needs arm-none-eabi-gcc with newlib).

Code is what a linker keeps that drops unused sections, in bytes: of a function with all that it
calls in the module, but without the library's sine and cosine. Stack is the compiler's figure for
the function and for the helper that calls those. Operations leave out the sine–cosine pairs.
"""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.nodes import count_operations
from gibbs_codegen.robot.file import read_robot, shipped_robots

FUNCTIONS = ("mass_matrix_and_residual", "forward_dynamics")
TOOLS = "arm-none-eabi-"
FLAGS = "-std=c99 -O2 -mthumb -mfloat-abi=hard -ffunction-sections -fdata-sections -fstack-usage"
TARGETS = {
    "M4F float": ("-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16"),
    "M7 double": ("-mcpu=cortex-m7", "-mfpu=fpv5-d16"),
}


@dataclass(frozen=True)
class Object:
    """A module's compiled C source, and the prefix of its names."""

    path: Path
    prefix: str

    def public(self) -> list[str]:
        """Functions and tables that a user may call or read."""
        lines = run("nm", "--extern-only", "--defined-only", self.path).splitlines()
        return [line.split()[-1] for line in lines]

    def code(self, kept: Sequence[str]) -> int:
        """Bytes of code and tables that are left when `kept` is what is used."""
        linked = self.path.with_suffix(".linked.o")
        wanted = [word for name in kept for word in ("-u", name)]
        run("ld", "-r", "--gc-sections", *wanted, self.path, "-o", linked)
        return int(run("size", linked).splitlines()[1].split()[0])

    def stack(self, function: str) -> int:
        """Bytes of stack of a function and the helper for angles beyond its own range."""
        lines = self.path.with_suffix(".su").read_text(encoding="utf-8").splitlines()
        rows = [line.split("\t") for line in lines]
        taken = {place.rsplit(":", 1)[-1]: int(size) for place, size, _ in rows}
        helpers = [size for name, size in taken.items() if name.startswith("library_sine_cosine")]
        return taken[self.prefix + function] + max(helpers)


def run(tool: str, *arguments: str | Path) -> str:
    """What one of the cross tools prints."""
    command = [TOOLS + tool, *map(str, arguments)]
    return subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout


def compiled(source: Path, target: str) -> Object:
    """Compile a module's source for a target."""
    output = source.with_suffix(f".{target.split()[0]}.o")
    precision = [f"-D{source.stem.upper()}_FLOAT"] if target.endswith("float") else []
    run("gcc", *FLAGS.split(), *TARGETS[target], *precision, "-c", source, "-o", output)
    return Object(output, f"{source.stem}_")


def rows(model: Model, objects: Sequence[Object]) -> list[list[str]]:
    """Cells of a robot's rows: what, operations, pairs, then code and stack on each target."""
    found = []
    for name in FUNCTIONS:
        counts = count_operations(model.program.function(name).nodes())
        cells = [name, str(counts.total), str(counts.sine_cosine_pairs)]
        for made in objects:
            cells += [str(made.code([made.prefix + name])), str(made.stack(name))]
        found.append(cells)
    whole = ["all functions without batches", "", ""]
    for made in objects:
        whole += [str(made.code(made.public())), ""]
    return [*found, whole]


def main() -> None:
    """Print the table."""
    table = Table(title="Bytes of code and stack at -O2")
    for column in ("robot", "function"):
        table.add_column(column, no_wrap=True)
    figures = [f"{target}\n{what}" for target in TARGETS for what in ("code", "stack")]
    for column in ("operations", "pairs", *figures):
        table.add_column(column, justify="right")
    with tempfile.TemporaryDirectory() as folder:
        for name in shipped_robots():
            model, made = generate_robot(*read_robot(name), folder)
            objects = [compiled(made / f"{name}.c", target) for target in TARGETS]
            for i, cells in enumerate(rows(model, objects)):
                table.add_row("" if i else name, *cells)
            table.add_section()
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
