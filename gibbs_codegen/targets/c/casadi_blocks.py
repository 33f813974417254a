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
        """A block of it.

        Args:
            row, rows: The first row, and how many there are.
            column, columns: The same of columns.

        Returns:
            The block.
        """
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
    """Every row with every column.

    Args:
        rows, columns: How many there are.

    Returns:
        Pairs.
    """
    return frozenset((i, j) for i in range(rows) for j in range(columns))


def dense_pattern(rows: int, columns: int) -> tuple[int, ...]:
    """The pattern of a matrix without zeros, as CasADi has it.

    Args:
        rows, columns: Its sizes.

    Returns:
        Three integers.
    """
    return (rows, columns, 1)


def empty(rows: int, columns: int) -> Block:
    """A matrix of zeros.

    Args:
        rows, columns: Its sizes.

    Returns:
        A block without places.
    """
    return Block(rows, columns, {})


def column_by_column(block: Block, columns: int) -> Block:
    """Derivatives of a matrix's entries in the order that CasADi stacks these in.

    Args:
        block: A row for each entry of the matrix, row by row.
        columns: Number of columns of the matrix; 1 of a vector.

    Returns:
        The same rows, column of the matrix by column.
    """
    rows = block.rows // columns
    places = {
        (row % columns * rows + row // columns, column): place
        for (row, column), place in block.places.items()
    }
    return Block(block.rows, block.columns, places)


def by_coordinates(nonzeros: Iterable[tuple[int, int]]) -> frozenset[tuple[int, int]]:
    """Pattern of derivatives by the entries of q from that of those by the velocities of the base.

    Args:
        nonzeros: Rows and columns, of which the first six are those of the base.

    Returns:
        Rows and columns, of which the first seven are position and quaternion.
    """
    found: set[tuple[int, int]] = set()
    for i, j in nonzeros:
        targets = range(3) if j < 3 else range(3, 7) if j < 6 else (j + 1,)
        found.update((i, target) for target in targets)
    return frozenset(found)
