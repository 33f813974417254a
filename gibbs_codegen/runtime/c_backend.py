"""The C back end: the functions of a generated module, compiled, as Python functions.

The module's C source is compiled once and kept in a cache. Where Python's headers are there,
`native/caller.c` makes calls for one state cheap.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from gibbs_codegen.interface import Signature, module_signatures
from gibbs_codegen.runtime.c_library import compiled_library
from gibbs_codegen.runtime.caller import caller_type
from gibbs_codegen.runtime.compiled_function import (
    CompiledConstants,
    CompiledFunction,
    GeneralFunction,
    Pool,
)
from gibbs_codegen.runtime.compiler import Compiler, CompilerError
from gibbs_codegen.runtime.loaded_module import LoadedModule


def c_module(module: ModuleType, folder: Path, compiler: Compiler, threads: int) -> ModuleType:
    """The functions and constants of a module, computed by its compiled C source.

    Args:
        module: The NumPy module.
        folder: Where its C files are.
        compiler: What compiles them.
        threads: How many threads share large batches.

    Returns:
        A module with the names of `module`, whose `__file__` is the shared library.

    Raises:
        CompilerError: It cannot be compiled or loaded.
        CacheError: The library cannot be kept.
    """
    path = compiled_library(folder, module.NAME, compiler)
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        raise CompilerError(f"{path.name} cannot be loaded: {error}") from None
    functions = module_signatures(module)
    _check_symbols(library, module.NAME, functions)
    made = LoadedModule(module)
    made.__file__ = str(path)
    constants = CompiledConstants(library, module)
    prepare = GeneralFunction(lambda given: constants.prepare(**given), module.prepare)
    made.prepare = prepare  # type: ignore[attr-defined]
    pool = Pool(threads)
    caller = caller_type(compiler)
    for signature in functions:
        function = CompiledFunction(library, module, signature, constants, pool)
        general = GeneralFunction(function.evaluate, getattr(module, signature.name))
        setattr(made, signature.name, function.fast(caller, general) if caller else general)
    return made


def _check_symbols(library: ctypes.CDLL, prefix: str, functions: Sequence[Signature]) -> None:
    """Refuse a library that lacks a function.

    Args:
        library: What was compiled.
        prefix: Name of the robot.
        functions: Those that it must have.

    Raises:
        CompilerError: It lacks one.
    """
    names = [f"{prefix}_{f.name}{form}" for f in functions for form in ("", "_batch")]
    for name in (f"{prefix}_init_constants", "gibbs_codegen_rows", "gibbs_codegen_lost", *names):
        if not hasattr(library, name):
            raise CompilerError(f"the library has no {name}; do flags in CC hide or rename it?")
