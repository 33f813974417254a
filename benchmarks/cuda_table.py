"""Print what threads of rollouts take: `python benchmarks/cuda_table.py [ROBOT ...]`.

It needs no GPU: it compiles the CUDA source of robots by NVRTC (the extra `cuda`), and prints the
rows of the table in docs/howto/cuda.md: of semi-implicit Euler with feedback, limits and lag. Where
`nvidia-cuda-nvdisasm` is installed, also the instructions of a step, and an estimate of steps a
second of an H200: what the fullest of its issue slots and pipes allows, times 0.6. It is no
measurement; `cuda_times.py` measures, where there is a GPU.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections import Counter
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

from cuda_device import machine_code

from gibbs_codegen import generate, robots

ARCHITECTURE, KERNEL = "sm_90", "{}_rollout_euler_commands"
# Of an H200: parts of multiprocessors, each of which issues an instruction of 32 threads a clock.
PARTS, CLOCK, SHARE, THREADS = 132 * 4, 1.83e9, 0.6, 32
# Pipes of such a part, with the clocks that an instruction of 32 threads keeps them, by beginnings
# of names; all others are integers'.
PIPES = {
    "D": ("doubles", 2),
    "MUFU": ("special functions", 8),
    **dict.fromkeys(("LD", "ST"), ("memory", 4)),
    **dict.fromkeys(("F", "B", "CALL", "RET", "NOP", "EXIT", "U"), ("others", 1)),
}
INTEGERS = "integers", 2


def instructions(code: bytes, kernel: str) -> Counter[str] | None:
    """Instructions of a step of a kernel, by name; None without a disassembler.

    They are those of the longest loop that has no other loop within.
    """
    try:
        paths = files("nvidia-cuda-nvdisasm") or []
    except PackageNotFoundError:
        return None
    [tool] = (x.locate() for x in paths if x.name == "nvdisasm")
    with tempfile.NamedTemporaryFile(suffix=".cubin") as file:
        file.write(code)
        file.flush()
        command = [str(tool), "-c", file.name]
        text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    text = text[text.index(f".text.{kernel}:") :].partition(".section")[0]
    names: list[str] = []
    labels: dict[str, int] = {}
    loops: list[range] = []
    for line in text.splitlines():
        if label := re.match(r"(\.L_x_\d+):", line):
            labels[label[1]] = len(names)
        elif found := re.match(r"\s+/\*\w{4,}\*/\s+(?:@!?U?P\w+\s+)?([A-Z]\w*)(.*)", line):
            names.append(found[1])
            to = re.search(r"\.L_x_\d+", found[2])
            if found[1] == "BRA" and to and to[0] in labels:
                loops.append(range(labels[to[0]], len(names)))
    inner = [x for x in loops if not any(y.start in x and y.stop < x.stop for y in loops)]
    return Counter(names[k] for k in max(inner, key=len))


def estimate(counts: Counter[str]) -> float:
    """Steps a second of an H200, if the fullest pipe were busy for a share of the time."""
    pipes: Counter[tuple[str, int]] = Counter()
    for name, count in counts.items():
        pipes[next((x for begin, x in PIPES.items() if name.startswith(begin)), INTEGERS)] += count
    busiest = max(counts.total(), *(clocks * count for (_, clocks), count in pipes.items()))
    return SHARE * PARTS * CLOCK * THREADS / busiest


def rows(name: str, folder: Path) -> list[str]:
    """Rows of the table for a robot."""
    made = generate(name, folder, targets=("numpy", "c", "cuda"), verify=False)
    lines = []
    for word in ("float", "double"):
        code, found = machine_code(made, ARCHITECTURE, single=word == "float")
        kernel = KERNEL.format(name)
        of_kernel = found[kernel]
        counts = instructions(code, kernel)
        guess = ["–", "–"] if counts is None else [counts.total(), f"{1e-9 * estimate(counts):.1f}"]
        numbers = (of_kernel.registers, of_kernel.stack, of_kernel.stores, of_kernel.loads, *guess)
        lines.append(f"| {name} | {word} | {' | '.join(map(str, numbers))} |")
    return lines


def main() -> None:
    shipped = sorted(file.stem for file in Path(robots.__file__).parent.glob("*.toml"))
    print("| robot | | registers | stack | stored | loaded | instructions | G steps/s, estimate |")
    print("|---|---|---:|---:|---:|---:|---:|---:|")
    with tempfile.TemporaryDirectory() as folder:
        for name in sys.argv[1:] or shipped:
            print(*rows(name, Path(folder)), sep="\n", flush=True)


if __name__ == "__main__":
    main()
