"""Entries of a derivative that can differ from zero."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gibbs_codegen.interface import FUNCTIONS, derivatives_among
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.nodes import Number, Output


@dataclass(frozen=True)
class Pattern:
    """The entries of a matrix that are not zero at every state, column by column.

    Blocks of an array of more than two axes are one below the other, as one matrix; `width` is the
    number of its columns, `size` that of all its entries.
    """

    rows: tuple[int, ...]
    columns: tuple[int, ...]
    width: int
    size: int


def matrices(model: Model) -> dict[str, list[str]]:
    """Names of the matrices of each function that was derived on request and has any."""
    names_of = {
        signature.name: [
            output.name
            for output, shape in zip(
                FUNCTIONS[signature.name].outputs, signature.shapes, strict=True
            )
            if len(shape) > 1
        ]
        for _, signature in model.derived
        if signature.name in derivatives_among(model.functions)
    }
    return {function: names for function, names in names_of.items() if names}


def patterns(model: Model) -> dict[str, Pattern]:
    """Patterns, by output, of all matrices that are derivatives, from the program's own zeros.

    Functions that share a name of one share the pattern, with the entries of all of them.
    """
    places: dict[str, set[tuple[int, int]]] = {}
    shapes: dict[str, tuple[int, ...]] = {}
    for function, names in matrices(model).items():
        outputs = model.program.function(function).outputs
        for described, output in zip(FUNCTIONS[function].outputs, outputs, strict=True):
            if described.name in names:
                places.setdefault(described.name, set()).update(nonzeros(output))
                shapes[described.name] = output.shape
    return {
        name: Pattern(
            tuple(row for row, _ in ordered),
            tuple(column for _, column in ordered),
            *(shapes[name][-1], math.prod(shapes[name])),
        )
        for name, nonzero_places in places.items()
        for ordered in [sorted(nonzero_places, key=lambda place: place[::-1])]
    }


def nonzeros(output: Output) -> set[tuple[int, int]]:
    """Row and column of each entry of an output that is not zero at every state.

    A vector is one row.
    """
    width = math.prod(output.shape[-1:])
    zero = Number(0.0)
    return {divmod(i, width) for i, e in enumerate(output.entries) if e != zero}
