"""What the C templates are given, rollouts included: text only, every decision already taken."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from dataclasses import dataclass

from gibbs_codegen.interface import LANES
from gibbs_codegen.program.model import Model
from gibbs_codegen.robot.layout import inputs, layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.module_lists import module_lists
from gibbs_codegen.targets.c.casadi import CasadiText, casadi_text
from gibbs_codegen.targets.c.function import CFunction, FunctionText
from gibbs_codegen.targets.c.sparse import (
    PatternText,
    SparseText,
    pattern_texts,
    sparse_texts,
)
from gibbs_codegen.targets.c.statements import WIDTH, StatementPrinter, load_parameter
from gibbs_codegen.targets.c.steps import composed_texts
from gibbs_codegen.targets.documentation import (
    attitude_text,
    base_frame,
    coordinate_table,
    entry_lines,
    state_tables,
    unknown_table,
)
from gibbs_codegen.targets.printers import InfixPrinter
from gibbs_codegen.targets.verbatim import c_source


@dataclass(frozen=True)
class RolloutText:
    """What depends on the robot, and the source that does not.

    `block` comes before the functions that the template makes of the robot's, `run` after them.
    """

    rotors: int
    is_quaternion: bool
    block: str
    run: str


def rollout_text(robot: Robot) -> RolloutText:
    """Part of the context of the templates of rollouts."""
    return RolloutText(
        robot.rotors,
        layout_of(robot).is_quaternion,
        c_source("rollout/begin.c"),
        c_source("rollout/rollout.c").rstrip(),
    )


Lines = list[str]


@dataclass(frozen=True)
class ParameterText:
    """A parameter: its enumerator, its name, its default as a literal, and its unit."""

    macro: str
    name: str
    value: str
    unit: str


@dataclass(frozen=True)
class ModuleText:
    """Everything in header, source and CasADi adapter that depends on the robot.

    `entry_lines` explain the entries of arguments and results. `places` has the enumerators of the
    places in arguments, by the words for these. `support` is the source that depends on no robot,
    and `gather` that of functions without zeros. `casadi` is what the adapter is given besides, and
    `rollout` what the source of rollouts is.
    """

    header: Lines
    name: str
    NAME: str
    lanes: int
    single_lanes: int
    convention_lines: Lines
    result_lines: Lines
    entry_lines: Lines
    sizes: list[tuple[str, int]]
    folded_lines: Lines
    parameters: list[ParameterText]
    places: dict[str, Lines]
    constants: Lines
    default_constants: Lines
    parameter_loads: Lines
    prepare: Lines
    total_mass: str
    support: str
    functions: list[FunctionText]
    patterns: list[PatternText]
    sparse: list[SparseText]
    gather: str
    casadi: CasadiText
    rollout: RolloutText


def module_text(model: Model, printer: InfixPrinter, header: Lines) -> ModuleText:
    """Context of the C templates."""
    robot, program = model.robot, model.program
    values = program.prepared(model.defaults)
    loads = [(name, program.parameters.index(name)) for name in model.parameters_read]
    functions = [
        CFunction(model, function, signature, printer).text()
        for function, signature in model.derived
    ]
    functions += composed_texts(model)
    return ModuleText(
        header=header,
        name=robot.name,
        NAME=robot.name.upper(),
        lanes=LANES,
        single_lanes=2 * LANES,
        convention_lines=_convention_lines(robot),
        result_lines=_result_lines(robot),
        entry_lines=entry_lines(_tables(robot)),
        sizes=_sizes(model),
        folded_lines=_folded_lines(model),
        parameters=_parameters(model, printer),
        places=_places(robot),
        constants=list(program.constants),
        default_constants=[printer.number(values[name]) for name in program.constants],
        parameter_loads=[load_parameter(name, place) for name, place in loads],
        prepare=StatementPrinter(printer, kind="STEPWISE real").declare_all(program.prepare),
        total_mass=printer.expression(model.total_mass),
        support=c_source("support.c"),
        functions=functions,
        patterns=pattern_texts(model),
        sparse=sparse_texts(model),
        gather=c_source("gather.c"),
        casadi=casadi_text(model),
        rollout=rollout_text(robot),
    )


def _sizes(model: Model) -> list[tuple[str, int]]:
    listed = module_lists(model.robot, model.derivatives)
    sizes = [(name, len(names)) for name, names in listed.items()]
    lengths = len(model.defaults), len(model.program.constants)
    return [*sizes, *zip(("PARAMETERS", "CONSTANTS"), lengths, strict=True)]


def _parameters(model: Model, printer: InfixPrinter) -> list[ParameterText]:
    macros = _macros(model.robot.name, model.defaults)
    return [
        ParameterText(macro=macro, name=name, value=printer.number(value), unit=model.units[name])
        for macro, (name, value) in zip(macros, model.defaults.items(), strict=True)
    ]


def _places(robot: Robot) -> dict[str, Lines]:
    """Enumerators of the places in each list; no parameter's begins with a single letter."""
    listed = module_lists(robot)
    return {
        words: _macros(f"{robot.name}_{words[0]}", listed[name])
        for words, name in (
            ("q", "COORDINATES"),
            ("v, and in a", "VELOCITIES"),
            ("u", "INPUTS"),
            ("frames, also of rows in W", "FRAMES"),
            ("bodies", "BODIES"),
        )
        if listed[name]
    }


def _macros(prefix: str, names: Iterable[str]) -> Lines:
    """Names in capitals after a prefix, unless two that people gave are the same in capitals."""
    rests = [*names]
    capitals = [rest.upper() for rest in rests]
    chosen = capitals if len({*capitals}) == len(rests) else rests
    return [f"{prefix.upper()}_{rest}" for rest in chosen]


def _tables(robot: Robot) -> dict[str, Lines]:
    """What explains the entries of arguments and results, by headings."""
    return {
        **state_tables(robot),
        "Unknowns of the hybrid system, in order": unknown_table(robot),
        "Inputs u, in order": coordinate_table(inputs(robot)),
        **{
            f"{name.capitalize()}, in order": textwrap.wrap(", ".join(listed), WIDTH - 8)
            for name, listed in module_lists(robot).items()
            if name in ("POINTS", "FRAMES", "BODIES") and listed
        },
    }


def _result_lines(robot: Robot) -> Lines:
    text = (
        "No function checks its results. They are infinite or NaN if an argument is not finite, if "
        "a number overflows or, in forward dynamics, if a degree of freedom has no mass."
    )
    if layout_of(robot).is_quaternion:
        text += (
            " No attitude makes them so. A quaternion that is not of unit length is normalised by "
            f"{robot.name}_integrate only, if the square of its length is neither 0 nor infinite."
        )
    else:
        text += (
            " No attitude angle makes them so: no floating-point number is an odd multiple of 90 "
            "degrees, and close to those the functions are accurate."
        )
    return textwrap.wrap(text, WIDTH - 4)


def _convention_lines(robot: Robot) -> Lines:
    rates = "Rates are plain time derivatives of the coordinates, not body rates."
    if layout_of(robot).is_quaternion:
        rates = (
            "The velocities of the base are in its own frame, and a has their time derivatives "
            "component by component. Coordinates, velocities and accelerations are those of a "
            "free flyer in Pinocchio."
        )
    attitude = f"The attitude, from {base_frame(robot)} to the world, is {attitude_text(robot)}."
    carrier = "the motor's arm" if robot.base.rotors else "the body that carries the rotor"
    thrusts = (
        "A thrust acts at its motor, along the direction that the robot file gives in the frame of "
        f"{carrier}."
    )
    said = [attitude, rates, *([thrusts] if robot.rotors else [])]
    return textwrap.wrap(" ".join(said), WIDTH - 4)


def _folded_lines(model: Model) -> Lines:
    text = ", ".join(model.folded) or "nothing"
    return textwrap.wrap(f"Zero in the robot file and therefore folded away: {text}.", WIDTH - 6)
