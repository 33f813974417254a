"""Print code, stack and instructions of filters on Cortex-M, compiled with -O2:
`python benchmarks/embedded_filter.py` (needs arm-none-eabi-gcc with newlib, and qemu-system-arm).

Code is what a linker keeps of the module and its filter for a function, in bytes, without libm.
Stack is the compiler's figure of the function, and of the one that it calls which takes most.
Instructions are those that QEMU counts for a call. Coordinates and velocities after ten calls are
off by so much from those of NumPy.
"""

from __future__ import annotations

import itertools
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import numpy as np
from rich.console import Console
from rich.table import Table

sys.path[:0] = [str(Path(__file__).parents[1] / "tests")]

from support.embedded_laws import CROSS, M4F, M7, Processor, filtered, objects  # noqa: E402

from gibbs_codegen import generate, load  # noqa: E402
from gibbs_codegen.arrays import Functions, Program, evaluate  # noqa: E402
from gibbs_codegen.arrays.contents import functions_of  # noqa: E402
from gibbs_codegen.machine.filters import filter_functions  # noqa: E402

ROBOTS = ("quadrotor_arm_2link",)
LAWS = {"state_filter": "", "imu_filter": "imu"}


def cross(tool: str, *arguments: str | Path) -> str:
    """What one of the cross tools prints."""
    command = [CROSS + tool, *map(str, arguments)]
    return subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout


def sizes(robot: str, program: Program, folder: Path, processor: Processor) -> tuple[str, str]:
    """Bytes of code and of stack of a function of a filter."""
    made, symbol = objects(robot, folder, processor), f"{robot}_{program.name}"
    linked = made[1].with_suffix(".linked.o")
    cross("ld", "-r", "--gc-sections", "-u", symbol, *made, "-o", linked)
    code = cross("size", linked).splitlines()[1].split()[0]
    lines = [x.split("\t") for path in made for x in path.with_suffix(".su").open()]
    taken = {place.rsplit(":", 1)[-1]: int(size) for place, size, _ in lines}
    called = (taken.get(f"{robot}_{function}", 0) for _, function in functions_of(program))
    return code, str(taken[symbol] + max(called, default=0))


def given(programs: Sequence[Program], of: Program) -> dict[str, np.ndarray]:
    """What a function of a filter is given near hovering, and all members of its structure."""
    rng, inputs = np.random.default_rng(1), [x for p in (*programs, of) for x in p.inputs]
    arrays = {x.operation.name: rng.uniform(0.01, 0.1, x.shape) for x in inputs}
    arrays |= {"gravity": np.array([0.0, 0.0, -9.81]), "h": np.array(1e-3), "gate": np.array(1e30)}
    arrays["q"][:7] = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    return arrays | {"covariance": 1e-2 * np.eye(len(arrays["covariance"]))}


def after(program: Program, arrays: dict[str, np.ndarray], module: ModuleType) -> np.ndarray:
    """Coordinates and velocities after ten calls, by NumPy."""
    for _ in range(10):
        inputs = {name: arrays[name] for name in program.names}
        found = evaluate(program, inputs, {"robot": module})
        arrays = {name: found.get(f"{name}_next", x) for name, x in arrays.items()}
    return np.concatenate([arrays["q"], arrays["v"]])


def main() -> None:
    """Print the table."""
    table = Table(title="Filters on Cortex-M at -O2: bytes, instructions of a call, error")
    for column in ("robot", "function", "processor", "code", "stack", "instructions", "off"):
        table.add_column(column, justify="right")
    for robot, law in itertools.product(ROBOTS, LAWS):
        with tempfile.TemporaryDirectory() as out:
            folder = generate(robot, out, laws=[law], verify=False)
            module = load(folder)
            functions = filter_functions(Functions(module), LAWS[law])
            for function, processor in itertools.product(functions, (M4F, M7)):
                program = function.program
                arrays = given([x.program for x in functions], program)
                told, count = filtered(robot, function, folder, processor, arrays)
                off = np.abs(told - after(program, arrays, module)).max()
                cells = *sizes(robot, program, folder, processor), f"{count:.0f}", f"{off:.1e}"
                table.add_row(robot, program.name, processor.name, *cells)
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
