"""A predictive controller in C: its programs and its solver, compiled with a robot's functions.

What it is told and tells stands in one structure of real numbers, whose members `members` lists:
C has its type from there, and NumPy its arrays.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.arrays.c_text import CProgram, c_functions
from gibbs_codegen.arrays.contents import functions_of
from gibbs_codegen.arrays.nodes import Program
from gibbs_codegen.arrays.predictive import Horizon
from gibbs_codegen.files.verbatim import c_source
from gibbs_codegen.interface import LANES
from gibbs_codegen.runtime.c_library import chosen_compiler, compiled_files, opened
from gibbs_codegen.runtime.programs import PREFIX, blocks_of, support

Array = NDArray[np.float64]
# What a module must have beside what it has by default.
DERIVATIVES = (
    "forward_dynamics_derivatives",
    "frame_poses_derivatives",
    "integrate_derivatives",
    "difference_derivatives",
)
# Iterations of the interior-point method that are too many.
_MOST = 40
# Shares of a step that are tried: all, half, and so on.
_SHARES = 5


class Row(NamedTuple):
    """A limited quantity: an entry of (u, x), or the difference of two of them.

    `entry` and `other` (-1 if none) are places in changes (du, dx) of inputs and state, `place` and
    `other_place` in inputs and state themselves.
    """

    entry: int
    place: int
    other: int = -1
    other_place: int = -1


@dataclass(frozen=True)
class Transcription:
    """A horizon of so many steps with limited quantities."""

    horizon: Horizon
    steps: int
    rows: tuple[Row, ...]

    @property
    def members(self) -> dict[str, tuple[int, ...]]:
        """Shapes of what the controller is told and tells, by name.

        - `x` and `u`: the plan, states at nodes and inputs from each to the next
        - `reference`: where nodes are to be; `h`: lengths of steps, s
        - `weights`, `lag_times` (s), `ahead`: as of `arrays.predictive`
        - `diagonal`, `changes`: of the Hessian by (u, x), beside that by q: its diagonal, and the
          weights of changes of inputs
        - `least`, `most`, `penalty`, `scale`: limits of the rows, price of exceeding them, and how
          large their values are
        - `barrier`, `tolerance`: mean of price times slack at the begin of the interior-point
          method, and at its end as a share of 1 and the cost; `rounds`: how often a step
          linearises and solves
        - `iterations`: of the last step; `cost`, `gaps`, `share`: of its plan
        """
        horizon, steps, rows = self.horizon, self.steps, max(len(self.rows), 1)
        robot, weights = horizon.robot, sum(horizon.weight_sizes.values())
        return {
            "x": (steps + 1, horizon.size),
            "u": (steps, robot.inputs),
            "reference": (steps + 1, horizon.reference_size),
            "h": (steps,),
            "weights": (weights,),
            "lag_times": (max(horizon.motors, 1),),
            "ahead": (horizon.ahead,),
            "diagonal": (robot.inputs + horizon.states,),
            "changes": (max(horizon.before, 1),),
            "least": (rows,),
            "most": (rows,),
            "penalty": (rows,),
            "scale": (rows,),
            "barrier": (),
            "tolerance": (),
            "rounds": (),
            "iterations": (),
            "cost": (),
            "gaps": (),
            "share": (),
        }

    @property
    def programs(self) -> dict[str, Program]:
        """Programs by the macros that call them."""
        horizon = self.horizon
        return {
            "NODE": horizon.node(),
            "VALUES": horizon.values(),
            "END": horizon.end(),
            "MOVED": horizon.moved(),
            "AWAY": horizon.away(),
        }

    def source(self) -> str:
        """The C source."""
        horizon, programs = self.horizon, self.programs
        robot = horizon.robot
        sizes = {
            "INPUTS": robot.inputs,
            "STATES": horizon.states,
            "VELOCITIES": robot.space.velocities,
            "SIZE": horizon.size,
            "REFERENCE": horizon.reference_size,
            "MOTORS": horizon.motors,
            "CHANGES": horizon.before,
            "NODES": self.steps,
            "LIMITS": len(self.rows),
            "MOST": _MOST,
            "SHARES": _SHARES,
        }
        every = list(programs.values())
        return "\n".join(
            [
                f'#include "{robot.name}.h"',
                "",
                f"#define LANES {LANES}",
                f"typedef {robot.name}_real real;",
                f"typedef {robot.name}_constants Constants;",
                *support(every, robot),
                *blocks_of(every, each=False),
                *c_functions(every, PREFIX, "static "),
                f"enum {{ {', '.join(f'{name} = {size}' for name, size in sizes.items())} }};",
                _table("limited", [(row.entry, row.other) for row in self.rows]),
                _table("placed", [(row.place, row.other_place) for row in self.rows]),
                *(_macro(name, program) for name, program in programs.items()),
                c_source("horizon.c"),
                "typedef struct {",
                *(
                    f"    real {name}{''.join(f'[{axis}]' for axis in shape)};"
                    for name, shape in self.members.items()
                ),
                "} Controller;",
                "",
                c_source("predictive.c"),
            ]
        )


def _table(name: str, rows: Sequence[tuple[int, int]]) -> str:
    entries = ", ".join(f"{{{first}, {second}}}" for first, second in rows or [(0, -1)])
    return f"static const int {name}[][2] = {{{entries}}};"


def _macro(name: str, program: Program) -> str:
    """What calls a program with all arguments that programs of its kind may take."""
    arguments = [*program.names, *program.outputs]
    if "weights" in program.names and name != "END" and "lag_times" not in program.names:
        arguments.insert(program.names.index("weights") + 1, "unused")
    text = CProgram(program, PREFIX)
    own = [*(["constants"] if text.owners else []), *program.names, *program.outputs]
    return f"#define {name}({', '.join(arguments)}) \\\n    {text.name}({', '.join(own)})"


class CompiledPredictive:
    """A transcription, compiled: arrays by name, which `prepare`, `step` and `shift` work on."""

    def __init__(self, module: ModuleType, transcription: Transcription, constants: Any) -> None:
        """Compile it; `constants` are what the module's `prepare` returned.

        Raises `CompilerError`, or `CacheError` where the cache cannot be used.
        """
        self._library = _library(module, transcription)
        sizes = {name: math.prod(shape) for name, shape in transcription.members.items()}
        memory, first = np.zeros(sum(sizes.values())), 0
        self.arrays: dict[str, Array] = {}
        for name, shape in transcription.members.items():
            self.arrays[name] = memory[first : first + sizes[name]].reshape(shape)
            first += sizes[name]
        size = self._library.predictive_room
        size.restype = ctypes.c_size_t
        room = np.zeros(size() + 64, dtype=np.uint8)
        begin = room.ctypes.data + -room.ctypes.data % 64
        horizon = transcription.horizon
        self._x, self._u = np.zeros(horizon.size), np.zeros(horizon.robot.inputs)
        self._owned = memory, room, constants
        self._own = [
            ctypes.c_char_p(constants) if isinstance(constants, bytes) else constants,
            ctypes.c_void_p(memory.ctypes.data),
            ctypes.c_void_p(begin),
        ]
        self._state = [ctypes.c_void_p(x.ctypes.data) for x in (self._x, self._u)]

    def prepare(self) -> None:
        """Linearise the plan."""
        self._library.predictive_prepare(*self._own)

    def step(self, x: Array) -> tuple[bool, Array]:
        """Inputs (nu) at a state, and whether the plan was found."""
        self._x[:] = x
        solved = self._library.predictive_step(*self._own, *self._state)
        return bool(solved), self._u.copy()

    def predict(self, x: Array, u: Array, h: float) -> Array:
        """The state after a time `h`, s, with inputs u (nu)."""
        found = np.empty_like(x)
        pointers = [ctypes.c_void_p(each.ctypes.data) for each in (x, u, found)]
        self._library.predictive_predict(*self._own, *pointers[:2], ctypes.c_double(h), pointers[2])
        return found

    def shift(self) -> None:
        """Move the plan on by its first step."""
        self._library.predictive_shift(*self._own)


def _library(module: ModuleType, transcription: Transcription) -> ctypes.CDLL:
    name = module.NAME
    programs = transcription.programs.values()
    functions = list(dict.fromkeys(f for program in programs for _, f in functions_of(program)))
    for function in functions:
        getattr(module, function)  # It says how the module is to be generated, if it lacks one.
    path = compiled_files(
        Path(module.__path__[0]),
        name,
        [f"{name}.h", f"{name}.c"],
        chosen_compiler(),
        ["-fno-math-errno"],
        {"_predictive.c": transcription.source().encode()},
        functions=functions,
    )
    return opened(path)
