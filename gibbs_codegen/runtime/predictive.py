"""A predictive controller in C: its programs and its solver, with a header for users of C.

One structure of real numbers holds its inputs and results; `members` lists its members: C has its
type from there, and NumPy its arrays. Both compile the same text; for users of C a function follows
that fills the structure with the arguments of a controller.
"""

from __future__ import annotations

import ctypes
import math
import re
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.arrays.c_file import comment, opening
from gibbs_codegen.arrays.c_text import CProgram, c_functions, literal
from gibbs_codegen.arrays.nodes import Program
from gibbs_codegen.files.line_breaks import WIDTH, broken
from gibbs_codegen.files.staging import writing
from gibbs_codegen.files.verbatim import c_source
from gibbs_codegen.machine.predictive import Horizon
from gibbs_codegen.runtime.programs import PREFIX, blocks_of, called, library, support

Array = NDArray[np.float64]
# Functions that a module needs beside the default ones, the last ones where it has actuators.
DERIVATIVES = (
    "forward_dynamics_derivatives",
    "frame_poses_derivatives",
    "integrate_derivatives",
    "difference_derivatives",
    "inputs_of_derivatives",
    "actuator_rates_derivatives",
)
# Functions that it needs besides where something acts on frames, the last one where it has
# actuators; and where payloads do.
UNDER_WRENCHES = (
    "forward_dynamics_with_wrenches_derivatives",
    "frame_velocities_derivatives",
    "rotor_speeds_derivatives",
)
WITH_PAYLOADS = (*UNDER_WRENCHES, "frame_bias_accelerations_derivatives")
# Iterations of the interior-point method that are too many.
_MOST = 40
# Shares of a step that are tried: all, half, and so on. Rounds of a first plan.
_SHARES, _FIRST = 5, 30


class LimitRow(NamedTuple):
    """A limited quantity: an entry of (u, x), or the difference of two of them.

    `entry` and `other` (-1 if none) are places in changes (du, dx) of inputs and state, `place` and
    `other_place` in inputs and state themselves.
    """

    entry: int
    place: int
    other: int = -1
    other_place: int = -1


class Entry(NamedTuple):
    """A member of the structure: its shape, what it is, and whether it is a setting."""

    shape: tuple[int, ...]
    words: str
    is_setting: bool = True


# What begins a line, which defines what it names.
_DEFINITION = re.compile(r"(?:#define |static INLINE \w+ |IN_LANES\()(\w+)")
# Functions for users of C: results, arguments, and what each does.
_FUNCTIONS = {
    "size": ("size_t", "void", "Bytes of a controller."),
    "init": ("void", "{self}", "Fill in all settings, and reset. Once, before anything else."),
    "reset": ("void", "{self}", "Forget the plan, before a flight. Settings stay."),
    "step": (
        "int",
        "{self}, const {real} *state, const {real} *reference, {real} *u",
        "Inputs of the step that begins now: prepare, feedback, shift and act in one call.\n\n"
        "@param controller the controller\n"
        "@param state q, then v, as they were measured\n"
        "@param reference what nodes are to be, row by row, as the member `reference`\n"
        "@param u inputs within their limits\n"
        "@return whether a plan was found; if not, u follows the last one: see `failures`",
    ),
    "prepare": ("void", "{self}", "Linearise the plan about the member `reference`, beforehand."),
    "feedback": (
        "int",
        "{self}, const {real} *state, {real} *u",
        "Inputs at a state (q, v), once all is prepared; returns whether a plan was found.",
    ),
    "shift": ("void", "{self}", "Move the plan on by its first step, after `feedback`."),
    "act": (
        "void",
        "{self}, const {real} *u",
        "Tell which inputs act for a step from now on: those of `feedback`, or other ones.",
    ),
}


@dataclass(frozen=True)
class Transcription:
    """A horizon of so many steps with limited quantities."""

    horizon: Horizon
    steps: int
    rows: tuple[LimitRow, ...]

    @property
    def members(self) -> dict[str, Entry]:
        """Inputs and outputs of the controller, by name; settings are given once."""
        horizon, steps, rows = self.horizon, self.steps, max(len(self.rows), 1)
        robot, motors = horizon.robot, max(horizon.motors, 1)
        sizes = {
            **{f"{name}, of the cost": math.prod(shape) for name, shape in horizon.signals.items()},
            "points (3 each, m, world axes)": 3 * len(horizon.points),
            "rotations (9 each, row by row, frame to world)": 9 * len(horizon.orientations),
            "q": robot.space.coordinates,
            "v": robot.space.velocities,
            "u": robot.inputs,
        }
        row = ", ".join(f"{name}: {size}" for name, size in sizes.items() if size)
        weights = ", ".join(f"{name}: {size}" for name, size in horizon.weight_sizes.items())
        acting = ", ".join(f"{name}: {math.prod(shape)}" for name, shape in horizon.figures)
        settings = {
            "h": Entry((steps,), "Lengths of the steps, s."),
            "hover": Entry((horizon.reference_size,), f"The reference of a node in hover ({row})."),
            "weights": Entry(
                (sum(horizon.weight_sizes.values()),),
                f"Of squares of what is off ({weights}), of which `diagonal` has some again.",
            ),
            "lag_times": Entry(
                (max(horizon.lag_times, 1),), "Time constants of the motors, or actuators, s."
            ),
            "around": Entry(
                (max(sum(math.prod(shape) for _, shape in horizon.figures), 1),),
                f"What acts now, and through the horizon ({acting or 'nothing'}).",
            ),
            "settled": Entry((motors,), "The state of the motors in hover."),
            "ahead": Entry(
                (horizon.ahead,), "What follows the horizon costs, by a regulator about hover."
            ),
            "diagonal": Entry(
                (robot.inputs + horizon.states,),
                "Of the Hessian by inputs and state, beside that by q.",
            ),
            "across": Entry(
                (robot.inputs, horizon.states),
                "Of the Hessian by an input and by the state: of changes of inputs, and of servos.",
            ),
            "least": Entry(
                (rows,), "Limits of inputs, joints and their rates, and rates of inputs."
            ),
            "most": Entry((rows,), "The upper ones."),
            "penalty": Entry((rows,), "Prices of exceeding limits; 1e30 where none may."),
            "scale": Entry((rows,), "How large what is limited is."),
            "barrier": Entry((), "Mean of price times slack at the begin of the solver."),
            "tolerance": Entry((), "The same at its end, as a share of 1 and the cost."),
            "rounds": Entry((), "How often a step linearises and solves."),
            "delay": Entry((), "How much later inputs take effect, s, a step at most."),
        }
        results = {
            "x": ((steps + 1, horizon.size), "The plan: states at nodes,"),
            "u": ((steps, robot.inputs), "and inputs from each to the next."),
            "reference": (
                (steps + 1, horizon.reference_size),
                f"What nodes are to be, `delay` after now and then step by step ({row}).",
            ),
            "acting": ((robot.inputs,), "Inputs that act now."),
            "motors": ((motors,), "Thrusts of motors that lag, N, or states of the actuators."),
            "failures": (
                (),
                "Instants since the last plan was found; -1 and less before a first one.",
            ),
            "iterations": ((), "Of the solver at the last instant."),
            "cost": ((), "Of the plan."),
            "gaps": ((), "What is missing of the plan: 0 where it can be flown."),
            "share": ((), "Of the last step of the plan, of which 1 is all."),
        }
        return {**settings, **{name: Entry(*words, False) for name, words in results.items()}}

    @property
    def programs(self) -> dict[str, Program]:
        """Programs by the macros that call them."""
        horizon = self.horizon
        return {
            "NODE": horizon.node(),
            "VALUES": horizon.values(),
            "END": horizon.end(),
            "END_COST": horizon.end_cost(),
            "MOVED": horizon.moved(),
            "AWAY": horizon.away(),
        }

    def header(self) -> str:
        """The C header."""
        robot, horizon = self.horizon.robot, self.horizon
        name, stem = robot.name, f"{robot.name}_predictive"
        capitals = stem.upper()
        width, states = robot.inputs + horizon.states, horizon.states
        lanes = f"{name.upper()}_LANES"
        rows = max(len(self.rows), 1)
        # What `horizon.c` and `predictive.c` have of each node, of which there is one more here for
        # the rest; rows of matrices fill vectors. The source checks it.
        padded = f"(({width} + {lanes} - 1) / {lanes} * {lanes})"
        step_numbers = 2 * states + 18 * rows + horizon.size + states + robot.inputs
        node = f"{2 * width + 4} * {padded} + {step_numbers} + {lanes}"
        room = f"{self.steps + 2} * ({node}) + {states**2 + 2 * rows}"
        return "\n".join(
            [
                self._opening,
                comment(
                    f"@file\n@brief Predictive control of {name}: at every instant the best plan "
                    f"of {self.steps} steps within limits, of which the begin is flown.\n\n"
                    f"Nothing is allocated: a controller is one variable of the type {stem}, "
                    "static rather than on a stack. Several may be used at the same time, each by "
                    "one thread. It must stay where it is from `init` on."
                ),
                f"#ifndef {capitals}_H\n#define {capitals}_H\n",
                f'#include <stddef.h>\n\n#include "{name}.h"\n',
                '#ifdef __cplusplus\nextern "C" {\n#endif\n',
                comment("Steps, and lengths of states and of references of nodes.") + "enum {",
                f"    {capitals}_NODES = {self.steps},",
                f"    {capitals}_STATE = {robot.space.coordinates + robot.space.velocities},",
                f"    {capitals}_REFERENCE = {horizon.reference_size}",
                "};\n",
                f"#define {capitals}_ROOM \\\n    ({room})\n",
                comment("A controller: its settings, its plan, and room for its solver.")
                + "typedef struct {",
                *(
                    textwrap.indent(comment(row.words, WIDTH - 4), "    ")
                    + f"    {name}_real {member}{''.join(f'[{axis}]' for axis in row.shape)};"
                    for member, row in self.members.items()
                ),
                f"    {name}_constants constants; /**< of the robot that is predicted */",
                f"    {name}_real room[{capitals}_ROOM]; /**< for the solver */",
                f"}} {stem};\n",
                *(
                    comment(f"@brief {words}")
                    + "\n".join(
                        broken(
                            f"{returned} {stem}_{function}"
                            f"({pattern.format(self=f'{stem} *controller', real=f'{name}_real')});"
                        )
                    )
                    + "\n"
                    for function, (returned, pattern, words) in _FUNCTIONS.items()
                ),
                f"#ifdef __cplusplus\n}}\n#endif\n\n#endif /* {capitals}_H */\n",
            ]
        )

    def source(self) -> str:
        """The C source, but for `init`."""
        horizon, programs = self.horizon, self.programs
        robot = horizon.robot
        capitals = robot.name.upper()
        sizes = {
            "INPUTS": robot.inputs,
            "STATES": horizon.states,
            "BENT": horizon.bent.stop - horizon.bent.start,
            "BEND": horizon.bent.start,
            "MOTION": horizon.motion,
            "SIZE": horizon.size,
            "SEEN": robot.space.coordinates + robot.space.velocities,
            "REFERENCE": horizon.reference_size,
            "MOTORS": horizon.motors,
            "CHANGES": horizon.before,
            "NODES": self.steps,
            "LIMITS": len(self.rows),
            "MOST": _MOST,
            "SHARES": _SHARES,
            "FIRST": _FIRST,
        }
        in_order = list(programs.values())
        return _without_unused(
            [
                self._opening,
                f'#include "{robot.name}_predictive.h"',
                "",
                f"#if defined(__GNUC__) && !defined({capitals}_SINGLY)",
                f"#define LANES {capitals}_LANES",
                "#endif",
                f"typedef {robot.name}_real real;",
                f"typedef {robot.name}_constants Constants;",
                f"typedef {robot.name}_predictive Controller;",
                f"#define MODULE(name) {robot.name}_##name",
                *support(in_order, robot),
                "#if LANES > 1",
                *blocks_of(in_order, per_state=False),
                "#endif",
                *c_functions(in_order, PREFIX, "static "),
                f"enum {{ {', '.join(f'{name} = {size}' for name, size in sizes.items())} }};",
                _table("limited", [(row.entry, row.other) for row in self.rows]),
                _table("placed", [(row.place, row.other_place) for row in self.rows]),
                *(_macro(name, program) for name, program in programs.items()),
                c_source("horizon.c"),
                c_source("predictive.c"),
            ]
        )

    def settings(self, values: Mapping[str, Array]) -> str:
        """The function `init`, which fills in `values` by the names of settings and `constants`."""
        lines = [
            "",
            "static void settle(real *to, const volatile real *from, const int count)",
            "{",
            "    for (int i = 0; i < count; ++i) {",
            "        to[i] = from[i];",
            "    }",
            "}",
            "",
            "void MODULE(predictive_init)(Controller *own)",
            "{",
        ]
        for name, value in values.items():
            numbers = ", ".join(map(literal, value.ravel().tolist()))
            # Volatile, since gcc 12 copies constants wrongly (see emitted/platform.c).
            lines += broken(f"    static const volatile real {name}[{value.size}] = {{{numbers}}};")
        lines.append("    memset(own, 0, sizeof *own);")
        lines += [
            f"    settle(reals(&own->{name}), {name}, {x.size});" for name, x in values.items()
        ]
        return "\n".join([*lines, "    MODULE(predictive_reset)(own);", "}", ""])

    @property
    def _opening(self) -> str:
        robot = self.horizon.robot
        lines = opening(robot, f"{robot.name}_batch.c")
        return "".join(f"/* {line} */\n" for line in lines)


def _without_unused(lines: Sequence[str]) -> str:
    """C without macros of a line that only definitions name."""
    kept = "\n".join(lines).split("\n")
    matches = map(_DEFINITION.match, kept)
    pairs = [(line, match[1] if match else "") for line, match in zip(kept, matches, strict=True)]
    named = {word for line, name in pairs for word in re.findall(r"\w+", line) if word != name}
    macro = re.compile(r"#define (?!.*\\$)")
    return "\n".join(line for line, name in pairs if name in named or not macro.match(line))


def _table(name: str, rows: Sequence[tuple[int, int]]) -> str:
    entries = ", ".join(f"{{{first}, {second}}}" for first, second in rows or [(0, -1)])
    return f"static const int {name}[][2] = {{{entries}}};"


def _macro(name: str, program: Program) -> str:
    """A macro that calls a program with all arguments that programs of its kind may take."""
    shared = ["lag_times", "around"] if "h" in program.names else []
    inputs = [name for name in program.names if name not in shared]
    arguments = [*inputs, *shared, *program.outputs]
    text = CProgram(program, PREFIX)
    arguments_read = [*(["constants"] if text.owners else []), *program.names, *program.outputs]
    call = f"((void)constants, {text.name}({', '.join(arguments_read)}))"
    return f"#define {name}({', '.join(arguments)}) \\\n    {call}"


class CompiledPredictive:
    """A transcription, compiled: arrays by name, which its functions work on."""

    def __init__(self, module: ModuleType, transcription: Transcription, constants: Any) -> None:
        """Compile it; `constants` are what the module's `prepare` returned.

        Raises `CompilerError`, or `CacheError` where the cache cannot be used.
        """
        self._transcription, self._name = transcription, f"{module.NAME}_predictive"
        texts = {".h": transcription.header(), ".c": transcription.source()}
        sources = {f"{self._name}{ending}": text for ending, text in texts.items()}
        functions = called([*transcription.programs.values()])
        self._library = library(module, functions, sources, "its predictive controller")
        shapes = {name: member.shape for name, member in transcription.members.items()}
        shapes["constants"] = (len(constants) // 8,)
        # The rest is room for the solver.
        size = self._library[f"{self._name}_size"]
        size.restype = ctypes.c_size_t
        memory, first = np.zeros(size() // 8), 0
        self.arrays: dict[str, Array] = {}
        for name, shape in shapes.items():
            last = first + math.prod(shape)
            self.arrays[name], first = memory[first:last].reshape(shape), last
        self.arrays["constants"][:] = np.frombuffer(constants)
        robot = transcription.horizon.robot
        self._state = np.zeros(robot.space.coordinates + robot.space.velocities)
        self._u = np.zeros(robot.inputs)
        controller, state, u = (
            ctypes.c_void_p(x.ctypes.data) for x in (memory, self._state, self._u)
        )

        # To look a function up takes as long as to call it.
        def call(name: str, *arguments: ctypes.c_void_p) -> Callable[[], int]:
            return partial(self._library[f"{self._name}_{name}"], controller, *arguments)

        self.reset, self.prepare, self.shift = map(call, ("reset", "prepare", "shift"))
        self._feedback, self._act = call("feedback", state, u), call("act", u)

    def feedback(self, state: Array) -> tuple[bool, Array]:
        """True if there is a plan at a state (q, v), and inputs (nu)."""
        self._state[:] = state
        return bool(self._feedback()), self._u.copy()

    def act(self, u: Array) -> None:
        """Let inputs (nu) act for a step."""
        self._u[:] = u
        self._act()

    def write_c(self, folder: Path) -> list[Path]:
        """Write header and source; raises `OutputError`."""
        plan = self._transcription
        names = [name for name, member in plan.members.items() if member.is_setting]
        settings = plan.settings({name: self.arrays[name] for name in [*names, "constants"]})
        texts = {".h": plan.header(), ".c": plan.source() + settings}
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
        for ending, text in texts.items():
            path = folder / f"{self._name}{ending}"
            with writing(path):
                path.write_text(text, encoding="utf-8")
        return [folder / f"{self._name}{ending}" for ending in texts]
