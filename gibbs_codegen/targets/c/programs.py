"""Functions in C that are array programs: time steps, which call others.

For a block of states an entry of an array is `lanes` reals, and what is computed for an entry is
computed in a loop over these. What is kept on the way is in one array.
"""

from __future__ import annotations

from gibbs_codegen.arrays.c_text import CProgram, View
from gibbs_codegen.arrays.contents import functions_of
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Node, Program
from gibbs_codegen.files.line_breaks import broken
from gibbs_codegen.machine.steps import emitted_step
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.scratch import stack_bytes
from gibbs_codegen.program.trigonometry import gather_angles
from gibbs_codegen.targets.c import statements as c
from gibbs_codegen.targets.c.function import SCRATCH, FunctionBody, function_text
from gibbs_codegen.targets.documentation import calls, doxygen
from gibbs_codegen.targets.printers import Context, Lines

_DOUBLE = 8


class StepProgram(CProgram):
    """The function in C of a program for one state, which calls those of a `robot`."""

    before_loops = ("ENTRYWISE",)
    has_lanes = False

    def __init__(self, program: Program, robot: str) -> None:
        super().__init__(program)
        self._robot = robot

    @property
    def scratch(self) -> dict[str, int]:
        """Entries for one state of the array with what is kept on the way, by its name, if any."""
        entries = max((x.begin + x.size for x in self.arrays.values()), default=0)
        return {SCRATCH: entries} if entries else {}

    def _in_rows(self, array: str, x: Node, is_uniform: bool | None = None) -> View:
        uniform = self.uniform(x) if is_uniform is None else is_uniform
        return super()._in_rows(array, x)._replace(has_lanes=self.has_lanes and not uniform)

    def _is_kept(self, x: Node) -> bool:
        return bool(x.shape) or not self.uniform(x)

    def _same(self, text: str) -> str:
        return text

    def _kind(self, x: Node) -> str:
        return "real"

    def _in_states(self, lines: Lines, is_uniform: bool) -> Lines:
        return lines

    def _function(self, functions: Functions, name: str) -> tuple[str, list[str]]:
        return f"{self._robot}_{name}", ["constants"]

    def _declaration(self, name: str, size: int, is_uniform: bool) -> str:
        return f"real {name}[{size}];"

    def _declared(self) -> list[str]:
        """Arrays between statements, which share the scratch."""
        return [
            f"real *{name} = {SCRATCH} + {storage.begin};" for name, storage in self.arrays.items()
        ]

    def function_body(self) -> FunctionBody:
        """The body of the function, which needs no helpers."""
        body = self.body()  # First, since it finds the tables.
        lines = [*c.local_arrays({x: str(size) for x, size in self.scratch.items()})]
        lines += [*self.constants(), *body]
        return FunctionBody([], [part for line in lines for part in broken(line)])


class LaneProgram(StepProgram):
    """The function in C of a program for `lanes` states side by side."""

    has_lanes = True

    def _in_states(self, lines: Lines, is_uniform: bool) -> Lines:
        if is_uniform:
            return lines
        return [*self.before_loops, *c.loop("lane", "lanes", lines)]

    def _function(self, functions: Functions, name: str) -> tuple[str, list[str]]:
        return f"{name}_block", ["constants"]

    def _declaration(self, name: str, size: int, is_uniform: bool) -> str:
        return f"real {name}[{size}];" if is_uniform else f"real {name}[{size} * LANES];"

    def parameters(self) -> list[str]:
        """Declarations of what the function is given, in their order."""
        return [
            "const Constants *RESTRICT constants",
            *c.read_arrays(self.program.names),
            *c.written_arrays(self.program.outputs),
            *c.written_arrays(self.scratch),
            "const int lanes",
        ]

    def _declared(self) -> list[str]:
        return [
            f"real *{name} = {SCRATCH} + {storage.begin} * lanes;"
            for name, storage in self.arrays.items()
        ]

    def function_body(self) -> FunctionBody:
        """The body of the function for a block, and the helper that it calls."""
        name, body = f"{self.program.name}_states", self.body()
        lines = c.indented([*self.constants(), *body])
        head = c.head(f"static INLINE void {name}", self.parameters())
        helper = [*head, "{", *(part for line in lines for part in broken(line)), "}"]
        sizes = {x: c.array_size(size, lanes=True) for x, size in self.scratch.items()}
        arrays = ["constants", *self.program.names, *self.program.outputs, *sizes]
        call = c.call(name, [*arrays, "LANES"])
        return FunctionBody([helper], [*c.local_arrays(sizes), *call])


def program_texts(model: Model) -> list[Context]:
    """Values for the templates of functions that are array programs."""
    robot = Functions(model.listing)
    texts = []
    for signature in model.composed:
        program = emitted_step(robot, signature.name)
        one, block = (form(program, robot.name) for form in (StepProgram, LaneProgram))
        work = calls(model.description, signature.name)
        documentation = doxygen(model.description, signature, work, _stack(model, one))
        texts.append(
            function_text(
                *(robot.name, signature, documentation),
                *(one.function_body(), block.function_body()),
            )
        )
    return texts


def _stack(model: Model, text: StepProgram) -> int:
    """Stack that a function takes for one state of doubles (bytes): its own, and of its parts."""
    called = {name for _, name in functions_of(text.program)}
    parts = [stack_bytes(gather_angles(model.program.function(name))) for name in called]
    return _DOUBLE * sum(text.scratch.values()) + 2 * max(parts)
