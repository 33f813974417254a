"""Print code, stack and instructions of laws on Cortex-M, compiled with -O2:
`python benchmarks/embedded_laws.py` (needs arm-none-eabi-gcc with newlib, and qemu-system-arm).

Code is what a linker keeps of the module and its laws for a law and for what it knows of the
rotors, in bytes, without libm. Stack is the deepest sum of the compiler's figures: of the law, of
what is inlined into it, and of the function that it calls which takes most. Instructions are those
that QEMU counts for a call, from near the desired motion, with thrusts within their limits and with
some beyond them.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

sys.path[:0] = [str(Path(__file__).parents[1] / "tests")]

from support.embedded_laws import CROSS, M4F, M7, Processor, called, objects  # noqa: E402

from gibbs_codegen import generate, load  # noqa: E402

LAWS = (
    ("quadrotor", "geometric"),
    ("hexarotor_3link", "computed_torque"),
    ("hextilt_flying_arm_5", "computed_torque"),
    ("hexarotor_3link", "force"),
    ("quadrotor_arm_2link", "geometric_force"),
)


def cross(tool: str, *arguments: str | Path) -> str:
    """What one of the cross tools prints."""
    command = [CROSS + tool, *map(str, arguments)]
    return subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout


def code(name: str, law: str, made: list[Path]) -> int:
    """Bytes that are left of objects when a law is what is used."""
    linked = made[1].with_suffix(".linked.o")
    wanted = [f"{name}_{law}", f"{name}_init_rotors", f"{name}_init_constants"]
    kept = [word for symbol in wanted for word in ("-u", symbol)]
    cross("ld", "-r", "--gc-sections", *kept, *made, "-o", linked)
    return int(cross("size", linked).splitlines()[1].split()[0])


def stack(name: str, law: str, made: list[Path]) -> int:
    """Bytes of a law and of the deepest of what it calls: in its file, and of the module."""
    rows = [
        line.split("\t")
        for path in made
        for line in path.with_suffix(".su").read_text(encoding="utf-8").splitlines()
    ]
    sizes = {place.rsplit(":", 1)[-1]: int(size) for place, size, _ in rows}
    own = {
        symbol: sizes[symbol]
        for symbol in sizes
        if symbol in (law, "find_nearest", "find_thrusts", "solve_free", "guess_again")
    }
    called_ = ("inverse_dynamics", "centre_of_mass_jacobian", "input_matrix", "frame_jacobians")
    inner = max(sizes[f"{name}_{function}"] for function in called_)
    nearest = sum(size for symbol, size in own.items() if symbol != law)
    return sizes[f"{name}_{law}"] + own.get(law, 0) + max(inner, nearest)


def cases(name: str, law: str) -> Iterator[list[list[NDArray[np.float64]]]]:
    """Members of gains, state and reference, near the motion: without limits, and with some."""
    module = load(Path(name))
    nq, nv, nu = (len(x) for x in (module.COORDINATES, module.VELOCITIES, module.INPUTS))
    level = np.zeros(nq)
    if module.ATTITUDE == "quaternion":
        level[6] = 1.0
    near, v = module.integrate(level, np.full(nv, 0.05)), np.full(nv, 0.1)
    reference = [level, np.zeros(nv), np.zeros(nv)]
    if law.startswith("geometric"):
        reference += [module.centre_of_mass(level), np.zeros(3), np.zeros(3)]
    state, frame = [near, v], []
    if law.endswith("force"):
        frame = [np.full(3, 100.0), np.full(3, 20.0), np.full(3, 2.0)]
        state.append(np.full(6, 0.5))
        reference += [np.array([1.0, 0.0, 0.0]), np.full(1, 5.0), np.ones(1)]
    weight = module.inverse_dynamics(level, 0.0 * v, 0.0 * v)
    hover = np.linalg.pinv(module.input_matrix(level)) @ weight
    for most in (np.inf, 0.7 * np.abs(hover[np.array(module.INPUT_UNITS) == "N"]).max()):
        gains = [np.full(nv, 9.0), np.full(nv, 6.0), np.full(nu, -most), np.full(nu, most)]
        yield [[*gains, *frame], state, reference]


def measured(name: str, law: str, folder: Path, processor: Processor) -> list[str]:
    """Cells of a row."""
    made = objects(name, folder, processor)
    counts = called(name, law, folder, processor, list(cases(str(folder), law))).instructions
    return [str(code(name, law, made)), str(stack(name, law, made)), *(f"{x:.0f}" for x in counts)]


def main() -> None:
    """Print the table."""
    table = Table(title="A law on Cortex-M at -O2: bytes, and instructions of a call")
    columns = ("robot", "law", "processor", "code", "stack", "instructions", "with limits")
    for column in columns:
        table.add_column(column, justify="left" if column in columns[:3] else "right")
    with tempfile.TemporaryDirectory() as out:
        for name, law in LAWS:
            folder = generate(name, f"{out}/{law}", laws=[law])
            for processor in (M4F, M7):
                table.add_row(name, law, processor.name, *measured(name, law, folder, processor))
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
