"""Verification of a module in a folder, back end by back end."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import ModuleType
from typing import get_args

from gibbs_codegen.errors import MissingFunctionError, UsageError, printable
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.runtime import c_library
from gibbs_codegen.runtime.c_backend import c_module
from gibbs_codegen.runtime.cache import CacheError, cached_library
from gibbs_codegen.runtime.load import BACKENDS, find_module, load
from gibbs_codegen.runtime.rollouts import Precision
from gibbs_codegen.verification import c_program
from gibbs_codegen.verification.comparison import Comparison, failed
from gibbs_codegen.verification.contents import (
    compare_c_defaults,
    compare_contents,
    compare_robot_file,
)
from gibbs_codegen.verification.invariants import compared_with_themselves, unclear
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.verify import (
    Known,
    Progress,
    Verification,
    compare_module,
    formulations,
)

MOST_STATES = 10_000
# Results of the source do not depend on optimisation.
_UNOPTIMISED = ("-O0",)


class _UnavailableError(Exception):
    """A back end that cannot be had here, through no fault of the module; the message says why."""


def verify(
    name_or_path: str | os.PathLike[str],
    states: int = 20,
    seed: int = 0,
    backends: Sequence[str] = BACKENDS,
    progress: Progress = lambda _: None,
) -> Verification:
    """Compare a generated module with formulations that share no code with its derivation.

    Args:
        name_or_path: Folder of the module, or its name in `generated/`, as for `load`.
        states: Number of random states, 1 to 10 000.
        seed: Seed of the states and of other parameters.
        backends: "numpy", "c" or both.
        progress: Called with the name of each step.

    Returns:
        All comparisons, with the faults of the module.

    Raises:
        UsageError: If there is no such module, no robot file with it, or an argument is wrong.
    """
    if not isinstance(states, int) or not 1 <= states <= MOST_STATES:
        raise UsageError(f"states: from 1 to {MOST_STATES}, not {states!r}")
    if not isinstance(seed, int) or seed < 0:
        raise UsageError(f"seed: a whole number, at least 0, not {seed!r}")
    for backend in backends:
        if backend not in BACKENDS:
            raise UsageError(f"back end {backend!r}: unknown; known: {', '.join(BACKENDS)}")
    folder = find_module(Path(name_or_path))
    robot_file = folder / "robot.toml"
    if not robot_file.is_file():
        raise UsageError(f"{printable(folder)}: has no robot.toml, the robot file of the module")
    robot, _ = read_robot(str(robot_file))
    available, not_done = formulations(robot)
    verification = Verification(robot.name, seed, not_done=not_done)
    same_file = compare_robot_file(robot_file.read_bytes(), _source(folder))
    # C is compiled while the functions in NumPy are compared.
    pool = ThreadPoolExecutor(len(BACKENDS))
    known: Known = {}
    numpy = pool.submit(load, folder)
    modules = {name: pool.submit(_loaded, numpy, folder, robot, name) for name in backends}
    if "c" in backends:  # So is what is needed later; where that fails, those say so who need it.
        pool.submit(_single_precision, folder, robot.name)
        pool.submit(lambda: modules["c"].result().compiled.function("positions", c_library.EACH))
        for kind in get_args(Precision):
            pool.submit(lambda x: c_program.rollouts_in_c(numpy.result(), x, _UNOPTIMISED), kind)
    try:
        for backend in backends:

            def step(stage: str, backend: str = backend) -> None:
                progress(f"{backend}: {stage}")

            step("loading")
            comparisons = [same_file]
            try:
                module = modules[backend].result()
            except _UnavailableError as error:
                verification.not_done[f"back end {backend}"] = str(error)
                continue
            except (UsageError, c_library.CompilerError, SystemExit) as error:
                comparisons.append(failed("the module", "", error))
            else:
                beside = numpy.result() if backend != "numpy" else None
                comparisons += compare_module(
                    module, robot, available, states, seed, step, numpy=beside, known=known
                )
                if backend == "c" and all(c.passed for c in compare_contents(module, robot)):
                    step("as a C program calls it")
                    comparisons += _compare_c(module, folder, robot, verification)
            verification.comparisons[backend] = comparisons
            verification.not_done |= compared_with_themselves(comparisons) | unclear(comparisons)
    finally:  # What has not begun by now is not needed.
        pool.shutdown(wait=False, cancel_futures=True)
    return verification


def _loaded(numpy: Future[ModuleType], folder: Path, robot: Robot, backend: str) -> ModuleType:
    """A back end ("numpy" or "c") of a module, of which `numpy` is the former.

    Raises `_UnavailableError` if it cannot be had here, and `UsageError` if the module is broken,
    as `SystemExit` and `CompilerError` tell as well.
    """
    module = numpy.result()
    if backend == "numpy":
        return module
    missing = [name for name in c_library.c_files(robot.name) if not (folder / name).is_file()]
    if missing:
        options = _source(folder)[:1000]
        if "--target c" not in options and "--target" in options:
            raise _UnavailableError("the module was generated without the C target")
        raise UsageError(f"{', '.join(missing)}: missing")
    compiler = _compiler()
    try:
        return c_module(module, folder, compiler, 1, _UNOPTIMISED, whole=True)
    except CacheError as error:
        raise _UnavailableError(str(error)) from None
    except c_library.CompilerError as error:
        if _works(compiler):
            raise
        raise _UnavailableError(str(error)) from None


def _compiler() -> c_library.Compiler:
    try:
        return c_library.chosen_compiler()
    except c_library.CompilerError as error:
        raise _UnavailableError(str(error)) from None


def _works(compiler: c_library.Compiler) -> bool:
    """True if the compiler makes libraries that can be loaded, whatever the module's C."""

    def make(output: Path) -> None:
        source = output.with_suffix(".c")
        source.write_text(
            "int gibbs_codegen_works(void);\nint gibbs_codegen_works(void) { return 1; }\n"
        )
        compiler.library([source], output)

    try:
        library = ctypes.CDLL(str(cached_library(f"{compiler.identity}\nworks", make)))
        return hasattr(library, "gibbs_codegen_works")
    except (c_library.CompilerError, CacheError, OSError):
        return False


def _compare_c(
    module: ModuleType, folder: Path, robot: Robot, verification: Verification
) -> list[Comparison]:
    """Compare what only a C program uses of the C source, rollouts in both precisions among it.

    `verification` gets the reasons for what cannot be compared.
    """
    seed = verification.seed
    comparisons = compare_c_defaults(module, robot)
    comparisons += c_program.compare_c_program(str(module.__file__), module, robot, seed)
    try:
        path = _single_precision(folder, robot.name)
        single, not_done = c_program.compare_single_precision(str(path), module, robot, seed)
    except (c_library.CompilerError, CacheError) as error:
        single, not_done = [failed(c_program.SINGLE_PRECISION, "", error)], {}
    comparisons += single
    precisions = get_args(Precision)[: 1 if c_program.SINGLE_PRECISION in not_done else 2]
    try:
        for precision in precisions:
            rows, lacking = c_program.compare_rollouts(
                module.in_numpy, Tree(robot), seed, precision, _UNOPTIMISED
            )
            comparisons += rows
            not_done |= lacking
    except MissingFunctionError as error:
        not_done[c_program.ROLLOUTS] = str(error)
    verification.not_done |= not_done
    return comparisons


def _single_precision(folder: Path, name: str) -> Path:
    """Path of the library of all functions in single precision."""
    flags = (f"-D{name.upper()}_FLOAT", *_UNOPTIMISED)
    return c_library.compiled_library(folder, name, _compiler(), flags)


def _source(folder: Path) -> str:
    return (folder / "numpy_module.py").read_text(encoding="utf-8", errors="replace")
