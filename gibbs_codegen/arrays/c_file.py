"""C files of array programs for one state, which stand beside those of a generated module.

They have no other source than the module's header: what a program calls that is written by hand is
in them, as far as it is called. Structures group inputs that belong together, and their members are
flat arrays, row by row.
"""

from __future__ import annotations

import os
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from gibbs_codegen.arrays.c_text import CProgram
from gibbs_codegen.arrays.contents import (
    check_distinct,
    externals_of,
    owners_of,
    solve_room,
)
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Node, Program
from gibbs_codegen.errors import UsageError
from gibbs_codegen.files.line_breaks import WIDTH, broken
from gibbs_codegen.files.staging import writing
from gibbs_codegen.files.verbatim import c_source
from gibbs_codegen.version import __version__

# Endings of the names of files that modules have.
_OF_MODULES = ("batch", "each", "laws", "rollout")
# Functions written by hand, after the paragraphs that they need.
_BY_HAND = ("numbers.c", "allocation.c", "smallest_thrusts.c")
_EXTERNALS = frozenset({"nearest_thrusts", "smallest_thrusts", "force_axis"})
_NAME = re.compile(r"^(?:static [\w *]*?\b(\w+)\(|(?:enum \{ |\} |#define )(\w+))", re.MULTILINE)


@dataclass(frozen=True)
class Member:
    """A member of a structure: the input or output of a program that it holds, and what it is.

    What is remembered from call to call is an input that the output `after` takes the place of.
    """

    name: str
    value: str
    words: str
    after: str = ""

    @property
    def values(self) -> tuple[str, ...]:
        """The input and the output that it holds."""
        return tuple(filter(None, (self.value, self.after)))


@dataclass(frozen=True)
class Structure:
    """A structure that functions are given as the argument `name`, of the type `<robot>_<name>`."""

    name: str
    words: str
    members: tuple[Member, ...]

    @classmethod
    def kept(cls, name: str, words: str, **members: str) -> Structure:
        """A structure of what is remembered, by names and words of its members."""
        made = (Member(name, name, words, f"{name}_next") for name, words in members.items())
        return cls(name, words, tuple(made))


@dataclass(frozen=True)
class CFunction:
    """A program as a function of C: structures for inputs and outputs, which others follow alone.

    `words` say what it does; `explained` what inputs and outputs are that no structure has.
    """

    program: Program
    words: str
    structures: tuple[Structure, ...] = ()
    explained: Mapping[str, str] = field(default_factory=dict)


def c_files(
    robot: Functions, stem: str, words: str, functions: Sequence[CFunction], opening: Iterable[str]
) -> dict[str, str]:
    """Header and source `stem`.h and .c of programs, by name; `opening` are lines of a comment.

    Raises `UsageError` for a program that calls what is written by hand in Python alone.
    """
    for function in functions:
        if unknown := sorted(externals_of(function.program) - _EXTERNALS):
            raise UsageError(
                f"{function.program.name}: {', '.join(unknown)} is written by hand and has no C; "
                "use other nodes, or give its values as inputs"
            )
    above = "".join(f"/* {line} */\n" for line in opening)
    header, source = _header(robot, stem, words, functions), _source(robot, stem, functions)
    return {f"{stem}.h": f"{above}\n{header}", f"{stem}.c": f"{above}\n{source}"}


def write_c(
    program: Program, robot: Functions, folder: str | os.PathLike[str], words: str = ""
) -> list[Path]:
    """Write a program as C for firmware: one function, `<robot>_<program>`, for one state.

    It is given the robot's constants, if it calls functions of the robot, then inputs and outputs
    in the program's order: numbers by value, arrays row by row. It allocates no memory, and is
    compiled with `<robot>.c`, in double or, with -D<ROBOT>_FLOAT, in single precision.

    Args:
        program: The program.
        robot: The robot whose functions it calls.
        folder: Folder for the two files; give the folder of the module to the compiler with -I.
        words: What it does, in a sentence for the header.

    Returns:
        Paths of the header and the source.

    Raises:
        UsageError: If the program has external functions of which there is no C, or a name that
            it cannot have there.
        OutputError: If the files cannot be written.
    """
    explained = {
        name: f"{x.size} numbers, of the shape {x.shape}"
        if len(x.shape) > 1
        else (f"{x.size} numbers" if x.shape else "a number")
        for name, x in _values(program).items()
    }
    if program.name in _OF_MODULES:
        raise UsageError(f"{program.name}: a module has a file of that name; rename the program")
    stem = f"{robot.name}_{program.name}"
    words = words or f"The array program {program.name}."
    made = [CFunction(program, words, explained=explained)]
    texts = c_files(robot, stem, f"{program.name} of {robot.name}.", made, opening(robot))
    for name, text in texts.items():
        with writing(Path(folder) / name):
            (Path(folder) / name).write_text(text, encoding="utf-8")
    return [Path(folder) / name for name in texts]


def opening(robot: Functions, *others: str) -> list[str]:
    """The head of files that are compiled with a module's functions for one state, and `others`."""
    files = " and ".join([f"{robot.name}.c", *others])
    return [
        f"Printed by gibbs_codegen {__version__}; compile it with {files}.",
        "SPDX-License-Identifier: MIT-0 (yours to use, change and pass on without conditions)",
    ]


def _header(robot: Functions, stem: str, words: str, functions: Sequence[CFunction]) -> str:
    guard = f"{stem.upper()}_H"
    kept: dict[str, tuple[Structure, Mapping[str, Node]]] = {}
    for function in functions:
        for structure in function.structures:
            _, values = kept.get(structure.name, (structure, {}))
            kept[structure.name] = (structure, {**values, **_values(function.program)})
    parts = [
        comment(f"@file\n@brief {words}"),
        f"#ifndef {guard}\n#define {guard}\n",
        f'#include "{robot.name}.h"\n',
        '#ifdef __cplusplus\nextern "C" {\n#endif\n',
        *(_declared(robot, structure, values) for structure, values in kept.values()),
        *(comment(_explained(f)) + ";\n".join([*_heading(robot, f), ""]) for f in functions),
        "#ifdef __cplusplus\n}\n#endif\n",
        f"#endif /* {guard} */\n",
    ]
    return "\n".join(parts)


def _declared(robot: Functions, structure: Structure, values: Mapping[str, Node]) -> str:
    """The type of a structure."""
    name = f"{robot.name}_{structure.name}"
    lines = []
    for member in structure.members:
        held = next(values[value] for value in member.values if value in values)
        size = f"[{held.size}]" if held.shape else ""
        lines += [f"    {line}" for line in comment(member.words, width=WIDTH - 4).splitlines()]
        lines.append(f"    {robot.name}_real {member.name}{size};")
    return "\n".join([f"{comment(structure.words)}typedef struct {{", *lines, f"}} {name};\n"])


def _explained(function: CFunction) -> str:
    """The comment on a function: its work, and its arguments without structures."""
    rows = [f"@brief {function.words}"]
    if function.explained:
        rows.append("")
    rows += [f"@param {name} {words}" for name, words in function.explained.items()]
    return "\n".join(rows)


def comment(text: str, width: int = WIDTH) -> str:
    """A comment of lines, each of which is wrapped."""
    lines = [
        line
        for row in text.split("\n")
        for line in textwrap.wrap(row, width - 3, subsequent_indent="    " if "@p" in row else "")
        or [""]
    ]
    if len(lines) == 1 and len(lines[0]) < width - 7:
        return f"/** {lines[0]} */\n"
    return "\n".join(["/**", *(f" * {line}".rstrip() for line in lines), " */\n"])


def _values(program: Program) -> dict[str, Node]:
    """Inputs and outputs by name."""
    return dict(zip(program.names, program.inputs, strict=True)) | dict(program.outputs)


def _heading(robot: Functions, function: CFunction) -> list[str]:
    """The lines of a function's type and parameters."""
    held = {value for x in function.structures for m in x.members for value in m.values}
    program = function.program
    # With a structure, an output is given back in it.
    declared = [f"const {robot.name}_constants *{owner}" for owner in _owners(program)]
    for structure in function.structures:
        is_output = any(x in program.outputs for m in structure.members for x in m.values)
        const = "" if is_output else "const "
        declared.append(f"{const}{robot.name}_{structure.name} *{structure.name}")
    for name, x in _values(program).items():
        if name not in held:
            const = "const " if name not in program.outputs and x.shape else ""
            star = "*" if x.shape or name in program.outputs else ""
            declared.append(f"{const}{robot.name}_real {star}{name}")
    return [f"void {robot.name}_{program.name}(\n    " + ",\n    ".join(declared) + ")"]


def _owners(program: Program) -> list[str]:
    """Names of the arguments with constants."""
    owners = owners_of(program)
    return ["constants"] if len(owners) == 1 else owners


def _source(robot: Functions, stem: str, functions: Sequence[CFunction]) -> str:
    programs = [*dict.fromkeys(x for f in functions for x in f.program.inner)]
    check_distinct([*programs, *(f.program for f in functions)])
    texts = [CProgram(x, is_plain=True).function() for x in programs]
    for function in functions:
        texts += [CProgram(function.program, is_plain=True).function(), _calling(robot, function)]
    body = "\n\n".join(
        "\n".join(part for line in lines for part in broken(line)) for lines in texts
    )
    sizes = {
        "ROTORS": len(robot.base_inputs),
        "SOLVE_ROOM": max((solve_room(f.program) for f in functions), default=1),
    }
    helpers = _needed(body)
    text = f"{helpers}{body}"
    used = [name for name in sizes if re.search(rf"\b{name}\b", text)]
    enums = "".join(f"enum {{ {name} = {sizes[name]} }};\n" for name in used)
    single = f"#ifdef {robot.name.upper()}_FLOAT\n"
    suffixes = {"R(literal)": "literal", "LIBRARY(function)": "function"}
    wanted = {name: x for name, x in suffixes.items() if f"{name.partition('(')[0]}(" in text}
    macros = [
        *("#define SINGLE\n" if re.search(r"\bSINGLE\b", text) else "",),
        *(f"#define {name} {x}##f\n" for name, x in wanted.items()),
        "#else\n",
        *(f"#define {name} {x}\n" for name, x in wanted.items()),
    ]
    # Functions of <math.h> are called with a macro that chooses the precision.
    included = ["math.h"] if "LIBRARY(" in text or "NAN" in text or "INFINITY" in text else []
    included += ["string.h"] if "mem" in text else []
    includes = "".join(f"#include <{name}>\n" for name in included)
    return "\n".join(
        [
            f'#include "{stem}.h"\n',
            *([includes] if includes else []),
            f"typedef {robot.name}_real real;",
            f"typedef {robot.name}_constants Constants;",
            *([enums.rstrip()] if enums else []),
            *([f"{single}{''.join(macros)}#endif\n"] if wanted else [""]),
            text + "\n",
        ]
    )


def _calling(robot: Functions, function: CFunction) -> list[str]:
    """The function that users call, which takes structures apart."""
    places: dict[str, str] = {}
    copies = []
    for structure in function.structures:
        name = structure.name
        for member in structure.members:
            places |= dict.fromkeys(member.values, f"{name}->{member.name}")
            if member.after and member.value in function.program.names:
                # What is read is not what is written, which may come first.
                places[member.value] = f"{name}_before.{member.name}"
                copies.append(f"    const {robot.name}_{name} {name}_before = *{name};")
    program = CProgram(function.program, is_plain=True)
    passed = _owners(function.program)
    for name, x in _values(function.program).items():
        at = places.get(name, name)
        is_output = name in function.program.outputs
        passed.append(f"&{at}" if is_output and not x.shape and name in places else at)
    return [
        *"".join(_heading(robot, function)).split("\n"),
        "{",
        *dict.fromkeys(copies),
        f"    {program.name}({', '.join(passed)});",
        "}",
    ]


def _needed(text: str) -> str:
    """The text written by hand that another needs, for one state."""
    kept: list[str] = []
    paragraphs = [part for name in _BY_HAND for part in _for_one_state(name).split("\n\n")]
    for part in reversed(paragraphs):
        # A function is called; a variable may have its name.
        names = [rf"{call}\(" if call else rf"{other}\b" for call, other in _NAME.findall(part)]
        if any(re.search(rf"\b{name}", text) for name in names):
            kept.insert(0, part.strip())
            text = f"{part}\n{text}"
    return "".join(f"{part}\n\n" for part in kept)


def _for_one_state(name: str) -> str:
    """A file of functions written by hand, with numbers of one state."""
    text = c_source(name).replace("static INLINE void solve(", "static INLINE void real_solve(")
    return re.sub(r"\bINLINE\b", "inline", re.sub(r"\bnumber\b", "real", text))
