"""Values for the MATLAB templates: functions with their help, lists, and files that come once."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import replace

from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.matlab_text import MatlabPages
from gibbs_codegen.files.verbatim import matlab_source
from gibbs_codegen.interface import FUNCTIONS, Signature
from gibbs_codegen.machine.steps import emitted_step
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.nodes import names_in
from gibbs_codegen.program.patterns import patterns
from gibbs_codegen.robot.description import Description
from gibbs_codegen.targets.documentation import (
    HANGING,
    argument_text,
    attitude_lines,
    calls,
    coordinate_table,
    details,
    meaning,
    operations,
    output_text,
    parameter_texts,
    unknown_table,
    wrapped,
)
from gibbs_codegen.targets.matlab.statements import (
    MatlabStatements,
    check_names,
    column,
    column_major,
    load,
    variable,
)
from gibbs_codegen.targets.printers import Context, InfixPrinter, Lines

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
# What the entries of each list are, by the constant that has it in other languages. As files differ
# in more than capitals, no list has the name of a function.
LISTS = {
    "COORDINATES": ("coordinate_names", "coordinates q"),
    "VELOCITIES": ("velocity_names", "velocities v, whose rates are a"),
    "HYBRID_COORDINATES": ("hybrid_coordinate_names", "unknowns of the hybrid system"),
    "INPUTS": ("input_names", "inputs u"),
    "POINTS": ("point_names", "points"),
    "FRAMES": ("frame_names", "frames, also of rows in W"),
    "BODIES": ("body_names", "bodies"),
    "BASE_PARAMETERS": ("base_parameter_names", "base parameters"),
    "ROTORS": ("rotor_names", "rotors, by their thrusts in u"),
    "COMMANDS": ("command_names", "commands"),
    "ACTUATOR_STATES": ("actuator_state_names", "states x of the actuators"),
    "CONSTRAINTS": ("constraint_names", "constraints, by entries of active"),
    "CONSTRAINT_ROWS": ("constraint_row_names", "rows of the constraints"),
}
# The package's functions that return what other languages have as constants.
_NAMED = {constant: name for constant, (name, _) in LISTS.items()}
_NAMED |= {"PARAMETERS": "parameters", "PATTERNS": "patterns"}
# Width of a line, which begins with "%   ".
_WIDTH = 96


def package_text(
    model: Model, printer: InfixPrinter, header: Lines
) -> dict[str, dict[str, Context]]:
    """Contexts of the MATLAB templates, for each that of each file by its name in the package.

    Raises `UsageError` where MATLAB does not take a name of the robot's.
    """
    check_names(model)
    statements = MatlabStatements(printer)
    once = _model_text(model, printer, statements, header)
    functions = {
        signature.name: _function_text(model, signature, statements, header)
        for signature in model.signatures
    }
    files = ["states", "changed_parameters", "check_constants"]
    files += ["product"] if any(map(_has_derivatives, model.composed)) else []
    return {
        "matlab_function.m.jinja": functions,
        "matlab_list.m.jinja": list_texts(model.description, model.functions, header),
        "matlab_parameters.m.jinja": {"parameters": once},
        "matlab_prepare.m.jinja": {"prepare": once},
        "matlab_patterns.m.jinja": {"patterns": once} if once["patterns"] else {},
        "matlab_constants.m.jinja": {"+internal/default_constants": once},
        "matlab_source.m.jinja": {
            f"+internal/{name}": {"header": header, "lines": matlab_source(name)} for name in files
        },
    }


def _function_text(
    model: Model, signature: Signature, statements: MatlabStatements, header: Lines
) -> Context:
    """The text of one function.

    `fewest` and `most` count arguments. `checked` is what the check of these returns, `names` and
    `sizes` are what it takes.
    """
    program = model.program
    constants = len(program.constants)
    if FUNCTIONS[signature.name].composed:
        work = calls(model.description, signature.name)
        step = emitted_step(Functions(model.listing), signature.name)
        body = MatlabPages(step, f"{model.robot.name}.internal.product").lines()
        if _has_derivatives(signature):
            # Pages of constants stand beside those of all states, also where these share q.
            body.insert(0, "q = q .* ones(1, count);")
    else:
        function = program.function(signature.name)
        work = operations(function)
        used = {name for node in function.nodes() for name in names_in(node)}
        body = [load(n, "constants", program.constants.index(n)) for n in function.constants]
        # What it does once its arguments are columns.
        for argument, shape in zip(signature.arguments, signature.argument_shapes, strict=True):
            entries = zip(program.inputs[argument], column_major(shape), strict=True)
            body += [load(name, argument, place - 1) for name, place in entries if name in used]
        body += statements.assign_all(function.statements)
        described = FUNCTIONS[signature.name].outputs
        for output, computed in zip(described, function.outputs, strict=True):
            body += statements.fill(output.name, computed)
    arguments = [*signature.arguments, "constants"]
    shapes = [*(shape or (1,) for shape in signature.argument_shapes), (constants,)]
    names = ", ".join(f"'{argument}'" for argument in arguments)
    sizes = [" ".join(map(str, shape)) for shape in shapes]
    outputs = [output.name for output in FUNCTIONS[signature.name].outputs]
    return {
        "header": header,
        "package": model.robot.name,
        "name": signature.name,
        "results": outputs[0] if len(outputs) == 1 else f"[{', '.join(outputs)}]",
        "arguments": ", ".join(arguments),
        "fewest": len(signature.arguments),
        "most": len(arguments),
        "documentation": help_text(model.description, signature, work, constants),
        "checked": ", ".join(["count", *arguments]),
        "names": f"{{{names}}}",
        "sizes": f"{{{', '.join(size if ' ' not in size else f'[{size}]' for size in sizes)}}}",
        "body": body,
    }


def _has_derivatives(step: Signature) -> bool:
    return step.name.endswith("_derivatives")


def _model_text(
    model: Model, printer: InfixPrinter, statements: MatlabStatements, header: Lines
) -> Context:
    """Values for files that come once in a package: parameters, constants, patterns.

    `folded` are fields that are no parameters, as what stands in braces, and entries of `patterns`
    what stands in brackets.
    """
    program = model.program
    values = program.prepared(model.defaults)
    shapes = {
        output.name: shape
        for signature in model.signatures
        for output, shape in zip(FUNCTIONS[signature.name].outputs, signature.shapes, strict=True)
    }
    pattern_texts = []
    for matrix, pattern in patterns(model).items():
        places = column_major(shapes[matrix])
        entries = zip(pattern.rows, pattern.columns, strict=True)
        texts = [str(places[i * pattern.width + j]) for i, j in entries]
        pattern_texts.append({"name": matrix, "entries": column(texts)})
    return {
        "header": header,
        "package": model.robot.name,
        "parameters": parameter_texts(model, printer),
        "folded": column([f"'{variable(name)}'" for name in model.folded]),
        "parameter_loads": [
            f"{variable(name)} = values.{variable(name)};" for name in model.parameters_read
        ],
        "prepare": statements.assign_all(program.prepare),
        "total_mass": printer.expression(model.total_mass),
        "constants": column([variable(name) for name in program.constants]),
        "default_constants": column([printer.number(values[name]) for name in program.constants]),
        "patterns": pattern_texts,
    }


def list_texts(
    description: Description, functions: Collection[str], header: Lines
) -> dict[str, Context]:
    """The texts of all lists, by the names of their functions.

    `table` explains the entries, and `results` is what the function returns. Whether entries have
    units goes by the kind of list, not by whether this robot has any entries.
    """
    texts, explained = {}, description.explained
    for constant, names in description.lists(functions).items():
        name, what = LISTS[constant]
        has_units = constant in explained
        entries = explained.get(constant, ())
        table = coordinate_table(entries)
        if constant == "HYBRID_COORDINATES":
            table = unknown_table(description)
        if constant == "COORDINATES":
            table = [*table, "", *attitude_lines(description)]
        texts[name] = {
            "header": header,
            "package": description.robot.name,
            "name": name,
            "title": name.upper(),
            "what": what,
            "results": "[names, units]" if has_units else "names",
            "table": ["", *table] if table else [],
            "names": column([f"'{entry}'" for entry in names]),
            "has_units": has_units,
            "units": column([f"'{entry.unit}'" for entry in entries]),
        }
    return texts


def help_text(
    description: Description, signature: Signature, work: str, constants: int
) -> list[str]:
    """Documentation of a function as MATLAB's `help` shows it, without the sign of a comment.

    `work` is as of `documentation.docstring`; `constants` is how many there are.
    """

    def named(text: str) -> str:
        # Functions of the package stand in place of constants.
        return re.sub(r"\b[A-Z_]+\b", lambda match: _NAMED.get(match[0], match[0]), text)

    row = FUNCTIONS[signature.name]
    outputs = tuple(replace(output, entries=named(output.entries)) for output in row.outputs)
    row = replace(row, outputs=outputs, summary=named(row.summary), details=named(row.details))
    places = zip(signature.arguments, signature.argument_shapes, strict=True)
    takes = [
        f"{a}  {_size(shape)}: {meaning(description, a)}, {argument_text(description, a)}"
        for a, shape in places
    ]
    takes.append(
        f"constants  {_size((constants,))}: result of {description.robot.name}.prepare(); "
        "default: the constants of the default parameters"
    )
    returns = [
        f"{output.name}  {_size(sizes)}: {output_text(description, output)}"
        for output, sizes in zip(row.outputs, signature.shapes, strict=True)
    ]
    sections = {
        "Arguments, for k states each, or for one state that serves all:": takes,
        "Results:": returns,
        f"Source: {row.source}. {work}.": [],
    }
    names = [output.name for output in row.outputs]
    results = names[0] if len(names) == 1 else f"[{', '.join(names)}]"
    called = f"{results} = {description.robot.name}.{signature.name}"
    argument_lists = ", ".join(signature.arguments), ", ".join([*signature.arguments, "constants"])
    lines = wrapped([f"{called}({one})" for one in argument_lists], _WIDTH, HANGING)
    lines += ["", *wrapped([details(description, row)], _WIDTH, "")] if row.details else []
    for heading, items in sections.items():
        body = [f"{HANGING}{line}" for line in wrapped(items, _WIDTH - len(HANGING), HANGING)]
        lines += ["", *wrapped([heading], _WIDTH, ""), *body]
    below = [f"   {line}".rstrip() for line in lines]
    return [f"{signature.name.upper()} {row.summary}", *below]


def _size(shape: tuple[int, ...]) -> str:
    """The size of an array in MATLAB, with an axis for states."""
    return " x ".join([*map(str, shape or (1,)), "k"])
