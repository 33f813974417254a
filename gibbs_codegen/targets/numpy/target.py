"""What the NumPy templates are given: text only, every decision already taken."""

from __future__ import annotations

from dataclasses import dataclass

from gibbs_codegen.interface import DATA
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.nodes import Function, names_in
from gibbs_codegen.robot.coordinates import hybrid_coordinates, inputs, points
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.targets.documentation import (
    attitude_lines,
    coordinate_table,
    docstring,
    entry_lines,
    state_tables,
)
from gibbs_codegen.targets.numpy.statements import (
    StatementPrinter,
    elements,
    load,
    result,
    result_type,
    strings,
)
from gibbs_codegen.targets.printers import InfixPrinter
from gibbs_codegen.targets.verbatim import PythonSource, python_source

Lines = list[str]


@dataclass(frozen=True)
class ParameterText:
    """A parameter: its name, its default as a literal, and its unit."""

    name: str
    value: str
    unit: str


@dataclass(frozen=True)
class FunctionText:
    """A function: its head, its documentation, and the lines of its kernel.

    `arguments` has the number of entries of one state in each argument.
    """

    name: str
    arguments: dict[str, int]
    returns: str
    documentation: Lines
    result: str
    loads: Lines
    statements: Lines
    entries: Lines


@dataclass(frozen=True)
class ModuleText:
    """Everything in the emitted package that depends on the robot, and the source that does not.

    `entry_lines` explain the entries of arguments.
    """

    header: Lines
    name: str
    exports: Lines
    attitude: str
    attitude_lines: Lines
    entry_lines: Lines
    coordinates: Lines
    coordinate_units: Lines
    velocities: Lines
    velocity_units: Lines
    hybrid_coordinates: Lines
    inputs: Lines
    points: Lines
    parameters: list[ParameterText]
    folded: Lines
    parameter_loads: Lines
    prepare: Lines
    total_mass: str
    constants: Lines
    evaluation: PythonSource
    functions: list[FunctionText]


def module_text(model: Model, printer: InfixPrinter, header: Lines) -> ModuleText:
    """Context of the NumPy templates.

    Args:
        model: The derived robot.
        printer: Of expressions.
        header: Lines that open every file.

    Returns:
        The context.
    """
    robot, program = model.robot, model.program
    statements = StatementPrinter(printer)
    layout, driven = layout_of(robot), coordinate_table(inputs(robot))
    functions = [_function_text(model, function, statements) for function in program.functions]
    return ModuleText(
        header=header,
        name=robot.name,
        exports=_exports(["prepare", *(function.name for function in functions)]),
        attitude=robot.base.attitude,
        attitude_lines=attitude_lines(robot),
        entry_lines=entry_lines(state_tables(robot) | {"Inputs u, in order": driven}),
        coordinates=strings(layout.q.names),
        coordinate_units=strings(layout.q.units),
        velocities=strings(layout.v.names),
        velocity_units=strings(layout.v.units),
        hybrid_coordinates=strings(c.name for c in hybrid_coordinates(robot)),
        inputs=strings(c.name for c in inputs(robot)),
        points=strings(points(robot)),
        parameters=[
            ParameterText(name, printer.number(value), model.units[name])
            for name, value in model.defaults.items()
        ],
        folded=strings(model.folded),
        parameter_loads=[load(name, "values", name) for name in model.parameters_read],
        prepare=statements.assign_all(program.prepare),
        total_mass=printer.expression(model.total_mass),
        constants=elements(program.constants),
        evaluation=python_source("evaluation.py"),
        functions=functions,
    )


def _exports(functions: Lines) -> Lines:
    """Names of constants and functions, in the order that imports are sorted in."""
    return [*sorted(DATA, key=str.lower), *sorted(functions)]


def _function_text(model: Model, function: Function, statements: StatementPrinter) -> FunctionText:
    """The text of one function.

    Args:
        model: The derived robot.
        function: One of its program's.
        statements: The printer.

    Returns:
        What the template is given.
    """
    program = model.program
    used = {name for node in function.nodes() for name in names_in(node)}
    loads = [load(name, "k", program.constants.index(name)) for name in function.constants]
    for argument in function.arguments:
        names = program.inputs[argument]
        loads += [load(name, argument, i) for i, name in enumerate(names) if name in used]
    return FunctionText(
        name=function.name,
        arguments={a: len(program.inputs[a]) for a in function.arguments},
        returns=result_type(function.outputs),
        documentation=docstring(model, function),
        result=result(function.outputs),
        loads=loads,
        statements=statements.assign_all(function.statements),
        entries=statements.entries(function.outputs),
    )
