"""What the NumPy templates are given: text only, every decision already taken."""

from __future__ import annotations

import textwrap
from typing import Any

from gibbs_codegen.interface import ARGUMENTS, DATA, FUNCTIONS
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.nodes import Function, Statement, names_in, total_mass
from gibbs_codegen.program.operations import count_operations
from gibbs_codegen.program.steps import headed
from gibbs_codegen.robot.coordinates import hybrid_coordinates, inputs, points, reduced_coordinates
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.targets.documentation import (
    argument_text,
    attitude_text,
    coordinate_table,
    output_text,
)
from gibbs_codegen.targets.printers import InfixPrinter

_WIDTH = 100


def context(model: Model, printer: InfixPrinter) -> dict[str, Any]:
    """Context of the NumPy templates."""
    robot, program = model.robot, model.program
    constants = {name: f"k[{i}]" for i, name in enumerate(program.constants)}
    functions = [_function(model, function, constants, printer) for function in program.functions]
    return {
        "name": robot.name,
        "exports": sorted([*DATA, "prepare", *(f["name"] for f in functions)]),
        "attitude": robot.base.attitude,
        "attitude_text": attitude_text(robot),
        "coordinate_lines": coordinate_table(reduced_coordinates(robot)),
        "input_lines": coordinate_table(inputs(robot)),
        "coordinates": _strings([c.name for c in reduced_coordinates(robot)]),
        "hybrid_coordinates": _strings([c.name for c in hybrid_coordinates(robot)]),
        "inputs": _strings([c.name for c in inputs(robot)]),
        "points": _strings(list(points(robot))),
        "parameters": [
            {"name": name, "value": repr(value), "unit": model.units[name]}
            for name, value in model.defaults.items()
        ],
        "folded": _strings(list(model.folded)),
        "parameter_loads": [f'{n} = values["{n}"]' for n in _used_parameters(model)],
        "prepare": _statements(program.prepare, printer),
        "total_mass": printer.expression(total_mass(program)),
        "constant_names": _tuple_lines(list(program.constants)),
        "functions": functions,
    }


def _function(
    model: Model, function: Function, constants: dict[str, str], printer: InfixPrinter
) -> dict[str, Any]:
    used = _names_used(function)
    loads = [f"{name} = {constants[name]}" for name in function.constants]
    for argument in function.arguments:
        loads += [
            f"{name} = {argument}[{i}]"
            for i, name in enumerate(model.program.inputs[argument])
            if name in used
        ]
    entries = [printer.expression(e) for output in function.outputs for e in output.entries]
    arguments = ", ".join(function.arguments)
    return {
        "name": function.name,
        "signature": [f"{argument}: ArrayLike" for argument in function.arguments],
        "returns": _return_type(function),
        "arguments": arguments,
        "checked": [
            f'_argument("{a}", {a}, {len(model.program.inputs[a])})' for a in function.arguments
        ],
        "doc_lines": _doc_lines(model.robot, function),
        "loads": loads,
        "statements": _statements(function.statements, printer),
        "entries": _tuple_lines(entries),
        "result": ", ".join(_array_calls(function)),
    }


def _doc_lines(robot: Robot, function: Function) -> list[str]:
    row = FUNCTIONS[function.name]
    paragraphs: list[list[str]] = []
    arguments = [
        f"{a}: {ARGUMENTS[a].meaning}, {argument_text(robot, a)}" for a in function.arguments
    ]
    arguments.append(
        "constants: what `prepare` returns; those of the default parameters if omitted"
    )
    returned = [
        f"{output.name}: {_shape_text(shaped.shape)}; {output_text(robot, output)}"
        for output, shaped in zip(row.outputs, function.outputs, strict=True)
    ]
    counts = count_operations(function.nodes())
    source = (
        f"Source: {row.source}. {counts.total} operations, "
        f"{counts.sine_cosine_pairs} sine-cosine pairs."
    )
    paragraphs += [arguments, ["Returns:", *returned, source]]
    lines = [f'    """{row.summary}']
    if row.details:
        lines.append("")
        lines += textwrap.wrap(
            row.details, _WIDTH, initial_indent=" " * 4, subsequent_indent=" " * 4
        )
    for paragraph in paragraphs:
        lines.append("")
        for item in paragraph:
            lines += textwrap.wrap(item, _WIDTH, initial_indent=" " * 4, subsequent_indent=" " * 8)
    return [*lines, '    """']


def _shape_text(shape: tuple[int, ...]) -> str:
    return f"array ({', '.join(['...', *map(str, shape)])})"


def _return_type(function: Function) -> str:
    array = "NDArray[np.float64]"
    if len(function.outputs) == 1:
        return array
    return f"tuple[{', '.join([array] * len(function.outputs))}]"


def _array_calls(function: Function) -> list[str]:
    calls, start = [], 0
    for output in function.outputs:
        stop = start + len(output.entries)
        part = "entries" if len(function.outputs) == 1 else f"entries[{start}:{stop}]"
        calls.append(f"_array({part}, {output.shape!r}, batch)")
        start = stop
    return calls


def _names_used(function: Function) -> set[str]:
    return {name for node in function.nodes() for name in names_in(node)}


def _used_parameters(model: Model) -> list[str]:
    used = {name for s in model.program.prepare for name in names_in(s.value)}
    used |= set(model.program.constants)
    return [name for name in model.program.parameters if name in used]


def _statements(statements: tuple[Statement, ...], printer: InfixPrinter) -> list[str]:
    lines: list[str] = []
    for words, statement in headed(statements):
        if words:
            lines += ["", f"# {words}"]
        lines += _wrapped(f"{statement.name} = ", printer.expression(statement.value))
    return lines


def _wrapped(start: str, expression: str) -> list[str]:
    """An assignment within the line width, its right-hand side in parentheses if need be."""
    if len(start) + len(expression) <= _WIDTH - 4:
        return [start + expression]
    inner = textwrap.wrap(expression, _WIDTH - 8, break_long_words=False, break_on_hyphens=False)
    return [f"{start}(", *(f"    {line}" for line in inner), ")"]


def _tuple_lines(entries: list[str]) -> list[str]:
    text = ", ".join(entries) + ","
    return textwrap.wrap(text, _WIDTH - 8, break_long_words=False, break_on_hyphens=False)


def _strings(names: list[str]) -> list[str]:
    text = " ".join(f'"{name}",' for name in names)
    return textwrap.wrap(text, _WIDTH - 4)
