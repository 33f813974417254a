"""Values for the C templates: text only, every decision already taken."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable

from gibbs_codegen.files.line_breaks import WIDTH, broken
from gibbs_codegen.files.templating import render
from gibbs_codegen.files.verbatim import c_source
from gibbs_codegen.interface import (
    ARGUMENTS,
    FUNCTIONS,
    LANES,
    LISTS,
    derivatives_among,
    signatures,
)
from gibbs_codegen.program.model import Model
from gibbs_codegen.robot.description import Description
from gibbs_codegen.runtime.c_library import RUNTIME
from gibbs_codegen.runtime.rollout_source import rollout_context, rollout_programs
from gibbs_codegen.targets import documentation
from gibbs_codegen.targets.c.calls import check_calls, model_functions
from gibbs_codegen.targets.c.function import c_functions
from gibbs_codegen.targets.c.programs import program_texts
from gibbs_codegen.targets.c.sparse import pattern_texts, sparse_texts
from gibbs_codegen.targets.c.statements import CStatements, side_by_side
from gibbs_codegen.targets.printers import Context, InfixPrinter, Lines
from gibbs_codegen.version import __version__

# Rounding is part of what `prepare` computes.
_KIND = "STEPWISE real"
# Nobody reads the names of more derivatives that are left out.
_NAMED = 8


def module_text(
    model: Model, printer: InfixPrinter, header: Lines, *, blocks: bool = True
) -> Context:
    """Context of the C templates: all in header and source that depends on the robot.

    `blocks` says whether the header has the forms for blocks of states. `entry_lines` explain the
    entries of arguments and results. `places` has the enumerators of the places in arguments, by
    the words for these, and `layout` is their text, which the header of CUDA shares. `runtime` is
    the source that depends on no robot, which a header of its own has, and `gather` that of
    functions without zeros.
    """
    robot, program = model.robot, model.program
    values = program.prepared(model.defaults)
    functions = [*c_functions(model, printer), *program_texts(model)]
    macros = _macros(robot.name, model.defaults)
    listed, folded = model.description.lists(model.functions), ", ".join(model.folded) or "nothing"
    context = {
        "header": header,
        "runtime_header": [header[0], header[-1]],
        "name": robot.name,
        "NAME": robot.name.upper(),
        "blocks": blocks,
        "lanes": LANES,
        "single_lanes": 2 * LANES,
        "convention_lines": _convention_lines(model.description),
        "result_lines": _result_lines(model.description),
        "entry_lines": documentation.entry_lines(_tables(model)),
        "left_out_lines": _left_out_lines(model),
        "sizes": {
            **{name: len(names) for name, names in listed.items()},
            "PARAMETERS": len(model.defaults),
            "CONSTANTS": len(program.constants),
        },
        "folded_lines": textwrap.wrap(
            f"Not parameters, because they are zero in the robot file: {folded}.", WIDTH - 6
        ),
        "parameters": [
            {**parameter, "macro": macro}
            for parameter, macro in zip(
                documentation.parameter_texts(model, printer), macros, strict=True
            )
        ],
        "places": _places(model),
        "constants": program.constants,
        "fields": broken(f"{robot.name}_real {', '.join(program.constants)};", WIDTH - 4),
        "default_constants": in_braces(printer.number(values[name]) for name in program.constants),
        "total_mass": printer.expression(model.total_mass),
        "prepare": _prepare_lines(model, CStatements(printer, kind=_KIND)),
        "prepare_lane": _prepare_lines(model, CStatements(printer, kind=_KIND, of_several=True)),
        "finite": broken(
            f"good &= {' & '.join(f'is_finite({name})' for name in program.constants)};", WIDTH - 4
        ),
        "runtime_file": RUNTIME,
        # As a number, which the preprocessor compares: 10203 of 1.2.3.
        "runtime_version": int("".join(f"{int(x):02}" for x in __version__.split("."))),
        "runtime": c_source("runtime.c").rstrip(),
        "functions": functions,
        "patterns": pattern_texts(model),
        "sparse": sparse_texts(model),
        "gather": c_source("gather.c"),
    }
    return {**context, "layout": render("c_places.h.jinja", context).rstrip()}


def _prepare_lines(model: Model, statements: CStatements) -> Lines:
    """Lines that load the parameters, compute the constants and keep them."""
    program = model.program
    loads = [
        statements.load(name, "parameters", program.parameters.index(name))
        for name in model.parameters_read
    ]
    kept = [f"{statements.constant(name)} = {name};" for name in program.constants]
    return [
        *side_by_side(loads),
        *statements.assign_all(program.prepare),
        *side_by_side(kept),
    ]


def rollout_text(model: Model, _: InfixPrinter, header: Lines) -> Context:
    """Context of the templates of rollouts."""
    robot = model_functions(model)
    programs = rollout_programs(robot)
    check_calls(model, programs, "--target rollout: its source calls")
    return rollout_context(robot, programs, header)


def in_braces(texts: Iterable[str]) -> Lines:
    """Lines between braces, with as many entries in a line as there is room for."""
    return textwrap.wrap(" ".join(f"{text}," for text in texts), WIDTH - 4)


def _places(model: Model) -> dict[str, Lines]:
    """Enumerators of the places in each list; no parameter's begins with a single letter."""
    robot, listed = model.robot, _used(model)
    return {
        words: in_braces(_macros(f"{robot.name}_{words[0]}", listed[name]))
        for words, name in (
            ("q", "COORDINATES"),
            ("v, and in a", "VELOCITIES"),
            ("u", "INPUTS"),
            ("frames, also of rows in W", "FRAMES"),
            ("bodies", "BODIES"),
        )
        if listed.get(name)
    }


def _used(model: Model) -> dict[str, tuple[str, ...]]:
    """The lists that arguments or results of the functions have entries for."""
    rows = [FUNCTIONS[signature.name] for signature in model.signatures]
    shapes = [ARGUMENTS[argument].shape for row in rows for argument in row.arguments]
    letters = {letter for row in rows for output in row.outputs for letter in output.shape}
    letters = letters.union(*shapes)
    names = {LISTS[letter] for letter in letters if letter in LISTS}
    return {name: kept for name, kept in model.description.lists().items() if name in names}


def _macros(prefix: str, names: Iterable[str]) -> Lines:
    """Names in capitals after a prefix, unless two that people gave are the same in capitals."""
    rests = [*names]
    capitals = [rest.upper() for rest in rests]
    chosen = capitals if len({*capitals}) == len(rests) else rests
    return [f"{prefix.upper()}_{rest}" for rest in chosen]


def _tables(model: Model) -> dict[str, Lines]:
    """Tables of the entries of arguments and results, by headings."""
    description, used = model.description, _used(model)
    hybrid = documentation.unknown_table(description) if "HYBRID_COORDINATES" in used else []
    return {
        **documentation.state_tables(description),
        **({"Unknowns of the hybrid system, in order": hybrid} if hybrid else {}),
        "Inputs u, in order": documentation.coordinate_table(description.inputs),
        **{
            f"{name.capitalize()}, in order": textwrap.wrap(", ".join(listed), WIDTH - 8)
            for name, listed in used.items()
            if name in ("POINTS", "FRAMES", "BODIES") and listed
        },
    }


def _result_lines(description: Description) -> Lines:
    text = (
        "No function checks its results. They are infinite or NaN if an argument is not finite, if "
        "a number overflows or, in forward dynamics, if a degree of freedom has no mass."
    )
    if description.layout.is_quaternion:
        text += (
            f" No attitude makes them so. Only {description.robot.name}_integrate normalises a "
            "quaternion, if the square of its length is neither 0 nor infinite."
        )
    elif len(description.layout.angle_axes) == 3:
        text += (
            " No attitude angle makes them so: no floating-point number is an odd multiple of "
            "90 degrees, and near these angles the functions are accurate."
        )
    return textwrap.wrap(text, WIDTH - 4)


def _convention_lines(description: Description) -> Lines:
    rates = "Rates are plain time derivatives of the coordinates, not body rates."
    if description.layout.is_quaternion:
        rates = (
            "The velocities of the base are in its own frame, and a has their time derivatives "
            "component by component. Coordinates, velocities and accelerations are those of a "
            "free flyer in Pinocchio."
        )
    elif description.layout.turns_with_base:
        rates = (
            "The velocities of the base are along and about its own axes, and a has their time "
            "derivatives component by component."
        )
    elif not description.layout.moves_freely:
        rates = "Rates are plain time derivatives of the coordinates."
    robot, frame = description.robot, documentation.base_frame(description)
    attitude = (
        f"The attitude, from {frame} to the world, is {documentation.attitude_text(description)}."
    )
    carrier = "the motor's arm" if robot.base.rotors else "the body that carries the rotor"
    thrusts = (
        "A thrust acts at its motor, along the direction that the robot file gives in the frame of "
        f"{carrier}."
    )
    sentences = [attitude, rates, *([thrusts] if robot.rotors else [])]
    return textwrap.wrap(" ".join(sentences), WIDTH - 4)


def _left_out_lines(model: Model) -> Lines:
    """By which options the functions come that are not there."""
    possible = {signature.name for signature in signatures(model.lists, FUNCTIONS)}
    missing = [name for name in FUNCTIONS if name not in model.functions and name in possible]
    derivatives = derivatives_among(missing)
    others = [name for name in missing if name not in derivatives]
    clauses = []
    if others:
        clauses.append(f"{', '.join(others)}, which --functions adds")
    if derivatives:
        which = "derivatives" if len(derivatives) > _NAMED else ", ".join(derivatives)
        clauses.append(f"{which}, which --derivatives adds")
    text = f"The module was generated without {'; and '.join(clauses)}." if clauses else ""
    return textwrap.wrap(text, WIDTH - 4)
