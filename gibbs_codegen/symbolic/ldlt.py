"""LDLᵀ on a tape: sparse symmetric systems whose zeros are known while the code is written."""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from gibbs_codegen.symbolic.tape import Scalars, Values

Rows = Sequence[Values]


class ZeroPivotError(Exception):
    """A pivot is zero whatever the numbers: nothing determines unknown number `unknown`."""

    def __init__(self, unknown: int) -> None:
        self.unknown = unknown
        super().__init__(f"unknown {unknown}")


def solve_symmetric(
    tape: Scalars, matrix: Rows, right: Values, order: Sequence[int]
) -> list[sp.Expr]:
    """Unknowns of a symmetric system by LDLᵀ; zeros of the matrix cost nothing.

    `matrix` has both triangles, by rows; unknowns are eliminated in `order` and returned in that of
    the rows. Raises `ZeroPivotError` for a pivot that is zero whatever the numbers.
    """
    lower = [list(row) for row in matrix]
    rest = list(right)
    inverse: dict[int, sp.Expr] = {}
    factors: dict[tuple[int, int], sp.Expr] = {}
    for step, k in enumerate(order):
        if lower[k][k] == 0:
            raise ZeroPivotError(k)
        inverse[k] = tape.let(1 / lower[k][k])
        remaining = order[step + 1 :]
        for i in remaining:
            factors[i, k] = tape.let(lower[i][k] * inverse[k])
        for place, i in enumerate(remaining):
            if factors[i, k] == 0:
                continue
            for j in remaining[place:]:
                entry = tape.let(lower[i][j] - tape.let(factors[i, k] * lower[j][k]))
                lower[i][j] = lower[j][i] = entry
            rest[i] = tape.let(rest[i] - tape.let(factors[i, k] * rest[k]))
    solution: dict[int, sp.Expr] = {}
    for step in range(len(order) - 1, -1, -1):
        k = order[step]
        known = [tape.let(factors[i, k] * solution[i]) for i in order[step + 1 :]]
        solution[k] = tape.let(tape.let(rest[k] * inverse[k]) - sp.Add(*known))
    return [solution[k] for k in range(len(order))]


def minimum_degree(matrix: Rows) -> list[int]:
    """Order of elimination that takes, each time, an unknown coupled to the fewest others."""
    graph = _graph(matrix)
    order: list[int] = []
    while graph:
        order.append(min(reversed(graph), key=lambda unknown: len(graph[unknown])))
        _take_out(graph, order[-1])
    return order


def operations_to_solve(matrix: Rows, order: Sequence[int]) -> int:
    """Operations of `solve_symmetric`, signs apart, from where the zeros are alone."""
    graph = _graph(matrix)
    operations = 0
    for unknown in order:
        degree = len(graph[unknown])
        inverse, factors = 1, degree
        products = degree * (degree + 1) // 2
        differences = degree + _take_out(graph, unknown)
        right_and_solution = 1 + 4 * degree
        operations += inverse + factors + products + differences + right_and_solution
    return operations


def _graph(matrix: Rows) -> dict[int, set[int]]:
    """For each unknown, those that it is coupled to."""
    return {
        i: {j for j, entry in enumerate(row) if entry != 0 and j != i}
        for i, row in enumerate(matrix)
    }


def _take_out(graph: dict[int, set[int]], unknown: int) -> int:
    """Eliminate an unknown, which couples its neighbours; returns how many pairs already were."""
    neighbours = graph.pop(unknown)
    coupled = 0
    for i in neighbours:
        graph[i].discard(unknown)
        coupled += len(graph[i] & neighbours)
        graph[i] |= neighbours - {i}
    return coupled // 2
