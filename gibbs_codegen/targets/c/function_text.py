"""What the C templates are given of a function, whatever it computes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gibbs_codegen.interface import FUNCTIONS, Signature
from gibbs_codegen.targets.c.arrays import (
    from_block,
    from_entry,
    read_arrays,
    written_arrays,
)

Lines = list[str]


@dataclass(frozen=True)
class ArrayText:
    """An array as a matrix, and where its entries start and end in CasADi's scratch.

    Blocks of an array of three axes are one below the other.
    """

    name: str
    rows: int
    columns: int
    start: int
    end: int

    @property
    def width(self) -> int:
        """Entries of one state."""
        return self.rows * self.columns

    @property
    def is_matrix(self) -> bool:
        """Whether row by row is another order than column by column."""
        return self.columns > 1

    @property
    def in_scratch(self) -> str:
        """Where its entries are in CasADi's scratch, row by row."""
        return from_entry("w", self.start)


@dataclass(frozen=True)
class FunctionText:
    """What the C templates are given of a function.

    CasADi has matrices column by column: `casadi_loads` turn those among the arguments, and
    `casadi_inputs` and `casadi_outputs` are what its adapter calls the function with, which needs
    `casadi_entries` of scratch. `parameters` are those of the definition, `declared` those in the
    header. `one` and `block` are the bodies of the functions for one state and for a block of
    states, `whole_block` and `last_block` the arguments with which the second is called in a batch.
    """

    name: str
    public_name: str
    documentation: Lines
    inputs: list[ArrayText]
    outputs: list[ArrayText]
    casadi_entries: int
    casadi_loads: Lines
    casadi_inputs: Lines
    casadi_outputs: Lines
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
    """What the templates need of a function.

    Args:
        robot: Name of the robot.
        signature: Of the function.
        documentation: Lines of it.
        helpers: Definitions of what the bodies call, in order.
        one, block: The bodies for one state and for a block of states.

    Returns:
        The text.
    """
    names = [output.name for output in FUNCTIONS[signature.name].outputs]
    outputs = _array_texts(names, signature.shapes, 0, turned_alone=False)
    shapes, made = signature.argument_shapes, outputs[-1].end
    inputs = _array_texts(signature.arguments, shapes, made, turned_alone=True)
    arrays, real = [*inputs, *outputs], f"{robot}_real"
    advanced = [from_block(array.name, array.width, "whole") for array in outputs]
    return FunctionText(
        name=signature.name,
        public_name=f"{robot}_{signature.name}",
        documentation=documentation,
        inputs=inputs,
        outputs=outputs,
        casadi_entries=max(array.end for array in arrays),
        casadi_loads=[
            f"store({array.columns}, {array.rows}, {_given(place)}, {array.in_scratch});"
            for place, array in enumerate(inputs)
            if array.is_matrix
        ],
        casadi_inputs=[
            array.in_scratch if array.is_matrix else _given(place)
            for place, array in enumerate(inputs)
        ],
        casadi_outputs=[array.in_scratch for array in outputs],
        parameters=read_arrays(signature.arguments) + written_arrays(names),
        declared=read_arrays(signature.arguments, real, "") + written_arrays(names, real, ""),
        helpers=helpers,
        one=one,
        block=block,
        whole_block=[from_block(array.name, array.width, "block") for array in arrays],
        last_block=[*(f"last_{name}" for name in signature.arguments), *advanced],
    )


def _array_texts(
    names: Sequence[str], shapes: Sequence[Sequence[int]], start: int, turned_alone: bool
) -> list[ArrayText]:
    """Arrays one after the other.

    Args:
        names, shapes: Name and shape of each.
        start: Where the first starts in CasADi's scratch.
        turned_alone: Whether only those have a place there that CasADi has column by column.

    Returns:
        The arrays as matrices.
    """
    texts: list[ArrayText] = []
    for name, shape in zip(names, shapes, strict=True):
        *rows, columns = shape if len(shape) > 1 else (*shape, 1)
        end = start if turned_alone and columns == 1 else start + math.prod(shape)
        texts.append(ArrayText(name, math.prod(rows), columns, start, end))
        start = end
    return texts


def _given(place: int) -> str:
    """What CasADi gives for an argument, or zeros."""
    return f"arg[{place}] ? arg[{place}] : zeros"
