"""LDLᵀ on a tape: sparse symmetric systems whose zeros are known while the code is written."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import sympy as sp

from gibbs_codegen.symbolic.choices import above, or_one
from gibbs_codegen.symbolic.tape import Scalars, Values, times

Rows = Sequence[Values]
Safe = Callable[[int, sp.Expr], tuple[sp.Expr, sp.Expr]]
_NOTHING = sp.Rational(1, 10**30)
# How much larger than rounding the errors of vectors may be beside the largest.
_LOST = sp.Integer(100)
# How many times rounding, as a share, pivots are that are there.
_SHARE = sp.Integer(10)


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
            factors[i, k] = tape.let(times(lower[i][k], inverse[k]))
        for place, i in enumerate(remaining):
            if factors[i, k] == 0:
                continue
            for j in remaining[place:]:
                entry = tape.less(lower[i][j], tape.let(times(factors[i, k], lower[j][k])))
                lower[i][j] = lower[j][i] = entry
            rest[i] = tape.less(rest[i], tape.let(times(factors[i, k], rest[k])))
    solution: dict[int, sp.Expr] = {}
    for step in range(len(order) - 1, -1, -1):
        k = order[step]
        solved = [tape.let(times(factors[i, k], solution[i])) for i in order[step + 1 :]]
        solution[k] = tape.less(tape.let(times(rest[k], inverse[k])), *solved)
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
    """L D Lᵀ of a symmetric matrix in the order of its rows, to be used for many right sides."""

    def __init__(self, tape: Scalars, matrix: Rows) -> None:
        self._tape, self._size = tape, len(matrix)
        self.inverse: list[sp.Expr] = []
        self.lower: dict[tuple[int, int], sp.Expr] = {}
        rest = [list(row) for row in matrix]
        for k in range(self._size):
            if rest[k][k] == 0:
                raise ZeroPivotError(k)
            self.inverse.append(tape.let(1 / rest[k][k]))
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
        return self.solved_back(self.scaled(self.eliminated(right)))

    def solved_back(self, right: Values) -> list[sp.Expr]:
        """L⁻ᵀ b."""
        solution = list(right)
        for k in range(self._size - 1, -1, -1):
            solved = [
                self._tape.let(times(self.lower[i, k], solution[i]))
                for i in range(k + 1, self._size)
            ]
            solution[k] = self._tape.let(solution[k] - sp.Add(*solved))
        return solution


class _Orthogonal(Factors):
    """L D Lᵀ of the matrix w_i·W w_j, of vectors w by rows and weights W, without the matrix.

    Each vector is taken out of all that follow: what is left of a vector has the error of a vector,
    where what is left of the matrix has that of its square (modified Gram–Schmidt). `safe` tells of
    a pivot, by its number, whether it is there, 1 or 0, and what to divide by; one that is not
    there and its column of L are left out. `vectors` are L⁻¹ of the given ones.
    """

    def __init__(self, tape: Scalars, vectors: Rows, weights: Values, safe: Safe) -> None:
        self._tape, self._size = tape, len(vectors)
        self.inverse, self.lower, self.there = [], {}, []
        self.vectors = rest = [list(row) for row in vectors]
        for k, row in enumerate(rest):
            scaled = [tape.let(times(x, y)) for x, y in zip(row, weights, strict=True)]
            there, pivot = safe(k, tape.sum_of_products(row, scaled))
            self.there.append(there)
            self.inverse.append(tape.let(times(there, tape.let(1 / pivot))))
            for i in range(k + 1, self._size):
                product = tape.sum_of_products(rest[i], scaled)
                factor = self.lower[i, k] = tape.let(times(product, self.inverse[k]))
                pairs = zip(rest[i], row, strict=True)
                rest[i] = [tape.let(x - tape.let(times(factor, y))) for x, y in pairs]


class PseudoInverse:
    """The pseudo-inverse of the matrix w_i·W w_j: it gives the least of all solutions.

    Pivots are absent that are about ε of the entry of the matrix that they are left of, with the
    rounding error ε: of vectors that is √ε, so that no error of what is left is taken for a pivot,
    even where another is hardly more. So are those that nothing but rounding is left in, next to
    rows that are there: rows of zeros count for nothing.
    """

    def __init__(
        self, tape: Scalars, vectors: Rows, weights: Values, sizes: Values, rounding: sp.Expr
    ) -> None:
        """It takes vectors by rows; `sizes` are the diagonal of the matrix."""
        self._tape, size, one, zero = tape, len(vectors), sp.S.One, sp.S.Zero
        noise, share = tape.let(_LOST * rounding), tape.let(_SHARE * rounding)
        whole = tape.let(tape.let(noise * noise) * tape.let(sp.Add(*sizes)) + _NOTHING)

        def there(k: int, pivot: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
            least = tape.let(tape.let(share * sizes[k]) + whole)
            large = above(tape, tape.let(pivot - least))
            return large, or_one(tape, large, pivot)

        self._factors = factors = _Orthogonal(tape, vectors, weights, there)
        # L₁ = Q R by columns from the last to the first: in this order none that is there gets
        # shorter than 1.
        columns = [
            [factors.there[k] if i == k else factors.lower.get((i, k), zero) for i in range(size)]
            for k in range(size - 1, -1, -1)
        ]

        def at_least_one(_: int, pivot: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
            return one, or_one(tape, above(tape, tape.let(pivot - 1)), pivot)

        self._turned = _Orthogonal(tape, columns, [one] * size, at_least_one)

    def solved(self, right: Values) -> list[sp.Expr]:
        """The x that is least of those for which A x is next to b: Q R⁻ᵀ D⁻¹ R⁻¹ Qᵀ b."""
        tape, turned = self._tape, self._turned
        inner = turned.scaled([tape.sum_of_products(row, right) for row in turned.vectors])
        inner = self._factors.scaled(turned.solved_back(inner)[::-1])
        inner = turned.scaled(turned.eliminated(inner[::-1]))
        return tape.combination(inner, turned.vectors)

    def projected(self, right: Values) -> list[sp.Expr]:
        """A A⁺ b, without the digits that A⁺ loses: Q Qᵀ b."""
        turned = self._turned
        inner = [self._tape.sum_of_products(row, right) for row in turned.vectors]
        return self._tape.combination(turned.scaled(inner), turned.vectors)
