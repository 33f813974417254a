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
import math
import re
import sys
import sysconfig
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.cache import CacheError, cached_library
from gibbs_codegen.compiler import Compiler, CompilerError
from gibbs_codegen.interface import Signature, signatures

_NATIVE = Path(__file__).parent / "native"
_LANES = 8
# Fewer states a thread are sooner done than handed over.
_MIN_ROWS = 256
_DATA = ("NAME", "COORDINATES", "HYBRID_COORDINATES", "INPUTS", "POINTS", "PARAMETERS")

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
    made = ModuleType(module.__name__, module.__doc__)
    made.__file__ = str(path)
    for name in _DATA:
        setattr(made, name, getattr(module, name))
    constants = _Constants(library, module)
    made.prepare = constants.prepare  # type: ignore[attr-defined]
    pool = ThreadPoolExecutor(threads) if threads > 1 else None
    caller = _caller_type(compiler)
    lists = (module.COORDINATES, module.HYBRID_COORDINATES, module.INPUTS, module.POINTS)
    for signature in signatures(*map(len, lists)):
        function = _Function(library, module.NAME, signature, constants, pool, threads)
        general = function.general(getattr(module, signature.name))
        setattr(made, signature.name, function.fast(caller, general) if caller else general)
    return made


def compiled_library(folder: Path, name: str, compiler: Compiler) -> Path:
    """The shared library of a generated module, from the cache or compiled now.

    It exports the module's C functions, those of its CasADi adapter, and `gibbs_codegen_rows`.
    """
    files = [folder / file for file in c_files(name)] + [_NATIVE / "rows.c"]
    key = [compiler.identity, *(path.read_text(encoding="utf-8") for path in files)]
    sources = [path for path in files if path.suffix == ".c"]

    def make(output: Path) -> None:
        with _announced(f"compiling {name}"):
            compiler.library(sources, output)

    return cached_library("\0".join(key), make)


@contextmanager
def _announced(what: str) -> Iterator[None]:
    """Say what takes long, on a terminal; nothing in a pipe."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console

    with Console(stderr=True).status(what):
        yield


def c_files(name: str) -> list[str]:
    """Names of the files that the C target of a module consists of."""
    return [f"{name}.h", f"{name}.c", f"{name}_casadi.c"]


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


class _Function:
    """One compiled function, for one state and for rows of states."""

    def __init__(
        self,
        library: ctypes.CDLL,
        prefix: str,
        signature: Signature,
        constants: _Constants,
        pool: ThreadPoolExecutor | None,
        threads: int,
    ) -> None:
        self._signature = signature
        self._constants = constants
        self._pool = pool
        self._threads = threads
        self._one = library[f"{prefix}_{signature.name}"]
        self._batch = ctypes.cast(library[f"{prefix}_{signature.name}_batch"], ctypes.c_void_p)
        self._rows = library["gibbs_codegen_rows"]
        sizes = [*signature.widths, *(math.prod(shape) for shape in signature.shapes)]
        self._sizes = sizes
        self._c_sizes = (ctypes.c_size_t * len(sizes))(*sizes)

    def fast(self, caller: Callable[..., Any], general: Callable[..., Any]) -> Any:
        """The function with a short way for one state in plain arrays."""
        address = ctypes.cast(self._one, ctypes.c_void_p).value
        signature = self._signature
        return caller(address, signature.widths, signature.shapes, self._constants.default, general)

    def general(self, like: Callable[..., Any]) -> Callable[..., Any]:
        """The function for anything that NumPy makes an array of, and any batch.

        It has the name, the arguments and the documentation of `like`.
        """
        names = self._signature.arguments
        bind = inspect.signature(like).bind

        @functools.wraps(like)
        def function(*arguments: Any, **named: Any) -> Any:
            try:
                given = bind(*arguments, **named).arguments
            except TypeError as error:
                raise TypeError(f"{self._signature.name}() {error}") from None
            constants = self._constants.chosen(given.get("constants"))
            return self._evaluate([given[name] for name in names], constants)

        return function

    def _evaluate(self, arguments: Sequence[Any], constants: bytes) -> Any:
        signature = self._signature
        arrays = [
            _argument(name, value, width)
            for name, value, width in zip(
                signature.arguments, arguments, signature.widths, strict=True
            )
        ]
        batch = _common_batch(arrays)
        inputs = [
            np.ascontiguousarray(np.broadcast_to(array, (*batch, array.shape[-1])))
            for array in arrays
        ]
        outputs = [np.empty((*batch, *shape)) for shape in signature.shapes]
        if not batch:
            self._one(constants, *map(_pointer, [*inputs, *outputs]))
        else:
            self._all_rows(constants, math.prod(batch), inputs, outputs)
        return outputs[0] if len(outputs) == 1 else tuple(outputs)

    def _all_rows(self, constants: bytes, count: int, inputs: Arrays, outputs: Arrays) -> None:
        flat = [a.reshape(-1) for a in [*inputs, *outputs]]
        parts = min(self._threads, count // _MIN_ROWS)
        if self._pool is None or parts < 2:
            self._some_rows(constants, flat, 0, count)
            return
        # Whole blocks, so that no two threads write to one block.
        step = -(-count // (parts * _LANES)) * _LANES
        futures = [
            self._pool.submit(self._some_rows, constants, flat, start, min(step, count - start))
            for start in range(0, count, step)
        ]
        for future in futures:
            future.result()

    def _some_rows(self, constants: bytes, flat: Arrays, start: int, count: int) -> None:
        starts = [a[start * size :] for a, size in zip(flat, self._sizes, strict=True)]
        pointers = (ctypes.c_void_p * len(starts))(*(a.ctypes.data for a in starts))
        scratch = np.empty(_LANES * (sum(self._sizes) + 1))
        # Blocks that begin where a cache line does are faster.
        aligned = scratch.ctypes.data + -scratch.ctypes.data % 64
        self._rows(
            self._batch,
            constants,
            ctypes.c_size_t(count),
            len(self._signature.widths),
            len(self._signature.shapes),
            self._c_sizes,
            pointers,
            ctypes.c_void_p(aligned),
        )


def _argument(name: str, values: Any, width: int) -> NDArray[np.float64]:
    """An argument as an array, once its last axis has been checked."""
    array: NDArray[np.float64] = np.asarray(values, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != width:
        raise ValueError(
            f"{name} must have {width} entries along its last axis, not shape {array.shape}"
        )
    return array


def _common_batch(arrays: Arrays) -> tuple[int, ...]:
    shapes = [array.shape[:-1] for array in arrays]
    try:
        return np.broadcast_shapes(*shapes)
    except ValueError:
        raise ValueError(f"leading axes {shapes} do not broadcast") from None


def _pointer(array: NDArray[np.float64]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


@functools.cache
def _caller_type(compiler: Compiler) -> Callable[..., Any] | None:
    """The extension type that calls with little overhead; none where Python's headers are not."""
    include = sysconfig.get_path("include")
    if not (Path(include) / "Python.h").is_file() or sys.implementation.name != "cpython":
        return None
    source = _NATIVE / "caller.c"

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
    except (CompilerError, CacheError, ImportError):
        return None
    caller: Callable[..., Any] = made.Caller
    return caller
