"""From a robot to its model: every function of the table derived, and lowered into a program."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import sympy as sp

from gibbs_codegen.derivation.functions import DERIVATIONS, chosen_derivatives
from gibbs_codegen.derivation.hybrid import hybrid_system, reduced_system
from gibbs_codegen.derivation.regularity import (
    check_conditioning,
    check_massless_motions,
    check_range,
)
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.systems import Array, Systems
from gibbs_codegen.graph.from_tape import ImportedTape
from gibbs_codegen.graph.graph import Ref
from gibbs_codegen.interface import ARGUMENTS, FUNCTIONS, Signature, signatures
from gibbs_codegen.program.lower import Slice, lower
from gibbs_codegen.program.model import Derivatives, Model, Progress
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.module_lists import module_lists
from gibbs_codegen.symbolic.tape import Tape


def derive(
    robot: Robot,
    keep_zeros: bool = False,
    progress: Progress = lambda _: None,
    derivatives: Derivatives = False,
) -> Model:
    """Derive everything that is emitted for a robot.

    Args:
        robot: The robot.
        keep_zeros: Keep parameters that are zero in the robot file.
        progress: Told the name of each step as it begins.
        derivatives: Which functions are derived of those generated on request, as of
            `chosen_derivatives`.

    Returns:
        The robot with its program and its parameters.

    Raises:
        SingularRobotError: For a robot with a massless degree of freedom.
        UsageError: For one whose numbers overflow, and for an unknown name among `derivatives`.
    """
    chosen = chosen_derivatives(derivatives)
    tape = Tape()
    symbolic = SymbolicRobot.of(robot, tape, keep_zeros)
    check_massless_motions(robot, symbolic.parameters.defaults)
    return model_of(tape, symbolic, keep_zeros, progress, chosen)


def model_of(
    tape: Tape,
    symbolic: SymbolicRobot,
    keep_zeros: bool = False,
    progress: Progress = lambda _: None,
    derivatives: Sequence[str] = (),
) -> Model:
    """Derive everything that is emitted for a robot whose symbols are on `tape`.

    `keep_zeros` says whether parameters that are zero were kept, `derivatives` which of the
    functions generated on request are derived; `progress` is told the name of each step as it
    begins.
    """
    robot, parameters = symbolic.robot, symbolic.parameters
    imported = ImportedTape(tape)
    slices = _slices(imported, symbolic, derivatives, progress)
    progress("lowering the program")
    inputs = {
        argument: tuple(symbol.name for symbol in getattr(symbolic, argument))
        for argument in ARGUMENTS
    }
    names = tuple(parameters.defaults)
    # The mass matrix by itself: the whole program's `prepare` divides by pivots, hidden or not.
    mass_matrix = [piece for piece in slices if piece.name == "mass_matrix"]
    check_conditioning(robot, lower(imported, inputs, names, mass_matrix), parameters.defaults)
    program = lower(imported, inputs, names, slices)
    check_range(robot, program, parameters.defaults)
    return Model(
        robot,
        program,
        {name: parameters.defaults[name] for name in program.parameters},
        {name: parameters.units[name] for name in program.parameters},
        tuple(parameters.folded),
        keep_zeros,
        tuple(derivatives),
    )


def _slices(
    imported: ImportedTape,
    symbolic: SymbolicRobot,
    derivatives: Sequence[str],
    progress: Progress,
) -> list[Slice]:
    """Every function in the order of the table, less those that are composed of others."""
    progress("reduced system")
    reduced = reduced_system(symbolic)
    progress("hybrid system")
    hybrid = hybrid_system(symbolic, reduced)
    systems = Systems(imported.tape, imported, symbolic, reduced, hybrid)
    lists: dict[str, Collection[str]] = {**module_lists(symbolic.robot, derivatives)}
    for on_request in (False, True):
        if on_request:  # Their shapes depend on which parameters the others have.
            lists["PARAMETERS"] = systems.parameters
        for signature in signatures(lists, derivatives):
            row = FUNCTIONS[signature.name]
            if row.on_request is on_request and not row.composed:
                progress(signature.name.replace("_", " "))
                systems.functions[signature.name] = _slice(systems, signature)
    return [
        systems.functions[signature.name]
        for signature in signatures(lists, derivatives)
        if signature.name in systems.functions
    ]


def _slice(systems: Systems, signature: Signature) -> Slice:
    """Entries of a function on the tape; `ValueError` where they contradict its row's shape."""
    arrays = []
    with systems.tape.function() as groups:
        for output, shape in zip(FUNCTIONS[signature.name].outputs, signature.shapes, strict=True):
            entries = _entries(DERIVATIONS[output.derivation](systems))
            if len(entries) != math.prod(shape):
                raise ValueError(
                    f"derivation {output.derivation!r} gives {len(entries)} entries; "
                    f"{output.name} of {signature.name} has shape {shape} in the table"
                )
            arrays.append((shape, entries))
    return Slice(signature.name, signature.arguments, tuple(arrays), groups)


def _entries(array: Array) -> tuple[sp.Expr | Ref, ...]:
    """Entries of a scalar, a vector or a matrix, row by row."""
    if isinstance(array, list | tuple):
        return tuple(entry for part in array for entry in _entries(part))
    return (array,)
