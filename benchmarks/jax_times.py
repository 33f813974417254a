"""Time the JAX back end against the C back end in one run: `python benchmarks/jax_times.py`.

Both compute forward dynamics, and it with its derivatives by q, v and u, for a batch of states in
float64, from arrays to arrays. JAX's functions are jitted, and results waited for. `--links 3 7`
selects members of the paper's family with six rotors; `--states` is the size of the batch.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from rich.console import Console
from rich.table import Table

from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.runtime.load import load

DERIVATIVES = "forward_dynamics_derivatives"
ROUNDS = 30


class Row(NamedTuple):
    """What was timed: seconds to compile, median of seconds to run, and that over C's."""

    task: str
    compile: float
    run: float
    ratio: float


def jax_times(links: int, states: int, folder: Path) -> list[Row]:
    """Times of the JAX back end, which follow C's round by round.

    Args:
        links: Of the hexarotor's arm.
        states: In the batch.
        folder: Where its module is made.

    Returns:
        A row for each task.
    """
    robot = paper_family(6, links)
    _, made = generate_robot(robot, robot_text(robot), folder, derivatives=DERIVATIVES)
    ours, c = load(made, backend="jax"), load(made, backend="c")
    rng = np.random.default_rng(0)
    q, v = rng.uniform(-1.0, 1.0, (2, states, len(c.COORDINATES)))
    state = q, v, rng.uniform(-1.0, 1.0, (states, len(c.INPUTS)))
    ours.forward_dynamics(*state)  # Compiles the C source, which the C back end needs as well.
    by_all = (0, 1, 2)
    tasks = {
        "forward_dynamics": (ours.forward_dynamics, c.forward_dynamics),
        DERIVATIVES: (ours.forward_dynamics_derivatives, c.forward_dynamics_derivatives),
        "jacfwd(forward_dynamics)": (
            jax.vmap(jax.jacfwd(ours.forward_dynamics, by_all)),
            c.forward_dynamics_derivatives,
        ),
        "jacrev(forward_dynamics)": (
            jax.vmap(jax.jacrev(ours.forward_dynamics, by_all)),
            c.forward_dynamics_derivatives,
        ),
    }
    return [timed(task, *functions, state) for task, functions in tasks.items()]


def timed(
    task: str, function: Callable[..., Any], in_c: Callable[..., Any], state: tuple[Any, ...]
) -> Row:
    """Compile a function and run it, in turns with C."""
    begun = time.perf_counter()
    compiled = jax.jit(function).lower(*state).compile()
    seconds = time.perf_counter() - begun
    arrays = [jax.numpy.asarray(array) for array in state]
    runs, ratios = [], []
    for _ in range(ROUNDS):
        begun = time.perf_counter()
        jax.block_until_ready(compiled(*arrays))
        half = time.perf_counter()
        in_c(*state)
        end = time.perf_counter()
        runs.append(half - begun)
        ratios.append((half - begun) / (end - half))
    return Row(task, seconds, statistics.median(runs), statistics.median(ratios))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--links", type=int, nargs="+", default=[3, 7])
    parser.add_argument("--states", type=int, default=4096)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    for links in options.links:
        table = Table("task", "jit, s", "run, ms", "times C", title=f"{links} links")
        with tempfile.TemporaryDirectory() as folder:
            for row in jax_times(links, options.states, Path(folder)):
                numbers = f"{row.compile:.2f}", f"{row.run * 1e3:.2f}", f"{row.ratio:.2f}"
                table.add_row(row.task, *numbers)
        Console().print(table)


if __name__ == "__main__":
    main()
