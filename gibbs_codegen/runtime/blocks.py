"""Blocks of states side by side, as C takes them: entry e of a lane is at [e * lanes + lane]."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.interface import LANES

Reals = NDArray[Any]
# Bytes to a multiple of which blocks are laid, so that a number of them is one load.
_ALIGNMENT = 64


@dataclass(frozen=True)
class Blocks:
    """Blocks of so many lanes, in single or double precision."""

    lanes: int
    single: bool = False

    @classmethod
    def widest(cls, *, single: bool = False) -> Blocks:
        """Blocks as wide as those of a module's functions."""
        return cls(2 * LANES if single else LANES, single)

    @property
    def real(self) -> np.dtype[Any]:
        """Type of the numbers."""
        return np.dtype(np.float32 if self.single else np.float64)

    def count(self, states: int) -> int:
        """The number of blocks that states take."""
        return -(-states // self.lanes)

    def filled(self, *shape: int) -> Reals:
        """Zeros that begin where a block may."""
        if self.lanes == 1:
            return np.zeros(shape, dtype=self.real)
        size = self.real.itemsize * math.prod(shape)
        memory = np.zeros(size + _ALIGNMENT, dtype=np.uint8)
        begin = -memory.ctypes.data % _ALIGNMENT
        return memory[begin : begin + size].view(self.real).reshape(shape)

    def of_rows(self, rows: Reals) -> Reals:
        """Rows (n, entries) in blocks (blocks, entries, lanes); the last row fills up the last."""
        states, entries = rows.shape
        if self.lanes == 1:
            return np.array(rows, dtype=self.real, order="C")[..., np.newaxis]
        blocks = self.filled(self.count(states), entries, self.lanes)
        places = np.minimum(np.arange(len(blocks) * self.lanes), states - 1)
        blocks[...] = np.swapaxes(rows[places].reshape(len(blocks), self.lanes, entries), 1, 2)
        return blocks

    def to_rows(self, blocks: Reals, states: int) -> Reals:
        """Rows (states, …) of blocks (blocks, …, lanes)."""
        if self.lanes == 1:
            return blocks[..., 0]
        rows = np.moveaxis(blocks, -1, 1)
        rows = rows.reshape(len(blocks) * self.lanes, *rows.shape[2:])
        return np.ascontiguousarray(rows[:states])


# One state after the other.
ONE = Blocks(1)
