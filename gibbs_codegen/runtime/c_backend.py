"""The C back end: the functions of a generated module, compiled, as Python functions.

The module's C source is compiled once and kept in a cache. States come in NumPy's natural layout;
`native/rows.c`, compiled beside it, turns them into the blocks that the compiled functions take.
Where Python's headers are there, `native/caller.c` makes calls for one state cheap.
"""

from __future__ import annotations

import ctypes
import functools
import importlib.machinery
import importlib.util
import inspect
import logging
import math
import os
import re
import sys
import sysconfig
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.emitted.evaluation import NotFiniteReport, batch_shape, state_array
from gibbs_codegen.interface import DATA, LANES, Signature, module_signatures
from gibbs_codegen.runtime.c_library import NATIVE, compiled_library
from gibbs_codegen.runtime.cache import CacheError, cached_library
from gibbs_codegen.runtime.compiler import Compiler, CompilerError

_log = logging.getLogger("gibbs_codegen")
# Fewer states a thread are mostly sooner done than handed over.
_MIN_ROWS = 16_384

Arrays = Sequence[NDArray[np.float64]]


def c_module(module: ModuleType, folder: Path, compiler: Compiler, threads: int) -> ModuleType:
    """The functions and constants of `module`, computed by its compiled C source.

    Raises `CompilerError` or `CacheError` where it cannot be compiled or kept.
    """
    path = compiled_library(folder, module.NAME, compiler)
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        raise CompilerError(f"{path.name} cannot be loaded: {error}") from None
    functions = module_signatures(module)
    _check_symbols(library, module.NAME, functions)
    made = ModuleType(module.__name__, module.__doc__)
    made.__file__ = str(path)
    for name in DATA:
        setattr(made, name, getattr(module, name))
    constants = _Constants(library, module)
    prepare = _General(lambda given: constants.prepare(**given), module.prepare)
    made.prepare = prepare  # type: ignore[attr-defined]
    pool = _Pool(threads)
    caller = _caller_type(compiler)
    for signature in functions:
        function = _Function(library, module, signature, constants, pool)
        general = _General(function.evaluate, getattr(module, signature.name))
        setattr(made, signature.name, function.fast(caller, general) if caller else general)
    return made


def _check_symbols(library: ctypes.CDLL, prefix: str, functions: Sequence[Signature]) -> None:
    """Refuse a library that lacks a function. Raises `CompilerError`."""
    names = [f"{prefix}_{f.name}{form}" for f in functions for form in ("", "_batch")]
    for name in (f"{prefix}_init_constants", "gibbs_codegen_rows", "gibbs_codegen_lost", *names):
        if not hasattr(library, name):
            raise CompilerError(f"the library has no {name}; do flags in CC hide or rename it?")


class _Constants:
    """What `prepare` returns in this back end: the C module's constants, as bytes."""

    def __init__(self, library: ctypes.CDLL, module: ModuleType) -> None:
        self._parameters: dict[str, float] = module.PARAMETERS
        self._check = module.prepare
        self._init = library[f"{module.NAME}_init_constants"]
        self.size = ctypes.sizeof(ctypes.c_double) * len(module.prepare({}))
        self.default: bytes = self.prepare({})

    def prepare(self, parameters: dict[str, float]) -> bytes:
        """Constants of the other functions for given parameters."""
        self._check(parameters)
        values = {**self._parameters, **parameters}
        numbers = np.array([float(value) for value in values.values()])
        constants = ctypes.create_string_buffer(self.size)
        if self._init(numbers.ctypes.data_as(ctypes.c_void_p), constants):
            raise ValueError("these parameters leave an acceleration undetermined")
        return constants.raw

    def chosen(self, constants: object) -> bytes:
        if constants is None:
            return self.default
        if not isinstance(constants, bytes) or len(constants) != self.size:
            raise TypeError("constants must be what this module's prepare() returned")
        return constants


class _Pool:
    """Threads, made when first needed, and anew in a process that was forked."""

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self._executor: ThreadPoolExecutor | None = None
        self._process = 0

    def executor(self) -> ThreadPoolExecutor:
        """The threads of this process."""
        if self._executor is None or self._process != os.getpid():
            self._executor, self._process = ThreadPoolExecutor(self.threads), os.getpid()
        return self._executor


class _Function:
    """One compiled function, for one state and for rows of states."""

    def __init__(
        self,
        library: ctypes.CDLL,
        module: ModuleType,
        signature: Signature,
        constants: _Constants,
        pool: _Pool,
    ) -> None:
        self._signature = signature
        self._constants = constants
        self._pool = pool
        self._report = NotFiniteReport(module.NAME, module.COORDINATES, module.INPUTS)
        own = f"{module.NAME}_{signature.name}"
        self._one = library[own]
        self._batch = ctypes.cast(library[f"{own}_batch"], ctypes.c_void_p)
        self._rows = library["gibbs_codegen_rows"]
        self._lost = library["gibbs_codegen_lost"]
        sizes = [*signature.widths, *(math.prod(shape) for shape in signature.shapes)]
        self._sizes = sizes
        self._c_sizes = (ctypes.c_size_t * len(sizes))(*sizes)

    def fast(self, caller: Callable[..., Any], general: Callable[..., Any]) -> Any:
        """The function with a short way for one state in plain arrays."""
        address = ctypes.cast(self._one, ctypes.c_void_p).value
        signature = self._signature
        return caller(address, signature.widths, signature.shapes, self._constants.default, general)

    def evaluate(self, given: Mapping[str, Any]) -> Any:
        """The function of arguments by name: anything that NumPy makes an array of, any batch."""
        signature = self._signature
        constants = self._constants.chosen(given.get("constants"))
        arrays = [
            state_array(name, given[name], width)
            for name, width in zip(signature.arguments, signature.widths, strict=True)
        ]
        batch = batch_shape(arrays)
        inputs = [
            np.require(np.broadcast_to(array, (*batch, array.shape[-1])), requirements=["C", "A"])
            for array in arrays
        ]
        outputs = [np.empty((*batch, *shape)) for shape in signature.shapes]
        if not batch:
            self._lost()
            self._one(constants, *map(_pointer, [*inputs, *outputs]))
            lost = bool(self._lost())
        else:
            lost = self._all_rows(constants, math.prod(batch), inputs, outputs)
        if lost:
            self._report_lost(arrays, outputs, batch)
        return outputs[0] if len(outputs) == 1 else tuple(outputs)

    def _report_lost(self, arrays: Arrays, outputs: Arrays, batch: tuple[int, ...]) -> None:
        """Report results that are not finite though arguments are, as the NumPy back end does."""
        signature = self._signature
        finite = np.ones(batch, dtype=bool)
        for output, shape in zip(outputs, signature.shapes, strict=True):
            finite &= np.isfinite(output).reshape(*batch, math.prod(shape)).all(axis=-1)
        named = dict(zip(signature.arguments, arrays, strict=True))
        self._report(signature.name, named, finite, 5)

    def _all_rows(self, constants: bytes, count: int, inputs: Arrays, outputs: Arrays) -> bool:
        """Compute all rows; whether finite inputs may have given what is not finite."""
        flat = [a.reshape(-1) for a in [*inputs, *outputs]]
        parts = min(self._pool.threads, count // _MIN_ROWS)
        if parts < 2:
            return self._some_rows(constants, flat, 0, count)
        # Whole blocks, so that no two threads write to one block.
        step = -(-count // (parts * LANES)) * LANES
        futures = [
            self._pool.executor().submit(
                self._some_rows, constants, flat, start, min(step, count - start)
            )
            for start in range(0, count, step)
        ]
        lost = [future.result() for future in futures]
        return any(lost)

    def _some_rows(self, constants: bytes, flat: Arrays, start: int, count: int) -> bool:
        starts = [a[start * size :] for a, size in zip(flat, self._sizes, strict=True)]
        pointers = (ctypes.c_void_p * len(starts))(*(a.ctypes.data for a in starts))
        scratch = np.empty(LANES * (sum(self._sizes) + 1))
        # Blocks that begin where a cache line does are faster.
        aligned = scratch.ctypes.data + -scratch.ctypes.data % 64
        lost = self._rows(
            self._batch,
            constants,
            ctypes.c_size_t(count),
            len(self._signature.widths),
            len(self._signature.shapes),
            self._c_sizes,
            pointers,
            ctypes.c_void_p(aligned),
        )
        return bool(lost)


class _General:
    """A compiled function for any arguments, which it takes as the function `like` does.

    It has the name and the documentation of `like`.
    """

    def __init__(
        self, evaluate: Callable[[Mapping[str, Any]], Any], like: Callable[..., Any]
    ) -> None:
        functools.update_wrapper(self, like)
        self._name = like.__name__
        self._evaluate = evaluate
        self._bind = inspect.signature(like).bind

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        try:
            given = self._bind(*arguments, **named).arguments
        except TypeError as error:
            raise TypeError(f"{self._name}() {error}") from None
        return self._evaluate(given)

    def __repr__(self) -> str:
        return f"<compiled function {self._name}>"

    def __reduce__(self) -> NoReturn:
        # By its name the NumPy function would be found instead.
        raise TypeError(
            f"{self._name}() is compiled code, which cannot be pickled: load the module in every "
            "process and pass arrays and constants"
        )

    def __copy__(self) -> _General:
        return self

    def __deepcopy__(self, _: object) -> _General:
        return self


def _pointer(array: NDArray[np.float64]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


@functools.cache
def _caller_type(compiler: Compiler) -> Callable[..., Any] | None:
    """The extension type that calls with little overhead; none where Python's headers are not."""
    include = sysconfig.get_path("include")
    if not (Path(include) / "Python.h").is_file() or sys.implementation.name != "cpython":
        _log.info("calls for one state take the long way: Python's headers are not installed")
        return None
    source = NATIVE / "caller.c"

    def make(output: Path) -> None:
        extra = [f"-I{include}", f"-I{np.get_include()}"]
        if sys.platform == "darwin":
            extra += ["-undefined", "dynamic_lookup"]
        compiler.library([source], output, extra)

    numpy_abi = re.match(r"\d+\.\d+", np.__version__)
    key = [
        compiler.identity,
        sys.version,
        include,
        numpy_abi[0] if numpy_abi else np.__version__,
        source.read_text(encoding="utf-8"),
    ]
    try:
        path = str(cached_library("\n".join(key), make))
        name = "gibbs_codegen_caller"
        loader = importlib.machinery.ExtensionFileLoader(name, path)
        spec = importlib.util.spec_from_file_location(name, path, loader=loader)
        if spec is None:
            return None
        made = importlib.util.module_from_spec(spec)
        loader.exec_module(made)
    except (CompilerError, CacheError, ImportError) as error:
        _log.info("calls for one state take the long way: %s", error)
        return None
    caller: Callable[..., Any] = made.Caller
    return caller
