"""One function in C: for one state, for a block of states, and its documentation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gibbs_codegen.interface import FUNCTIONS, Signature
from gibbs_codegen.program.loops import reroll
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.nodes import Function, Number, Output
from gibbs_codegen.program.scratch import Allocation, allocate_scratch
from gibbs_codegen.program.steps import Loop, schedule_stores
from gibbs_codegen.program.trigonometry import gather_angles
from gibbs_codegen.targets.c.arrays import (
    array_size,
    from_block,
    from_entry,
    local_arrays,
    read_arrays,
    written_arrays,
)
from gibbs_codegen.targets.c.sections import ANGLE, COSINE, SCRATCH, SINE, HelperPrinter
from gibbs_codegen.targets.c.statements import StatementPrinter, call, call_helper
from gibbs_codegen.targets.documentation import doxygen
from gibbs_codegen.targets.printers import InfixPrinter

# gcc vectorises no loop with more than 1000 memory references, and does smaller ones better.
_MAX_REFERENCES = 250
# Fewer steps in loops are not faster than straight on. Blocks of states never are faster in loops,
# which have to hold in memory what fits into registers if each column goes straight on.
_FEWEST_ROLLED = 200
# Angles whose sines and cosines are computed at once in a call for one state.
_AT_ONCE = 4

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


@dataclass(frozen=True, eq=False)
class _Sections:
    """A function split into sections, each a helper whose name begins with `prefix`."""

    prefix: str
    allocation: Allocation

    @property
    def names(self) -> list[str]:
        """Names of the helpers, in the order of the sections."""
        count = len(self.allocation.sections)
        return [self.prefix] if count == 1 else [f"{self.prefix}_{i + 1}" for i in range(count)]

    @property
    def steps_in_loops(self) -> int:
        """How many steps the loops stand for."""
        codes = [section.code for section in self.allocation.sections]
        return sum(len(code.unrolled) for code in codes if isinstance(code, Loop))


class CFunction:
    """Prints one function."""

    def __init__(
        self, model: Model, function: Function, signature: Signature, printer: InfixPrinter
    ) -> None:
        self._model = model
        self._function = function
        self._statements = StatementPrinter(printer)
        self._gathered = gather_angles(function)
        names = [output.name for output in FUNCTIONS[function.name].outputs]
        self._outputs = _array_texts(names, signature.shapes, 0, turned_alone=False)
        made = self._outputs[-1].end
        shapes = signature.argument_shapes
        self._inputs = _array_texts(signature.arguments, shapes, made, turned_alone=True)
        self._cleared = [_is_sparse(output) for output in function.outputs]
        gathered = self._gathered
        stored = [not cleared for cleared in self._cleared]
        steps = schedule_stores(gathered.statements, gathered.outputs, stored)
        name = function.name
        self._block = _Sections(f"{name}_lane", allocate_scratch(steps, {}, _MAX_REFERENCES))
        self._one = self._block
        items, signs = reroll(steps)
        if any(isinstance(item, Loop) for item in items):
            looped = _Sections(f"{name}_state", allocate_scratch(items, signs, _MAX_REFERENCES))
            if looped.steps_in_loops >= _FEWEST_ROLLED:
                self._one = looped

    def text(self) -> FunctionText:
        """What the templates need of the function."""
        prefix = f"{self._model.robot.name}_"
        inputs = [array.name for array in self._inputs]
        outputs = [array.name for array in self._outputs]
        arrays = [*self._inputs, *self._outputs]
        advanced = [from_block(array.name, array.width, "whole") for array in self._outputs]
        real = f"{prefix}real"
        return FunctionText(
            name=self._function.name,
            public_name=prefix + self._function.name,
            documentation=doxygen(self._model, self._function, self._gathered),
            inputs=self._inputs,
            outputs=self._outputs,
            casadi_entries=max(array.end for array in arrays),
            casadi_loads=[
                f"store({array.columns}, {array.rows}, {_given(place)}, {array.in_scratch});"
                for place, array in enumerate(self._inputs)
                if array.is_matrix
            ],
            casadi_inputs=[
                array.in_scratch if array.is_matrix else _given(place)
                for place, array in enumerate(self._inputs)
            ],
            casadi_outputs=[array.in_scratch for array in self._outputs],
            parameters=read_arrays(inputs) + written_arrays(outputs),
            declared=read_arrays(inputs, real, "") + written_arrays(outputs, real, ""),
            helpers=self._helpers(),
            one=self._body(self._one, lanes=False),
            block=self._body(self._block, lanes=True),
            whole_block=[from_block(array.name, array.width, "block") for array in arrays],
            last_block=[*(f"last_{name}" for name in inputs), *advanced],
        )

    def _helpers(self) -> list[Lines]:
        """Definitions of all helpers, in the order in which they are called."""
        printer = HelperPrinter(self._model, self._function, self._gathered, self._statements)
        helpers = []
        if self._gathered.angles:
            helpers.append(printer.angles(f"{self._function.name}_angles"))
        for sections in dict.fromkeys([self._one, self._block]):
            allocation = sections.allocation
            for name, section in zip(sections.names, allocation.sections, strict=True):
                helpers.append(printer.section(name, section, allocation))
        return helpers

    def _body(self, sections: _Sections, lanes: bool) -> Lines:
        """Body of the function.

        Args:
            sections: The helpers that it calls.
            lanes: Whether it is for a block of states, one a lane, or for one state.

        Returns:
            Lines.
        """
        angles, slots = len(self._gathered.angles), sections.allocation.slots
        inputs = [array.name for array in self._inputs]
        arrays = [*inputs, *(array.name for array in self._outputs)]
        lines = []
        if angles:
            lines.append(local_arrays([ANGLE, SINE, COSINE], array_size(angles, lanes)))
        if slots:
            lines.append(local_arrays([SCRATCH], array_size(slots, lanes)))
        for output, cleared in zip(self._outputs, self._cleared, strict=True):
            if cleared:
                lines += self._statements.clear(output.name, array_size(output.width, lanes))
        if slots:
            arrays = [SCRATCH, *arrays]
        if angles:
            arrays = [SINE, COSINE, *arrays]
            lines += call_helper(f"{self._function.name}_angles", [*inputs, ANGLE], lanes)
            lines += _sine_cosine(angles, lanes)
        for name in sections.names:
            lines += call_helper(name, arrays, lanes)
        return lines


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


def _is_sparse(output: Output) -> bool:
    """Whether it pays to clear the whole output first and then store what is not zero."""
    zeros = sum(entry == Number(0.0) for entry in output.entries)
    return zeros >= 32 and 3 * zeros >= len(output.entries)


def _sine_cosine(angles: int, lanes: bool) -> Lines:
    """Calls that compute the sines and cosines of all angles."""
    if lanes:
        return call("sine_cosine_many", [array_size(angles, lanes), ANGLE, SINE, COSINE])
    lines = []
    for i in range(0, angles, _AT_ONCE):
        arrays = [from_entry(array, i) for array in (ANGLE, SINE, COSINE)]
        lines += call("sine_cosine_few", [f"{min(_AT_ONCE, angles - i)}", *arrays])
    return lines
