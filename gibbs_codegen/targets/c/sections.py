"""The helpers of a C function: its angles, and the sections that the rest is split into."""

from __future__ import annotations

from collections.abc import Sequence

from gibbs_codegen.interface import FUNCTIONS
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.nodes import Function, names_in
from gibbs_codegen.program.scratch import Allocation, Section
from gibbs_codegen.program.steps import Loop, Step, Store, headed
from gibbs_codegen.program.trigonometry import GatheredFunction, cosine_name, sine_name
from gibbs_codegen.targets.c.arrays import load, place_in_loop, read_arrays, spill, written_arrays
from gibbs_codegen.targets.c.statements import (
    StatementPrinter,
    comment,
    helper,
    load_constant,
    unused,
    vector_loop,
)

# The arrays that helpers hand values on in.
ANGLE, SINE, COSINE, SCRATCH = "angle", "sine", "cosine", "scratch"


class HelperPrinter:
    """Prints the helpers of one function, each a definition in lines."""

    def __init__(
        self,
        model: Model,
        function: Function,
        gathered: GatheredFunction,
        statements: StatementPrinter,
    ) -> None:
        self._inputs = {name: model.program.inputs[name] for name in function.arguments}
        self._outputs = [output.name for output in FUNCTIONS[function.name].outputs]
        self._constants = function.constants
        self._gathered = gathered
        self._statements = statements

    def angles(self, name: str) -> list[str]:
        """The helper that computes all angles whose sines and cosines are needed."""
        gathered = self._gathered
        nodes = [*(s.value for s in gathered.angle_statements), *gathered.angles]
        lines, idle = self._loads({name for node in nodes for name in names_in(node)})
        lines += self._statements.declare_all(gathered.angle_statements)
        for i, angle in enumerate(gathered.angles):
            lines += self._statements.store(ANGLE, i, angle)
        parameters = read_arrays(self._inputs) + written_arrays([ANGLE])
        return helper(name, parameters, [*map(unused, idle), *lines])

    def section(self, name: str, section: Section, allocation: Allocation) -> list[str]:
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
            *read_arrays([SINE, COSINE] if self._gathered.angles else []),
            *written_arrays([SCRATCH] if allocation.slots else []),
            *read_arrays(self._inputs),
            *written_arrays(self._outputs),
        ]
        return helper(name, parameters, [*map(unused, idle), *loads, *computed])

    def _straight(
        self, steps: Sequence[Step], section: Section, allocation: Allocation
    ) -> list[str]:
        """Lines of steps that are done once."""
        lines = [
            load(name, SCRATCH, slot, allocation.sign(name))
            for name, slot in section.reloads.items()
        ]
        for words, step in headed(steps):
            lines += comment(words)
            if isinstance(step, Store):
                lines += self._statements.store(self._outputs[step.output], step.place, step.value)
                continue
            lines += self._statements.declare(step.name, step.value)
            if step.name in section.spills:
                slot = section.spills[step.name]
                lines.append(spill(SCRATCH, slot, step.name, allocation.sign(step.name)))
        return lines

    def _loop(self, loop: Loop, section: Section, allocation: Allocation) -> list[str]:
        """Lines of a loop."""
        before, lines, inside = [], [], self._statements.inside
        for name, slot in section.reloads.items():
            if name in loop.operands:
                lines.append(load(name, SCRATCH, place_in_loop(slot)))
            else:
                before.append(load(name, SCRATCH, slot, allocation.sign(name)))
        places = map(place_in_loop, loop.places, loop.strides)
        for step in loop.body:
            if isinstance(step, Store):
                lines += inside.store(self._outputs[step.output], next(places), step.value)
                continue
            lines += inside.declare(step.name, step.value)
            if step.name in section.spills:
                slot = section.spills[step.name]
                lines.append(spill(SCRATCH, place_in_loop(slot), step.name))
        return [*before, *comment(loop.group), *vector_loop("i", loop.count, lines)]

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
        lines = [load_constant(name) for name in self._constants if name in read]
        idle = [] if lines else ["constants"]
        for argument, names in self._inputs.items():
            loads = [load(name, argument, i) for i, name in enumerate(names) if name in read]
            lines += loads
            idle += [] if loads else [argument]
        for i in range(len(self._gathered.angles)):
            for array, entry in ((SINE, sine_name(i)), (COSINE, cosine_name(i))):
                if entry in read:
                    lines.append(load(entry, array, i))
        return lines, idle
