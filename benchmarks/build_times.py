"""Time one function in blocks, by build: `python benchmarks/build_times.py [--compiler gcc]`.

Forward dynamics of `generated/hexarotor_3link` of 1024 states, on one core, compiled for this
processor, for x86-64-v3, for any x86-64 processor, and with HEXAROTOR_3LINK_DISPATCH, in double
and single precision, with constants that all states share and with constants of each state. Rounds
go through all builds in turn; what is reported is the least time of a state in nanoseconds.
"""

from __future__ import annotations

import argparse
import ctypes
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parent.parent.parent
NAME = "hexarotor_3link"
SIZES = ("CONSTANTS", "COORDINATES", "VELOCITIES", "INPUTS")
STATES, CALLS, ROUNDS = 1024, 100, 40
BUILDS = {
    "native": ("-march=native",),
    "x86-64-v3": ("-march=x86-64-v3",),
    "baseline": (),
    "dispatch": (f"-D{NAME.upper()}_DISPATCH",),
}
_CALLS = f"""
#include "{NAME}.h"

typedef {NAME}_real real;

void shared(int calls, const void *constants, size_t count, const real *q, const real *v,
            const real *u, real *a)
{{
    for (int i = 0; i < calls; ++i) {{
        {NAME}_forward_dynamics_batch(constants, count, q, v, u, a);
    }}
}}

void each(int calls, const void *constants, size_t count, const real *q, const real *v,
          const real *u, real *a)
{{
    for (int i = 0; i < calls; ++i) {{
        {NAME}_forward_dynamics_batch_each(constants, count, q, v, u, a);
    }}
}}
"""


def aligned(values: np.ndarray) -> np.ndarray:
    """A copy that begins at a multiple of 64 bytes."""
    room = np.empty(values.nbytes + 64, np.uint8)
    start = -room.ctypes.data % 64
    copy = room[start : start + values.nbytes].view(values.dtype).reshape(values.shape)
    copy[:] = values
    return copy


def measures(
    compiler: str, options: tuple[str, ...], real: type[np.floating], library: Path
) -> dict[str, Callable[[], float]]:
    """Functions that measure nanoseconds per state: with shared constants, and with own ones."""
    module = ROOT / "generated" / NAME
    library.with_suffix(".c").write_text(_CALLS, encoding="utf-8")
    sources = [
        module / f"{NAME}.c",
        module / f"{NAME}_batch.c",
        module / f"{NAME}_each.c",
        library.with_suffix(".c"),
    ]
    single = [f"-D{NAME.upper()}_FLOAT"] if real is np.float32 else []
    flags = ["-O3", "-fPIC", "-shared", *options, *single, f"-I{module}"]
    subprocess.run([compiler, *flags, *sources, "-o", library, "-lm"], check=True)
    functions = ctypes.CDLL(str(library))
    text = (module / f"{NAME}.h").read_text(encoding="utf-8")
    sizes = {key: int(text.split(f"#define {NAME.upper()}_{key} ")[1].split()[0]) for key in SIZES}
    number = ctypes.c_float if single else ctypes.c_double
    mark = "_float" if single else ""
    defaults = (number * sizes["CONSTANTS"]).in_dll(functions, f"{NAME}_default_constants{mark}")
    lanes = 64 // np.dtype(real).itemsize
    random = np.random.default_rng(1)
    arrays = [
        aligned(random.uniform(-0.9, 0.9, (STATES, sizes[key])).astype(real))
        for key in ("COORDINATES", "VELOCITIES", "INPUTS", "VELOCITIES")
    ]
    own = np.repeat(np.array(defaults, real), STATES).reshape(-1, STATES // lanes, lanes)
    constants = {"shared": np.array(defaults, real), "each": aligned(own.swapaxes(0, 1))}

    def measure(name: str) -> float:
        pointers = [ctypes.c_void_p(array.ctypes.data) for array in arrays]
        given = ctypes.c_void_p(constants[name].ctypes.data)
        start = time.thread_time_ns()
        functions[name](CALLS, given, ctypes.c_size_t(STATES), *pointers)
        return (time.thread_time_ns() - start) / (CALLS * STATES)

    return {name: lambda name=name: measure(name) for name in constants}


def main() -> None:
    """Print a table in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--compiler", default="gcc")
    compiler = parser.parse_args().compiler
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for real in (np.float64, np.float32):
            for build, options in BUILDS.items():
                library = Path(folder) / f"{build}_{real.__name__}.so"
                for name, measure in measures(compiler, options, real, library).items():
                    found[build, real, name] = measure
        rounds = [{key: measure() for key, measure in found.items()} for _ in range(ROUNDS)]
    best = {key: min(times[key] for times in rounds) for key in found}
    columns = [(real, name) for real in (np.float64, np.float32) for name in ("shared", "each")]
    words = {np.float64: "double", np.float32: "float"}
    print(f"| {compiler} | " + " | ".join(f"{words[r]}, {name}" for r, name in columns) + " |")
    print("|---|" + "---|" * len(columns))
    for build in BUILDS:
        times = " | ".join(f"{best[build, real, name]:.1f}" for real, name in columns)
        print(f"| {build} | {times} |")


if __name__ == "__main__":
    main()
