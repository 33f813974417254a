"""Functions in C that are array programs: time steps, which call others.

The text is the same for one state and for a block of states: an entry of an array is `lanes` reals,
and what is computed for an entry is computed in a loop over these. What is kept on the way is in
one array, since local arrays cannot have a length that depends on the number of states.
"""

from __future__ import annotations

from gibbs_codegen.arrays.c_text import CProgram, View
from gibbs_codegen.arrays.contents import functions_of
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Node, Program
from gibbs_codegen.files.line_breaks import broken
from gibbs_codegen.files.verbatim import c_source
from gibbs_codegen.interface import FUNCTIONS, Signature
from gibbs_codegen.machine.steps import emitted_step
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.scratch import stack_bytes
from gibbs_codegen.program.trigonometry import gather_angles
from gibbs_codegen.targets.c import statements as c
from gibbs_codegen.targets.c.function import SCRATCH, function_text
from gibbs_codegen.targets.documentation import calls, doxygen
from gibbs_codegen.targets.printers import Context, Lines

_DOUBLE = 8


class LaneProgram(CProgram):
    """The function in C of a program, for `lanes` states side by side."""

    before_loops = ("ENTRYWISE",)

    def __init__(self, program: Program) -> None:
        super().__init__(program)
        self.name = f"{program.name}_states"

    @property
    def entries(self) -> int:
        """Entries of the scratch for one state."""
        return max((x.begin + x.size for x in self.arrays.values()), default=0)

    def _in_rows(self, array: str, x: Node, is_uniform: bool | None = None) -> View:
        uniform = self.uniform(x) if is_uniform is None else is_uniform
        return super()._in_rows(array, x)._replace(has_lanes=not uniform)

    def _is_kept(self, x: Node) -> bool:
        return bool(x.shape) or not self.uniform(x)

    def _in_states(self, lines: Lines, is_uniform: bool) -> Lines:
        if is_uniform:
            return lines
        return [*self.before_loops, *c.loop("lane", "lanes", lines)]

    def _same(self, text: str) -> str:
        return text

    def _kind(self, x: Node) -> str:
        return "real"

    def _function(self, functions: Functions, name: str) -> tuple[str, list[str]]:
        return "CALL", [name, "constants"]

    def _declaration(self, name: str, size: int, is_uniform: bool) -> str:
        return f"real {name}[{size}];" if is_uniform else f"real {name}[{size} * LANES];"

    def parameters(self) -> list[str]:
        """Declarations of what the function is given, in their order."""
        return [
            "const Constants *RESTRICT constants",
            *c.read_arrays(self.program.names),
            *c.written_arrays(self.program.outputs),
            *c.written_arrays([SCRATCH] if self.entries else []),
            "const int lanes",
        ]

    def _declared(self) -> list[str]:
        """Arrays between statements, which share the scratch."""
        return [
            f"real *{name} = {SCRATCH} + {storage.begin} * lanes;"
            for name, storage in self.arrays.items()
        ]

    def function(self, storage: str = "static INLINE ") -> list[str]:
        """The text of the function."""
        body = self.body()
        head = c.head(f"{storage}void {self.name}", self.parameters())
        lines = c.indented([*self.constants(), *body])
        return [*head, "{", *(part for line in lines for part in broken(line)), "}"]


def program_texts(model: Model) -> list[Context]:
    """What the templates are given of the functions that are array programs.

    The first has all definitions that they share.
    """
    robot = Functions(model.listing)
    shared = [c_source("calls.c").splitlines()]
    texts = []
    for signature in model.composed:
        text = LaneProgram(emitted_step(robot, signature.name))
        helpers = [*shared, text.function()]
        work = calls(model.description, signature.name)
        documentation = doxygen(model.description, signature, work, _stack(model, text))
        bodies = [_body(signature, text, lanes) for lanes in (False, True)]
        texts.append(function_text(model.robot.name, signature, documentation, helpers, *bodies))
        shared = []
    return texts


def _body(signature: Signature, text: LaneProgram, lanes: bool) -> Lines:
    """Body of a function, for a block of states (`lanes`), or for one state."""
    outputs = [output.name for output in FUNCTIONS[signature.name].outputs]
    scratch = {SCRATCH: c.array_size(text.entries, lanes)} if text.entries else {}
    arrays = ["constants", *signature.arguments, *outputs, *scratch]
    return [*c.local_arrays(scratch), *c.call(text.name, [*arrays, "LANES" if lanes else "1"])]


def _stack(model: Model, text: LaneProgram) -> int:
    """Stack that a function takes for one state of doubles (bytes): its own, and of its parts."""
    called = {name for _, name in functions_of(text.program)}
    parts = [stack_bytes(gather_angles(model.program.function(name))) for name in called]
    return _DOUBLE * text.entries + 2 * max(parts)
