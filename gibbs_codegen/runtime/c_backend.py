"""The C back end: the functions of a generated module, compiled, as Python functions.

The module's C source is compiled once and kept in a cache. Where Python's headers are there,
`native/caller.c` makes calls for one state cheap.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from gibbs_codegen.interface import module_signatures
from gibbs_codegen.runtime.c_library import (
    Compiler,
    CompilerError,
    compiled_files,
    compiled_library,
    loaded_library,
)
from gibbs_codegen.runtime.caller import caller_type
from gibbs_codegen.runtime.compiled_function import (
    CompiledConstants,
    CompiledFunction,
    GeneralFunction,
    Pool,
)
from gibbs_codegen.runtime.loaded_module import LoadedModule


class EachLibrary:
    """The shared library of a module's functions that take constants of each state in blocks."""

    def __init__(
        self, folder: Path, name: str, compiler: Compiler, extra: Sequence[str] = ()
    ) -> None:
        """Take what is compiled later; `extra` flags come after the compiler's."""
        self._folder, self._name = folder, name
        self._compiler, self._extra = compiler, extra

    def function(self, name: str) -> ctypes.c_void_p:
        """The address of a function of the library, compiled now or taken from the cache.

        Raises `UsageError` if the module has no such source, or one of another make, else
        `CompilerError` or `CacheError`.
        """
        if not hasattr(self.library, name):
            raise CompilerError(f"the library has no {name}; do flags in CC hide or rename it?")
        return ctypes.cast(self.library[name], ctypes.c_void_p)

    @functools.cached_property
    def library(self) -> ctypes.CDLL:
        """The library. Raises as `function` does."""
        name = self._name
        files = [f"{name}.h", f"{name}.c", f"{name}_each.c"]
        path = compiled_files(
            self._folder, name, files, self._compiler, self._extra, included=[f"{name}.c"]
        )
        try:
            return ctypes.CDLL(str(path))
        except OSError as error:
            raise CompilerError(f"{path.name} cannot be loaded: {error}") from None


def c_module(
    module: ModuleType,
    folder: Path,
    compiler: Compiler,
    threads: int,
    of_each: Sequence[str] = (),
) -> ModuleType:
    """The functions and constants of a module, computed by its compiled C source.

    Its `__file__` is the shared library. `of_each` are flags for the functions that take constants
    of each state, which are compiled when they are first needed. Raises `CompilerError`, and
    `CacheError` if the library cannot be kept.
    """
    path = compiled_library(folder, module.NAME, compiler)
    functions = module_signatures(module)
    library = loaded_library(path, module.NAME, functions)
    made = LoadedModule(module, "c")
    made.__file__ = str(path)
    constants = CompiledConstants(library, module)
    prepare = GeneralFunction(lambda given: constants.prepare(**given), module.prepare)
    each = EachLibrary(folder, module.NAME, compiler, of_each)
    made.prepare = prepare  # type: ignore[attr-defined]
    pool = Pool(threads)
    caller = caller_type(compiler)
    for signature in functions:
        function = CompiledFunction(library, module, signature, constants, each.function, pool)
        general = GeneralFunction(function.evaluate, getattr(module, signature.name))
        setattr(made, signature.name, function.fast(caller, general) if caller else general)
    return made
