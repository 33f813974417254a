"""Values for the CUDA templates: the functions of C as those of a device, and kernels of them."""

from __future__ import annotations

import math

from gibbs_codegen.arrays.c_text import CProgram
from gibbs_codegen.arrays.contents import check_distinct, solve_room
from gibbs_codegen.arrays.nodes import Node, Program
from gibbs_codegen.files.verbatim import c_source
from gibbs_codegen.interface import FUNCTIONS
from gibbs_codegen.machine.rollout_steps import Parts, rollout_step, sent
from gibbs_codegen.machine.steps import METHODS
from gibbs_codegen.program.model import Model
from gibbs_codegen.runtime.programs import PREFIX
from gibbs_codegen.targets.c import statements as c
from gibbs_codegen.targets.c import target as c_target
from gibbs_codegen.targets.c.calls import check_calls, model_functions
from gibbs_codegen.targets.printers import Context, InfixPrinter, Lines

_INLINE = "static INLINE "
# What the constants of a thread are called, and the ending of its arrays.
_OWN = "own"
# Rollouts are of these, which threads do not choose from at run time: registers are scarce.
_PARTS = {"inputs": Parts(), "commands": Parts(feedback=True, limits=True, lag=True)}
# Bytes that a kernel may be given; larger matrices are behind pointers.
_ROOM = 30_000
# Inputs of rollouts, by their names in programs.
_WORDS = {
    "u": "inputs, held through each step",
    "command": "commands, held through each step",
    "gain": "gain: multiplied by the displacement from the state to the desired one, and added to "
    "the inputs",
    "desired_q": "desired coordinates",
    "desired_v": "desired velocities",
    "desired_x": "desired states of actuators",
    "least": "lower limits of the inputs",
    "most": "upper limits of the inputs",
    "lag": "1, exp(-h / 2 T), exp(-h / T) of each rotor with the time constant T; or 0, 0, 0",
}


def module_text(model: Model, printer: InfixPrinter, header: Lines) -> Context:
    """Context of the CUDA templates. Raises `UsageError` for a model without what rollouts call."""
    robot = model_functions(model)
    programs = [
        rollout_step(robot, method, parts, f"{method}_{word}", has_thrusts=True)
        for method in METHODS
        for word, parts in _PARTS.items()
    ]
    check_calls(model, programs, "--target cuda: its rollouts call")
    inner = list(dict.fromkeys(x for program in programs for x in program.inner))
    check_distinct([*inner, *programs])
    inputs = {
        key: x
        for program in programs
        for key, x in zip(program.names[3:], program.inputs[3:], strict=True)
    }
    rest = "actuators" if robot.actuator_states else "thrusts" if robot.lagging else ""
    shared = sum(x.size for x in inputs.values() if x.is_uniform)
    by_value = 8 * (shared + len(model.program.constants)) < _ROOM
    return c_target.module_text(model, printer, header) | {
        "runtime": c_source("device.c"),
        "rows": c_source("device_rows.c"),
        "open_loops": ": loops of the mechanism are open" if robot.undriven else "",
        "and_lag": ", lag" if "lag" in inputs else "",
        "and_rest": f", {rest}" if rest else "",
        "inputs": [
            line
            for key, x in inputs.items()
            for line in (
                f"/** {x.size}: {_WORDS[key]} */",
                f"{_declared(model.robot.name, key, x, by_value)};",
            )
        ],
        "size": programs[0].inputs[2].size,
        "sent": max(1, inputs[sent(robot)].size),
        "forms": [
            {
                "ending": "",
                "constants": "const Constants constants",
                "lines": ["const Constants *const own = &constants;"],
            },
            {
                "ending": "_each",
                "constants": "const real *RESTRICT constants",
                "lines": [
                    "Constants each;",
                    "const Constants *const own = &each;",
                    f"load({len(model.program.constants)}, constants, count, i, (real *)&each);",
                ],
            },
        ],
        "kernels": _kernels(model),
        "programs": [
            f"#define SOLVE_ROOM {max(map(solve_room, programs))}",
            c_source("numbers.c"),
            c_source("sine_cosine_numbers.c"),
            *(
                line
                for x in (*inner, *programs)
                for line in [*CProgram(x, PREFIX).function(_INLINE), ""]
            ),
        ],
        "rollouts": [_rollout(program) for program in programs],
    }


def _declared(robot: str, name: str, x: Node, by_value: bool) -> str:
    """What holds an input of a rollout, by value if all states share it and there is room."""
    if not x.is_uniform:
        return f"{robot}_rollout_rows {name}"
    return f"real {name}[{x.size}]" if by_value else f"const real *{name}"


def _kernels(model: Model) -> list[Context]:
    """Kernels of the functions, by what they are given, and what a thread does."""
    kernels = []
    for signature in model.signatures:
        outputs = [output.name for output in FUNCTIONS[signature.name].outputs]
        sizes = dict(zip(signature.arguments, signature.widths, strict=True))
        sizes |= dict(zip(outputs, map(math.prod, signature.shapes), strict=True))
        parameters = [*c.read_arrays(signature.arguments), *c.written_arrays(outputs)]
        places = {key: f"{key}_{_OWN}" for key in sizes}
        lines = [f"real {places[key]}[{max(1, size)}];" for key, size in sizes.items()]
        loads = [f"load({sizes[x]}, {x}, count, i, {places[x]});" for x in signature.arguments]
        called = c.call(f"{model.robot.name}_{signature.name}", [_OWN, *places.values()])
        stores = [f"store({sizes[x]}, {places[x]}, count, i, {x});" for x in outputs]
        kernels.append(
            {
                "name": signature.name,
                "parameters": [f"{x}," for x in parameters[:-1]] + [f"{parameters[-1]})"],
                "lines": [*lines, *loads, *called, *stores],
            }
        )
    return kernels


def _rollout(program: Program) -> Context:
    """A rollout: arrays of what differs from state to state, their loads, and the arguments."""
    inputs = dict(list(zip(program.names, program.inputs, strict=True))[3:])
    sizes = {key: x.size for key, x in inputs.items() if not x.is_uniform}
    return {
        "name": program.name,
        "declared": [f"real {key}[{max(1, size)}];" for key, size in sizes.items()],
        "loads": [
            f"load_rows(&given->{key}, {size}, i, step, {key});" for key, size in sizes.items()
        ],
        "changes": " || ".join(f"given->{key}.by_step" for key in sizes),
        "arguments": ", ".join(key if key in sizes else f"given->{key}" for key in inputs),
    }
