"""What is timed: a compiled function behind one interface, and how its numbers are laid out.

`function(q, v, tau, first, second)` takes five pointers to doubles. For the mass matrix and
residual it leaves the matrix in `first` and the residual, or minus it, in `second`; for forward
dynamics the accelerations in `first`; for derivatives a vector and three matrices in `first`, one
after the other. A contender of width 8 takes eight states a call, each entry eight times in a row,
from memory that starts at a multiple of 64 bytes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

Array = np.ndarray
States = tuple[Array, Array, Array]
Results = tuple[Array, ...]

MASS_MATRIX_AND_RESIDUAL = "mass matrix and residual"
FORWARD_DYNAMICS = "forward dynamics"
TASKS = (MASS_MATRIX_AND_RESIDUAL, FORWARD_DYNAMICS)

LANES = 8


@dataclass(frozen=True)
class Contender:
    """One tool at one task, for one robot.

    `inputs` turns (q, v, τ), one row a state in the project's coordinates, into the tool's own,
    one row a state; `outputs` turns those states and rows of `first` and `second` into what
    `reference` gives: (M, R), or the accelerations alone. A tool that leaves results in its own
    memory has a `fetch(first, second)` that copies them out, which is not timed. `room` is the
    number of entries of `first`, if it is not a matrix of the velocities.
    """

    name: str
    task: str
    width: int
    function: Any
    inputs: Callable[[States], States]
    outputs: Callable[[States, Array, Array], Results]
    fetch: Any = None
    room: int = 0

    def memory(self, size: int) -> tuple[Array, Array]:
        """Room for `first` and `second` of one call, for a robot of `size` velocities."""
        return aligned((self.room or size * size) * self.width), aligned(size * self.width)


def aligned(*shape: int) -> Array:
    """Zeros that start at a multiple of 64 bytes."""
    size = int(np.prod(shape))
    memory = np.zeros(size + LANES)
    start = (-memory.ctypes.data % 64) // memory.itemsize
    return memory[start : start + size].reshape(shape)


def packed(rows: Array, width: int) -> Array:
    """Rows as blocks of `width` states, (blocks, entries, width)."""
    blocks = aligned(len(rows) // width, rows.shape[1], width)
    blocks[:] = rows.reshape(-1, width, rows.shape[1]).transpose(0, 2, 1)
    return blocks


def unpacked(blocks: Array) -> Array:
    """Rows of the states in blocks."""
    return blocks.transpose(0, 2, 1).reshape(-1, blocks.shape[1])


def results(contender: Contender, states: States) -> Results:
    """What a contender computes, in the project's coordinates."""
    count, size = states[1].shape
    blocks = [packed(rows, contender.width) for rows in contender.inputs(states)]
    entries = contender.room or size * size
    first = aligned(count // contender.width, entries, contender.width)
    second = aligned(count // contender.width, size, contender.width)
    for *given, one, two in zip(*blocks, first, second, strict=True):
        contender.function(*(block.ctypes.data for block in (*given, one, two)))
        if contender.fetch is not None:
            contender.fetch(one.ctypes.data, two.ctypes.data)
    return contender.outputs(states, unpacked(first), unpacked(second))


@dataclass(frozen=True)
class Ordered:
    """Layout of a tool whose k-th velocity is the project's `order[k]`; coordinates likewise."""

    order: tuple[int, ...]
    coordinates: tuple[int, ...]

    def inputs(self, states: States) -> States:
        """States in the tool's order."""
        q, v, tau = states
        return q[:, self.coordinates], v[:, self.order], tau[:, self.order]

    def matrices(self, rows: Array) -> Array:
        """Square matrices of the tool, row by row, with rows and columns in the project's order."""
        back = np.argsort(self.order)
        return rows.reshape(-1, len(back), len(back))[:, back][:, :, back]

    def matrix_and_residual(self, states: States, first: Array, second: Array) -> Results:
        """M and R of the tool's mass matrix and nonlinear effects, R being minus these."""
        return self.matrices(first), -second[:, np.argsort(self.order)]

    def derivatives(self, states: States, first: Array, second: Array) -> Results:
        """A vector and its three square matrices of derivatives."""
        size = len(self.order)
        vectors, *matrices = np.split(first, size + size**2 * np.arange(3), axis=1)
        return vectors[:, np.argsort(self.order)], *map(self.matrices, matrices)

    def accelerations(self, states: States, first: Array, second: Array) -> Results:
        """Accelerations in the project's order."""
        return (first[:, : len(self.order)][:, np.argsort(self.order)],)
