"""Verification of a module in a folder, back end by back end, and of one that is still text."""

from __future__ import annotations

import ctypes
import importlib.abc
import importlib.util
import os
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import numpy as np

from gibbs_codegen.errors import UsageError, WrongModuleError, printable
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.runtime.c_backend import c_module
from gibbs_codegen.runtime.c_library import c_files, compiled_library
from gibbs_codegen.runtime.cache import CacheError, cached_library
from gibbs_codegen.runtime.compiler import Compiler, CompilerError, find_compiler
from gibbs_codegen.runtime.load import BACKENDS, find_module, load
from gibbs_codegen.verification.c_program import (
    SINGLE_PRECISION,
    compare_c_program,
    compare_single_precision,
)
from gibbs_codegen.verification.comparison import Comparison, failure_text
from gibbs_codegen.verification.contents import (
    compare_c_defaults,
    compare_contents,
    compare_robot_file,
)
from gibbs_codegen.verification.newton_euler import NewtonEuler
from gibbs_codegen.verification.self_consistency import compared_with_themselves
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.verify import (
    QUICK,
    Progress,
    Verification,
    compare_module,
    formulations,
)

MOST_STATES = 10_000
# Of a module that was just emitted; all functions at a few states tell a wrong one.
_FEW_STATES = 3


def verify(
    name_or_path: str | os.PathLike[str],
    states: int = 20,
    seed: int = 0,
    backends: Sequence[str] = BACKENDS,
    progress: Progress = lambda _: None,
) -> Verification:
    """Check a generated module against formulations that share no code with its derivation.

    `name_or_path` is that of `load`. Every function is compared at `states` random states of a
    `seed`, for each of the `backends`. Raises `UsageError` where there is no such module, no robot
    file with it, or wrong use; what is wrong with the module itself is in what is returned.
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
        raise UsageError(f"{printable(folder)}: has no robot.toml, the file that it was made from")
    robot, _ = read_robot(str(robot_file))
    found, not_done = formulations(robot)
    verification = Verification(robot.name, seed, not_done=not_done)
    source = (folder / "numpy_module.py").read_text(encoding="utf-8", errors="replace")
    same_file = compare_robot_file(robot_file.read_bytes(), source)

    def step(backend: str) -> Progress:
        return lambda what: progress(f"{backend}: {what}")

    for backend in backends:
        step(backend)("loading")
        module = _loaded(folder, robot, backend)
        if isinstance(module, str):
            verification.not_done[f"back end {backend}"] = module
            continue
        comparisons = [same_file]
        if isinstance(module, Comparison):
            comparisons.append(module)
        else:
            numpy = load(folder) if backend != "numpy" else None
            comparisons += compare_module(
                module, robot, found, states, seed, step(backend), numpy=numpy
            )
            if backend == "c" and all(c.passed for c in compare_contents(module, robot)):
                step(backend)("as a C program calls it")
                comparisons += _compare_c(module, folder, robot, verification)
        verification.comparisons[backend] = comparisons
        verification.not_done |= compared_with_themselves(comparisons)
    return verification


def _loaded(folder: Path, robot: Robot, backend: str) -> ModuleType | Comparison | str:
    """A back end; or a comparison that failed, if it is broken; or why it cannot be had here."""
    try:
        module = load(folder)
    except (UsageError, SystemExit) as error:
        return _broken(error)
    if backend == "numpy":
        return module
    missing = [name for name in c_files(robot.name) if not (folder / name).is_file()]
    if missing and not _has_c_target(folder):
        return "the module was generated without the C target"
    if missing:
        return _broken(UsageError(f"{', '.join(missing)}: missing"))
    try:
        compiler = find_compiler(os.environ.get("CC") or None)
    except CompilerError as error:
        return str(error)
    try:
        return c_module(module, folder, compiler, 1)
    except CacheError as error:
        return str(error)
    except CompilerError as error:
        return _broken(error) if _works(compiler) else str(error)
    except UsageError as error:
        return _broken(error)


def _works(compiler: Compiler) -> bool:
    """Whether a compiler makes libraries that can be loaded, whatever it made of the module's C."""

    def make(output: Path) -> None:
        source = output.with_suffix(".c")
        source.write_text(
            "int gibbs_codegen_works(void);\nint gibbs_codegen_works(void) { return 1; }\n"
        )
        compiler.library([source], output)

    try:
        library = ctypes.CDLL(str(cached_library(f"{compiler.identity}\nworks", make)))
    except (CompilerError, CacheError, OSError):
        return False
    return hasattr(library, "gibbs_codegen_works")


def _compare_c(
    module: ModuleType, folder: Path, robot: Robot, verification: Verification
) -> list[Comparison]:
    """What only a C program uses of the C source."""
    seed = verification.seed
    comparisons = compare_c_defaults(module, robot)
    comparisons += compare_c_program(str(module.__file__), module, robot, seed)
    # What the source says does not depend on how well it is optimised.
    flags = (f"-D{robot.name.upper()}_FLOAT", "-O0")
    try:
        compiler = find_compiler(os.environ.get("CC") or None)
        path = compiled_library(folder, robot.name, compiler, flags)
        single = compare_single_precision(str(path), module, robot, seed)
    except (CompilerError, CacheError) as error:
        fault = printable(str(error), 400)
        return [*comparisons, Comparison(SINGLE_PRECISION, "", 0, np.inf, 0.0, fault)]
    if isinstance(single, str):
        verification.not_done[SINGLE_PRECISION] = single
        return comparisons
    return comparisons + single


def _has_c_target(folder: Path) -> bool:
    """Whether the module's header says that it was made with C sources."""
    head = (folder / "numpy_module.py").read_text(encoding="utf-8", errors="replace")[:1000]
    return "--target c" in head or "--target" not in head


def _broken(error: BaseException) -> Comparison:
    fault = str(error) or type(error).__name__
    return Comparison("the module", "", 0, np.inf, 0.0, printable(fault, 400))


def refuse_wrong(robot: Robot, numpy_source: str, progress: Progress = lambda _: None) -> None:
    """Verify emitted NumPy functions quickly, before they are written.

    Raises `WrongModuleError` where a comparison fails.
    """
    progress("verifying")
    try:
        module = _from_text(numpy_source)
        comparisons = compare_module(
            module, robot, [NewtonEuler(Tree(robot))], _FEW_STATES, 0, extent=QUICK
        )
    except (Exception, SystemExit) as error:  # Whatever was emitted.
        comparisons = [_broken(error)]
    failures = [failure_text(c) for c in comparisons if not c.passed]
    if failures:
        raise WrongModuleError(robot.name, failures, len(comparisons))


class _Text(importlib.abc.InspectLoader):
    """A loader of a module whose source is at hand."""

    def __init__(self, source: str) -> None:
        self._source = source

    def get_source(self, fullname: str) -> str:
        """The source, whatever the name."""
        return self._source


def _from_text(source: str) -> ModuleType:
    loader = _Text(source)
    spec = importlib.util.spec_from_loader("emitted", loader)
    assert spec is not None  # noqa: S101
    module = importlib.util.module_from_spec(spec)
    loader.exec_module(module)
    return module
