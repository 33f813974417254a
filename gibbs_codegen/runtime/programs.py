"""Array programs in C: compiled together with the functions that they call, and kept.

The same text is compiled for one state, in double precision, and for blocks of states side by side,
in double or single precision.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.arrays.c_text import CProgram, c_functions
from gibbs_codegen.arrays.contents import (
    elementaries_of,
    externals_of,
    functions_of,
    owners_of,
    solve_room,
)
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Program
from gibbs_codegen.files.verbatim import c_source
from gibbs_codegen.interface import FUNCTIONS
from gibbs_codegen.runtime.c_library import c_files, chosen_compiler, compiled_files, opened
from gibbs_codegen.runtime.loaded_module import require_functions

Array = NDArray[np.float64]
# Names of the functions, which the module has not.
PREFIX = "program_"
# Outputs of a step in the order in which `engine.c` takes them.
STEP = "x_next", "ended", "inputs", "refused"


def c_text(
    programs: Sequence[Program],
    robot: Functions,
    lanes: int = 1,
    *,
    per_state: bool = False,
    engine: Sequence[str] = (),
    beside: Sequence[Program] = (),
) -> str:
    """The C source of programs that call functions of a robot's module.

    With `per_state` every state of a block has constants of its own. With an `engine`, lines of
    what evaluates them many times a call, nothing else calls them; it may have programs `beside`.
    """
    constants = "real" if per_state else f"{robot.name}_constants"
    lines = [
        f'#include "{robot.name}.h"',
        "",
        *([f"#define LANES {lanes}"] if lanes > 1 else []),
        f"typedef {robot.name}_real real;",
        f"typedef {constants} Constants;",
        *support([*programs, *beside], robot),
        *(blocks_of(programs, per_state=per_state) if lanes > 1 else []),
        *c_functions(programs, PREFIX, "static " if engine else ""),
        *engine,
    ]
    return "\n".join(lines) + "\n"


def support(programs: Sequence[Program], robot: Functions) -> list[str]:
    """Lines that programs need for any robot; before them are `real` and `Constants`."""
    by_hand = set().union(*map(externals_of, programs))
    files = ["platform.c", "numbers.c"]
    if set().union(*map(elementaries_of, programs)) & {"sin", "cos"}:
        files += ["exactness.c", "sine_cosine.c", "sine_cosine_numbers.c"]
    files += ["curves.c"] if by_hand & {"desired", "centre"} else []
    files += ["lanes.c", "allocation.c"] if by_hand - {"desired", "centre"} else []
    files += ["smallest_thrusts.c"] if by_hand & {"smallest_thrusts", "force_axis"} else []
    return [
        f"#ifdef {robot.name.upper()}_FLOAT",
        "#define SINGLE",
        "#endif",
        f"#define SOLVE_ROOM {max(map(solve_room, programs))}",
        f"#define COORDINATES {robot.space.coordinates}",
        f"#define ROTORS {len(robot.base_inputs)}",
        "",
        *map(c_source, files),
    ]


def blocks_of(programs: Sequence[Program], *, per_state: bool) -> list[str]:
    """The module's functions that programs call, for the states of a block."""
    ending = "batch_each" if per_state else "batch"
    calls = dict.fromkeys(call for program in programs for call in functions_of(program))
    return [line for call in calls for line in _block(*call, ending)]


def take_step(programs: Sequence[Program], names: Sequence[str]) -> list[str]:
    """A step of one of programs; the state of time and h is x, and `names` are of what is given.

    Their outputs are those of `machine.closed_loop`. A program without the output `refused` refuses
    what is not finite.
    """
    owners = sorted(set().union(*map(owners_of, programs)) - {*names})
    return [*sizes(programs[0]), *entry("step", programs, owners, names, STEP)]


def sizes(program: Program) -> list[str]:
    """Sizes of the state, and of the inputs whose ranges are recorded."""
    size, ranged = program.inputs[program.names.index("x")].size, program.outputs["inputs"].size
    return [f"#define STATE {size}", f"#define RANGED {ranged}", c_source("ranges.c")]


def entry(
    name: str,
    programs: Sequence[Program],
    owners: Sequence[str],
    names: Sequence[str],
    outputs: Sequence[str],
    prefix: str = PREFIX,
) -> list[str]:
    """A function of inputs up to x, and of all else by addresses, which evaluates a program.

    Addresses are of constants of `owners`, of the context of what is written by hand, and of inputs
    by their names, and constants of other owners; where there are several programs, that of the
    number of one comes last.
    """
    slots = [*owners, None, *names]
    first = programs[0].names.index("x") + 1
    leading = programs[0].names[:first]
    parameters = [*(f"const real {key}" for key in leading[:-1]), "const number *x"]
    lines = [
        f"static INLINE void take_{name}(",
        f"    const void *const *given, {', '.join(parameters)},",
        f"    {', '.join(f'number *{key}' for key in outputs)})",
        "{",
    ]
    for number, program in enumerate(programs):
        text = CProgram(program, prefix)
        values = [f"(const void *const *)given[{len(owners)}]"] if text.has_context else []
        values += [f"(const Constants *)given[{slots.index(owner)}]" for owner in text.owners]
        values += leading
        for key, x in zip(program.names[first:], program.inputs[first:], strict=True):
            kind = "real" if x.is_uniform else "number"
            at = f"(const {kind} *)given[{slots.index(key)}]"
            values.append(f"*{at}" if x.shape == () else at)
        # A result that all states share is written for each.
        uniform = {key: x for key, x in program.outputs.items() if text.uniform(x)}
        results = [f"uniform_{key}" if key in uniform else key for key in program.outputs]
        chosen = f"if (*(const int *)given[{len(slots)}] == {number}) "
        lines += [
            f"    {chosen if len(programs) > 1 else ''}{{",
            *(f"        real uniform_{key}[{x.size}];" for key, x in uniform.items()),
            f"        {text.name}({', '.join([*values, *results])});",
            *(
                f"        for (int i = 0; i < {x.size}; ++i) "
                f"{{ {key}[i] = same(uniform_{key}[i]); }}"
                for key, x in uniform.items()
            ),
            "    }",
        ]
    if "refused" in outputs and "refused" not in programs[0].outputs:
        lines.append(f"    refuse_infinite({programs[0].outputs['x_next'].size}, x_next, refused);")
    return [*lines, "}", ""]


def _block(module: str, function: str, ending: str) -> list[str]:
    """A function of the module for the states of a block."""
    row = FUNCTIONS[function]
    names = [*row.arguments, *(output.name for output in row.outputs)]
    kinds = ["const number"] * len(row.arguments) + ["number"] * len(row.outputs)
    parameters = ["const Constants *constants"]
    parameters += [f"{kind} *{name}" for kind, name in zip(kinds, names, strict=True)]
    cast = [
        f"({kind.replace('number', 'real')} *){name}"
        for kind, name in zip(kinds, names, strict=True)
    ]
    return [
        f"static INLINE void {module}_{function}_block(",
        f"    {', '.join(parameters)})",
        "{",
        f"    {module}_{function}_{ending}(constants, LANES, {', '.join(cast)});",
        "}",
        "",
    ]


def library(
    module: ModuleType,
    functions: Sequence[str],
    sources: Mapping[str, str],
    contents: str,
    *,
    single: bool = False,
    per_state: bool = False,
    blocks: bool = True,
    files: Sequence[str] = (),
    flags: Sequence[str] = (),
) -> ctypes.CDLL:
    """The library of C sources by their names, with the functions of a module that they call.

    These take `blocks` of states, or one, with `per_state` constants of each state too. `files` of
    the module are compiled as well. A message names the `contents`.
    Raises `CompilerError`, `CacheError` where the cache cannot be used, and `MissingFunctionError`.
    """
    name = module.NAME
    require_functions(module, functions)
    path = compiled_files(
        Path(module.__path__[0]),
        name,
        [*c_files(name, per_state=per_state, blocks=blocks), *files],
        chosen_compiler(),
        [*flags, *([f"-D{name.upper()}_FLOAT"] if single else [])],
        {file: text.encode() for file, text in sources.items()},
        functions=functions,
        contents=contents,
    )
    return opened(path)


def called(programs: Sequence[Program]) -> list[str]:
    """The functions of the module that programs call."""
    return list(dict.fromkeys(name for program in programs for _, name in functions_of(program)))


class CompiledProgram:
    """A program in C for one state; `constants` by owner, or those of the robot file.

    `tables` are arrays for what is written by hand. `inputs` and `outputs` are arrays by name,
    which `run` reads and writes.
    """

    def __init__(
        self,
        module: ModuleType,
        program: Program,
        constants: Mapping[str, Any] | None = None,
        tables: Sequence[Array] = (),
    ) -> None:
        self.inputs = {
            name: np.zeros(x.shape) for name, x in zip(program.names, program.inputs, strict=True)
        }
        self.outputs = {name: np.zeros(x.shape) for name, x in program.outputs.items()}
        text, default = CProgram(program), module.prepare({})
        robots = [(constants or {}).get(owner) or default for owner in text.owners]
        kept = [np.ascontiguousarray(table, dtype=np.float64) for table in tables]
        # Nothing is guessed.
        context = np.array([*(x.ctypes.data for x in kept), 0], dtype=np.uint64)
        # Numbers are passed by value.
        self._numbers = [(ctypes.c_double(), x) for x in self.inputs.values() if x.ndim == 0]
        numbers = (number for number, _ in self._numbers)
        self._arguments: list[Any] = [
            *([ctypes.c_void_p(context.ctypes.data)] if text.has_context else []),
            *robots,
            *(next(numbers) if x.ndim == 0 else _address(x) for x in self.inputs.values()),
            *map(_address, self.outputs.values()),
        ]
        self._owned = kept, context
        source = {f"_{program.name}.c": c_text([program], Functions(module))}
        contents = f"the program {program.name}"
        compiled = library(module, called([program]), source, contents, blocks=False)
        self._function = compiled[PREFIX + program.name]

    def run(self) -> None:
        """Compute the outputs of the inputs."""
        for number, x in self._numbers:
            number.value = float(x)
        self._function(*self._arguments)

    def __call__(self, *arguments: Any) -> dict[str, Array]:
        """Outputs (of their shapes) by name, of inputs in the program's order."""
        for x, value in zip(self.inputs.values(), arguments, strict=True):
            x[...] = value
        self.run()
        return {name: x.copy() for name, x in self.outputs.items()}


def _address(array: Array) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
