"""Closed forms, for reading and for tests: the same derivation on a tape that names nothing."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import sympy as sp

from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.tree_dynamics import (
    generalised_inertia_forces,
    gibbs_function,
    mass_matrix,
)
from gibbs_codegen.equations.normal_form import TooLongError, collected, count_terms
from gibbs_codegen.equations.readable_chain import chain_state, check_chain, readable_chain
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.symbolic.inline_tape import InlineTape
from gibbs_codegen.symbolic.vectors import Matrix


@dataclass(frozen=True)
class ChainClosedForm:
    """S_j of one open chain and ∂S_j/∂θ̈_{j,i}, as expressions in the robot's symbols.

    `accelerations` are the symbols θ̈_{j,i} in the order of the chain's coordinates; `partials` come
    from the recursion of eq. 5, not from differentiating `gibbs`, so that the two can be compared.
    """

    coordinates: tuple[str, ...]
    accelerations: tuple[sp.Symbol, ...]
    gibbs: sp.Expr
    partials: tuple[sp.Expr, ...]


def chain_closed_form(robot: Robot, number: int) -> ChainClosedForm:
    """Closed form of an open chain (eqs. 2, 3 and 5), which grows about threefold with every link.

    Args:
        robot: The robot.
        number: Of the chain, 1 to N.

    Returns:
        The closed form. A constrained joint keeps its acceleration as a symbol; its rate is zero.

    Raises:
        UsageError: If there is no such chain.
    """
    check_chain(robot, number)
    tape = InlineTape()
    symbolic = SymbolicRobot.of(robot, tape)
    chain, serial = symbolic.open_chains[number - 1]
    state = chain_state(symbolic, chain)
    return ChainClosedForm(
        chain.coordinates,
        tuple(state.accelerations),
        gibbs_function(tape, symbolic.root, serial, state),
        tuple(generalised_inertia_forces(tape, symbolic.root, serial, state)),
    )


@lru_cache(maxsize=8)
def closed_system(robot: Robot, chain: int, most: int) -> tuple[Matrix, list[sp.Expr]]:
    """I_j and R_j (eq. 15) in symbols that read well, collected by products of rates.

    `chain` is from 1. Raises `TooLongError` if both have more than `most` terms together.
    """
    readable = readable_chain(robot, chain)
    tape, root, serial = readable.symbolic.tape, readable.symbolic.root, readable.serial
    rates = [rate for rate in readable.state.rates if rate != 0]
    left: list[sp.Expr] = []
    limit = most
    forces = generalised_inertia_forces(tape, root, serial, readable.state.unaccelerated)
    for row, (_, force) in zip(forces, readable.passive, strict=True):
        left.append(collected(force - row, rates, limit))
        most -= count_terms(left[-1])
        if most < 0:
            raise TooLongError
    matrix = mass_matrix(tape, root, serial)
    for i, (armature, _) in enumerate(readable.passive):
        matrix[i][i] += armature
    for i, row in enumerate(matrix):
        for j in range(i + 1):
            row[j] = matrix[j][i] = collected(row[j], (), limit)
            most -= count_terms(row[j])
    if most < 0:
        raise TooLongError
    return matrix, left
