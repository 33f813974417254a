"""Matrices that CasADi is given: where their entries are in its scratch, and their patterns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Block:
    """A matrix: the place in scratch of each entry, by row and column, that can be other than zero.

    It is what CasADi calls sparse: entries without a place are no part of it.
    """

    rows: int
    columns: int
    places: Mapping[tuple[int, int], int]

    @property
    def transposed(self) -> Block:
        """The same with rows for columns."""
        places = {(column, row): place for (row, column), place in self.places.items()}
        return Block(self.columns, self.rows, places)

    @property
    def gathered(self) -> list[int]:
        """Places of the entries, column by column."""
        return [self.places[at] for at in self._ordered]

    @property
    def pattern(self) -> tuple[int, ...]:
        """The pattern as CasADi has it: sizes, where each column begins, and the rows."""
        if len(self.places) == self.rows * self.columns:
            return dense_pattern(self.rows, self.columns)
        ordered = self._ordered
        begins = [sum(column < j for _, column in ordered) for j in range(self.columns + 1)]
        return (self.rows, self.columns, *begins, *(row for row, _ in ordered))

    @property
    def stored_at(self) -> int | None:
        """Where it begins if it is all there and stands row by row in scratch; otherwise None."""
        start = self.places.get((0, 0))
        if start is None or len(self.places) < self.rows * self.columns:
            return None
        row_by_row = all(
            place == start + i * self.columns + j for (i, j), place in self.places.items()
        )
        return start if row_by_row else None

    @property
    def _ordered(self) -> list[tuple[int, int]]:
        return sorted(self.places, key=lambda at: (at[1], at[0]))


@dataclass(frozen=True)
class Matrix:
    """An array in scratch, row by row from `start`, and which of its entries can be nonzero."""

    start: int
    rows: int
    columns: int
    nonzeros: frozenset[tuple[int, int]]

    def part(self, row: int, rows: int, column: int, columns: int) -> Block:
        """A block by its first row and column, and how many there are of each."""
        places = {
            (i - row, j - column): self.start + i * self.columns + j
            for i, j in self.nonzeros
            if row <= i < row + rows and column <= j < column + columns
        }
        return Block(rows, columns, places)

    @property
    def whole(self) -> Block:
        """All of it."""
        return self.part(0, self.rows, 0, self.columns)

    @property
    def filled(self) -> Block:
        """All of it, also what is zero at every state."""
        every = entries(self.rows, self.columns)
        return Matrix(self.start, self.rows, self.columns, every).whole


def entries(rows: int, columns: int) -> frozenset[tuple[int, int]]:
    """Pairs of every row with every column."""
    return frozenset((i, j) for i in range(rows) for j in range(columns))


def dense_pattern(rows: int, columns: int) -> tuple[int, ...]:
    """The pattern of a matrix without zeros, as CasADi has it: three integers."""
    return (rows, columns, 1)


def empty(rows: int, columns: int) -> Block:
    """A matrix of zeros: a block without places."""
    return Block(rows, columns, {})


def column_by_column(block: Block, columns: int) -> Block:
    """Derivatives of a matrix's entries in the order that CasADi stacks these in, by columns.

    `block` has a row for each entry of the matrix, row by row; `columns` is 1 of a vector.
    """
    rows = block.rows // columns
    places = {
        (row % columns * rows + row // columns, column): place
        for (row, column), place in block.places.items()
    }
    return Block(block.rows, block.columns, places)


def by_coordinates(nonzeros: Iterable[tuple[int, int]]) -> frozenset[tuple[int, int]]:
    """Pattern of derivatives by the entries of q from that of those by the base's velocities.

    In place of the base's six columns come seven, of position and quaternion.
    """
    found: set[tuple[int, int]] = set()
    for i, j in nonzeros:
        targets = range(3) if j < 3 else range(3, 7) if j < 6 else (j + 1,)
        found.update((i, target) for target in targets)
    return frozenset(found)
