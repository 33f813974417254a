"""The compiled functions of a module as operations of XLA on the CPU.

XLA takes minutes to compile what a C compiler does in seconds, and its code for a long function is
slower by far. `native/jax_call.c` hands the arrays of a batch to the module's C functions.
"""

from __future__ import annotations

import ctypes
import functools
import logging
import math
import threading
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import jax

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.interface import Signature
from gibbs_codegen.runtime import c_library
from gibbs_codegen.runtime.cache import CacheError, cached_library

_log = logging.getLogger("gibbs_codegen")
_SLOW = "%s: XLA compiles the functions, which takes long: %s"
_ONE_BY_ONE = "%s: states with constants of their own are computed one by one: %s"
_TARGET = "gibbs_codegen"
_adding = threading.Lock()


class CompiledCalls:
    """Calls of a module's compiled functions in programs of XLA."""

    def __init__(
        self, module: ModuleType, library: c_library.ModuleLibrary, caller: ctypes.CDLL
    ) -> None:
        """Take the compiled functions of a module, which XLA learns of when they are called.

        `caller` is the library of `native/jax_call.c`. Raises `CompilerError` if the constants are
        lacking.
        """
        self._library = library
        self._core = c_library.opened_core(library.core, module.NAME)
        # Another module of this name has another text.
        self._prefix = f"{module.NAME}/{library.digest}/"
        self._constants = len(module.prepare({}))
        self._module, self._caller = module.NAME, caller
        self._reasons: dict[str, str] = {}
        self._registered: set[str] = set()

    def why_not(self, signature: Signature) -> str:
        """The reason why XLA cannot call a function, which it learns of now; empty where it can."""
        with _adding:
            if signature.name not in self._reasons:
                try:
                    self._add(signature)
                    self._reasons[signature.name] = ""
                except (c_library.CompilerError, CacheError) as error:
                    reason = self._reasons[signature.name] = printable(error, 400)
                    _log.warning(_SLOW, f"{self._module}.{signature.name}", reason)
            return self._reasons[signature.name]

    def _add(self, signature: Signature) -> None:
        """Add a function to those that XLA can call. Raises `CompilerError` or `CacheError`."""
        sizes = [*signature.widths, *map(math.prod, signature.shapes), self._constants]
        batch = self._library.function(signature.name, c_library.BATCH)
        failed = self._caller.gibbs_codegen_jax_add(
            f"{self._prefix}{signature.name}".encode(),
            ctypes.cast(self._core["gibbs_codegen_rows"], ctypes.c_void_p),
            ctypes.cast(batch, ctypes.c_void_p),
            ctypes.byref(ctypes.c_double.in_dll(self._core, f"{self._module}_default_constants")),
            len(signature.widths),
            len(signature.shapes),
            (ctypes.c_size_t * len(sizes))(*sizes),
        )
        if failed:
            raise c_library.CompilerError(f"{signature.name} cannot be added to what XLA can call")

    def __call__(
        self, signature: Signature, constants: Any, arguments: Sequence[Any]
    ) -> tuple[Any, ...]:
        """Results (..., width) of a function that takes arguments (..., width) of one precision.

        Constants (..., number of constants), None for the default, and arguments have equally many
        axes, which broadcast.
        """
        operands = [*arguments]
        if constants is not None:
            # Whether they differ from state to state is not known where `vmap` adds an axis later.
            self._add_each(signature.name)
            operands.append(constants)
        batch = jax.numpy.broadcast_shapes(*(array.shape[:-1] for array in operands))
        shapes = [
            jax.ShapeDtypeStruct((*batch, math.prod(shape)), operands[0].dtype)
            for shape in signature.shapes
        ]
        call = jax.ffi.ffi_call(_TARGET, shapes, vmap_method="expand_dims")
        return tuple(call(*operands, function=f"{self._prefix}{signature.name}"))

    def _add_each(self, name: str) -> None:
        """Add the form for constants of each state to a function; where it can be had, and once."""
        with _adding:
            if name in self._registered:
                return
            self._registered.add(name)
            try:
                function = self._library.function(name, c_library.EACH)
            except (c_library.CompilerError, CacheError, UsageError) as error:
                if len(self._registered) == 1:
                    _log.warning(_ONE_BY_ONE, self._module, printable(error, 400))
                return
            address = ctypes.cast(function, ctypes.c_void_p)
            self._caller.gibbs_codegen_jax_add_each(f"{self._prefix}{name}".encode(), address)


def compiled_calls(module: ModuleType, folder: Path) -> CompiledCalls | str:
    """The compiled functions of a module where XLA computes on the CPU, or why there are none.

    Where they cannot be compiled, the log says so too. Raises `UsageError` for a C file of another
    make.
    """
    if (backend := jax.default_backend()) != "cpu":
        return f"JAX computes on the {backend}, and compiled functions run on the CPU only"
    if any(not (folder / name).is_file() for name in c_library.c_files(module.NAME)):
        reason = "the module was generated without the C target"
        _log.warning(_SLOW, module.NAME, reason)
        return reason
    try:
        library = c_library.ModuleLibrary(folder, module, c_library.chosen_compiler())
        with _adding:
            return CompiledCalls(module, library, _caller())
    except (c_library.CompilerError, CacheError, OSError) as error:
        reason = printable(error, 400)
        _log.warning(_SLOW, module.NAME, reason)
        return reason


@functools.cache
def _caller() -> ctypes.CDLL:
    """The library of `native/jax_call.c`, whose target XLA knows afterwards: one for the process.

    Raises `CompilerError` or `CacheError` where it cannot be made or kept, `OSError` where it
    cannot be loaded.
    """
    compiler = c_library.chosen_compiler()
    source = c_library.NATIVE / "jax_call.c"
    include = Path(jax.ffi.include_dir())
    header = include / "xla" / "ffi" / "api" / "c_api.h"
    texts = [c_library.native_source("jax_call.c"), header.read_text(encoding="utf-8")]

    def make(output: Path) -> None:
        compiler.library([source], output, [f"-I{include}"])

    library = ctypes.CDLL(str(cached_library("\n".join([compiler.identity, *texts]), make)))
    target = jax.ffi.pycapsule(library.gibbs_codegen_jax_call)
    jax.ffi.register_ffi_target(_TARGET, target, platform="cpu")
    return library
