"""One equation of the paper for one chain, as plain values: what notebooks and `show` lay out."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.equations.definitions import Definition
from gibbs_codegen.equations.notation import Name


@dataclass(frozen=True)
class Place:
    """A row of the hybrid system that one of the chain's unknowns stands for, counted from −1."""

    item: int
    unknown: Name
    hybrid: Name
    row: int


@dataclass(frozen=True)
class ChainEquation:
    """One equation of the paper for one chain.

    `lines` define symbols in order, each by earlier ones: with them it is complete. `names` has the
    symbols as they are written. `accelerations` are those of the coordinates, `quasi` tells whether
    the base's are rates of quasi-velocities. `torques` are the constraint torques and `held` the
    places, from 0, of what they hold among the accelerations; `matrix`, `residual` and `forces`
    (eq. 15) hold the symbols that `lines` define, or zero. `places` and `inputs` (eq. 18) pair the
    chain's symbols with the hybrid system's. `closed` tells whether the lines are closed forms.
    `frames` are rows of the items' coordinates, γ, x, y, z, α, d and θ (m, °), from item 4 on.
    """

    robot: str
    chain: int
    number: int
    title: str
    names: dict[sp.Symbol, Name]
    lines: tuple[Definition, ...] = ()
    accelerations: tuple[sp.Symbol, ...] = ()
    torques: tuple[sp.Symbol, ...] = ()
    held: tuple[int, ...] = ()
    matrix: tuple[tuple[sp.Expr, ...], ...] = ()
    residual: tuple[sp.Expr, ...] = ()
    forces: tuple[sp.Expr, ...] = ()
    places: tuple[Place, ...] = ()
    inputs: tuple[tuple[Name, Name], ...] = ()
    closed: bool = True
    quasi: bool = False
    frames: tuple[tuple[sp.Expr, ...], ...] = ()

    @property
    def bordered(self) -> list[list[list[sp.Expr]]]:
        """Matrix, unknowns, R and F of eq. 15, bordered where the chain is constrained."""
        zero, one = sp.S.Zero, sp.S.One
        matrix = [list(row) for row in self.matrix]
        vectors = [list(self.accelerations), list(self.residual), list(self.forces)]
        border = [[one if i == place else zero for place in self.held] for i in range(len(matrix))]
        matrix = [[*row, *(-z for z in zeta)] for row, zeta in zip(matrix, border, strict=True)]
        for column, torque in zip(zip(*border, strict=True), self.torques, strict=True):
            matrix.append([*column, *[zero] * len(self.torques)])
            for vector, last in zip(vectors, (torque, zero, zero), strict=True):
                vector.append(last)
        return [matrix, *vectors]
