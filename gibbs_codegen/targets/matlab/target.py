"""What the MATLAB templates are given: text only, every decision already taken."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gibbs_codegen.interface import FUNCTIONS, Signature
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.nodes import Function, names_in
from gibbs_codegen.program.patterns import patterns
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.targets.documentation import calls, operations
from gibbs_codegen.targets.matlab.help import ListText, help_text, list_texts
from gibbs_codegen.targets.matlab.names import check_names, variable
from gibbs_codegen.targets.matlab.statements import (
    StatementPrinter,
    column,
    column_major,
    load,
)
from gibbs_codegen.targets.printers import InfixPrinter
from gibbs_codegen.targets.verbatim import matlab_source

Lines = list[str]

# Each makes the files of a kind; the package's own functions are in a package within it.
TEMPLATES = (
    "matlab_function.m.jinja",
    "matlab_list.m.jinja",
    "matlab_parameters.m.jinja",
    "matlab_prepare.m.jinja",
    "matlab_patterns.m.jinja",
    "matlab_constants.m.jinja",
    "matlab_source.m.jinja",
)


@dataclass(frozen=True)
class FunctionText:
    """A function: its head, its documentation, and what it does.

    `fewest` and `most` count arguments. `checked` is what the check of these returns, `names` and
    `sizes` are what it takes. A function that is composed of others has a `step`; another has
    `body`.
    """

    header: Lines
    package: str
    name: str
    results: str
    arguments: str
    fewest: int
    most: int
    documentation: Lines
    checked: str
    names: str
    sizes: str
    body: Lines
    step: StepText | None


@dataclass(frozen=True)
class StepText:
    """A time step: its method, and whether it has derivatives, and moves are no sums."""

    method: str
    derivatives: bool
    is_quaternion: bool


@dataclass(frozen=True)
class ParameterText:
    """A parameter: the field of it, its default as a literal, and its unit."""

    field: str
    value: str
    unit: str


@dataclass(frozen=True)
class PatternText:
    """A pattern: the name of its matrix, and its entries as what stands in brackets."""

    name: str
    entries: Lines


@dataclass(frozen=True)
class ModelText:
    """What files that are there once in a package depend on: parameters, constants, patterns.

    `folded` are fields that are no parameters, as what stands in braces.
    """

    header: Lines
    package: str
    parameters: list[ParameterText]
    folded: Lines
    parameter_loads: Lines
    prepare: Lines
    total_mass: str
    constants: Lines
    default_constants: Lines
    patterns: list[PatternText]


@dataclass(frozen=True)
class SourceText:
    """A function that depends on no robot."""

    header: Lines
    lines: Lines


def package_text(
    model: Model, printer: InfixPrinter, header: Lines
) -> dict[str, Mapping[str, object]]:
    """Contexts of the MATLAB templates, for each that of each file by its name in the package.

    Raises `UsageError` where MATLAB does not take a name of the robot's.
    """
    check_names(model)
    statements = StatementPrinter(printer)
    once = _model_text(model, printer, statements, header)
    steps = {s.name: _step_text(model, s.name) for s in model.composed}
    own = ["states", "changed_parameters", "check_constants"]
    own += list(dict.fromkeys(step.method for step in steps.values()))
    own += ["with_derivatives"] if any(step.derivatives for step in steps.values()) else []
    functions = {
        signature.name: _function_text(model, signature, statements, header)
        for signature in model.signatures
    }
    lists: dict[str, ListText] = list_texts(model.robot, model.derivatives, header)
    return {
        "matlab_function.m.jinja": functions,
        "matlab_list.m.jinja": lists,
        "matlab_parameters.m.jinja": {"parameters": once},
        "matlab_prepare.m.jinja": {"prepare": once},
        "matlab_patterns.m.jinja": {"patterns": once} if once.patterns else {},
        "matlab_constants.m.jinja": {"+internal/default_constants": once},
        "matlab_source.m.jinja": {
            f"+internal/{name}": SourceText(header, matlab_source(name)) for name in own
        },
    }


def _function_text(
    model: Model, signature: Signature, statements: StatementPrinter, header: Lines
) -> FunctionText:
    """The text of one function."""
    constants = len(model.program.constants)
    step, body = None, []
    if FUNCTIONS[signature.name].composed:
        step, work = _step_text(model, signature.name), calls(model.robot, signature.name)
    else:
        function = model.program.function(signature.name)
        body, work = _body(model, function, statements), operations(function)
    arguments = [*signature.arguments, "constants"]
    shapes = [*(shape or (1,) for shape in signature.argument_shapes), (constants,)]
    names = ", ".join(f"'{argument}'" for argument in arguments)
    sizes = [" ".join(map(str, shape)) for shape in shapes]
    outputs = [output.name for output in FUNCTIONS[signature.name].outputs]
    return FunctionText(
        header=header,
        package=model.robot.name,
        name=signature.name,
        results=outputs[0] if len(outputs) == 1 else f"[{', '.join(outputs)}]",
        arguments=", ".join(arguments),
        fewest=len(signature.arguments),
        most=len(arguments),
        documentation=help_text(model.robot, signature, work, constants),
        checked=", ".join(["count", *arguments]),
        names=f"{{{names}}}",
        sizes=f"{{{', '.join(size if ' ' not in size else f'[{size}]' for size in sizes)}}}",
        body=body,
        step=step,
    )


def _step_text(model: Model, name: str) -> StepText:
    method = name.removesuffix("_derivatives")
    is_quaternion = layout_of(model.robot).is_quaternion
    return StepText(method.removeprefix("step_"), method != name, is_quaternion)


def _body(model: Model, function: Function, statements: StatementPrinter) -> Lines:
    """What a function does once its arguments are columns."""
    program = model.program
    used = {name for node in function.nodes() for name in names_in(node)}
    lines = [load(n, "constants", program.constants.index(n)) for n in function.constants]
    signature = next(s for f, s in model.derived if f is function)
    for argument, shape in zip(signature.arguments, signature.argument_shapes, strict=True):
        names = zip(program.inputs[argument], column_major(shape), strict=True)
        lines += [load(name, argument, place - 1) for name, place in names if name in used]
    lines += statements.assign_all(function.statements)
    for described, output in zip(FUNCTIONS[function.name].outputs, function.outputs, strict=True):
        lines += statements.fill(described.name, output)
    return lines


def _model_text(
    model: Model, printer: InfixPrinter, statements: StatementPrinter, header: Lines
) -> ModelText:
    """What files that are there once depend on."""
    program = model.program
    values = program.prepared(model.defaults)
    shapes = {
        output.name: shape
        for signature in model.signatures
        for output, shape in zip(FUNCTIONS[signature.name].outputs, signature.shapes, strict=True)
    }
    found = []
    for matrix, pattern in patterns(model).items():
        places = column_major(shapes[matrix])
        entries = zip(pattern.rows, pattern.columns, strict=True)
        texts = [str(places[row * pattern.width + column]) for row, column in entries]
        found.append(PatternText(matrix, column(texts)))
    return ModelText(
        header=header,
        package=model.robot.name,
        parameters=[
            ParameterText(variable(name), printer.number(value), model.units[name])
            for name, value in model.defaults.items()
        ],
        folded=column([f"'{variable(name)}'" for name in model.folded]),
        parameter_loads=[
            f"{variable(name)} = values.{variable(name)};" for name in model.parameters_read
        ],
        prepare=statements.assign_all(program.prepare),
        total_mass=printer.expression(model.total_mass),
        constants=column([variable(name) for name in program.constants]),
        default_constants=column([printer.number(values[name]) for name in program.constants]),
        patterns=found,
    )
