"""Derivatives without their zeros in C: patterns, and functions that write the other entries.

These functions call those that write whole matrices, which they keep on the stack, and pick entries
from them. That saves output, and neither time nor stack; the text of long functions is not doubled.
"""

from __future__ import annotations

import textwrap

from gibbs_codegen.files.line_breaks import INDENT, WIDTH
from gibbs_codegen.interface import FUNCTIONS, Signature
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.patterns import Pattern, matrices, patterns
from gibbs_codegen.program.scratch import stack_bytes
from gibbs_codegen.program.trigonometry import gather_angles
from gibbs_codegen.targets.c import statements as c
from gibbs_codegen.targets.c.function import declarations
from gibbs_codegen.targets.documentation import sparse_doxygen
from gibbs_codegen.targets.printers import Context, Lines

_DOUBLE = 8


def pattern_texts(model: Model) -> list[Context]:
    """The patterns: the macro for the length, and rows and columns as what stands in braces.

    Without entries the arrays still have `room` for one, since C has none of no length.
    """
    return [
        {
            "name": name,
            "macro": f"{model.robot.name}_{name}_nonzeros".upper(),
            "length": len(pattern.rows),
            "room": max(len(pattern.rows), 1),
            "rows": _integers(pattern.rows or (0,)),
            "columns": _integers(pattern.columns or (0,)),
        }
        for name, pattern in patterns(model).items()
    ]


def sparse_texts(model: Model) -> list[Context]:
    """Values for the templates of each function that writes the entries of patterns."""
    pattern_of, with_matrices = patterns(model), matrices(model)
    return [
        _sparse_text(
            model.robot.name,
            signature,
            {name: pattern_of[name] for name in names},
            stack_bytes(gather_angles(function)),
        )
        for function, signature in model.derived
        if (names := with_matrices.get(signature.name))
    ]


def _sparse_text(
    robot: str, signature: Signature, of_matrices: dict[str, Pattern], stack: int
) -> Context:
    """One function that writes the entries of patterns.

    `signature` is that of the function that writes whole matrices, whose stack is given in bytes.
    """
    prefix = f"{robot}_"
    outputs = [output.name for output in FUNCTIONS[signature.name].outputs]
    whole = {name: f"whole_{name}" for name in of_matrices}
    body = c.local_arrays({whole[name]: str(of_matrices[name].size or 1) for name in whole})
    written = [whole.get(name, name) for name in outputs]
    body += c.call(prefix + signature.name, ["constants", *signature.arguments, *written])
    for name, pattern in of_matrices.items():
        at = f"{prefix}{name}_rows", f"{prefix}{name}_columns"
        places = [str(len(pattern.rows)), *at, str(pattern.width)]
        body += c.call("gather", [*places, whole[name], name])
    lengths = {name: len(pattern.rows) for name, pattern in of_matrices.items()}
    stack += _DOUBLE * sum(pattern.size for pattern in of_matrices.values())
    inputs, public = signature.arguments, f"{prefix}{signature.name}_sparse"
    parameters = [*c.read_arrays(inputs), *c.written_arrays(outputs)]
    return {
        "documentation": sparse_doxygen(signature, lengths, stack),
        "declaration": declarations(robot, public, inputs, outputs)[0],
        "head": c.head(f"void {public}", ["const Constants *RESTRICT constants", *parameters]),
        "body": body,
    }


def _integers(numbers: tuple[int, ...]) -> Lines:
    """Integers as they stand in braces."""
    return textwrap.wrap(" ".join(f"{number}," for number in numbers), WIDTH - INDENT)
