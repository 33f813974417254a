"""The emitted C under instruments that take their time: threads, races, undefined memory."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from support.c_programs import random_calls, threads_beside_each_other
from support.compiled import SMALL, Emitted, build, compile_only
from support.tools import run, tool


def threads_program(
    robot: Emitted, compiler: str, options: Sequence[str], folder: Path, *defined: str
) -> Path:
    """The program of eight threads, compiled."""
    source = folder / "threads.c"
    source.write_text(threads_beside_each_other(robot), encoding="utf-8")
    options = [*options, "-pthread", f"-I{robot.folder}"]
    objects = compile_only(compiler, options, robot.sources, folder)
    objects += compile_only(compiler, [*options, *defined], [str(source)], folder)
    run([tool(compiler), *options, *objects, "-o", folder / "threads", "-lm"])
    return folder / "threads"


@pytest.mark.slow
def test_eight_threads_would_tell_a_byte_that_differs(
    emitted: Callable[[str], Emitted], tmp_path: Path
) -> None:
    robot = emitted(SMALL)
    calls = f"-DCALLS={10 * 2 * len(robot.signatures())}"
    program = threads_program(robot, "gcc", ["-O0"], tmp_path, "-DSPOILED", calls)
    # Each of the eight makes each check, two for every function, ten times.
    assert run([program]) == "80\n"


RACES = "WARNING: ThreadSanitizer"


@pytest.mark.slow
def test_no_thread_races_with_another(emitted: Callable[[str], Emitted], tmp_path: Path) -> None:
    """Each gives the bytes that one gives. Nor would the instrument be silent about a race."""
    (tmp_path / "race.c").write_text(
        "#include <pthread.h>\n"
        "static int shared;\n"
        "static void *work(void *given) { ++shared; return given; }\n"
        "int main(void) { pthread_t t; pthread_create(&t, 0, work, 0); ++shared;\n"
        "return pthread_join(t, 0); }\n"
    )
    options = ["-O0", "-fsanitize=thread"]
    race = build("gcc", [*options, "-pthread"], [str(tmp_path / "race.c")], tmp_path / "race")
    with pytest.raises(pytest.fail.Exception, match=RACES):
        run([race])
    robot = emitted(SMALL)
    program = threads_program(robot, "gcc", options, tmp_path, "-DCALLS=600")
    assert run([program]) == "0\n"


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
def test_nothing_is_divided_by_zero_and_no_conversion_loses_what_it_converts(
    emitted: Callable[[str], Emitted], tmp_path: Path
) -> None:
    """At any state, with the parameters of the robot file."""
    checks = "-fsanitize=float-divide-by-zero,implicit-conversion,undefined"
    options = ["-O0", checks, "-fno-sanitize-recover=all"]
    divided = "{ return words && 1.0 / (double)(count - 1) > 2.0; }\n"
    narrow = "{ const signed char few = 300 * count; return words ? few : 0; }\n"
    for name, body in (("division by zero", divided), ("implicit conversion", narrow)):
        source, program = tmp_path / "wrong.c", tmp_path / "wrong"
        source.write_text(f"int main(int count, char **words)\n{body}")
        run([tool("clang"), *options, source, "-o", program])
        with pytest.raises(pytest.fail.Exception, match=name):
            run([program])
    run([calls_program(emitted(SMALL), "clang", options, [*options, "-DSOUND"], tmp_path)])


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("valgrind") is None, reason="valgrind is not installed")
def test_valgrind_finds_nothing(emitted: Callable[[str], Emitted], tmp_path: Path) -> None:
    """In code optimised as it is used, which no sanitizer has changed."""
    program = calls_program(emitted(SMALL), "gcc", ["-O2"], ["-O2", "-DCALLS=100"], tmp_path)
    run(["valgrind", "--quiet", "--error-exitcode=9", "--leak-check=full", program])
