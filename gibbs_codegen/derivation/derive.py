"""From a robot to its model: every function of the table derived, and lowered into a program."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

from gibbs_codegen.derivation import regularity
from gibbs_codegen.derivation.constraint_derivatives import ConstrainedSystems
from gibbs_codegen.derivation.functions import DERIVATIONS
from gibbs_codegen.derivation.hybrid import hybrid_system, reduced_system
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.systems import entries
from gibbs_codegen.graph.from_tape import ImportedTape
from gibbs_codegen.interface import ARGUMENTS, FUNCTIONS, Row, Signature, signatures
from gibbs_codegen.program.choice import Derivatives, Functions, chosen_functions
from gibbs_codegen.program.lower import Slice, lower
from gibbs_codegen.program.model import Model, Progress
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.symbolic.tape import Tape


def derive(
    robot: Robot,
    keep_zeros: bool = False,
    progress: Progress = lambda _: None,
    derivatives: Derivatives = False,
    functions: Functions = None,
) -> Model:
    """Derive everything that is emitted for a robot.

    Args:
        robot: The robot.
        keep_zeros: Keep parameters that are zero in the robot file.
        progress: Finding the name of each step as it begins.
        derivatives: Which derivatives there are, as of `chosen_functions`.
        functions: Which other functions there are, as well.

    Returns:
        The robot with its program and its parameters.

    Raises:
        SingularRobotError: For a robot with a massless degree of freedom.
        UsageError: For one whose numbers overflow, and for an unknown name among both.
    """
    chosen = chosen_functions(functions, derivatives)
    chosen = tuple(name for name in chosen if _is_defined(robot, FUNCTIONS[name]))
    tape = Tape()
    symbolic = SymbolicRobot.of(robot, tape, keep_zeros)
    regularity.check_massless_motions(robot, symbolic.parameters.defaults)
    return model_of(tape, symbolic, keep_zeros, progress, chosen)


def _is_defined(robot: Robot, row: Row) -> bool:
    """False for a function that needs velocities in more directions than a robot on wheels has.

    Christoffel's symbols need them for wheels that turn, derivatives of steps for a drive.
    """
    if robot.base.drive and row.name.startswith("step_") and row.kind:
        return False
    return "v_r" not in row.arguments or not (robot.base.drive or robot.wheels)


def model_of(
    tape: Tape,
    symbolic: SymbolicRobot,
    keep_zeros: bool = False,
    progress: Progress = lambda _: None,
    functions: Sequence[str] | None = None,
) -> Model:
    """Derive everything that is emitted for a robot whose symbols are on `tape`.

    `keep_zeros` says whether parameters that are zero were kept, `functions` which are derived, by
    default those of every module; `progress` is called with the name of each step as it begins.
    """
    robot, parameters = symbolic.robot, symbolic.parameters
    imported = ImportedTape(tape)
    chosen = chosen_functions(functions)
    slices, differentiated = _slices(imported, symbolic, chosen, progress)
    progress("lowering the program")
    inputs = {
        argument: tuple(symbol.name for symbol in getattr(symbolic, argument))
        for argument in ARGUMENTS
    }
    names = tuple(parameters.defaults)
    *others, mass_matrix, total_mass = slices
    program = lower(imported, inputs, names, [*others, total_mass])
    whole = program
    if mass_matrix.name not in chosen:
        whole = lower(imported, inputs, names, [mass_matrix])
    # The mass matrix by itself: the whole program's `prepare` divides by pivots, hidden or not.
    regularity.check_conditioning(robot, whole.only(mass_matrix.name), parameters.defaults)
    (mass,) = program.function(total_mass.name).outputs[0].entries
    # What cancels in lowered functions is a parameter too, if there are derivatives by it.
    known = {*program.parameters, *differentiated}
    listed = tuple(name for name in names if name in known)
    program = replace(program, functions=program.functions[:-1], parameters=listed)
    regularity.check_range(robot, program, parameters.defaults)
    return Model(
        symbolic.description,
        program,
        {name: parameters.defaults[name] for name in program.parameters},
        {name: parameters.units[name] for name in program.parameters},
        tuple(parameters.folded),
        keep_zeros,
        chosen,
        mass,
    )


def _slices(
    imported: ImportedTape, symbolic: SymbolicRobot, functions: Sequence[str], progress: Progress
) -> tuple[list[Slice], Collection[str]]:
    """Functions in the order of the table, less those that are composed of others.

    After them come the mass matrix once more, which is looked at, and what is no function of the
    module: the mass of the whole robot. With these comes by which parameters there are derivatives.
    """
    progress("reduced system")
    tree = symbolic.ungeared
    reduced = reduced_system(tree)
    progress("hybrid system")
    hybrid = hybrid_system(tree, reduced)
    systems = ConstrainedSystems(
        imported, symbolic, reduced.folded(symbolic), hybrid.folded(symbolic)
    )
    lists: dict[str, Collection[str]] = {**symbolic.description.lists(functions)}
    for stage in range(4):
        if stage == 3:  # Their shapes depend on which parameters the others have.
            lists["PARAMETERS"] = systems.parameters
        for signature in signatures(lists, functions):
            row = FUNCTIONS[signature.name]
            row_stage = 0 if not row.on_request else 1 if "CONSTRAINTS" in row.needs else 2
            if any("p" in output.shape for output in row.outputs):
                row_stage = 3
            if row_stage == stage and not row.composed:
                progress(signature.name.replace("_", " "))
                systems.functions[signature.name] = _slice(systems, signature)
    (matrix,) = signatures(lists, ["mass_matrix"])
    mass_matrix = systems.functions.get("mass_matrix") or _slice(systems, matrix)
    slices = [
        *(
            systems.functions[signature.name]
            for signature in signatures(lists, functions)
            if signature.name in systems.functions
        ),
        mass_matrix,
        Slice("total mass", (), (((), (systems.total_mass,)),)),
    ]
    letters = {x for name in functions for output in FUNCTIONS[name].outputs for x in output.shape}
    return slices, systems.parameters if "p" in letters else ()


def _slice(systems: ConstrainedSystems, signature: Signature) -> Slice:
    """Entries of a function on the tape; `ValueError` where they contradict its row's shape."""
    arrays = []
    row = FUNCTIONS[signature.name]
    with systems.imported.tape.function() as groups:
        for output, name, shape in zip(row.outputs, row.derivations, signature.shapes, strict=True):
            values = entries(DERIVATIONS[name](systems))
            if len(values) != math.prod(shape):
                raise ValueError(
                    f"derivation {name!r} gives {len(values)} entries; "
                    f"{output.name} of {signature.name} has shape {shape} in the table"
                )
            arrays.append((shape, values))
    return Slice(signature.name, signature.arguments, tuple(arrays), groups, row.parts)
