"""Closed forms, for reading and for tests: the same derivation on a tape that names nothing."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import sympy as sp

from gibbs_codegen.derivation.machine import Machine
from gibbs_codegen.derivation.tree_dynamics import (
    Matrix,
    State,
    generalised_inertia_forces,
    gibbs_function,
    mass_matrix,
)
from gibbs_codegen.equations.normal_form import TooLongError, collected, count_terms
from gibbs_codegen.equations.readable_chain import readable_chain
from gibbs_codegen.errors import UsageError
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.symbolic.inline_tape import InlineTape
from gibbs_codegen.symbolic.tape import Stage


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
    """Closed form of chain `number` = 1 … N (eqs. 2, 3 and 5).

    A constrained joint keeps its acceleration as a symbol; its rate is zero. Raises `UsageError`
    where there is no such chain. Expressions grow by a factor of three or so with every link.
    """
    if not 1 <= number <= robot.rotors:
        raise UsageError(f"chain {number}: {robot.name} has chains 1 to {robot.rotors}")
    tape = InlineTape()
    machine = Machine.of(robot, tape)
    chain, serial = machine.open_chains[number - 1]
    free = {symbol.name for symbol in machine.q}
    accelerations = tuple(tape.symbol(f"a_{name}", Stage.MOTION) for name in chain.coordinates)
    rates = [sp.Symbol(f"v_{name}") if name in free else sp.S.Zero for name in chain.coordinates]
    state = State(rates, accelerations, machine.parameters.gravity)
    return ChainClosedForm(
        chain.coordinates,
        accelerations,
        gibbs_function(tape, machine.root, serial, state),
        tuple(generalised_inertia_forces(tape, machine.root, serial, state)),
    )


@lru_cache(maxsize=8)
def closed_system(robot: Robot, chain: int, most: int) -> tuple[Matrix, list[sp.Expr]]:
    """I_j and R_j (eq. 15) in symbols that read well, collected by products of rates.

    Raises `TooLongError` where together they have more than `most` terms.
    """
    readable = readable_chain(robot, chain)
    tape, root, serial = readable.machine.tape, readable.machine.root, readable.serial
    rates = [rate for rate in readable.state.rates if rate != 0]
    left: list[sp.Expr] = []
    limit = most
    for row in generalised_inertia_forces(tape, root, serial, readable.unaccelerated):
        left.append(collected(-row, rates, limit))
        most -= count_terms(left[-1])
        if most < 0:
            raise TooLongError
    matrix = mass_matrix(tape, root, serial)
    for i, row in enumerate(matrix):
        for j in range(i + 1):
            row[j] = matrix[j][i] = collected(row[j], (), limit)
            most -= count_terms(row[j])
    if most < 0:
        raise TooLongError
    return matrix, left
