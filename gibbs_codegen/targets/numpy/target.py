"""Values for the NumPy templates: text only, every decision already taken."""

from __future__ import annotations

from typing import Any

from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.numpy_text import NumpyText
from gibbs_codegen.files.verbatim import python_source
from gibbs_codegen.interface import ARGUMENTS, DATA, DATA_ON_REQUEST, LISTS, OWN_LISTS, Signature
from gibbs_codegen.machine.steps import emitted_step
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.nodes import Function, names_in
from gibbs_codegen.program.patterns import patterns
from gibbs_codegen.targets import documentation
from gibbs_codegen.targets.numpy import statements as python
from gibbs_codegen.targets.printers import Context, InfixPrinter, Lines


def module_text(model: Model, printer: InfixPrinter, header: Lines) -> Context:
    """Context of the NumPy templates: what depends on the robot, and the source that does not.

    The values of `lists`, constants that are tuples, and rows and columns of `patterns` are what
    stands in parentheses. A function has a kernel unless it is composed of others.
    """
    description, program = model.description, model.program
    statements = python.PythonStatements(printer)
    tables = documentation.state_tables(description)
    tables["Inputs u, in order"] = documentation.coordinate_table(description.inputs)
    constants: dict[str, Any] = {**model.lists}
    constants |= description.constants
    pattern_texts = [
        {
            "name": name,
            "rows": python.integers(pattern.rows),
            "columns": python.integers(pattern.columns),
        }
        for name, pattern in patterns(model).items()
    ]
    on_request = [name for name in DATA_ON_REQUEST if name in constants]
    data = [*DATA, *on_request, *(["PATTERNS"] if pattern_texts else [])]
    robot = Functions(model.listing)
    steps = [
        {
            "name": signature.name,
            "lines": [
                part
                for line in NumpyText(emitted_step(robot, signature.name)).lines()
                for part in python.assignment(line)
            ],
        }
        for signature in model.composed
    ]
    functions = [
        _function_text(
            model,
            signature,
            documentation.operations(function),
            _kernel_text(model, function, statements),
        )
        for function, signature in model.derived
    ]
    functions += [
        _function_text(model, signature, documentation.calls(description, signature.name))
        for signature in model.composed
    ]
    return {
        "header": header,
        "name": model.robot.name,
        # In the order that imports are sorted in.
        "exports": [
            *sorted(data, key=str.lower),
            *sorted(["prepare", *(s.name for s in model.signatures)]),
        ],
        "attitude_lines": documentation.attitude_lines(description),
        "entry_lines": documentation.entry_lines(tables),
        "attitude": description.layout.attitude,
        "lists": {
            name: python.literals(constants[name])
            for name in (*DATA, *on_request)
            if isinstance(constants.get(name), tuple)
        },
        "tables": [
            {
                "name": name,
                "type": kind,
                "lines": [
                    f'"{key}": {python.literal(value)},' for key, value in constants[name].items()
                ],
            }
            for name, kind in _TABLES.items()
            if name in constants
        ],
        "patterns": pattern_texts,
        "parameters": documentation.parameter_texts(model, printer),
        "folded": python.literals(model.folded),
        "parameter_loads": [python.load(name, "values", name) for name in model.parameters_read],
        "prepare": statements.assign_all(program.prepare),
        "total_mass": printer.expression(model.total_mass),
        "constants": python.elements(program.constants),
        "evaluation": python_source("preparation.py", "evaluation.py"),
        "labels": _labels(model),
        "functions": functions,
        "steps": steps,
        "joins": any("_joined(" in line for step in steps for line in step["lines"]),
    }


def _labels(model: Model) -> dict[str, str]:
    """Expressions for the names of entries as of `entry_labels`, by arguments of the functions."""
    used = {argument for signature in model.signatures for argument in signature.arguments}
    labels = {}
    for argument in (name for name in ARGUMENTS if name in used):
        shape = ARGUMENTS[argument].shape
        # What every module says of W by itself.
        if len(shape) > 1 and argument != "W":
            first, second = (LISTS.get(letter, letter) for letter in shape)
            times = f"range({second})" if second.isdigit() else second
            named = f"[name for name in {first} for _ in {times}]"
            labels[argument] = f"[*{second}] * {first}" if first.isdigit() else named
        elif shape in OWN_LISTS:
            labels[argument] = LISTS[shape]
    return labels


# Constants that are dicts, and the types of their values.
_TABLES = {
    "COORDINATE_PLACES": "slice",
    "VELOCITY_PLACES": "slice",
    "CONSTRAINT_PLACES": "slice",
    "LOOPS": "tuple[str, ...]",
    "COORDINATE_LIMITS": "tuple[float | None, float | None]",
    "VELOCITY_LIMITS": "tuple[float | None, float | None]",
    "INPUT_LIMITS": "tuple[float | None, float | None]",
    "TIME_CONSTANTS": "float",
    "SPINS": "float",
    "COMMAND_LIMITS": "tuple[float | None, float | None]",
    "ACTUATOR_TIMES": "tuple[float, float]",
    "DRIVE_PARAMETERS": "dict[str, str]",
    "ROTOR_AIR": "tuple[str | float, ...]",
}


def _function_text(
    model: Model, signature: Signature, work: str, kernel: Context | None = None
) -> Context:
    """One function: its head, its documentation, and the call that computes its entries.

    That returns all if the function is composed of others, and has no kernel. `work` is what a call
    takes, in words.
    """
    name, heads = (signature.name, [f"{argument}: ArrayLike" for argument in signature.arguments])
    arrays = [
        f'state_array("{argument}", {", ".join([argument, *map(str, shape)])})'
        for argument, shape in zip(signature.arguments, signature.argument_shapes, strict=True)
    ]
    called, first = (
        ("entries, batch = _evaluate", [f"_{name}"]) if kernel else (f"return _{name}", [])
    )
    return {
        "name": name,
        "head": python.listed(
            f"def {name}",
            [*heads, "constants: tuple[Any, ...] | None = None"],
            f" -> {python.result_type(len(signature.shapes))}:",
        ),
        "evaluated": python.listed(called, [*first, "constants", *arrays]),
        "documentation": documentation.docstring(model.description, signature, work),
        "kernel": kernel,
    }


def _kernel_text(model: Model, function: Function, statements: python.PythonStatements) -> Context:
    """The straight-line part of a function, and what the function makes of its entries."""
    program = model.program
    used = {name for node in function.nodes() for name in names_in(node)}
    places = [program.constants.index(name) for name in function.constants]
    loads = python.load_all(function.constants, "k", places, whole=False)
    for argument in function.arguments:
        names = program.inputs[argument]
        read = [i for i, name in enumerate(names) if name in used]
        loads += python.load_all(
            [names[i] for i in read], argument, read, whole=len(read) == len(names)
        )
    return {
        "arguments": ["k", "sin", "cos", *function.arguments],
        "result": python.result(function.outputs),
        "loads": loads,
        "statements": statements.assign_all(function.statements),
        "entries": statements.entries(function.outputs),
    }
