"""A compiled function of a module as a Python function, for one state or a batch of any shape.

States come in NumPy's natural layout; `native/rows.c` turns them into the blocks that the compiled
functions take.
"""

from __future__ import annotations

import ctypes
import functools
import inspect
import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from types import ModuleType
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.emitted.evaluation import NotFiniteReport, batch_shape, state_array
from gibbs_codegen.interface import LANES, Signature

# Fewer states a thread are mostly sooner done than handed over.
_MIN_ROWS = 16_384

Arrays = Sequence[NDArray[np.float64]]


class CompiledConstants:
    """What `prepare` returns in this back end: the C module's constants, as bytes."""

    def __init__(self, library: ctypes.CDLL, module: ModuleType) -> None:
        self._parameters: dict[str, float] = module.PARAMETERS
        self._check = module.prepare
        self._init = library[f"{module.NAME}_init_constants"]
        self.size = ctypes.sizeof(ctypes.c_double) * len(module.prepare({}))
        self.default: bytes = self.prepare({})

    def prepare(self, parameters: dict[str, float]) -> bytes:
        """Constants of the functions for given parameters.

        Args:
            parameters: Values that differ from the defaults, by name.

        Returns:
            Bytes of the C module's struct.

        Raises:
            ValueError: They leave an acceleration undetermined, or the NumPy module refuses them.
        """
        self._check(parameters)
        values = {**self._parameters, **parameters}
        numbers = np.array([float(value) for value in values.values()])
        constants = ctypes.create_string_buffer(self.size)
        if self._init(numbers.ctypes.data_as(ctypes.c_void_p), constants):
            raise ValueError("these parameters leave an acceleration undetermined")
        return constants.raw

    def chosen(self, constants: object) -> bytes:
        """Constants of a call.

        Args:
            constants: What `prepare` returned, or None for the default.

        Returns:
            Bytes of the C module's struct.

        Raises:
            TypeError: They are not this module's.
        """
        if constants is None:
            return self.default
        if not isinstance(constants, bytes) or len(constants) != self.size:
            raise TypeError("constants must be what this module's prepare() returned")
        return constants


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
        library: ctypes.CDLL,
        module: ModuleType,
        signature: Signature,
        constants: CompiledConstants,
        pool: Pool,
    ) -> None:
        self._signature = signature
        self._constants = constants
        self._pool = pool
        self._report = NotFiniteReport(
            module.NAME, module.COORDINATES, module.VELOCITIES, module.INPUTS, module.FRAMES
        )
        own = f"{module.NAME}_{signature.name}"
        self._one = library[own]
        self._batch = ctypes.cast(library[f"{own}_batch"], ctypes.c_void_p)
        self._rows = library["gibbs_codegen_rows"]
        self._lost = library["gibbs_codegen_lost"]
        sizes = [*signature.widths, *(math.prod(shape) for shape in signature.shapes)]
        self._sizes = sizes
        self._c_sizes = (ctypes.c_size_t * len(sizes))(*sizes)

    def fast(self, caller: Callable[..., Any], general: Callable[..., Any]) -> Any:
        """The function with a short way for one state in plain arrays.

        Args:
            caller: What `caller_type` returns.
            general: The function for any arguments, which takes the calls for all others.

        Returns:
            What is called as `general` is.
        """
        address = ctypes.cast(self._one, ctypes.c_void_p).value
        signature = self._signature
        shapes = signature.argument_shapes, signature.shapes
        return caller(address, *shapes, self._constants.default, general)

    def evaluate(self, given: Mapping[str, Any]) -> Any:
        """The function for any arguments.

        Args:
            given: Anything that NumPy makes an array (..., width) of, by the arguments' names, and
                what `CompiledConstants.prepare` returned as `constants`, or None.

        Returns:
            An array (..., *shape), or a tuple of them.
        """
        signature = self._signature
        constants = self._constants.chosen(given.get("constants"))
        arrays = [
            state_array(name, given[name], *shape)
            for name, shape in zip(signature.arguments, signature.argument_shapes, strict=True)
        ]
        batch = batch_shape(dict(zip(signature.arguments, arrays, strict=True)))
        inputs = [
            np.require(np.broadcast_to(array, (*batch, array.shape[-1])), requirements=["C", "A"])
            for array in arrays
        ]
        outputs = [np.empty((*batch, *shape)) for shape in signature.shapes]
        if not batch:
            self._lost()
            pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (*inputs, *outputs)]
            self._one(constants, *pointers)
            lost = bool(self._lost())
        else:
            lost = self._all_rows(constants, math.prod(batch), inputs, outputs)
        if lost:
            self._report_lost(arrays, outputs, batch)
        return outputs[0] if len(outputs) == 1 else tuple(outputs)

    def _report_lost(self, arrays: Arrays, outputs: Arrays, batch: tuple[int, ...]) -> None:
        """Report results that are not finite though arguments are, as the NumPy back end does.

        Args:
            arrays: Arguments (..., width).
            outputs: Results (*batch, *shape).
            batch: The shape that the leading axes broadcast to.
        """
        signature = self._signature
        finite = np.ones(batch, dtype=bool)
        for output, shape in zip(outputs, signature.shapes, strict=True):
            finite &= np.isfinite(output).reshape(*batch, math.prod(shape)).all(axis=-1)
        named = dict(zip(signature.arguments, arrays, strict=True))
        self._report(signature.name, named, finite, 5)

    def _all_rows(self, constants: bytes, count: int, inputs: Arrays, outputs: Arrays) -> bool:
        """Compute all rows, on several threads where they are many.

        Args:
            constants: Bytes of the C module's constants.
            count: Number of rows.
            inputs: Arrays (*batch, width) in C order.
            outputs: Arrays (*batch, *shape), which are filled.

        Returns:
            Whether finite inputs may have given what is not finite.
        """
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
        """Compute rows that follow each other, on this thread.

        Args:
            constants: Bytes of the C module's constants.
            flat: Inputs and outputs, flattened.
            start: Number of the first row.
            count: How many rows.

        Returns:
            Whether finite inputs may have given what is not finite.
        """
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


class GeneralFunction:
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
        """Call it as `like` is called."""
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

    def __copy__(self) -> GeneralFunction:
        return self

    def __deepcopy__(self, _: object) -> GeneralFunction:
        return self
