"""One function of the program in C: for one state, and for a block of states."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from gibbs_codegen.interface import FUNCTIONS, WHOLES, Signature
from gibbs_codegen.program.loops import reroll
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.nodes import Function, Number, Output, names_in
from gibbs_codegen.program.scratch import Section, SlotAllocation, allocate_scratch, stack_bytes
from gibbs_codegen.program.steps import Loop, Step, Store, headed, schedule_stores
from gibbs_codegen.program.trigonometry import (
    GatheredFunction,
    cosine_name,
    gather_angles,
    sine_name,
)
from gibbs_codegen.targets.c import statements as c
from gibbs_codegen.targets.documentation import doxygen, operations
from gibbs_codegen.targets.printers import Context, InfixPrinter, Lines


@dataclass(frozen=True)
class FunctionBody:
    """A function's body, and definitions of the helpers that it calls, in the order of calls."""

    helpers: list[Lines]
    lines: Lines


def function_text(
    robot: str,
    signature: Signature,
    documentation: Lines,
    one: FunctionBody,
    block: FunctionBody,
    parts: Sequence[str] = (),
) -> Context:
    """Context of a function for templates, by its bodies for one state and for a block of states.

    Of the functions for one state, for a block of states and for a batch there are the heads;
    `declarations` are those in the header, for a batch also with constants of each state.
    `whole_block` and `last_block` are calls of the second in a batch, `last_inputs` what makes the
    inputs of the last block whole. `one_parts` and `batch_parts` call the `parts`, which return one
    output each, where the others are NULL.
    """
    names = [output.name for output in FUNCTIONS[signature.name].outputs]
    inputs = dict(zip(signature.arguments, signature.widths, strict=True))
    outputs = dict(zip(names, map(math.prod, signature.shapes), strict=True))
    key, public, block_name = signature.name, f"{robot}_{signature.name}", f"{signature.name}_block"
    constants, count = "const Constants *RESTRICT constants", "const size_t count"
    parameters = c.read_arrays(signature.arguments) + c.written_arrays(names)
    of_block = [c.from_block(name, width, "block") for name, width in (inputs | outputs).items()]
    last = {name: f"last_{name}" for name in inputs}
    rest = [c.from_block(name, width, "whole") for name, width in outputs.items()]
    return {
        "name": key,
        "documentation": documentation,
        "declarations": declarations(robot, public, signature.arguments, names),
        "one_head": c.head(f"void {public}", [constants, *parameters]),
        "one_parts": _calls_of_parts(signature, parts, f"{robot}_{{}}", ["constants"]),
        "batch_parts": _calls_of_parts(signature, parts, "BATCH({})", ["constants", "count"]),
        "one": one,
        "block_head": c.head(f"static WIDE void {block_name}", [constants, *parameters]),
        "block": block,
        "batch_head": c.head(f"void BATCH({key})", [constants, count, *parameters]),
        "whole_block": c.call(block_name, ["OF_BLOCK(constants, block)", *of_block]),
        "last_inputs": _last_block(inputs, last),
        "last_block": c.call(block_name, ["last_constants", *last.values(), *rest]),
    }


def _calls_of_parts(
    signature: Signature, parts: Sequence[str], called: str, first: Sequence[str]
) -> Lines:
    """Lines that call the part of a function that is wanted, where it is one alone.

    `called` has braces in place of the name; `first` are the first arguments.
    """
    lines: Lines = []
    for part in parts:
        row = FUNCTIONS[part]
        outputs = [output.name for output in row.outputs]
        names = [output.name for output in FUNCTIONS[signature.name].outputs]
        unwanted = " && ".join(f"{name} == NULL" for name in names if name not in outputs)
        call = c.call(called.format(part), [*first, *row.arguments, *outputs])
        lines += [f"if ({unwanted}) {{", *c.indented([*call, "return;"]), "}"]
    return lines


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


def c_functions(model: Model, printer: InfixPrinter) -> list[Context]:
    """Contexts of the program's functions for the templates.

    One that returns a part of what another does is a call of the text of that, if compilers leave
    out of it what is for the other outputs only: where it is one text, with the same angles.
    """
    parts_of = {f.name: _parts(model, f, signature, printer) for f, signature in model.derived}
    contexts = []
    for name, parts in parts_of.items():
        whole = parts_of.get(WHOLES.get(name, ""))
        if whole and whole.angles != parts.angles:
            whole = None
        one = (
            _PartOfText(parts, c.CStatements(printer), whole)
            if whole and isinstance(whole.one, _StraightOn)
            else parts.one
        )
        block = parts.block
        if whole and len(whole.block.allocation.sections) == 1:
            block = _PartOfBlock(parts, block.statements, block.allocation, whole)
        work, stack = operations(parts.function), stack_bytes(parts.gathered)
        documentation = doxygen(model.description, parts.signature, work, stack)
        bodies = one.body(), block.body()
        head = model.robot.name, parts.signature, documentation
        contexts.append(function_text(*head, *bodies, parts.called_by))
    return contexts


def _parts(model: Model, function: Function, signature: Signature, printer: InfixPrinter) -> _Parts:
    """Parts of a function that are printed."""
    gathered = gather_angles(function)
    stored = [not _is_sparse(output) for output in function.outputs]
    steps = schedule_stores(gathered.statements, gathered.outputs, stored)
    inputs = {name: model.program.inputs[name] for name in function.arguments}
    called_by = [name for name in FUNCTIONS[function.name].parts if name in model.functions]
    return _Parts(function, signature, inputs, gathered, steps, called_by, printer)


@dataclass(frozen=True)
class _Parts:
    """A function, the names of its inputs by argument, its angles, and its schedule.

    `called_by` are the functions that return a part of what it does by its text; `printer` writes
    it in its forms, `one` and `block`.
    """

    function: Function
    signature: Signature
    inputs: Mapping[str, Sequence[str]]
    gathered: GatheredFunction
    steps: Sequence[Step]
    called_by: Sequence[str]
    printer: InfixPrinter

    @cached_property
    def one(self) -> _StraightOn | _InSections:
        """It for one state: straight on, or in sections if loops stand for much of it."""
        items, signs = reroll(self.steps) if len(self.steps) >= _FEWEST_ROLLED else ([], {})
        if any(isinstance(item, Loop) for item in items):
            allocation = allocate_scratch(items, signs, _MAX_REFERENCES)
            codes = [section.code for section in allocation.sections]
            rolled = sum(len(code.unrolled) for code in codes if isinstance(code, Loop))
            if rolled >= _FEWEST_ROLLED:
                return _InSections(self, c.CStatements(self.printer), allocation)
        return _StraightOn(self, c.CStatements(self.printer))

    @cached_property
    def block(self) -> _OfBlock:
        """It for a block of states."""
        allocation = allocate_scratch(self.steps, {}, _MAX_REFERENCES)
        return _OfBlock(self, c.CStatements(self.printer, of_several=True), allocation)

    @property
    def outputs(self) -> list[str]:
        """Names of the arrays that are returned."""
        return [output.name for output in FUNCTIONS[self.function.name].outputs]

    @property
    def angles(self) -> int:
        """Number of angles."""
        return len(self.gathered.angles)

    @property
    def cleared(self) -> dict[str, int]:
        """Sizes of the outputs that are made zero before entries are stored, by name."""
        return {
            name: math.prod(output.shape)
            for name, output in zip(self.outputs, self.function.outputs, strict=True)
            if _is_sparse(output)
        }


@dataclass(frozen=True)
class _Printed:
    """A function in one of its forms, with the printer of that form's statements."""

    parts: _Parts
    statements: c.CStatements

    def _array_size(self, entries: int | str) -> str:
        return c.array_size(entries, self.statements.of_several)

    def _local_arrays(self, slots: int = 0) -> Lines:
        """Declarations of the arrays of angles and scratch."""
        names = [ANGLE, SINE, COSINE] if self.parts.angles else []
        sizes = dict.fromkeys(names, self._array_size(self.parts.angles))
        return c.local_arrays(sizes | ({SCRATCH: self._array_size(slots)} if slots else {}))

    def _unwanted(self, entries: Mapping[str, int]) -> Lines:
        """Declarations of arrays for outputs that are not wanted, by their entries."""
        return c.local_arrays({name: self._array_size(size) for name, size in entries.items()})

    def _cleared(self) -> Lines:
        """Loops that make outputs zero."""
        sizes = self.parts.cleared.items()
        return [
            line
            for name, size in sizes
            for line in self.statements.clear(name, self._array_size(size))
        ]

    def _angle_lines(self, statements: c.CStatements) -> tuple[Lines, Lines]:
        """Lines that compute the angles and put them into their array, and arguments not used."""
        gathered = self.parts.gathered
        lines, idle = self._loads(self._angle_names(), statements.depth)
        lines += statements.assign_all(gathered.angle_statements)
        stores = [statements.store(ANGLE, i, angle) for i, angle in enumerate(gathered.angles)]
        stored = c.side_by_side((line for store in stores for line in store), statements.depth)
        return [*lines, *stored], idle

    def _few_sines(self) -> Lines:
        """Calls that compute the sines and cosines of the angles of one state."""
        lines = []
        for i in range(0, self.parts.angles, _AT_ONCE):
            arrays = [c.from_entry(array, i) for array in (ANGLE, SINE, COSINE)]
            count = min(_AT_ONCE, self.parts.angles - i)
            lines += c.call("sine_cosine_few", [f"{count}", *arrays])
        return lines

    def _stored(self, step: Store, statements: c.CStatements, place: str = "") -> Lines:
        """Lines of a store, at a place in a loop or by row and column."""
        shape = self.parts.function.outputs[step.output].shape
        at = place or c.place(shape, step.place)
        return statements.store(self.parts.outputs[step.output], at, step.value)

    def _angle_names(self) -> set[str]:
        """Names that the angles are computed of."""
        gathered = self.parts.gathered
        nodes = [*(s.value for s in gathered.angle_statements), *gathered.angles]
        return {name for node in nodes for name in names_in(node)}

    def _loads(self, read: set[str], depth: int = 1) -> tuple[list[str], list[str]]:
        """Lines in `depth` blocks that load what is read of arguments, and arguments not used."""
        statements = self.statements
        loads = {
            "constants": [
                statements.load_constant(name)
                for name in self.parts.function.constants
                if name in read
            ]
        }
        for argument, names in self.parts.inputs.items():
            loads[argument] = [
                statements.load(name, argument, i) for i, name in enumerate(names) if name in read
            ]
        idle = [argument for argument, lines in loads.items() if not lines]
        return [x for lines in loads.values() for x in c.side_by_side(lines, depth)], idle

    def _sine_loads(self, read: set[str]) -> Lines:
        """Lines that load the sines and cosines that are read."""
        return c.side_by_side(
            self.statements.load(entry, array, i)
            for i in range(self.parts.angles)
            for array, entry in ((SINE, sine_name(i)), (COSINE, cosine_name(i)))
            if entry in read
        )


class _StraightOn(_Printed):
    """A function for one state without helpers."""

    def body(self) -> FunctionBody:
        """Its body."""
        steps, statements = self.parts.steps, self.statements
        read = {name for step in steps for name in names_in(step.value)}
        loads, idle = self._loads(read)
        idle = [
            name for name in idle if not self._angle_names() & {*self.parts.inputs.get(name, ())}
        ]
        written = {self.parts.outputs[step.output] for step in steps if isinstance(step, Store)}
        idle += [o for o in self.parts.outputs if o not in written and o not in self.parts.cleared]
        lines = [*self._local_arrays(), *map(c.unused, idle), *self._cleared()]
        if self.parts.angles:
            # What is loaded for the angles would be kept in memory while sines are computed.
            lines += ["{", *c.indented(self._angle_lines(statements.inside)[0]), "}"]
            lines += self._few_sines()
        lines += [*loads, *self._sine_loads(read)]
        computed: list[str] = []
        for words, step in headed(steps):
            computed += statements.comment(words)
            if isinstance(step, Store):
                computed += self._stored(step, statements)
            else:
                computed += statements.assign(step.name, step.value)
        lines += c.side_by_side(computed)
        if not self.parts.called_by:
            return FunctionBody([], lines)
        inputs, outputs = self.parts.inputs, self.parts.outputs
        name = f"{self.parts.function.name}_text"
        parameters = c.read_arrays(inputs) + c.written_arrays(outputs)
        helper = statements.helper(name, parameters, lines)
        return FunctionBody([helper], statements.call_helper(name, [*inputs, *outputs]))


@dataclass(frozen=True)
class _PartOfText(_StraightOn):
    """A function for one state that is a call of the text of another, which computes more."""

    whole: _Parts

    def body(self) -> FunctionBody:
        """Its body."""
        unwanted, arrays = _in_place_of(self.parts, self.whole)
        lines = [*self.statements.comment(_LEFT_OUT)[1:], *self._unwanted(unwanted)]
        lines += self.statements.call_helper(f"{self.whole.function.name}_text", arrays)
        return FunctionBody([], lines)


@dataclass(frozen=True)
class _InSections(_Printed):
    """A function in sections, each a helper, for one state."""

    allocation: SlotAllocation
    ending: ClassVar[str] = "part"

    @property
    def _names(self) -> list[str]:
        """Names of the helpers, in the order of the sections."""
        prefix, count = f"{self.parts.function.name}_{self.ending}", len(self.allocation.sections)
        return [prefix] if count == 1 else [f"{prefix}_{i + 1}" for i in range(count)]

    def body(self) -> FunctionBody:
        """Its helpers and its body."""
        parts, slots = self.parts, self.allocation.slots
        inputs = parts.signature.arguments
        arrays = [*inputs, *parts.outputs]
        lines, helpers = [*self._local_arrays(slots), *self._cleared()], []
        if slots:
            arrays = [SCRATCH, *arrays]
        if parts.angles:
            arrays = [SINE, COSINE, *arrays]
            name = f"{parts.function.name}_{self.ending}_angles"
            helpers.append(self._angles(name))
            lines += self.statements.call_helper(name, [*inputs, ANGLE])
            lines += self._sines()
        for name, section in zip(self._names, self.allocation.sections, strict=True):
            helpers.append(self._section(name, section))
            lines += self.statements.call_helper(name, arrays)
        return FunctionBody(helpers, lines)

    def _sines(self) -> Lines:
        """Calls that compute the sines and cosines of all angles."""
        return self._few_sines()

    def _angles(self, name: str) -> list[str]:
        """The helper that computes all angles whose sines and cosines are needed."""
        lines, idle = self._angle_lines(self.statements)
        parameters = c.read_arrays(self.parts.inputs) + c.written_arrays([ANGLE])
        return self.statements.helper(name, parameters, [*map(c.unused, idle), *lines])

    def _section(self, name: str, section: Section) -> list[str]:
        """The helper that computes one section of the function."""
        code, parts = section.code, self.parts
        if isinstance(code, Loop):
            steps: Sequence[Step] = code.body
            read = set(code.invariants)
            computed = self._loop(code, section)
        else:
            steps = code
            read = {name for step in steps for name in names_in(step.value)}
            computed = self._straight(code, section)
        loads, idle = self._loads(read)
        stored = {step.output for step in steps if isinstance(step, Store)}
        idle = self._idle_arrays(section, read) + idle
        idle += [output for i, output in enumerate(parts.outputs) if i not in stored]
        parameters = [
            *c.read_arrays([SINE, COSINE] if parts.angles else []),
            *c.written_arrays([SCRATCH] if self.allocation.slots else []),
            *c.read_arrays(parts.inputs),
            *c.written_arrays(parts.outputs),
        ]
        lines = [*map(c.unused, idle), *loads, *self._sine_loads(read), *computed]
        return self.statements.helper(name, parameters, lines)

    def _straight(self, steps: Sequence[Step], section: Section) -> list[str]:
        """Lines of steps that are done once."""
        statements, sign = self.statements, self.allocation.sign
        loads = [
            statements.load(name, SCRATCH, slot, sign(name))
            for name, slot in section.reloads.items()
        ]
        lines: list[str] = []
        for words, step in headed(steps):
            lines += statements.comment(words)
            if isinstance(step, Store):
                lines += self._stored(step, statements)
                continue
            lines += statements.assign(step.name, step.value)
            if step.name in section.spills:
                slot = section.spills[step.name]
                lines.append(statements.spill(SCRATCH, slot, step.name, sign(step.name)))
        return [*c.side_by_side(loads), *c.side_by_side(lines)]

    def _loop(self, loop: Loop, section: Section) -> list[str]:
        """Lines of a loop."""
        statements, inside = self.statements, self.statements.inside
        before, lines = [], []
        for name, slot in section.reloads.items():
            if name in loop.operands:
                lines.append(statements.load(name, SCRATCH, c.place_in_loop(slot)))
            else:
                sign = self.allocation.sign(name)
                before.append(statements.load(name, SCRATCH, slot, sign))
        places = map(c.place_in_loop, loop.places, loop.strides)
        for step in loop.body:
            if isinstance(step, Store):
                lines += self._stored(step, inside, next(places))
                continue
            lines += inside.assign(step.name, step.value)
            if step.name in section.spills:
                slot = section.spills[step.name]
                lines.append(statements.spill(SCRATCH, c.place_in_loop(slot), step.name))
        return [
            *before,
            *statements.comment(loop.group),
            *c.vector_loop("i", loop.count, lines),
        ]

    def _idle_arrays(self, section: Section, read: set[str]) -> list[str]:
        """Arrays of angles and scratch that a section is given and, by `read`, does not use."""
        count = self.parts.angles
        idle = []
        for array, entry in ((SINE, sine_name), (COSINE, cosine_name)):
            if count and read.isdisjoint(map(entry, range(count))):
                idle.append(array)
        if self.allocation.slots and not (section.reloads or section.spills):
            idle.append(SCRATCH)
        return idle


class _OfBlock(_InSections):
    """A function for a block of states, one a lane."""

    ending: ClassVar[str] = "lane"

    def _sines(self) -> Lines:
        size = self._array_size(self.parts.angles)
        return c.call("sine_cosine_many", [size, ANGLE, SINE, COSINE])


@dataclass(frozen=True)
class _PartOfBlock(_OfBlock):
    """A function for a block of states that calls the one helper of another, as `_PartOfText`."""

    whole: _Parts

    def body(self) -> FunctionBody:
        """Its body."""
        helper = f"{self.whole.function.name}_{self.ending}"
        unwanted, arrays = _in_place_of(self.parts, self.whole)
        lines = [*self._local_arrays(), *self._cleared()]
        if self.parts.angles:
            inputs = arrays[: len(self.whole.inputs)]
            lines += self.statements.call_helper(f"{helper}_angles", [*inputs, ANGLE])
            lines += self._sines()
            arrays = [SINE, COSINE, *arrays]
        # What is not wanted stays within a lane, or compilers would not see that nobody reads it.
        of_lane = [name if name in unwanted else f"{name} + lane" for name in arrays]
        call = c.call(helper, ["OF_LANE(constants, lane)", *of_lane, "LANES"])
        lines += self.statements.comment(_LEFT_OUT)[1:]
        lines += c.vector_loop("lane", "LANES", [*self._unwanted(unwanted), *call])
        return FunctionBody([], lines)


_LEFT_OUT = "Compilers remove computations whose results are not used."


def _in_place_of(part: _Parts, whole: _Parts) -> tuple[dict[str, int], list[str]]:
    """Sizes of the arrays that a part does not want by name, and the arguments of the whole.

    The first argument of the part stands for those that it lacks, since none of it is read.
    """
    first = next(iter(part.inputs))
    arguments, unwanted = [name if name in part.inputs else first for name in whole.inputs], {}
    for name, output in zip(whole.outputs, whole.function.outputs, strict=True):
        arguments.append(name if name in part.outputs else f"unwanted_{name}")
        if name not in part.outputs:
            unwanted[arguments[-1]] = math.prod(output.shape)
    return unwanted, arguments


def _is_sparse(output: Output) -> bool:
    """True if it pays to clear the whole output first and then store what is not zero."""
    zeros = output.entries.count(Number(0.0))
    return zeros >= 32 and 3 * zeros >= len(output.entries)
