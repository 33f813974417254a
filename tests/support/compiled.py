"""Emitted modules as files, and their C compiled with every warning an error."""

from __future__ import annotations

import ctypes
import math
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.family import benchmark_robot
from gibbs_codegen.interface import LANES, Signature, module_signatures
from gibbs_codegen.interface.table import GROUPS
from gibbs_codegen.program.choice import Derivatives
from gibbs_codegen.program.model import Model
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.runtime.load import load
from gibbs_codegen.targets.registry import find_targets, render_module
from support.actuated import DERIVATIVES, TEXT, actuated
from support.derived import derived
from support.random_robots import random_robot
from support.tools import compiled, run, tool

WARNINGS = [
    *("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Wdouble-promotion"),
    *("-Wsign-conversion", "-Wfloat-conversion", "-Wundef", "-Wcast-qual", "-Wcast-align"),
    *("-Wvla", "-Wformat=2", "-Wfloat-equal", "-Wunused-macros", "-Werror"),
]
C = ["-std=c99", *WARNINGS, "-Wstrict-prototypes", "-Wmissing-prototypes"]
CXX = ["-x", "c++", "-std=c++17", *WARNINGS]
Array = NDArray[np.floating]
LANGUAGES = {"gcc": C, "clang": C, "g++": CXX, "clang++": CXX}
SANITIZERS = ["-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all"]

SMALL = "quadrotor_2link"
# What is emitted for tests: all that is by default, and what else needs no derivatives.
TARGETS = ("numpy", "c", "rollout")
EVERY_GROUP = ("default", *GROUPS)
# Seed, rotors and links: every kind of joint and body, with and without gravity and drag.
RANDOM = {
    f"random_{rotors}_{links}": (seed, rotors, links)
    for seed, rotors, links in ((0, 2, 0), (0, 3, 1), (2, 5, 2), (1, 4, 3), (1, 7, 4), (0, 2, 5))
}
# The one with three links again, cut into pieces of so many memory references.
CUT = {f"random_cut_at_{limit}": limit for limit in (40, 60)}
WHOLE = "random_4_3"
# Columns that go in loops if loops of few steps will do.
ROLLED = "rolled"
# One with actuators of every kind, and the derivatives of what they do.
ACTUATED = "actuated"


@dataclass(frozen=True)
class Emitted:
    """A module made for a test: what it was emitted from, its folder, its NumPy functions."""

    model: Model
    folder: Path
    module: ModuleType

    @property
    def name(self) -> str:
        """The robot's name, which is the prefix in C."""
        return self.model.robot.name

    @property
    def sources(self) -> list[str]:
        """The C sources, of functions for one state and for batches."""
        return [str(self.file(ending)) for ending in (".c", "_batch.c")]

    @property
    def functions(self) -> list[str]:
        """The C sources, and that of functions with constants of each state."""
        return [*self.sources, str(self.file("_each.c"))]

    @property
    def single(self) -> str:
        """What selects single precision."""
        return f"-D{self.name.upper()}_FLOAT"

    def file(self, ending: str) -> Path:
        """The emitted file whose name goes on after the robot's with `ending`."""
        return self.folder / f"{self.name}{ending}"

    def text(self, ending: str) -> str:
        """What stands in that file."""
        return self.file(ending).read_text(encoding="utf-8")

    def signatures(self) -> list[Signature]:
        """Signatures of all functions."""
        return module_signatures(self.module)


def emit(robot: Robot, folder: Path, text: str = "", derivatives: Derivatives = False) -> Emitted:
    """Take the model of a robot, write its module to a new folder, and import it."""
    model = derived(robot, derivatives=derivatives, functions=EVERY_GROUP)
    folder.mkdir()
    for name, content in render_module(model, text, find_targets(TARGETS)).items():
        (folder / name).write_text(content, encoding="utf-8")
    return Emitted(model, folder, load(folder))


def emit_labelled(label: str, folder: Path) -> Emitted:
    """Emit a robot that ships, or one of RANDOM or CUT, or with loops, or with actuators."""
    if label == ACTUATED:
        return emit(actuated(), folder, TEXT, derivatives=DERIVATIVES)
    if label == ROLLED:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("gibbs_codegen.targets.c.function._FEWEST_ROLLED", 1)
            patch.setattr("gibbs_codegen.program.loops._FEWEST_STEPS", 12)
            return emit(replace(benchmark_robot(9), name=label), folder)
    if label not in RANDOM and label not in CUT:
        robot, text = read_robot(label)
        return emit(robot, folder, text)
    with pytest.MonkeyPatch.context() as patch:
        if label in CUT:
            patch.setattr("gibbs_codegen.targets.c.function._MAX_REFERENCES", CUT[label])
        robot = random_robot(*RANDOM[WHOLE if label in CUT else label])
        return emit(replace(robot, name=label), folder)


def finds_leaks(compiler: str, folder: Path) -> bool:
    """Whether the compiler's sanitizer may look for leaks here, which takes a right to trace."""
    source, program = folder / "leak.c", folder / "leak"
    source.write_text(
        "#include <stdlib.h>\n"
        "int main(void) { char *volatile lost = malloc(5); lost = NULL; return lost != NULL; }\n"
    )
    run([tool(compiler), "-fsanitize=address", source, "-o", program])
    said = subprocess.run([str(program)], capture_output=True, text=True, check=False).stderr
    return "detected memory leaks" in said


def build(compiler: str, options: Sequence[str], sources: Sequence[str], output: Path) -> Path:
    """Compile, as C or C++ by the compiler's kind, every warning being an error."""
    language = LANGUAGES[compiler]
    command = [tool(compiler), *language, *options, *sources, "-x", "none", "-lm"]
    return compiled(command, output)


def compile_only(
    compiler: str, options: Sequence[str], sources: Sequence[str], folder: Path
) -> list[Path]:
    """Compile each source to an object file."""
    objects = []
    for source in sources:
        command = [tool(compiler), *LANGUAGES[compiler], *options, "-c", source]
        objects.append(compiled(command, folder / f"{Path(source).stem}.o"))
    return objects


class Library:
    """The emitted C as a shared library, called through ctypes as its header documents."""

    def __init__(
        self,
        emitted: Emitted,
        path: Path,
        compiler: str,
        options: Sequence[str],
        real: type[np.floating] = np.float64,
        each: bool = False,
    ) -> None:
        sources = emitted.functions if each else emitted.sources
        build(compiler, ["-shared", "-fPIC", *options], sources, path)
        self.real = real
        self.lanes = LANES if real is np.float64 else 2 * LANES
        self._library = ctypes.CDLL(str(path))
        self._name = emitted.name
        self._mark = "_float" if real is np.float32 else ""
        self._size = len(emitted.model.program.constants)
        self.constants = self.data(f"default_constants{self._mark}", self._size)

    def data(self, name: str, size: int, number: Any = None) -> Array:
        """A constant array of the library, of reals where no type of numbers is given."""
        if number is None:
            number = ctypes.c_float if self.real is np.float32 else ctypes.c_double
        return np.array((number * size).in_dll(self._library, f"{self._name}_{name}"))

    def call(self, name: str, *arguments: Array | int | None) -> int:
        """Call a function whose arguments are arrays of reals, NULL, and counts."""
        c_arguments = [
            ctypes.c_size_t(a)
            if isinstance(a, int)
            else ctypes.c_void_p(None if a is None else a.ctypes.data)
            for a in arguments
        ]
        return int(self._library[f"{self._name}_{name}"](*c_arguments))

    def init(self, parameters: Sequence[float]) -> tuple[int, Array]:
        """What init_constants returns, and the constants."""
        constants = np.full(self._size, np.nan, self.real)
        numbers = np.array(parameters, self.real)
        return self.call(f"init_constants{self._mark}", numbers, constants), constants

    def init_batch(self, parameters: Array, unused: Array) -> tuple[int, Array]:
        """What init_constants_batch returns, and the constants of each state."""
        count = len(parameters)
        constants = np.full(
            (math.ceil(count / self.lanes), self._size, self.lanes), unused, self.real
        )
        given = self.blocks(parameters, unused)
        name = f"init_constants_batch{self._mark}"
        returned = self.call(name, count, given, constants)
        return returned, self.rows(constants, count)

    def one(
        self, signature: Signature, rows: Sequence[Array], constants: Array | None = None
    ) -> list[Array]:
        """The function, state by state, with constants of each; outputs hold garbage before."""
        count = len(rows[0] if constants is None else constants)
        if constants is None:
            constants = np.broadcast_to(self.constants, (count, self._size))
        outputs = [np.full((count, *shape), np.nan, self.real) for shape in signature.shapes]
        for i in range(count):
            inputs = [np.ascontiguousarray(array[i], self.real) for array in (constants, *rows)]
            self.call(signature.name, *inputs, *(out[i : i + 1] for out in outputs))
        return outputs

    def batch(
        self,
        signature: Signature,
        rows: Sequence[Array],
        unused: Array,
        constants: Array | None = None,
    ) -> list[Array]:
        """The _batch function, or with constants of each state the _batch_each function.

        Unused lanes of inputs and all of the outputs hold `unused`. One block more than the outputs
        need must be left as it is.
        """
        count = len(rows[0] if constants is None else constants)
        inputs = [self.blocks(array, unused) for array in rows]
        outputs = [
            np.full(
                (math.ceil(count / self.lanes) + 1, math.prod(shape), self.lanes), unused, self.real
            )
            for shape in signature.shapes
        ]
        name, first = f"{signature.name}_batch", self.constants
        if constants is not None:
            name, first = f"{name}_each", self.blocks(constants, unused)
        self.call(name, first, count, *inputs, *outputs)
        for output in outputs:
            assert output[-1].tobytes() == np.full_like(output[-1], unused).tobytes()
        return [
            self.rows(output, count).reshape(count, *shape)
            for output, shape in zip(outputs, signature.shapes, strict=True)
        ]

    def blocks(self, rows: Array, unused: Array) -> Array:
        """States in blocks, entry by entry as the header says."""
        rows = rows.reshape(len(rows), -1)
        count, width = rows.shape
        blocks = np.full(math.ceil(count / self.lanes) * width * self.lanes, unused, self.real)
        for i, e in np.ndindex(count, width):
            blocks[(i // self.lanes) * width * self.lanes + e * self.lanes + i % self.lanes] = rows[
                i, e
            ]
        return blocks

    def rows(self, blocks: Array, count: int) -> Array:
        """States from an array of blocks, entries and lanes."""
        return np.stack([blocks[i // self.lanes, :, i % self.lanes] for i in range(count)])
