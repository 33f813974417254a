"""CasADi as a contender: recursions in SX, its generated C, one state or eight at a time."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Iterator
from pathlib import Path

import casadi as ca
from peers.build import compiled, function
from peers.casadi_articulated import forward_dynamics
from peers.casadi_recursions import Machine, effects, mass_matrix
from peers.contender import (
    FORWARD_DYNAMICS,
    LANES,
    MASS_MATRIX_AND_RESIDUAL,
    Contender,
    Ordered,
)
from peers.tree import ATTITUDE, Tree

NO_OPERATION = (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST)
WIDTHS = (
    ("CasADi C", 1, "casadi_one.c"),
    ("CasADi C, eight at once", LANES, "casadi_eight.cpp"),
)


def tip_first(tree: Tree) -> Ordered:
    """Coordinates in the order in which composite bodies give the columns of the mass matrix.

    CasADi computes in the order of its outputs; from the tips on, one column is done with before
    the next, which makes the C for 30 links a quarter faster eight at a time.
    """
    size = tree.velocities
    joints = [tree.row(body) for body in range(tree.joints, 0, -1)]
    if tree.root != "xyz":
        return Ordered((*joints, *range(tree.base_velocities)), tree.layout.coordinates)
    order = (*joints, *reversed(range(ATTITUDE)), *range(size - 3, size))
    return Ordered(order, order)


def functions(tree: Tree) -> dict[str, ca.Function]:
    """A function per task: mass matrix and nonlinear effects, tip first; accelerations."""
    machine, tip = Machine(tree), tip_first(tree)
    q, v, tau = machine.q, machine.v, machine.tau
    rows, coordinates = list(tip.order), list(tip.coordinates)
    both = ca.cse([mass_matrix(machine)[rows, rows], effects(machine)[rows]])
    accelerations = ca.cse([forward_dynamics(machine)])
    return {
        MASS_MATRIX_AND_RESIDUAL: ca.Function(
            "mass_matrix_and_effects", [q[coordinates], v[rows]], both
        ),
        FORWARD_DYNAMICS: ca.Function("forward_dynamics", [q, v, tau], accelerations),
    }


def operations(made: ca.Function) -> int:
    """Operations of a function, sines and cosines among them, loads and stores not."""
    codes = (made.instruction_id(k) for k in range(made.n_instructions()))
    return sum(code not in NO_OPERATION for code in codes)


def libraries(
    made: Iterable[ca.Function], folder: Path, several: bool = True
) -> Iterator[tuple[str, int, ctypes.CDLL]]:
    """Functions as C, compiled in `folder`, for one state and, if wanted, for several at a time.

    Yields what to call it, how many states it takes a call, and the library.
    """
    generated = folder / "casadi_generated.c"
    generator, glue = ca.CodeGenerator(generated.name), ""
    for one in made:
        generator.add(one)
        glue += f"GLUE({one.name()})"
    generator.generate(f"{folder}/")
    arguments = [f'-DGENERATED="{generated}"', f"-DFUNCTIONS={glue}", "-lmvec", "-lm"]
    for name, width, source in WIDTHS if several else WIDTHS[:1]:
        library = compiled(source, folder / f"{source}.so", arguments)
        yield name, width, ctypes.CDLL(str(library))


def casadi_contenders(tree: Tree, folder: Path) -> list[Contender]:
    """CasADi one state and eight states at a time, both tasks."""
    tip = tip_first(tree)
    own = Ordered(tuple(range(tree.velocities)), tuple(range(len(tip.coordinates))))
    found = []
    for name, width, library in libraries(functions(tree).values(), folder):
        both = function(library, "casadi_mass_matrix_and_effects")
        forward = function(library, "casadi_forward_dynamics")
        found += [
            Contender(
                name, MASS_MATRIX_AND_RESIDUAL, width, both, tip.inputs, tip.matrix_and_residual
            ),
            Contender(name, FORWARD_DYNAMICS, width, forward, own.inputs, own.accelerations),
        ]
    return found
