"""Time rollouts on a GPU: `python benchmarks/cuda_times.py [ROBOT ...]`.

Their code is compiled by NVRTC (the extra `cuda`) for the GPU that is there. First each kernel is
compared with the same rollout on the CPU; then `--states` of them take `--steps` steps, with inputs
alone and with feedback, limits and lag, in floats and doubles, by blocks of several sizes, and with
registers as the compiler likes or 128 of them. Rates are of states that are on the GPU, the median
of `ROUNDS`, each from the beginning: steps of states that have ended cost nothing. Where any
has, it exits with 1, as where there is no GPU, and says so.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
from cuda_device import Call, Gpu, Kernels, machine_code

from gibbs_codegen import generate, load
from gibbs_codegen.runtime.rollouts import (
    REALS,
    Feedback,
    MotorModel,
    Problem,
    Rollout,
    compiled_rollout,
    functions_of,
)

ROUNDS, DT = 5, 1e-3
BLOCKS = 64, 128, 256
REGISTERS = {"own": (), "128": ("--maxrregcount=128",)}
# Of the largest number, after `SHORT` steps of `FEW` states.
ROOM, FEW, SHORT = {"double": 1e-11, "single": 1e-3}, 64, 100


def problems(module: ModuleType, count: int, steps: int) -> dict[str, Problem]:
    """Rollouts near rest with inputs alone, and with all that kernels have."""
    rng, robot = np.random.default_rng(0), functions_of(module)
    size, inputs = len(module.VELOCITIES), robot.inputs
    rest = np.zeros((1, len(module.COORDINATES)))
    if "qw" in module.COORDINATES:
        rest[0, module.COORDINATES.index("qw")] = 1.0
    q = module.integrate(np.repeat(rest, count, 0), 0.1 * rng.standard_normal((count, size)))
    v = 0.1 * rng.standard_normal((count, size))
    u = 0.1 * rng.standard_normal((count, 1, inputs))
    bare = Problem(module, None, q, v, u, steps, DT, every=steps)
    gain = 0.01 * rng.standard_normal((inputs, robot.layout.displaced.size + size))
    limits, lags = np.full(inputs, 300.0), np.full((1, robot.rotors), 0.03)
    motors = MotorModel(-limits, limits, lags, np.zeros((1, robot.rotors)))
    law = Feedback(gain, rest[:, None], np.zeros((1, 1, size)))
    return {"inputs": bare, "commands": replace(bare, feedback=law, motors=motors)}


def difference(found: Rollout, expected: Rollout) -> float:
    """The largest difference of q and v, as a share of the largest number."""
    return max(
        float(np.abs(ours - theirs).max() / np.abs(theirs).max())
        for ours, theirs in ((found.q, expected.q), (found.v, expected.v))
    )


def measured(gpu: Gpu, folder: Path, count: int, steps: int) -> None:
    """Print rates of a robot's rollouts."""
    module = load(folder, backend="c")
    if functions_of(module).driven:
        raise SystemExit(
            f"{folder.name}: has actuators; give robots that are sent thrusts, torques"
        )
    for precision in REALS:
        for registers, flags in REGISTERS.items():
            single = precision == "single"
            code, resources = machine_code(folder, gpu.architecture, single=single, flags=flags)
            gpu.load(code)
            kernels = Kernels(gpu, module, precision)
            few, many = (problems(module, *size) for size in ((FEW, SHORT), (count, steps)))
            for word, problem in few.items():
                for method in ("euler", "rk4"):
                    given = replace(problem, method=method, precision=precision)
                    apart = difference(kernels.rollout(given), compiled_rollout(given))
                    if not apart <= ROOM[precision]:
                        raise SystemExit(f"{folder.name}, {precision}, {word}: differs by {apart}")
                    call = kernels.prepared(replace(many[word], method=method, precision=precision))
                    taken = [f"{rate(gpu, call, block, count * steps):.2f}" for block in BLOCKS]
                    if ended := np.count_nonzero(call.rollout().ended):
                        raise SystemExit(f"{folder.name}, {precision}, {word}: {ended} states end")
                    call.free()
                    used = resources[call.kernel].registers
                    row = folder.name, precision, method, word, registers, used, *taken
                    print(f"| {' | '.join(map(str, row))} | {apart:.0e} |", flush=True)


def rate(gpu: Gpu, call: Call, block: int, steps: int) -> float:
    """Steps a second, 1e9."""
    gpu.block, seconds = block, []
    for _ in range(ROUNDS + 1):  # The first is not like the others.
        call.restart()
        begin = time.perf_counter()
        call.run()
        seconds.append(time.perf_counter() - begin)
    return 1e-9 * steps / statistics.median(seconds[1:])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robots", nargs="*", default=["quadrotor_arm_2link", "hexarotor_3link"])
    parser.add_argument("--states", type=int, default=2**20)
    parser.add_argument("--steps", type=int, default=1000)
    given = parser.parse_args()
    try:
        gpu = Gpu()
    except RuntimeError as error:
        sys.exit(str(error))
    print(f"{gpu.name}, {gpu.architecture}; {given.states} states, {given.steps} steps")
    sizes = " | ".join(f"G steps/s, blocks of {block}" for block in BLOCKS)
    print(f"| robot | | | | registers | | {sizes} | largest difference |")
    print(f"|---|---|---|---|---|---:|{'---:|' * len(BLOCKS)}---:|")
    with tempfile.TemporaryDirectory() as folder:
        for name in given.robots:
            made = generate(name, folder, targets=("numpy", "c", "cuda"), verify=False)
            measured(gpu, made, given.states, given.steps)


if __name__ == "__main__":
    main()
