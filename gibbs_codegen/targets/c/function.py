"""One function in C: its helpers, one state, a block of states, any number, and its comment."""

from __future__ import annotations

import textwrap
from typing import Any

from gibbs_codegen.interface import ARGUMENTS, FUNCTIONS
from gibbs_codegen.program.loops import reroll
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.nodes import (
    Function,
    Number,
    Output,
    names_in,
)
from gibbs_codegen.program.operations import count_operations
from gibbs_codegen.program.scratch import Allocation, Section, allocate_scratch
from gibbs_codegen.program.stack import stack_bytes
from gibbs_codegen.program.steps import Loop, Step, Store, headed, schedule_stores
from gibbs_codegen.program.trigonometry import (
    GatheredFunction,
    cosine_name,
    gather_angles,
    sine_name,
)
from gibbs_codegen.targets.c.statements import (
    WIDTH,
    StatementPrinter,
    call,
    heading,
    hold,
    load,
    local_arrays,
    unused,
    vector_loop,
)
from gibbs_codegen.targets.documentation import argument_text, output_text
from gibbs_codegen.targets.printers import InfixPrinter

# gcc vectorises no loop with more than 1000 memory references, and does smaller ones better.
_MAX_REFERENCES = 250
# Fewer steps in loops are not faster than straight on. Blocks of states never are faster in loops,
# which have to hold in memory what fits into registers if each column goes straight on.
_FEWEST_ROLLED = 200
# Angles whose sines and cosines are computed at once in a call for one state.
_AT_ONCE = 4


class CFunction:
    """Lines of one function: its helpers, one state, a block of states, and any number of them."""

    def __init__(self, model: Model, function: Function, printer: InfixPrinter) -> None:
        self._model = model
        self._function = function
        self._statements = StatementPrinter(printer)
        self._parts: GatheredFunction = gather_angles(function)
        self._row = FUNCTIONS[function.name]
        self._outputs = [output.name for output in self._row.outputs]
        self._sparse = [_is_sparse(output) for output in function.outputs]
        steps = schedule_stores(
            self._parts.statements, self._parts.outputs, [not sparse for sparse in self._sparse]
        )
        self._block = allocate_scratch(steps, {}, _MAX_REFERENCES)
        looped = allocate_scratch(*reroll(steps), _MAX_REFERENCES)
        self._one = looped if _goes_in_loops(looped) else self._block

    def context(self) -> dict[str, Any]:
        """What the templates need of the function."""
        prefix = f"{self._model.robot.name}_"
        return {
            "name": self._function.name,
            "public_name": prefix + self._function.name,
            "doc_lines": self._doc_lines(),
            "helpers": self._helpers(),
            "inputs": [
                {"name": name, "width": len(self._model.program.inputs[name])}
                for name in self._function.arguments
            ],
            "parameters": ",\n    ".join(self._array_parameters("RESTRICT ", "real")),
            "declared": ",\n    ".join(self._array_parameters("", f"{prefix}real")),
            "one": self._call_lines("1", ""),
            "block": self._call_lines("LANES", " + lane"),
            "advanced": self._advanced("block"),
            "last": self._advanced_last(),
            **self._casadi(),
        }

    def _casadi(self) -> dict[str, Any]:
        """What the CasADi adapter needs: outputs one after the other in its work array."""
        outputs, start = [], 0
        for name, output in zip(self._outputs, self._function.outputs, strict=True):
            rows, columns = (*output.shape, 1, 1)[:2]
            outputs.append({"name": name, "rows": rows, "columns": columns, "start": start})
            start += rows * columns
        return {
            "casadi_outputs": ", ".join(f"w + {output['start']}" for output in outputs),
            "outputs": outputs,
            "work": start,
        }

    def _array_parameters(self, qualifier: str, real: str) -> list[str]:
        arrays = [f"const {real} *{qualifier}{name}" for name in self._function.arguments]
        return arrays + [f"{real} *{qualifier}{name}" for name in self._outputs]

    def _width(self, name: str) -> int:
        if name in self._function.arguments:
            return len(self._model.program.inputs[name])
        return len(self._function.outputs[self._outputs.index(name)].entries)

    def _advanced(self, block: str) -> str:
        """Arrays of a function at a block, as arguments of a call."""
        names = [*self._function.arguments, *self._outputs]
        return ",\n            ".join(f"{n} + {block} * ({self._width(n)} * LANES)" for n in names)

    def _advanced_last(self) -> str:
        """Arrays of a function at a last block that is not whole: inputs come from a copy."""
        copies = [f"last_{name}" for name in self._function.arguments]
        outputs = [f"{n} + whole * ({self._width(n)} * LANES)" for n in self._outputs]
        return ",\n            ".join(copies + outputs)

    def _helpers(self) -> list[dict[str, Any]]:
        helpers = []
        name = self._function.name
        if self._parts.angles:
            helpers.append(self._angle_helper(f"{name}_angles"))
        for allocation in dict.fromkeys([self._one, self._block]):
            for section, section_name in zip(
                allocation.sections, self._section_names(allocation), strict=True
            ):
                helpers.append(self._section_helper(section_name, section, allocation))
        return helpers

    def _section_names(self, allocation: Allocation) -> list[str]:
        name = self._function.name + ("_lane" if allocation is self._block else "_state")
        if len(allocation.sections) == 1:
            return [name]
        return [f"{name}_{number}" for number, _ in enumerate(allocation.sections, start=1)]

    def _angle_helper(self, name: str) -> dict[str, Any]:
        parts = self._parts
        nodes = [*(s.value for s in parts.angle_statements), *parts.angles]
        lines, idle = self._loads({n for node in nodes for n in names_in(node)})
        lines += self._statements.declare_all(parts.angle_statements)
        for i, angle in enumerate(parts.angles):
            lines += self._statements.store("angle", i, angle)
        inputs = [f"const real *RESTRICT {a}" for a in self._function.arguments]
        return {
            "name": name,
            "parameters": ",\n    ".join([*inputs, "real *RESTRICT angle"]),
            "lines": [*map(unused, idle), *lines],
        }

    def _section_helper(
        self, name: str, section: Section, allocation: Allocation
    ) -> dict[str, Any]:
        if isinstance(section.code, Loop):
            steps, read = section.code.body, set(section.code.invariants)
        else:
            steps = section.code
            read = {name for step in steps for name in names_in(step.value)}
        lines, idle = self._loads(read)
        if isinstance(section.code, Loop):
            lines += self._loop_lines(section.code, section, allocation)
        else:
            lines += self._straight_lines(section.code, section, allocation)
        stored = {step.output for step in steps if isinstance(step, Store)}
        idle += [output for i, output in enumerate(self._outputs) if i not in stored]
        return {
            "name": name,
            "parameters": ",\n    ".join(
                [
                    *self._scratch_parameters(allocation),
                    *self._array_parameters("RESTRICT ", "real"),
                ]
            ),
            "lines": [*map(unused, self._idle_scratch(section, read, allocation) + idle), *lines],
        }

    def _straight_lines(
        self, steps: tuple[Step, ...], section: Section, allocation: Allocation
    ) -> list[str]:
        lines = []
        for name, slot in section.reloads.items():
            lines.append(load(name, "held", slot, allocation.sign(name)))
        for words, step in headed(steps):
            lines += heading(words)
            if isinstance(step, Store):
                lines += self._statements.store(self._outputs[step.output], step.place, step.value)
                continue
            lines += self._statements.declare(step.name, step.value)
            if step.name in section.spills:
                slot = section.spills[step.name]
                lines.append(hold("held", slot, step.name, allocation.sign(step.name)))
        return lines

    def _loop_lines(self, loop: Loop, section: Section, allocation: Allocation) -> list[str]:
        before, lines, inside = [], [], self._statements.inside
        for name, slot in section.reloads.items():
            if name in loop.operands:
                lines.append(load(name, "held", f"({slot} + i)"))
            else:
                before.append(load(name, "held", slot, allocation.sign(name)))
        places = iter(zip(loop.places, loop.strides, strict=True))
        for step in loop.body:
            if isinstance(step, Store):
                first, stride = next(places)
                place = f"({first} + {stride} * i)"
                lines += inside.store(self._outputs[step.output], place, step.value)
                continue
            lines += inside.declare(step.name, step.value)
            if step.name in section.spills:
                lines.append(hold("held", f"({section.spills[step.name]} + i)", step.name))
        return [*before, *heading(loop.group), *vector_loop("i", loop.count, lines)]

    def _scratch_parameters(self, allocation: Allocation) -> list[str]:
        scratch = []
        if self._parts.angles:
            scratch += ["const real *RESTRICT sine", "const real *RESTRICT cosine"]
        if allocation.slots:
            scratch.append("real *RESTRICT held")
        return scratch

    def _idle_scratch(self, section: Section, read: set[str], allocation: Allocation) -> list[str]:
        """Scratch arrays that a section does not use."""
        count = range(len(self._parts.angles))
        idle = []
        if count and not any(sine_name(i) in read for i in count):
            idle.append("sine")
        if count and not any(cosine_name(i) in read for i in count):
            idle.append("cosine")
        if allocation.slots and not (section.reloads or section.spills):
            idle.append("held")
        return idle

    def _loads(self, read: set[str]) -> tuple[list[str], list[str]]:
        """Lines that load what is neither made nor held, and the arguments that are not used."""
        constants = [name for name in self._function.constants if name in read]
        lines = [f"const real {name} = constants->{name};" for name in constants]
        idle = [] if constants else ["constants"]
        for argument in self._function.arguments:
            loads = [
                load(name, argument, i)
                for i, name in enumerate(self._model.program.inputs[argument])
                if name in read
            ]
            lines += loads
            idle += [] if loads else [argument]
        for i in range(len(self._parts.angles)):
            for array, entry in (("sine", sine_name(i)), ("cosine", cosine_name(i))):
                if entry in read:
                    lines.append(load(entry, array, i))
        return lines, idle

    def _call_lines(self, stride: str, offset: str) -> list[str]:
        """Body of the function for one state, or for a block of states, one a lane."""
        one = stride == "1"
        allocation = self._one if one else self._block
        size = "" if one else " * LANES"
        count, lines = len(self._parts.angles), []
        if count:
            lines.append(local_arrays(("angle", "sine", "cosine"), f"{count}{size}"))
        if allocation.slots:
            lines.append(local_arrays(["held"], f"{allocation.slots}{size}"))
        for output, sparse in zip(self._outputs, self._sparse, strict=True):
            if sparse:
                lines += self._statements.clear(output, f"{self._width(output)}{size}")
        name = self._function.name
        arrays = [*self._function.arguments]
        if count:
            call = [*arrays, "angle"]
            lines += _lane_call(f"{name}_angles", call, stride, offset)
            lines += _sine_lines(count, one)
        scratch = (["sine", "cosine"] if count else []) + (["held"] if allocation.slots else [])
        for section_name in self._section_names(allocation):
            call = [*scratch, *arrays, *self._outputs]
            lines += _lane_call(section_name, call, stride, offset)
        return lines

    def _doc_lines(self) -> list[str]:
        robot, function = self._model.robot, self._function
        counts = count_operations(function.nodes())
        lines = [f"@brief {self._row.summary}", ""]
        if self._row.details:
            lines += [*textwrap.wrap(self._row.details, WIDTH - 3), ""]
        items = [
            f"@param[in] constants what {robot.name}_init_constants() made, or "
            f"&{robot.name}_default_constants"
        ]
        for a in function.arguments:
            width = len(self._model.program.inputs[a])
            text = argument_text(robot, a)
            items.append(f"@param[in] {a} {ARGUMENTS[a].meaning}, {width} entries: {text}")
        for output, shaped in zip(self._row.outputs, function.outputs, strict=True):
            shape = " x ".join(map(str, shaped.shape)) or "1"
            items.append(f"@param[out] {output.name} {shape}: {output_text(robot, output)}")
        items += [
            f"@note {counts.total} operations, {counts.sine_cosine_pairs} sine-cosine pairs; "
            f"about {stack_bytes(self._parts)} bytes of stack for one state of doubles, optimised.",
            f"@par Source: {self._row.source}.",
        ]
        for item in items:
            lines += textwrap.wrap(item, WIDTH - 3, subsequent_indent="    ")
        return [f" {line}".rstrip() for line in lines]


def _goes_in_loops(allocation: Allocation) -> bool:
    """Whether the steps that loops stand for are enough to be worth it."""
    loops = [section.code for section in allocation.sections if isinstance(section.code, Loop)]
    return sum(len(loop.unrolled) for loop in loops) >= _FEWEST_ROLLED


def _is_sparse(output: Output) -> bool:
    """Whether it pays to clear the whole output first and then store what is not zero."""
    zeros = sum(entry == Number(0.0) for entry in output.entries)
    return zeros >= 32 and 3 * zeros >= len(output.entries)


def _lane_call(name: str, arrays: list[str], stride: str, offset: str) -> list[str]:
    lines = call(name, ["constants", *(f"{array}{offset}" for array in arrays), stride])
    return vector_loop("lane", "LANES", lines) if offset else lines


def _sine_lines(count: int, one: bool) -> list[str]:
    if not one:
        return call("sine_cosine_many", [f"{count} * LANES", "angle", "sine", "cosine"])
    lines = []
    for i in range(0, count, _AT_ONCE):
        arrays = [f"{array} + {i}" for array in ("angle", "sine", "cosine")]
        lines += call("sine_cosine_few", [f"{min(_AT_ONCE, count - i)}", *arrays])
    return lines
