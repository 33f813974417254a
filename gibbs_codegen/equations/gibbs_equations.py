"""Equations 2 and 5 of a chain: its Gibbs function S_j, and the partials by the accelerations."""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from gibbs_codegen.equations.chain_equation import ChainEquation
from gibbs_codegen.equations.closed_form import closed_system
from gibbs_codegen.equations.definitions import Definition, step_names
from gibbs_codegen.equations.item_motions import ItemMotions
from gibbs_codegen.equations.normal_form import TooLongError
from gibbs_codegen.equations.notation import Kind, Name, name
from gibbs_codegen.equations.readable_chain import readable_chain
from gibbs_codegen.robot.model import Robot


def gibbs_function(robot: Robot, chain: int, most: int) -> ChainEquation:
    """S_j (eq. 2), up to terms free of accelerations where it is closed: ½θ̈ᵀI_jθ̈ − R_jᵀθ̈.

    If I_j and R_j have more than `most` terms together, it is definitions: S_j is then the sum of
    the items' own.
    """
    readable = readable_chain(robot, chain)
    total, accelerations = sp.Symbol("S"), readable.state.accelerations
    steps: list[Definition] = []
    try:
        matrix, residual = closed_system(robot, chain, most)
        closed, names, meaning = True, readable.names, "Gibbs function (J/s²)"
        half = sp.Rational(1, 2)
        terms = [
            sp.Mul(half if i == j else 1, entry, accelerations[i], accelerations[j])
            for i, row in enumerate(matrix)
            for j, entry in enumerate(row)
            if i <= j
        ]
        for entry, acceleration in zip(residual, accelerations, strict=True):
            terms += [-term * acceleration for term in sp.Add.make_args(entry)]
    except TooLongError:
        motions = ItemMotions(robot, chain)
        closed, names, meaning = False, motions.names, ""
        shares, steps = motions.gibbs_functions()
        terms = []
        for item, share in shares.items():
            symbol = sp.Symbol(f"S_{item}")
            words = "Gibbs function of an item (J/s²)"
            names[symbol] = name("S", f"{chain},{item}", Kind.RESULT, words)
            steps.append((symbol, share))
            terms.append(symbol)
        for (armature, force), a in zip(readable.passive, accelerations, strict=True):
            terms += [sp.Rational(1, 2) * armature * a**2, -force * a]
    lines = (*readable.definitions, *steps, (total, sp.Add(*terms)))
    names = {**names, total: name("S", str(chain), Kind.RESULT, meaning)} | step_names(lines)
    title = f"Gibbs function of chain {chain}"
    return ChainEquation(
        robot.name, chain, 2, title, names, lines, closed=closed, quasi=readable.quasi
    )


def gibbs_partials(robot: Robot, chain: int, most: int) -> ChainEquation:
    """∂S_j/∂θ̈_{j,i} = I_jθ̈_j − R_j (eq. 5), row by row.

    If I_j and R_j have more than `most` terms together, it is definitions.
    """
    readable = readable_chain(robot, chain)
    closed, names, accelerations = True, readable.names, readable.state.accelerations
    steps: Sequence[Definition] = ()
    try:
        matrix, residual = closed_system(robot, chain, most)
        rows = [
            sp.Add(*(entry * a for entry, a in zip(row, accelerations, strict=True)), -rest)
            for row, rest in zip(matrix, residual, strict=True)
        ]
    except TooLongError:
        motions = ItemMotions(robot, chain)
        closed, names = False, motions.names
        rows, steps = motions.partials()
        given = zip(rows, readable.passive, accelerations, strict=True)
        rows = [row + armature * a - force for row, (armature, force), a in given]
    lines = [*readable.definitions, *steps]
    shown = dict(names)
    for a, row in zip(accelerations, rows, strict=True):
        symbol, by = sp.Symbol(f"S_by_{a.name}"), names[a]
        latex = f"\\frac{{\\partial S_{{{chain}}}}}{{\\partial {by.latex}}}"
        shown[symbol] = Name(latex, f"∂S_{chain}/∂{by.text}", Kind.RESULT, "")
        lines.append((symbol, row))
    title = f"Partial derivatives of the Gibbs function of chain {chain}"
    shown |= step_names(lines)
    return ChainEquation(
        robot.name, chain, 5, title, shown, tuple(lines), closed=closed, quasi=readable.quasi
    )
