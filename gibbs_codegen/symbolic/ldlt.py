"""LDLᵀ on a tape: sparse symmetric systems whose zeros are known while the code is written."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import sympy as sp

from gibbs_codegen.symbolic.choices import above, chosen
from gibbs_codegen.symbolic.tape import Scalars, Values, times

Rows = Sequence[Values]
Safe = Callable[[int, sp.Expr], tuple[sp.Expr, sp.Expr]]
_NOTHING = sp.Rational(1, 10**30)


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


class Factors:
    """L D Lᵀ of a symmetric matrix in the order of its rows, to be used for many right sides.

    `safe` tells of a pivot, by its number, whether it is there, 1 or 0, and what to divide by. A
    pivot that is not there, and its column of L, are left out.
    """

    def __init__(self, tape: Scalars, matrix: Rows, safe: Safe | None = None) -> None:
        self._tape, self._size = tape, len(matrix)
        self.inverse: list[sp.Expr] = []
        self.lower: dict[tuple[int, int], sp.Expr] = {}
        self.there: list[sp.Expr] = []
        rest = [list(row) for row in matrix]
        for k in range(self._size):
            pivot, there = rest[k][k], sp.S.One
            if safe is None and pivot == 0:
                raise ZeroPivotError(k)
            if safe is not None:
                there, pivot = safe(k, pivot)
            self.there.append(there)
            self.inverse.append(tape.let(times(there, tape.let(1 / pivot))))
            after = range(k + 1, self._size)
            for i in after:
                self.lower[i, k] = tape.let(times(rest[i][k], self.inverse[k]))
            for i in after:
                for j in range(i, self._size) if self.lower[i, k] != 0 else ():
                    entry = tape.let(rest[i][j] - tape.let(times(self.lower[i, k], rest[j][k])))
                    rest[i][j] = rest[j][i] = entry

    def eliminated(self, right: Values) -> list[sp.Expr]:
        """L⁻¹ b."""
        rest = list(right)
        for k in range(self._size):
            for i in range(k + 1, self._size):
                rest[i] = self._tape.let(rest[i] - self._tape.let(times(self.lower[i, k], rest[k])))
        return rest

    def scaled(self, values: Values) -> list[sp.Expr]:
        """D⁻¹ y."""
        return [
            self._tape.let(times(entry, by)) for entry, by in zip(values, self.inverse, strict=True)
        ]

    def solved(self, right: Values) -> list[sp.Expr]:
        """The x of L D Lᵀ x = b."""
        found = self.scaled(self.eliminated(right))
        for k in range(self._size - 1, -1, -1):
            known = [
                self._tape.let(times(self.lower[i, k], found[i])) for i in range(k + 1, self._size)
            ]
            found[k] = self._tape.let(found[k] - sp.Add(*known))
        return found


class PseudoInverse:
    """The pseudo-inverse of a semi-definite matrix: of all solutions that which is least.

    Pivots are absent that are no more than √ε of the entry of the matrix that they are left of,
    with the rounding error ε: then no error of what is left is taken for a pivot, even where
    another is hardly more. So are those that nothing but rounding is left in, next to rows that
    are there: rows of zeros count for nothing.
    """

    def __init__(self, tape: Scalars, matrix: Rows, rounding: sp.Expr) -> None:
        self._tape, size, one = tape, len(matrix), sp.S.One
        sizes = [matrix[k][k] for k in range(size)]
        share = tape.let(sp.sqrt(rounding))
        whole = tape.let(tape.let(rounding * tape.let(sp.Add(*sizes))) + _NOTHING)

        def there(k: int, pivot: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
            least = tape.let(tape.let(share * sizes[k]) + whole)
            found = above(tape, tape.let(pivot - least))
            return found, chosen(tape, found, pivot, one)

        self._factors = factors = Factors(tape, matrix, there)
        # L₁ by rows, its columns from the last to the first, and L₁ᵀL₁ with ones for columns that
        # are not there. In this order no pivot is less than 1.
        self._rows = [
            [
                factors.lower[i, k] if k < i else factors.there[i] if k == i else sp.S.Zero
                for k in range(size - 1, -1, -1)
            ]
            for i in range(size)
        ]
        columns = [*zip(*self._rows, strict=True)]
        squares = [[tape.let(sp.Add(*map(times, x, y))) for x in columns] for y in columns]
        for k, column in enumerate(columns):
            others = [x for i, x in enumerate(column) if i != size - 1 - k]
            squares[k][k] = tape.let(sp.Add(one, *map(times, others, others)))

        def at_least_one(k: int, pivot: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
            return one, chosen(tape, above(tape, tape.let(pivot - 1)), pivot, one)

        self._squares = Factors(tape, squares, at_least_one)

    def solved(self, right: Values) -> list[sp.Expr]:
        """The x that is least of those for which A x is next to b."""
        tape, rows = self._tape, self._rows
        inner = [tape.sum_of_products(column, right) for column in zip(*rows, strict=True)]
        inner = self._factors.scaled(self._squares.solved(inner)[::-1])
        inner = self._squares.solved(inner[::-1])
        return [tape.sum_of_products(row, inner) for row in rows]
