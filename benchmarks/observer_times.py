"""Time the observer of generalised momentum of an arm of seven joints, and count instructions.

`python benchmarks/observer_times.py` prints nanoseconds of processor time on this machine, with
gcc -O3 -march=native, of many repeats the least; and instructions on Cortex-M as QEMU counts them,
at -O2 (needs arm-none-eabi-gcc with newlib, and qemu-system-arm). A wrench is told with the
Jacobians of the frames.
"""

from __future__ import annotations

import ctypes
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[1] / "tests")]

from arrays.test_observers import arm_text  # noqa: E402
from support.compiled import build  # noqa: E402
from support.embedded_laws import M4F, M7, observed  # noqa: E402

from gibbs_codegen import load, parse_robot  # noqa: E402
from gibbs_codegen.pipeline import generate_robot  # noqa: E402

CALLS, ROUNDS = 1000, 200
# Calls in C, so that those of Python are not counted.
LOOP = """
#include "arm_7_laws.h"
void steps(const arm_7_constants *c, arm_7_observer *o, const double *x)
{
    for (int k = 0; k < %d; ++k)
        arm_7_momentum_observer_step(c, o, x, x + 7, x + 14, x + 21, 1e-3);
}
void wrenches(const arm_7_constants *c, const arm_7_observer *o, arm_7_frame_observer *f,
              const double *x, double *wrench)
{
    double jacobians[2 * 42];
    for (int k = 0; k < %d; ++k) {
        arm_7_frame_jacobians(c, x, jacobians);
        arm_7_wrench_of_residual(f, jacobians + 42, o->residual, x + 21, x + 28, x + 35, wrench);
    }
}
"""


def least(call: Callable[[], None]) -> float:
    """Nanoseconds of processor time of one of the calls that another makes in C."""
    times = []
    for _ in range(ROUNDS):
        begin = time.process_time_ns()
        call()
        times.append((time.process_time_ns() - begin) / CALLS)
    return min(times)


def main() -> None:
    """Print all figures."""
    text = arm_text()
    with tempfile.TemporaryDirectory() as out:
        laws = ["momentum_observer"]
        _, folder = generate_robot(parse_robot(text), text, out, laws=laws, verify=False)
        loop = Path(out) / "loop.c"
        loop.write_text(LOOP % (CALLS, CALLS), encoding="utf-8")
        sources = [str(loop), *(str(folder / f"arm_7{x}.c") for x in ("", "_laws"))]
        options = ["-O3", "-march=native", "-shared", "-fPIC", "-Wno-missing-prototypes"]
        options.append(f"-I{folder}")
        library = ctypes.CDLL(str(build("gcc", options, sources, Path(out) / "loop.so")))
        symbol = ctypes.c_char.in_dll(library, "arm_7_default_constants")
        constants = ctypes.c_void_p(ctypes.addressof(symbol))
        given = {name: np.linspace(0.2, 0.9, 7) for name in ("q", "v", "u")}
        given |= {"share": np.full(7, 0.02), "weight": np.ones(7), "damping": np.full(6, 0.1)}
        observer, of_frame, wrench = np.zeros(21), np.ones(42), np.zeros(6)
        numbers = np.concatenate([*given.values()])
        memory, frame, x, result = (
            ctypes.c_void_p(array.ctypes.data) for array in (observer, of_frame, numbers, wrench)
        )
        print(f"a step: {least(lambda: library.steps(constants, memory, x)):.0f} ns")
        wrenches = least(lambda: library.wrenches(constants, memory, frame, x, result))
        print(f"a wrench: {wrenches:.0f} ns")
        frames = len(load(folder).FRAMES)
        for processor in (M4F, M7):
            _, counts = observed("arm_7", folder, processor, frames, given)
            step, told = counts
            print(f"{processor.name}: {step:.0f} instructions a step, {told:.0f} a wrench")


if __name__ == "__main__":
    main()
