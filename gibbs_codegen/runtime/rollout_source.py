"""The C source of rollouts: the programs of their steps, and the engine that takes them.

It is the same for rollouts from Python, of which each is made of one program with what it needs,
and for those who have it generated to compile it themselves, in which a call chooses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from gibbs_codegen.arrays.c_text import c_functions, literal
from gibbs_codegen.arrays.contents import owners_of
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Node, Program
from gibbs_codegen.files.templating import render
from gibbs_codegen.files.verbatim import c_source
from gibbs_codegen.machine.rollout_steps import ALL, Parts, rollout_inputs, rollout_step, sent
from gibbs_codegen.machine.steps import METHODS
from gibbs_codegen.runtime.programs import PREFIX, blocks_of, support, take_step

TEMPLATES = {
    "c_rollout.h.jinja": "{name}_rollout.h",
    "c_rollout.c.jinja": "{name}_rollout.c",
}
# A call chooses among these; each has the parts of the ones before it.
_PARTS = {
    "inputs": Parts(),
    "commands": Parts(feedback=True, limits=True, lag=True, bounds=True),
    "wrenches": ALL,
}
# The value of every entry of an input that is left out, if not 0.
_WITHOUT = {
    **{"desired_q": 1.0, "least": -math.inf, "most": math.inf},
    **{"lowest": -math.inf, "highest": math.inf},
}

# By what is sent: the list of its entries, and what follows it, of all states and of one.
_SENT = {"command": ("COMMANDS", "x", "x"), "u": ("INPUTS", "thrusts", "thrust")}


def rollout_programs(robot: Functions) -> list[Program]:
    """Programs for all that a rollout may have, those of a method one after the other."""
    return [
        rollout_step(robot, method, parts, f"{method}_{word}", has_thrusts=True)
        for method in METHODS
        for word, parts in _PARTS.items()
    ]


def rollout_files(
    robot: Functions, programs: Sequence[Program], header: Sequence[str]
) -> dict[str, str]:
    """Texts of the header and the source by their names; `header` are lines that open both."""
    context = rollout_context(robot, programs, header)
    return {
        file.format(name=robot.name): render(template, context)
        for template, file in TEMPLATES.items()
    }


def rollout_context(
    robot: Functions, programs: Sequence[Program], header: Sequence[str]
) -> dict[str, Any]:
    """Values for the templates."""
    inputs, _, actuated = _SENT[sent(robot)]
    return {
        "header": header,
        "name": robot.name,
        "has_drives": robot.driven,
        "has_drive": robot.space.has_drive,
        "has_inputs": not robot.driven,  # Otherwise commands are held, which have no lag.
        "inputs": inputs,
        "states": robot.actuator_states,
        "actuated": actuated,
        "others": [
            name for name in _inputs(robot, programs) if name not in rollout_inputs(robot, ALL)
        ],
        "source": _source(robot, programs),
    }


def _source(robot: Functions, programs: Sequence[Program]) -> list[str]:
    """Lines of the source that follow the header's."""
    name, capitals = robot.name, robot.name.upper()
    _, followers, follower = _SENT[sent(robot)]
    macros = {
        "NQ": f"{capitals}_COORDINATES",
        "NV": f"{capitals}_VELOCITIES",
        "CONSTANTS": f"{capitals}_CONSTANTS",
        "ACTUATORS": "(STATE - NQ - NV)",
        "FIRST_ROWS": sent(robot),
        "ACTUATED": followers,
        "ACTUATED_SAMPLES": f"{follower}_samples",
        **{word: f"{capitals}_ROLLOUT_{word}" for word in ("RUNNING", "DIVERGED", "OUT_OF_BOUNDS")},
    }
    return [
        f"#ifdef {capitals}_DISPATCH",
        "#define DISPATCH",
        "#endif",
        f"#if defined(__GNUC__) && !defined({capitals}_SINGLY)",
        f"#define LANES {capitals}_LANES",
        "typedef real Constants;",
        "#else",
        f"typedef {name}_constants Constants;",
        "#endif",
        f"#define MODULE(name) {name}_##name",
        *(f"#define {macro} {text}" for macro, text in macros.items()),
        *support(programs, robot),
        "#if LANES > 1",
        *blocks_of(programs, per_state=True),
        "#endif",
        "",
        *c_functions(programs, PREFIX, "static "),
        c_source("rows.c"),
        *take_step(programs, [*_inputs(robot, programs)]),
        c_source("engine.c"),
        *_tables(robot, programs),
        c_source("rollout.c").rstrip(),
    ]


def _inputs(robot: Functions, programs: Sequence[Program]) -> dict[str, Node | None]:
    """Inputs that a rollout may have, and further ones of programs."""
    inputs: dict[str, Node | None] = {**rollout_inputs(robot, ALL)}
    for program in programs:
        inputs |= _read(robot, program)
    return inputs


def _read(robot: Functions, program: Program) -> dict[str, Node | None]:
    """Inputs of a program, and None for the constants of a model that it knows, by name."""
    inputs: dict[str, Node | None] = dict(zip(program.names[3:], program.inputs[3:], strict=True))
    return inputs | dict.fromkeys(owner for owner in owners_of(program) if owner != robot.owner)


def _tables(robot: Functions, programs: Sequence[Program]) -> list[str]:
    """Inputs of programs, in the order of the header, and the programs that have them."""
    inputs, lines, room = _inputs(robot, programs), [], 0
    read = [_read(robot, program) for program in programs]
    for name, x in inputs.items():
        size = x.size if x is not None and any(name in names for names in read) else 0
        is_shared, without = x is not None and x.is_uniform, literal(_WITHOUT.get(name, 0.0))
        shown = "CONSTANTS" if x is None else size
        lines.append(f"    {{{shown}, {int(is_shared)}, {without}}}, /* {name} */")
        room += size
    sizes = ["CONSTANTS"] * (1 + sum(x is None for x in inputs.values()))
    masks = [
        sum(1 << place for place, name in enumerate(inputs) if name in names) for names in read
    ]
    return [
        f"#define GIVEN {len(inputs)}",
        f"#define PROGRAMS {len(programs)}",
        f"#define ROOM ({' + '.join([*sizes, str(room)])})",
        "static const Input INPUTS[GIVEN] = {",
        *lines,
        "};",
        "/* Bits for the inputs that a program has. */",
        f"static const unsigned HAS[PROGRAMS] = {{{', '.join(f'{mask}u' for mask in masks)}}};",
        "",
    ]
