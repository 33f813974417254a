"""What the C templates are given of a function, whatever it computes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gibbs_codegen.interface import FUNCTIONS, Signature
from gibbs_codegen.targets.c.arrays import from_block, read_arrays, written_arrays

Lines = list[str]


@dataclass(frozen=True)
class ArrayText:
    """An array: its name, and the entries of one state."""

    name: str
    width: int


@dataclass(frozen=True)
class FunctionText:
    """What the C templates are given of a function.

    `parameters` are those of the definition, `declared` those in the header. `one` and `block` are
    the bodies of the functions for one state and for a block of states, `whole_block` and
    `last_block` the arguments with which the second is called in a batch.
    """

    name: str
    public_name: str
    documentation: Lines
    inputs: list[ArrayText]
    parameters: Lines
    declared: Lines
    helpers: list[Lines]
    one: Lines
    block: Lines
    whole_block: Lines
    last_block: Lines


def function_text(
    robot: str,
    signature: Signature,
    documentation: Lines,
    helpers: list[Lines],
    one: Lines,
    block: Lines,
) -> FunctionText:
    """What the templates need of a function; `helpers` are definitions of what bodies call.

    `one` and `block` are the bodies for one state and for a block of states.
    """
    names = [output.name for output in FUNCTIONS[signature.name].outputs]
    inputs = _array_texts(signature.arguments, signature.argument_shapes)
    outputs = _array_texts(names, signature.shapes)
    real = f"{robot}_real"
    advanced = [from_block(array.name, array.width, "whole") for array in outputs]
    return FunctionText(
        name=signature.name,
        public_name=f"{robot}_{signature.name}",
        documentation=documentation,
        inputs=inputs,
        parameters=read_arrays(signature.arguments) + written_arrays(names),
        declared=read_arrays(signature.arguments, real, "") + written_arrays(names, real, ""),
        helpers=helpers,
        one=one,
        block=block,
        whole_block=[from_block(array.name, array.width, "block") for array in (*inputs, *outputs)],
        last_block=[*(f"last_{name}" for name in signature.arguments), *advanced],
    )


def _array_texts(names: Sequence[str], shapes: Sequence[tuple[int, ...]]) -> list[ArrayText]:
    """Arrays by their names and shapes."""
    return [ArrayText(name, math.prod(shape)) for name, shape in zip(names, shapes, strict=True)]
