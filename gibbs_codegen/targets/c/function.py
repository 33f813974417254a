"""One function of the program in C: for one state, and for a block of states."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gibbs_codegen.interface import FUNCTIONS, Signature
from gibbs_codegen.program.loops import reroll
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.nodes import Function, Number, Output, names_in
from gibbs_codegen.program.scratch import Allocation, Section, allocate_scratch, stack_bytes
from gibbs_codegen.program.steps import Loop, Step, Store, headed, schedule_stores
from gibbs_codegen.program.trigonometry import (
    cosine_name,
    gather_angles,
    sine_name,
)
from gibbs_codegen.targets.c import statements as c
from gibbs_codegen.targets.documentation import doxygen, operations
from gibbs_codegen.targets.printers import Context, InfixPrinter, Lines


def function_text(
    robot: str,
    signature: Signature,
    documentation: Lines,
    helpers: list[Lines],
    one: Lines,
    block: Lines,
) -> Context:
    """What the templates need of a function; `helpers` are definitions of what bodies call.

    `one` and `block` are the bodies for one state and for a block of states. Of the functions for
    one state, for a block of states and for a batch there are the heads; `declarations` are those
    in the header, for a batch also with constants of each state. `whole_block` and `last_block` are
    calls of the second in a batch, `last_inputs` what makes the inputs of the last block whole.
    """
    names = [output.name for output in FUNCTIONS[signature.name].outputs]
    inputs = dict(zip(signature.arguments, signature.widths, strict=True))
    outputs = dict(zip(names, map(math.prod, signature.shapes), strict=True))
    own, public, block_name = signature.name, f"{robot}_{signature.name}", f"{signature.name}_block"
    constants, count = "const Constants *RESTRICT constants", "const size_t count"
    parameters = c.read_arrays(signature.arguments) + c.written_arrays(names)
    of_block = [c.from_block(name, width, "block") for name, width in (inputs | outputs).items()]
    last = {name: f"last_{name}" for name in inputs}
    rest = [c.from_block(name, width, "whole") for name, width in outputs.items()]
    return {
        "name": own,
        "documentation": documentation,
        "declarations": declarations(robot, public, signature.arguments, names),
        "helpers": helpers,
        "one_head": c.head(f"void {public}", [constants, *parameters]),
        "one": one,
        "block_head": c.head(f"static WIDE void {block_name}", [constants, *parameters]),
        "block": block,
        "batch_head": c.head(f"void BATCH({own})", [constants, count, *parameters]),
        "whole_block": c.call(block_name, ["OF_BLOCK(constants, block)", *of_block]),
        "last_inputs": _last_block(inputs, last),
        "last_block": c.call(block_name, ["last_constants", *last.values(), *rest]),
    }


def declarations(
    robot: str, public: str, read: Sequence[str], written: Sequence[str]
) -> list[Lines]:
    """Declarations of a function for one state, for batches, and with constants of each state.

    `read` and `written` are the names of its arrays.
    """
    real = f"{robot}_real"
    arrays = c.read_arrays(read, real, "") + c.written_arrays(written, real, "")
    constants = f"const {robot}_constants *constants"
    return [
        c.head(f"void {public}", [constants, *arrays], ";"),
        c.head(f"void {public}_batch", [constants, "size_t count", *arrays], ";"),
        c.head(
            f"void {public}_batch_each", [f"const {real} *constants", "size_t count", *arrays], ";"
        ),
    ]


def _last_block(widths: Mapping[str, int], last: Mapping[str, str]) -> Lines:
    """Lines that make the last blocks of inputs whole, by the names of these."""
    sizes = {last[name]: c.array_size(width or 1, lanes=True) for name, width in widths.items()}
    lines = c.local_arrays(sizes)
    for name, width in widths.items():
        start = c.from_block(name, width, "whole")
        lines += c.call("fill_lanes", [str(width), "rest", start, last[name]])
    return lines


# The arrays that helpers hand values on in.
ANGLE, SINE, COSINE, SCRATCH = "angle", "sine", "cosine", "scratch"


# gcc vectorises no loop with more than 1000 memory references, and does smaller ones better.
_MAX_REFERENCES = 250
# Fewer steps in loops are not faster than straight on. Blocks of states never are faster in loops,
# which have to hold in memory what fits into registers if each column goes straight on.
_FEWEST_ROLLED = 200
# Angles whose sines and cosines are computed at once in a call for one state.
_AT_ONCE = 4


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
        self._statements = c.CStatements(printer)
        self._signature = signature
        self._gathered = gather_angles(function)
        self._inputs = {name: model.program.inputs[name] for name in function.arguments}
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

    def text(self) -> Context:
        """What the templates need of the function."""
        description = self._model.description
        stack = stack_bytes(self._gathered)
        return function_text(
            description.robot.name,
            self._signature,
            doxygen(description, self._signature, operations(self._function), stack),
            helpers=self._helpers(),
            one=self._body(self._one, lanes=False),
            block=self._body(self._block, lanes=True),
        )

    def _helpers(self) -> list[Lines]:
        """Definitions of all helpers, in the order in which they are called."""
        helpers = []
        if self._gathered.angles:
            helpers.append(self._angles(f"{self._function.name}_angles"))
        for sections in dict.fromkeys([self._one, self._block]):
            allocation = sections.allocation
            for name, section in zip(sections.names, allocation.sections, strict=True):
                helpers.append(self._section(name, section, allocation))
        return helpers

    def _angles(self, name: str) -> list[str]:
        """The helper that computes all angles whose sines and cosines are needed."""
        gathered = self._gathered
        nodes = [*(s.value for s in gathered.angle_statements), *gathered.angles]
        lines, idle = self._loads({name for node in nodes for name in names_in(node)})
        lines += self._statements.assign_all(gathered.angle_statements)
        stores = [self._statements.store(ANGLE, i, x) for i, x in enumerate(gathered.angles)]
        lines += c.side_by_side(line for store in stores for line in store)
        parameters = c.read_arrays(self._inputs) + c.written_arrays([ANGLE])
        return c.helper(name, parameters, [*map(c.unused, idle), *lines])

    def _section(self, name: str, section: Section, allocation: Allocation) -> list[str]:
        """The helper that computes one section of the function.

        `allocation` says where the sections keep what they hand on.
        """
        code = section.code
        if isinstance(code, Loop):
            steps: Sequence[Step] = code.body
            read = set(code.invariants)
            computed = self._loop(code, section, allocation)
        else:
            steps = code
            read = {name for step in steps for name in names_in(step.value)}
            computed = self._straight(code, section, allocation)
        loads, idle = self._loads(read)
        stored = {step.output for step in steps if isinstance(step, Store)}
        idle = self._idle_arrays(section, read, allocation) + idle
        idle += [output for i, output in enumerate(self._outputs) if i not in stored]
        parameters = [
            *c.read_arrays([SINE, COSINE] if self._gathered.angles else []),
            *c.written_arrays([SCRATCH] if allocation.slots else []),
            *c.read_arrays(self._inputs),
            *c.written_arrays(self._outputs),
        ]
        return c.helper(name, parameters, [*map(c.unused, idle), *loads, *computed])

    def _straight(
        self, steps: Sequence[Step], section: Section, allocation: Allocation
    ) -> list[str]:
        """Lines of steps that are done once."""
        loads = [
            c.load(name, SCRATCH, slot, allocation.sign(name))
            for name, slot in section.reloads.items()
        ]
        lines: list[str] = []
        for words, step in headed(steps):
            lines += self._statements.comment(words)
            if isinstance(step, Store):
                lines += self._statements.store(self._outputs[step.output], step.place, step.value)
                continue
            lines += self._statements.assign(step.name, step.value)
            if step.name in section.spills:
                slot = section.spills[step.name]
                lines.append(c.spill(SCRATCH, slot, step.name, allocation.sign(step.name)))
        return [*c.side_by_side(loads), *c.side_by_side(lines)]

    def _loop(self, loop: Loop, section: Section, allocation: Allocation) -> list[str]:
        """Lines of a loop."""
        before, lines, inside = [], [], self._statements.inside
        for name, slot in section.reloads.items():
            if name in loop.operands:
                lines.append(c.load(name, SCRATCH, c.place_in_loop(slot)))
            else:
                before.append(c.load(name, SCRATCH, slot, allocation.sign(name)))
        places = map(c.place_in_loop, loop.places, loop.strides)
        for step in loop.body:
            if isinstance(step, Store):
                lines += inside.store(self._outputs[step.output], next(places), step.value)
                continue
            lines += inside.assign(step.name, step.value)
            if step.name in section.spills:
                slot = section.spills[step.name]
                lines.append(c.spill(SCRATCH, c.place_in_loop(slot), step.name))
        return [
            *before,
            *self._statements.comment(loop.group),
            *c.vector_loop("i", loop.count, lines),
        ]

    def _idle_arrays(self, section: Section, read: set[str], allocation: Allocation) -> list[str]:
        """Arrays of angles and scratch that a section is given and, by `read`, does not use."""
        count = len(self._gathered.angles)
        idle = []
        for array, entry in ((SINE, sine_name), (COSINE, cosine_name)):
            if count and read.isdisjoint(map(entry, range(count))):
                idle.append(array)
        if allocation.slots and not (section.reloads or section.spills):
            idle.append(SCRATCH)
        return idle

    def _loads(self, read: set[str]) -> tuple[list[str], list[str]]:
        """Lines that load what is read and no step computes, and the arguments not used."""
        loads = {
            "constants": [
                c.load_constant(name) for name in self._function.constants if name in read
            ]
        }
        for argument, names in self._inputs.items():
            loads[argument] = [
                c.load(name, argument, i) for i, name in enumerate(names) if name in read
            ]
        idle = [argument for argument, lines in loads.items() if not lines]
        loads[SINE] = [
            c.load(entry, array, i)
            for i in range(len(self._gathered.angles))
            for array, entry in ((SINE, sine_name(i)), (COSINE, cosine_name(i)))
            if entry in read
        ]
        return [x for lines in loads.values() for x in c.side_by_side(lines)], idle

    def _body(self, sections: _Sections, lanes: bool) -> Lines:
        """Body of the function, for a block of states (`lanes`), one a lane, or for one state."""
        angles, slots = len(self._gathered.angles), sections.allocation.slots
        inputs = self._signature.arguments
        arrays = [*inputs, *self._outputs]
        local = dict.fromkeys([ANGLE, SINE, COSINE] if angles else [], c.array_size(angles, lanes))
        local |= {SCRATCH: c.array_size(slots, lanes)} if slots else {}
        lines = c.local_arrays(local)
        for name, shape, cleared in zip(
            self._outputs, self._signature.shapes, self._cleared, strict=True
        ):
            if cleared:
                lines += self._statements.clear(name, c.array_size(math.prod(shape), lanes))
        if slots:
            arrays = [SCRATCH, *arrays]
        if angles:
            arrays = [SINE, COSINE, *arrays]
            lines += c.call_helper(f"{self._function.name}_angles", [*inputs, ANGLE], lanes)
            lines += _sine_cosine(angles, lanes)
        for name in sections.names:
            lines += c.call_helper(name, arrays, lanes)
        return lines


def _is_sparse(output: Output) -> bool:
    """Whether it pays to clear the whole output first and then store what is not zero."""
    zeros = sum(entry == Number(0.0) for entry in output.entries)
    return zeros >= 32 and 3 * zeros >= len(output.entries)


def _sine_cosine(angles: int, lanes: bool) -> Lines:
    """Calls that compute the sines and cosines of all angles."""
    if lanes:
        return c.call("sine_cosine_many", [c.array_size(angles, lanes), ANGLE, SINE, COSINE])
    lines = []
    for i in range(0, angles, _AT_ONCE):
        arrays = [c.from_entry(array, i) for array in (ANGLE, SINE, COSINE)]
        lines += c.call("sine_cosine_few", [f"{min(_AT_ONCE, angles - i)}", *arrays])
    return lines
