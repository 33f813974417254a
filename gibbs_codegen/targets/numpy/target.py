"""What the NumPy templates are given: text only, every decision already taken."""

from __future__ import annotations

from dataclasses import dataclass

from gibbs_codegen.interface import DATA, DATA_ON_REQUEST, Signature
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.nodes import Function, names_in
from gibbs_codegen.program.patterns import patterns
from gibbs_codegen.robot.layout import inputs, layout_of
from gibbs_codegen.robot.module_lists import carriers, module_lists
from gibbs_codegen.targets.documentation import (
    attitude_lines,
    calls,
    coordinate_table,
    docstring,
    entry_lines,
    operations,
    state_tables,
)
from gibbs_codegen.targets.numpy.statements import (
    StatementPrinter,
    elements,
    integers,
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
class PatternText:
    """A pattern: the name of its matrix, and rows and columns as what stands in parentheses."""

    name: str
    rows: Lines
    columns: Lines


@dataclass(frozen=True)
class KernelText:
    """The straight-line part of a function, and what the function makes of its entries."""

    arguments: Lines
    result: str
    loads: Lines
    statements: Lines
    entries: Lines


@dataclass(frozen=True)
class FunctionText:
    """A function: its head, its documentation, and its kernel unless it is composed of others.

    `arguments` has the shape of each argument for one state, as what goes on in a call.
    """

    name: str
    arguments: dict[str, str]
    returns: str
    documentation: Lines
    kernel: KernelText | None


@dataclass(frozen=True)
class StepText:
    """A time step: its name, its method, and whether it has derivatives."""

    name: str
    method: str
    derivatives: bool


@dataclass(frozen=True)
class ModuleText:
    """Everything in the emitted package that depends on the robot, and the source that does not.

    `entry_lines` explain the entries of arguments. `lists` are the constants that list names, each
    as the lines that stand in parentheses.
    """

    header: Lines
    name: str
    exports: Lines
    attitude: str
    attitude_lines: Lines
    entry_lines: Lines
    lists: dict[str, Lines]
    patterns: list[PatternText]
    parameters: list[ParameterText]
    folded: Lines
    parameter_loads: Lines
    prepare: Lines
    total_mass: str
    constants: Lines
    evaluation: PythonSource
    functions: list[FunctionText]
    steps: list[StepText]
    euler: bool
    runge_kutta: bool
    step_derivatives: bool
    is_quaternion: bool


def module_text(model: Model, printer: InfixPrinter, header: Lines) -> ModuleText:
    """Context of the NumPy templates."""
    robot, program = model.robot, model.program
    statements = StatementPrinter(printer)
    layout, driven = layout_of(robot), coordinate_table(inputs(robot))
    listed = module_lists(robot, model.derivatives) | {"DERIVATIVES": model.derivatives}
    listed["CARRIERS"] = carriers(robot)
    units = {"COORDINATE_UNITS": layout.q.units, "VELOCITY_UNITS": layout.v.units}
    constants = {name: strings(names) for name, names in (listed | units).items()}
    found = [
        PatternText(matrix, integers(pattern.rows), integers(pattern.columns))
        for matrix, pattern in patterns(model).items()
    ]
    on_request = [name for name in DATA_ON_REQUEST if name in constants]
    data = [*DATA, *on_request, *(["PATTERNS"] if found else [])]
    steps = [_step_text(signature.name) for signature in model.composed]
    return ModuleText(
        header=header,
        name=robot.name,
        exports=_exports(data, ["prepare", *(s.name for s in model.signatures)]),
        attitude=robot.base.attitude,
        attitude_lines=attitude_lines(robot),
        entry_lines=entry_lines(state_tables(robot) | {"Inputs u, in order": driven}),
        lists={name: constants[name] for name in (*DATA, *on_request) if name in constants},
        patterns=found,
        parameters=[
            ParameterText(name, printer.number(value), model.units[name])
            for name, value in model.defaults.items()
        ],
        folded=strings(model.folded),
        parameter_loads=[load(name, "values", name) for name in model.parameters_read],
        prepare=statements.assign_all(program.prepare),
        total_mass=printer.expression(model.total_mass),
        constants=elements(program.constants),
        evaluation=python_source("preparation.py", "evaluation.py"),
        functions=_functions(model, statements),
        steps=steps,
        euler=any(step.method == "euler" for step in steps),
        runge_kutta=any(step.method == "rk4" for step in steps),
        step_derivatives=any(step.derivatives for step in steps),
        is_quaternion=layout.is_quaternion,
    )


def _exports(data: Lines, functions: Lines) -> Lines:
    """Names of constants and functions, in the order that imports are sorted in."""
    return [*sorted(data, key=str.lower), *sorted(functions)]


def _step_text(name: str) -> StepText:
    method = name.removesuffix("_derivatives")
    return StepText(name, method.removeprefix("step_"), method != name)


def _functions(model: Model, statements: StatementPrinter) -> list[FunctionText]:
    """The texts of all functions, those that are composed of others last."""
    derived = [
        _function_text(
            model, signature, operations(function), _kernel_text(model, function, statements)
        )
        for function, signature in model.derived
    ]
    composed = [_function_text(model, s, calls(model.robot, s.name)) for s in model.composed]
    return derived + composed


def _function_text(
    model: Model, signature: Signature, work: str, kernel: KernelText | None = None
) -> FunctionText:
    """The text of one function; it has no kernel if it is composed of others.

    `work` is what a call takes, in words.
    """
    shapes = zip(signature.arguments, signature.argument_shapes, strict=True)
    return FunctionText(
        name=signature.name,
        arguments={argument: "".join(f", {size}" for size in shape) for argument, shape in shapes},
        returns=result_type(len(signature.shapes)),
        documentation=docstring(model.robot, signature, work),
        kernel=kernel,
    )


def _kernel_text(model: Model, function: Function, statements: StatementPrinter) -> KernelText:
    """The text of one kernel."""
    program = model.program
    used = {name for node in function.nodes() for name in names_in(node)}
    loads = [load(name, "k", program.constants.index(name)) for name in function.constants]
    for argument in function.arguments:
        names = program.inputs[argument]
        loads += [load(name, argument, i) for i, name in enumerate(names) if name in used]
    return KernelText(
        arguments=["k", "sin", "cos", *function.arguments],
        result=result(function.outputs),
        loads=loads,
        statements=statements.assign_all(function.statements),
        entries=statements.entries(function.outputs),
    )
