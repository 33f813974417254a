"""The functions of a module for constants per state, compiled when they are first needed."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Sequence
from pathlib import Path

from gibbs_codegen.runtime.c_library import compiled_files
from gibbs_codegen.runtime.compiler import Compiler, CompilerError


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
