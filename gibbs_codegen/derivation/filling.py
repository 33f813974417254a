"""Which chain adds to which entry of the hybrid system: what Figs. 7–9 and `info` show."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from gibbs_codegen.derivation.hybrid import chain_matrix, chain_system
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.robot.chains import coupling_map
from gibbs_codegen.robot.coordinates import hybrid_coordinates, inputs
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.symbolic.tape import Tape
from gibbs_codegen.symbolic.vectors import Matrix

Filling = tuple[tuple[tuple[int, ...], ...], ...]
_Open = list[list[list[int]]]


@dataclass(frozen=True)
class FilledEntries:
    """For each entry of I_H, R_H and B_H, the chains that add something to it (Figs. 7–9).

    `matrix` and `inputs` are by rows and columns; `residual` has one column.
    """

    matrix: Filling
    residual: Filling
    inputs: Filling


def filled_matrix(robot: Robot) -> Filling:
    """For each entry of I_H, the chains, by number, whose own matrix (eq. 15) is not zero there."""
    symbolic, size = SymbolicRobot.of(robot, Tape()), len(hybrid_coordinates(robot))
    matrix = _no_entries(size, size)
    for number, places in enumerate(coupling_map(robot), start=1):
        _note(matrix, number, chain_matrix(symbolic, number), places, places)
    return _frozen(matrix)


def filled_entries(robot: Robot) -> FilledEntries:
    """Where each chain's own system (eq. 15) has entries other than zero, by the coupling map."""
    symbolic = SymbolicRobot.of(robot, Tape())
    size, width = len(hybrid_coordinates(robot)), len(inputs(robot))
    matrix, residual, thrust = (_no_entries(size, columns) for columns in (size, 1, width))
    for number, places in enumerate(coupling_map(robot), start=1):
        system = chain_system(symbolic, number)
        _note(matrix, number, system.matrix, places, places)
        _note(residual, number, [[entry] for entry in system.residual], places, (0,))
        _note(thrust, number, system.inputs, places, range(width))
    return FilledEntries(*map(_frozen, (matrix, residual, thrust)))


def _no_entries(rows: int, columns: int) -> _Open:
    return [[[] for _ in range(columns)] for _ in range(rows)]


def _note(
    filling: _Open, number: int, entries: Matrix, rows: Iterable[int], columns: Sequence[int]
) -> None:
    """Note chain `number` in `filling` at `rows` and `columns`, where its entries are not zero."""
    for row, values in zip(rows, entries, strict=True):
        for column, entry in zip(columns, values, strict=True):
            if entry != 0:
                filling[row][column].append(number)


def _frozen(filling: _Open) -> Filling:
    return tuple(tuple(tuple(chains) for chains in row) for row in filling)
