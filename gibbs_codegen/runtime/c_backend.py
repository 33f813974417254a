"""The C back end: the functions of a generated module, compiled, as Python functions.

The module's C source is compiled in parts and kept in a cache. Functions take one state, for which
`native/caller.c` makes calls cheap where Python's headers are there, or a batch of any shape.
States come in NumPy's natural layout; `native/rows.c` turns them into the blocks that the compiled
functions take.
"""

from __future__ import annotations

import ctypes
import functools
import logging
import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gibbs_codegen.emitted.evaluation import NotFiniteReport, batch_shape, state_array
from gibbs_codegen.emitted.preparation import first_of, real_numbers
from gibbs_codegen.errors import printable
from gibbs_codegen.interface import LANES, LISTS, Signature, entry_labels, module_signatures
from gibbs_codegen.runtime.c_library import (
    BATCH,
    EACH,
    Compiler,
    CompilerError,
    ModuleLibrary,
    opened_core,
)
from gibbs_codegen.runtime.cache import CacheError
from gibbs_codegen.runtime.caller import caller_type
from gibbs_codegen.runtime.loaded_module import GeneralFunction, LoadedModule

# Fewer states a thread are mostly sooner done than handed over.
_MIN_ROWS = 16_384

_UNDETERMINED = "these parameters leave an acceleration undetermined"

_log = logging.getLogger("gibbs_codegen")

Arrays = Sequence[NDArray[np.float64]]
Constants = bytes | NDArray[np.float64]


class CompiledConstants:
    """Result of `prepare` in this back end: bytes of the C module's constants.

    Where they differ from state to state they are an array (..., size / 8) of numbers.
    """

    def __init__(self, library: ctypes.CDLL, module: ModuleType) -> None:
        self._parameters: dict[str, float] = module.PARAMETERS
        self._check = module.prepare
        self._init = library[f"{module.NAME}_init_constants"]
        self._of_each = library["gibbs_codegen_constants_of_each"]
        self._of_each.restype = ctypes.c_size_t
        self.count = len(module.prepare({}))
        self.size = ctypes.sizeof(ctypes.c_double) * self.count
        self.default = self._one([*self._parameters.values()])

    def prepare(self, parameters: Mapping[str, ArrayLike]) -> Constants:
        """Bytes of the C module's struct; or its numbers (..., count), for arrays that broadcast.

        Raises `ValueError` if they leave an acceleration undetermined, or the NumPy module refuses
        them.
        """
        first = self._check(parameters)[0]
        by_name = {**self._parameters, **parameters}
        values = [real_numbers(name, value) for name, value in by_name.items()]
        if not isinstance(first, np.ndarray):
            return self._one([float(value) for value in values])
        rows = np.stack([np.broadcast_to(value, first.shape) for value in values], axis=-1)
        constants = np.empty((*first.shape, self.count))
        sizes = map(ctypes.c_size_t, (first.size, len(values), self.count))
        useless = self._of_each(self._init, *sizes, _pointer(rows), _pointer(constants))
        if useless:
            wrong = np.arange(first.size).reshape(first.shape) == useless - 1
            raise ValueError(f"{first_of('state', wrong)[1]}: {_UNDETERMINED}")
        return constants

    def _one(self, values: Sequence[float]) -> bytes:
        """Constants for one value of each parameter. Raises ValueError as `prepare` does."""
        constants = ctypes.create_string_buffer(self.size)
        if self._init(_pointer(np.array(values)), constants):
            raise ValueError(_UNDETERMINED)
        return constants.raw

    def chosen(self, constants: object) -> Constants:
        """Constants of a call, the default if None.

        Raises `TypeError` if they are another module's.
        """
        if constants is None:
            return self.default
        if isinstance(constants, bytes) and len(constants) == self.size:
            return constants
        if (
            isinstance(constants, np.ndarray)
            and constants.dtype == np.float64
            and constants.shape[1:][-1:] == (self.count,)
        ):
            return constants
        raise TypeError("constants must be what this module's prepare() returned")


def numbers(constants: Constants) -> NDArray[np.float64]:
    """Constants (..., count) as numbers."""
    return np.frombuffer(constants) if isinstance(constants, bytes) else constants


@functools.lru_cache(maxsize=64)
def default_constants(module: ModuleType) -> NDArray[np.float64]:
    """Constants (count) of the robot file; to prepare them takes as long as a thousand states."""
    constants = module.prepare({})
    return np.frombuffer(constants) if isinstance(constants, bytes) else np.array(constants)


def _pointer(array: NDArray[np.float64]) -> ctypes.c_void_p:
    return array.ctypes.data_as(ctypes.c_void_p)


class Pool:
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


class CompiledFunction:
    """One compiled function, for one state and for rows of states."""

    def __init__(
        self,
        core: ctypes.CDLL,
        library: ModuleLibrary,
        module: ModuleType,
        signature: Signature,
        constants: CompiledConstants,
        pool: Pool,
        in_numpy: Callable[..., Any],
    ) -> None:
        """Take the libraries of a module; `in_numpy` is its function in NumPy."""
        self._signature = signature
        self._library, self._in_numpy = library, in_numpy
        self._caller: Any = None
        self._is_lost = False
        self._forms: dict[str, Any] = {}
        self._constants = constants
        self._pool = pool
        self._report = NotFiniteReport(
            module.NAME, module.COORDINATES, module.VELOCITIES, module.INPUTS, module.FRAMES
        )
        self._report._labels |= entry_labels(
            {name: getattr(module, name, ()) for name in LISTS.values()}, signature
        )
        self._rows = core["gibbs_codegen_rows"]
        self._lost = core["gibbs_codegen_lost"]
        sizes = [*signature.widths, *map(math.prod, signature.shapes), constants.count]
        self._sizes = sizes
        self._c_sizes = (ctypes.c_size_t * len(sizes))(*sizes)

    def fast(self, caller: Callable[..., Any] | None) -> Any:
        """The function for any arguments, with a short way for one state in plain arrays.

        `caller` is what `caller_type` returns, which makes that.
        """
        general = GeneralFunction(self.evaluate, self._in_numpy)
        # The short way takes eight arguments.
        if caller is None or len(self._signature.arguments) > 8:
            return general
        shapes = self._signature.argument_shapes, self._signature.shapes
        self._caller = caller(*shapes, self._constants.default, general)
        return self._caller

    def _compiled(self, form: str) -> Any:
        """The function in a form; that for one state is known to the short way from now on."""
        if form not in self._forms:
            function = self._library.function(self._signature.name, form)
            if self._caller is not None and not form:
                self._caller.bind(ctypes.cast(function, ctypes.c_void_p).value)
            self._forms[form] = ctypes.cast(function, ctypes.c_void_p) if form else function
        return self._forms[form]

    def evaluate(self, by_name: Mapping[str, Any]) -> Any:
        """The function for any arguments: an array (..., *shape), or a tuple of them.

        `by_name` are what NumPy makes arrays (..., width) of, by the arguments' names, and
        `constants` as `CompiledConstants.prepare` returns them, or None.
        """
        signature = self._signature
        constants = self._constants.chosen(by_name.get("constants"))
        of_all = constants if isinstance(constants, bytes) else None
        of_each = [] if isinstance(constants, bytes) else [constants]
        arrays = [
            state_array(name, by_name[name], *shape)
            for name, shape in zip(signature.arguments, signature.argument_shapes, strict=True)
        ]
        named = dict(zip(signature.arguments, arrays, strict=True))
        batch = batch_shape(named, *(array.shape[:-1] for array in of_each))
        form = "" if not batch else EACH if of_each else BATCH
        try:
            function = None if self._is_lost else self._compiled(form)
        except (CompilerError, CacheError) as error:
            function, self._is_lost = None, True
            words = printable(error, 400)
            _log.warning("%s: runs in NumPy instead of C: %s", signature.name, words)
        if function is None:
            entries = np.moveaxis(numbers(constants), -1, 0)
            return self._in_numpy(**{**by_name, "constants": tuple(entries)})
        outputs = [np.empty((*batch, *shape)) for shape in signature.shapes]
        inputs, of_states = ([_rows(array, batch) for array in some] for some in (arrays, of_each))
        if not batch:
            self._lost()
            function(of_all, *map(_pointer, (*inputs, *outputs)))
            lost = bool(self._lost())
        else:
            lost = self._all_rows(function, of_all, [*inputs, *outputs, *of_states], batch)
        if lost:  # Reported if arguments are finite, as the NumPy back end does.
            finite = np.ones(batch, dtype=bool)
            for output, shape in zip(outputs, signature.shapes, strict=True):
                finite &= np.isfinite(output).reshape(*batch, math.prod(shape)).all(axis=-1)
            self._report(signature.name, named, finite, 4)
        return outputs[0] if len(outputs) == 1 else tuple(outputs)

    def _all_rows(
        self,
        function: ctypes.c_void_p,
        constants: bytes | None,
        arrays: Arrays,
        batch: tuple[int, ...],
    ) -> bool:
        """Compute all rows, on several threads where they are many.

        Returns whether finite inputs may have given what is not finite. `constants` are None for
        those of each state. `arrays` are inputs (*batch, width), outputs (*batch, *shape), which
        are filled, and constants of each state, all in C order.
        """
        count = math.prod(batch)
        flat = [a.reshape(-1) for a in arrays]
        parts = min(self._pool.threads, count // _MIN_ROWS)
        if parts < 2:
            return self._some_rows(function, constants, flat, 0, count)
        # Whole blocks, so that no two threads write to one block.
        step = -(-count // (parts * LANES)) * LANES
        futures = [
            self._pool.executor().submit(
                self._some_rows, function, constants, flat, start, min(step, count - start)
            )
            for start in range(0, count, step)
        ]
        lost = [future.result() for future in futures]
        return any(lost)

    def _some_rows(
        self,
        function: ctypes.c_void_p,
        constants: bytes | None,
        flat: Arrays,
        start: int,
        count: int,
    ) -> bool:
        """Compute `count` rows from `start` on, on this thread, of flattened arrays.

        Returns whether finite inputs may have given what is not finite. `constants` are None for
        those of each state.
        """
        sizes = self._sizes[: len(flat)]
        starts = [_address(a) + 8 * start * size for a, size in zip(flat, sizes, strict=True)]
        pointers = (ctypes.c_void_p * len(starts))(*starts)
        scratch = np.empty(LANES * (sum(sizes) + 1))
        # Blocks that begin where a cache line does are faster.
        aligned = -(-_address(scratch) // 64) * 64
        lost = self._rows(
            function,
            constants,
            ctypes.c_size_t(count),
            len(self._signature.widths),
            len(self._signature.shapes),
            self._c_sizes,
            pointers,
            ctypes.c_void_p(aligned),
        )
        if lost < 0:
            raise RuntimeError(f"{self._signature.name} has more arrays than rows.c takes")
        return bool(lost)


def _address(array: NDArray[np.float64]) -> int:
    """Address of the first entry; `array.ctypes.data` takes three times as long."""
    return int(array.__array_interface__["data"][0])


def _rows(array: NDArray[np.float64], batch: tuple[int, ...]) -> NDArray[np.float64]:
    """An array (..., width) as rows that follow each other, (*batch, width)."""
    if array.shape[:-1] == batch and array.flags.carray:
        return array
    whole = np.broadcast_to(array, (*batch, array.shape[-1]))
    return np.require(whole, requirements=["C", "A"])


def c_module(
    module: ModuleType,
    folder: Path,
    compiler: Compiler,
    threads: int,
    flags: Sequence[str] = (),
    *,
    whole: bool = False,
) -> ModuleType:
    """The functions and constants of a module, computed by its compiled C source.

    Functions are compiled when they are first called, with those of their group. `__file__` is the
    shared library of the constants, or of everything if that is to be `whole`; `compiled` has the
    others. `flags` come after the compiler's. Raises `CompilerError`, and `CacheError` if the
    library cannot be kept.
    """
    library = ModuleLibrary(folder, module, compiler, flags, whole=whole)
    core = opened_core(library.core, module.NAME)
    made = LoadedModule(module, "c")
    made.__file__ = str(library.core)
    made.compiled = library  # type: ignore[attr-defined]
    constants = CompiledConstants(core, module)
    prepare = GeneralFunction(lambda by_name: constants.prepare(**by_name), module.prepare)
    made.prepare = prepare  # type: ignore[attr-defined]
    pool = Pool(threads)
    caller = caller_type(compiler)
    for signature in module_signatures(module):
        in_numpy = getattr(module, signature.name)
        function = CompiledFunction(core, library, module, signature, constants, pool, in_numpy)
        setattr(made, signature.name, function.fast(caller))
    return made
