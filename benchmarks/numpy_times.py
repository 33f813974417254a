"""Time the NumPy target against Pinocchio in one run: `python benchmarks/numpy_times.py`.

Both are called from Python, on the benchmark family and the same states; the ratio is what carries
to other machines. Pinocchio computes the mass matrix (crba) and the nonlinear effects of the same
tree with a rigid base, so that it has the same coordinates.
"""

from __future__ import annotations

import sys
import timeit
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
from rich.console import Console
from rich.table import Table

sys.path[:0] = [
    str(Path(__file__).parent),
    str(Path(__file__).parents[1]),
    str(Path(__file__).parents[1] / "tests"),
]

from family import benchmark_robot  # noqa: E402
from support.emitted import emitted_module  # noqa: E402
from support.pinocchio_oracle import Oracle  # noqa: E402

STATES = 1000


def best(call: Callable[[], object], number: int) -> float:
    """Smallest of five means over `number` calls, in µs."""
    return min(timeit.repeat(call, number=number, repeat=5)) / number * 1e6


def main() -> None:
    """Print times per state, after checking that both give the same numbers."""
    table = Table(title="Mass matrix and residual, µs per state")
    for column in ("n", "one state", f"batch of {STATES}", "Pinocchio", "one ratio", "batch ratio"):
        table.add_column(column, justify="right")
    for links in (3, 7, 30):
        robot = benchmark_robot(links)
        module, oracle = emitted_module(robot), Oracle(robot, rigid_base=True)
        rng = np.random.default_rng(0)
        q, v = rng.uniform(-1, 1, (2, STATES, len(module.COORDINATES)))
        tree_q, tree_v = oracle.spread(q[0]), oracle.spread(v[0])

        def theirs(oracle=oracle, q=tree_q, v=tree_v) -> tuple[np.ndarray, np.ndarray]:
            matrix = pin.crba(oracle.model, oracle.data, q)
            return matrix, pin.nonLinearEffects(oracle.model, oracle.data, q, v)

        both, order = module.mass_matrix_and_residual, oracle.order
        matrix, residual = both(q[0], v[0])
        peer_matrix, effects = theirs()
        np.testing.assert_allclose(matrix, peer_matrix[np.ix_(order, order)], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(residual, -effects[order], rtol=1e-9, atol=1e-9)
        one = best(lambda f=both, q=q[0], v=v[0]: f(q, v), 200)
        batch = best(lambda f=both, q=q, v=v: f(q, v), 5) / STATES
        peer = best(theirs, 500)
        cells = [f"{value:.2f}" for value in (one, batch, peer, peer / one, peer / batch)]
        table.add_row(str(links), *cells)
    Console(width=100).print(table)


if __name__ == "__main__":
    main()
