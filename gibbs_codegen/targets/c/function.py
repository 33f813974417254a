"""One function of the program in C: for one state, and for a block of states."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gibbs_codegen.interface import FUNCTIONS, Signature
from gibbs_codegen.program.loops import reroll
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.nodes import Function, Number, Output
from gibbs_codegen.program.scratch import Allocation, allocate_scratch
from gibbs_codegen.program.stack import stack_bytes
from gibbs_codegen.program.steps import Loop, schedule_stores
from gibbs_codegen.program.trigonometry import gather_angles
from gibbs_codegen.targets.c.arrays import array_size, from_entry, local_arrays
from gibbs_codegen.targets.c.function_text import FunctionText, function_text
from gibbs_codegen.targets.c.sections import ANGLE, COSINE, SCRATCH, SINE, HelperPrinter
from gibbs_codegen.targets.c.statements import StatementPrinter, call, call_helper
from gibbs_codegen.targets.documentation import doxygen, operations
from gibbs_codegen.targets.printers import InfixPrinter

# gcc vectorises no loop with more than 1000 memory references, and does smaller ones better.
_MAX_REFERENCES = 250
# Fewer steps in loops are not faster than straight on. Blocks of states never are faster in loops,
# which have to hold in memory what fits into registers if each column goes straight on.
_FEWEST_ROLLED = 200
# Angles whose sines and cosines are computed at once in a call for one state.
_AT_ONCE = 4

Lines = list[str]


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
        self._signature = signature
        self._gathered = gather_angles(function)
        self._outputs = [output.name for output in FUNCTIONS[function.name].outputs]
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
        robot = self._model.robot
        stack = stack_bytes(self._gathered)
        return function_text(
            robot.name,
            self._signature,
            doxygen(robot, self._signature, operations(self._function), stack),
            helpers=self._helpers(),
            one=self._body(self._one, lanes=False),
            block=self._body(self._block, lanes=True),
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
        """Body of the function, for a block of states (`lanes`), one a lane, or for one state."""
        angles, slots = len(self._gathered.angles), sections.allocation.slots
        inputs = self._signature.arguments
        arrays = [*inputs, *self._outputs]
        lines = []
        if angles:
            lines.append(local_arrays([ANGLE, SINE, COSINE], array_size(angles, lanes)))
        if slots:
            lines.append(local_arrays([SCRATCH], array_size(slots, lanes)))
        for name, shape, cleared in zip(
            self._outputs, self._signature.shapes, self._cleared, strict=True
        ):
            if cleared:
                lines += self._statements.clear(name, array_size(math.prod(shape), lanes))
        if slots:
            arrays = [SCRATCH, *arrays]
        if angles:
            arrays = [SINE, COSINE, *arrays]
            lines += call_helper(f"{self._function.name}_angles", [*inputs, ANGLE], lanes)
            lines += _sine_cosine(angles, lanes)
        for name in sections.names:
            lines += call_helper(name, arrays, lanes)
        return lines


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
