"""The emitted C under instruments that take their time: threads, undefined memory."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from support.c_programs import random_calls, threads_beside_each_other
from support.compiled import SMALL, Emitted, compile_only
from support.tools import run, tool


def threads_program(
    robot: Emitted, compiler: str, options: Sequence[str], folder: Path, *defined: str
) -> Path:
    """The program of eight threads, compiled."""
    source = folder / "threads.c"
    source.write_text(threads_beside_each_other(robot), encoding="utf-8")
    options = [*options, "-pthread", f"-I{robot.folder}"]
    objects = compile_only(compiler, options, robot.sources[:1], folder)
    objects += compile_only(compiler, [*options, *defined], [str(source)], folder)
    run([tool(compiler), *options, *objects, "-o", folder / "threads", "-lm"])
    return folder / "threads"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("label", "compiler", "options"),
    [(SMALL, "gcc", ["-O0"])],
    ids=lambda value: "".join(value),
)
def test_eight_threads_give_the_bytes_that_one_gives(
    label: str,
    compiler: str,
    options: list[str],
    emitted: Callable[[str], Emitted],
    tmp_path: Path,
) -> None:
    """In 1000 calls each, of every function for one state and in blocks."""
    program = threads_program(emitted(label), compiler, options, tmp_path, "-DCALLS=1000")
    assert run([program]) == "0\n"


@pytest.mark.slow
def test_eight_threads_would_tell_a_byte_that_differs(
    emitted: Callable[[str], Emitted], tmp_path: Path
) -> None:
    robot = emitted(SMALL)
    calls = f"-DCALLS={10 * 2 * len(robot.signatures())}"
    program = threads_program(robot, "gcc", ["-O0"], tmp_path, "-DSPOILED", calls)
    # Each of the eight makes each check, two for every function, ten times.
    assert run([program]) == "80\n"


def calls_program(
    robot: Emitted, compiler: str, source: Sequence[str], driver: Sequence[str], folder: Path
) -> Path:
    """The program of random calls; the module's source and the rest compiled with own options."""
    text = folder / "calls.c"
    text.write_text(random_calls(robot), encoding="utf-8")
    objects = compile_only(compiler, source, robot.functions, folder)
    objects += compile_only(compiler, [*driver, f"-I{robot.folder}"], [str(text)], folder)
    run([tool(compiler), *source, *objects, "-o", folder / "calls", "-lm"])
    return folder / "calls"


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("valgrind") is None, reason="valgrind is not installed")
def test_valgrind_finds_nothing(emitted: Callable[[str], Emitted], tmp_path: Path) -> None:
    """In code optimised as it is used, which no sanitizer has changed."""
    program = calls_program(emitted(SMALL), "gcc", ["-O1", "-g"], ["-O1", "-DCALLS=50"], tmp_path)
    run(["valgrind", "--quiet", "--error-exitcode=9", "--leak-check=full", program])
