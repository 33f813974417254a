"""Equation 15 of a chain: its equations of motion, bordered where the chain is constrained."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import sympy as sp

from gibbs_codegen.equations.chain_equation import ChainEquation
from gibbs_codegen.equations.closed_form import closed_system
from gibbs_codegen.equations.definitions import Definition, step_names
from gibbs_codegen.equations.item_motions import ItemMotions
from gibbs_codegen.equations.normal_form import TooLongError, collected
from gibbs_codegen.equations.notation import Kind, Name
from gibbs_codegen.equations.readable_chain import generalised_forces, readable_chain
from gibbs_codegen.robot.model import Robot


def equations_of_motion(robot: Robot, chain: int, most: int) -> ChainEquation:
    """I_jθ̈_j − ζ_{j,4}τ'_j = R_j + F_j with ζᵀθ̈_j = 0, or without τ'_j in the last chain.

    This is eq. 15, with I_j and R_j as definitions if they have more than `most` terms together.
    """
    readable = readable_chain(robot, chain)
    forces = [collected(f, readable.symbolic.u, 1000) for f in generalised_forces(readable)]
    closed, names = True, readable.names
    steps: Sequence[Definition] = ()
    try:
        matrix, residual = closed_system(robot, chain, most)
    except TooLongError:
        motions = ItemMotions(robot, chain, accelerated=False)
        closed, names = False, motions.names
        matrix, residual, steps = motions.linear_system()
        for i, (armature, force) in enumerate(readable.passive):
            matrix[i][i] += armature
            residual[i] += force
    named = _NamedEntries(chain, dict(names), [*readable.definitions, *steps])
    places = range(len(residual))
    symbols = {
        (i, j): named.entry("I", (i, j), matrix[i][j]) for i in places for j in places if i <= j
    }
    shown_residual = tuple(named.entry("R", (i,), residual[i]) for i in places)
    shown_forces = tuple(named.entry("F", (i,), forces[i]) for i in places)
    return ChainEquation(
        robot.name,
        chain,
        15,
        f"Equations of motion of chain {chain}",
        named.names | step_names(named.lines),
        tuple(named.lines),
        tuple(readable.state.accelerations),
        readable.torques,
        readable.held,
        tuple(tuple(symbols[min(i, j), max(i, j)] for j in places) for i in places),
        shown_residual,
        shown_forces,
        closed=closed,
        quasi=readable.quasi,
    )


class _NamedEntries:
    """Entries of I_j, R_j and F_j, defined line by line."""

    def __init__(self, chain: int, names: dict[sp.Symbol, Name], lines: list[Definition]) -> None:
        self._chain = chain
        self.names = names
        self.lines = lines

    def entry(self, letter: str, places: Iterable[int], value: sp.Expr) -> sp.Expr:
        """Symbol of an entry of I, R or F at its places from 0, which it defines, or zero."""
        if value == 0:
            return value
        text = ",".join(str(place + 1) for place in places)
        symbol = sp.Symbol(f"{letter}({text})")
        latex = f"{letter}_{{{self._chain}}}^{{({text})}}"
        self.names[symbol] = Name(latex, f"{letter}_{self._chain}({text})", Kind.RESULT, "")
        self.lines.append((symbol, value))
        return symbol
