"""Time calls of the C back end from Python: `python benchmarks/call_times.py`.

What a call costs beyond the C function itself, for one state, and what a state costs in a batch of
a thousand in NumPy's layout, beside the NumPy back end. The C functions are timed by themselves in
a loop in C.
"""

from __future__ import annotations

import ctypes
import sys
import tempfile
import timeit
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

sys.path[:0] = [
    str(Path(__file__).parent),
    str(Path(__file__).parents[1]),
    str(Path(__file__).parents[1] / "tests"),
]

from peers.timing import timer  # noqa: E402

from gibbs_codegen import load  # noqa: E402
from gibbs_codegen.interface import module_signatures  # noqa: E402

ROBOT = Path(__file__).parents[1] / "generated" / "hexarotor_3link"
STATES = 1000


def best(statement: str, names: dict[str, object], number: int) -> float:
    """Least of ten means over `number` runs, in ns."""
    return min(timeit.repeat(statement, globals=names, number=number, repeat=10)) / number * 1e9


def main() -> None:
    """Print nanoseconds a call and a state."""
    numpy, compiled = load(ROBOT), load(ROBOT, backend="c")
    rng = np.random.default_rng(0)
    table = Table(title=f"{numpy.NAME}: ns")
    for column in ("function", "C itself", "call", "overhead", "in a batch", "NumPy", "in a batch"):
        table.add_column(column, justify="right")
    with tempfile.TemporaryDirectory() as folder:
        time_calls = timer(Path(folder))
        for signature in module_signatures(numpy):
            arrays = [rng.uniform(-1, 1, (STATES, *shape)) for shape in signature.argument_shapes]
            constants = np.frombuffer(compiled.prepare({}))
            outputs = [np.empty(shape or 1) for shape in signature.shapes]
            given = [a.ctypes.data for a in (constants, *arrays, *outputs)]
            itself = float("nan")
            if len(given) <= 5:  # As many as the timing loop passes on; the rest are not looked at.
                given += [0] * (5 - len(given))
                first = [number for pointer in given[:3] for number in (pointer, 0)]
                address = ctypes.cast(compiled.compiled.function(signature.name), ctypes.c_void_p)
                itself = min(time_calls(address, 20_000, 1, *first, *given[3:]) for _ in range(10))
            row = [itself]
            for module in (compiled, numpy):
                function = getattr(module, signature.name)
                names = {"f": function, "one": [a[0] for a in arrays], "many": arrays}
                row.append(best("f(*one)", names, 2000))
                row.append(best("f(*many)", names, 10) / STATES)
            cells = [row[0], row[1], row[1] - row[0], *row[2:]]
            texts = ["" if np.isnan(cell) else f"{cell:.0f}" for cell in cells]
            table.add_row(signature.name, *texts)
    Console(width=110).print(table)


if __name__ == "__main__":
    main()
