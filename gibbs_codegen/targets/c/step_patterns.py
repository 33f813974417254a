"""Which entries of the derivatives of a time step can differ from zero.

The functions that a step calls have patterns; those of what is done one after the other are
products of them.
"""

from __future__ import annotations

from gibbs_codegen.interface import FUNCTIONS
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.patterns import patterns
from gibbs_codegen.robot.coordinates import inputs
from gibbs_codegen.robot.layout import layout_of

Pairs = frozenset[tuple[int, int]]


def step_patterns(model: Model, name: str) -> dict[str, Pairs]:
    """Rows and columns of A and B of "step_euler" or "step_rk4", in the tangent space.

    The model has the derivatives of steps.
    """
    size, width = layout_of(model.robot).v.size, len(inputs(model.robot))
    known = patterns(model)

    def of(matrix: str, row: int = 0, column: int = 0) -> Pairs:
        pattern = known[matrix]
        return frozenset(
            (row + i, column + j) for i, j in zip(pattern.rows, pattern.columns, strict=True)
        )

    # A state is q and v, and behind it are the inputs, which stay as they are.
    every = frozenset((i, i) for i in range(2 * size + width))
    accelerated = every | of("acceleration_dq", size) | of("acceleration_dv", size, size)
    accelerated |= of("acceleration_du", size, 2 * size)
    moved = every | of("coordinates_dq") | of("coordinates_dv", 0, size)
    stage = _product(moved, accelerated)
    whole = stage
    stages = FUNCTIONS[f"{name}_derivatives"].composed["forward_dynamics_derivatives"]
    for _ in range(1, stages):
        whole = _product(stage, whole)
    states = {(i, j) for i, j in whole if i < 2 * size}
    return {
        "A": frozenset((i, j) for i, j in states if j < 2 * size),
        "B": frozenset((i, j - 2 * size) for i, j in states if j >= 2 * size),
    }


def _product(left: Pairs, right: Pairs) -> Pairs:
    """Pattern of a product of matrices."""
    columns: dict[int, set[int]] = {}
    for i, j in right:
        columns.setdefault(i, set()).add(j)
    return frozenset((i, j) for i, k in left for j in columns.get(k, ()))
