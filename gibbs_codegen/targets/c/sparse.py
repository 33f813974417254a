"""Derivatives without their zeros in C: patterns, and functions that write the other entries.

These functions call those that write whole matrices, which they keep on the stack, and pick entries
from them. That saves output, and neither time nor stack; the text of long functions is not doubled.
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

from gibbs_codegen.interface import FUNCTIONS, Signature
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.patterns import Pattern, matrices, patterns
from gibbs_codegen.program.scratch import stack_bytes
from gibbs_codegen.program.trigonometry import gather_angles
from gibbs_codegen.targets.c.statements import (
    WIDTH,
    call,
    local_arrays,
    read_arrays,
    written_arrays,
)
from gibbs_codegen.targets.documentation import sparse_doxygen

Lines = list[str]

_DOUBLE = 8


@dataclass(frozen=True)
class PatternText:
    """A pattern: the macro for its length, and its rows and columns as what stands in braces.

    Without entries the arrays still have `room` for one, since C has none of no length.
    """

    name: str
    macro: str
    length: int
    room: int
    rows: Lines
    columns: Lines


@dataclass(frozen=True)
class SparseText:
    """What the C templates are given of a function that writes the entries of patterns."""

    public_name: str
    documentation: Lines
    parameters: Lines
    declared: Lines
    body: Lines


def pattern_texts(model: Model) -> list[PatternText]:
    """What the templates are given of the patterns of a module."""
    return [
        PatternText(
            name,
            f"{model.robot.name}_{name}_nonzeros".upper(),
            len(pattern.rows),
            max(len(pattern.rows), 1),
            _integers(pattern.rows or (0,)),
            _integers(pattern.columns or (0,)),
        )
        for name, pattern in patterns(model).items()
    ]


def sparse_texts(model: Model) -> list[SparseText]:
    """What the templates are given of each function that writes the entries of patterns."""
    found, with_matrices = patterns(model), matrices(model)
    return [
        _sparse_text(
            model.robot.name,
            signature,
            {name: found[name] for name in names},
            stack_bytes(gather_angles(function)),
        )
        for function, signature in model.derived
        if (names := with_matrices.get(signature.name))
    ]


def _sparse_text(
    robot: str, signature: Signature, of_matrices: dict[str, Pattern], stack: int
) -> SparseText:
    """One function that writes the entries of patterns.

    `signature` is that of the function that writes whole matrices, whose stack is given in bytes.
    """
    prefix = f"{robot}_"
    outputs = [output.name for output in FUNCTIONS[signature.name].outputs]
    whole = {name: f"whole_{name}" for name in of_matrices}
    body = [local_arrays([whole[name]], str(of_matrices[name].size or 1)) for name in whole]
    written = [whole.get(name, name) for name in outputs]
    body += call(prefix + signature.name, ["constants", *signature.arguments, *written])
    for name, pattern in of_matrices.items():
        at = f"{prefix}{name}_rows", f"{prefix}{name}_columns"
        places = [str(len(pattern.rows)), *at, str(pattern.width)]
        body += call("gather", [*places, whole[name], name])
    lengths = {name: len(pattern.rows) for name, pattern in of_matrices.items()}
    stack += _DOUBLE * sum(pattern.size for pattern in of_matrices.values())
    inputs, real = signature.arguments, f"{prefix}real"
    return SparseText(
        public_name=f"{prefix}{signature.name}_sparse",
        documentation=sparse_doxygen(signature, lengths, stack),
        parameters=read_arrays(inputs) + written_arrays(outputs),
        declared=read_arrays(inputs, real, "") + written_arrays(outputs, real, ""),
        body=body,
    )


def _integers(numbers: tuple[int, ...]) -> Lines:
    """Integers as they stand in braces."""
    return textwrap.wrap(" ".join(f"{number}," for number in numbers), WIDTH - 4)
