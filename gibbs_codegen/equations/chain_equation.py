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
    symbols as they are written. `coordinates` are the accelerations, `torque` the constraint torque
    or None; `matrix`, `residual` and `forces` (eq. 15) hold the symbols that `lines` define, or
    zero. `places` and `inputs` (eq. 18) pair the chain's symbols with the hybrid system's.
    `closed` tells whether the lines are closed forms.
    """

    robot: str
    chain: int
    number: int
    title: str
    names: dict[sp.Symbol, Name]
    lines: tuple[Definition, ...] = ()
    accelerations: tuple[sp.Symbol, ...] = ()
    torque: sp.Symbol | None = None
    matrix: tuple[tuple[sp.Expr, ...], ...] = ()
    residual: tuple[sp.Expr, ...] = ()
    forces: tuple[sp.Expr, ...] = ()
    places: tuple[Place, ...] = ()
    inputs: tuple[tuple[Name, Name], ...] = ()
    closed: bool = True

    @property
    def bordered(self) -> list[list[list[sp.Expr]]]:
        """Matrix, unknowns, R and F of eq. 15, bordered where the chain is constrained."""
        zero, one = sp.S.Zero, sp.S.One
        matrix = [list(row) for row in self.matrix]
        vectors = [list(self.accelerations), list(self.residual), list(self.forces)]
        if self.torque is not None:
            zeta = [one if i == 3 else zero for i in range(len(matrix))]
            matrix = [[*row, -z] for row, z in zip(matrix, zeta, strict=True)] + [[*zeta, zero]]
            for vector, last in zip(vectors, (self.torque, zero, zero), strict=True):
                vector.append(last)
        return [matrix, *vectors]
