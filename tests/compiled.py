"""Emitted modules as files, and their C compiled with every warning an error."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType

import pytest
from random_robots import random_robot
from tools import run, tool

from gibbs_codegen.emit import TARGETS, render_module
from gibbs_codegen.interface import Signature, signatures
from gibbs_codegen.load import load
from gibbs_codegen.model import Model, derive
from gibbs_codegen.robot import Robot
from gibbs_codegen.robot_file import read_robot

WARNINGS = [
    *("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Wdouble-promotion"),
    *("-Wsign-conversion", "-Wfloat-conversion", "-Wundef", "-Wcast-qual", "-Wcast-align"),
    *("-Wvla", "-Wformat=2", "-Wfloat-equal", "-Wunused-macros", "-Werror"),
]
C = ["-std=c99", *WARNINGS, "-Wstrict-prototypes", "-Wmissing-prototypes"]
CXX = ["-x", "c++", "-std=c++17", *WARNINGS]
LANGUAGES = {"gcc": C, "clang": C, "g++": CXX, "clang++": CXX}
SANITIZERS = ["-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all"]

SMALL = "quadrotor_2link"
# Seed, rotors and links: every kind of joint and body, with and without gravity and drag.
RANDOM = {
    f"random_{rotors}_{links}": (seed, rotors, links)
    for seed, rotors, links in ((0, 2, 0), (0, 3, 1), (2, 5, 2), (1, 4, 3), (1, 7, 4), (0, 2, 5))
}
# The one with three links again, cut into pieces of so many memory references.
CUT = {f"random_cut_at_{limit}": limit for limit in (40, 60)}
WHOLE = "random_4_3"


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
        """The C source and the CasADi adapter."""
        return [str(self.file(".c")), str(self.file("_casadi.c"))]

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
        module = self.module
        lists = (module.COORDINATES, module.HYBRID_COORDINATES, module.INPUTS, module.POINTS)
        return signatures(*map(len, lists))


def emit(robot: Robot, folder: Path, text: str = "") -> Emitted:
    """Derive a robot, write its module to a new folder, and import it."""
    model = derive(robot)
    folder.mkdir()
    for name, content in render_module(model, text, TARGETS).items():
        (folder / name).write_text(content, encoding="utf-8")
    return Emitted(model, folder, load(folder))


def emit_labelled(label: str, folder: Path) -> Emitted:
    """Emit a robot that ships, or one of RANDOM or CUT."""
    if label not in RANDOM and label not in CUT:
        robot, text = read_robot(label)
        return emit(robot, folder, text)
    with pytest.MonkeyPatch.context() as patch:
        if label in CUT:
            patch.setattr("gibbs_codegen.c_function._MAX_REFERENCES", CUT[label])
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
    run([tool(compiler), *language, *options, *sources, "-o", output, "-x", "none", "-lm"])
    return output


def compile_only(
    compiler: str, options: Sequence[str], sources: Sequence[str], folder: Path
) -> list[Path]:
    """Compile each source to an object file."""
    objects = []
    for source in sources:
        objects.append(folder / f"{Path(source).stem}.o")
        run([tool(compiler), *LANGUAGES[compiler], *options, "-c", source, "-o", objects[-1]])
    return objects
