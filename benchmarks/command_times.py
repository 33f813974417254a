"""Time commands as whole processes: `python benchmarks/command_times.py`."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

from rich.console import Console
from rich.table import Table

sys.path[:0] = [str(Path(__file__).parent)]

from family import benchmark_robot  # noqa: E402

from gibbs_codegen.robot.text import robot_text  # noqa: E402

RUNS = 5


def seconds(arguments: list[str], folder: str) -> list[float]:
    """Wall time of each of five processes, sorted."""
    times = []
    for _ in range(RUNS):
        start = time.perf_counter()
        command = [sys.executable, "-m", "gibbs_codegen", *arguments]
        subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)
        times.append(time.perf_counter() - start)
    return sorted(times)


def main() -> None:
    """Print the median and the range for each command."""
    table = Table(title=f"Whole process, seconds, {RUNS} runs")
    for column in ("command", "median", "least", "most"):
        table.add_column(column)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "benchmark_30.toml").write_text(robot_text(benchmark_robot(30)))
        for arguments in (
            ["--help"],
            ["generate", "hexarotor_3link"],
            ["generate", "--rotors", "6", "--links", "30"],
            ["generate", "benchmark_30.toml"],
            ["generate", "--rotors", "40", "--links", "3"],
        ):
            times = seconds(arguments, folder)
            cells = [f"{t:.2f}" for t in (median(times), times[0], times[-1])]
            table.add_row(" ".join(arguments), *cells)
    Console(width=100).print(table)


if __name__ == "__main__":
    main()
