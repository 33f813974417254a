"""Many steps of array programs in C, of one state or of many in blocks side by side.

`emitted/engine.c` takes them; its arrays are laid out here, in the order of the program's inputs.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.arrays.contents import owners_of
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Node, Program
from gibbs_codegen.files.verbatim import c_source
from gibbs_codegen.runtime.blocks import ONE, Blocks
from gibbs_codegen.runtime.c_library import Compiler, chosen_compiler
from gibbs_codegen.runtime.programs import c_text, called, library, take_step

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Taken(NamedTuple):
    """Outcome of steps: `taken` (count) of them, samples (count, s, size), `last` states.

    `refused` (count) tells which ended before a step, `goes_on` (count) which have not ended.
    Samples after the end of a state repeat its last one.
    """

    taken: NDArray[np.int32]
    samples: Array
    last: Array
    refused: Flags
    goes_on: Flags


class ProgramArguments:
    """Arguments of programs in C for `count` states in `blocks`, by addresses.

    `values` are by the names of `inputs`, with an axis of the states in front where these differ.
    `constants` are what the module's `prepare` returned, of one robot, or (count, constants), one
    for each owner. `tables` are arrays for what is written by hand; after them are guesses which of
    so many thrusts are at limits, of each state. With `per_state` states have constants of their
    own.
    """

    def __init__(
        self,
        inputs: Mapping[str, Node],
        values: Mapping[str, Any],
        constants: Sequence[Any],
        tables: Sequence[Array],
        guesses: int,
        count: int = 1,
        blocks: Blocks = ONE,
        *,
        per_state: bool = False,
    ) -> None:
        self._blocks, self._count, real = blocks, blocks.count(count), blocks.real
        # The array of each input by its name, in blocks where states have one each.
        self.arrays: dict[str, NDArray[Any]] = {}
        robots = [self._constants(x, per_state) for x in constants]
        columns = [*map(self._column, robots)]
        context = [np.ascontiguousarray(table, dtype=real) for table in tables]
        limited = blocks.filled(self._count, guesses, blocks.lanes)
        addresses = np.empty((self._count, len(tables) + 1), dtype=np.uint64)
        for k, table in enumerate(context):
            addresses[:, k] = table.ctypes.data
        addresses[:, -1] = self._column(limited)
        columns.append(self._column(addresses[:, :, np.newaxis]))
        for name, x in inputs.items():
            value = np.asarray(values[name], dtype=np.float64)
            if not x.is_uniform:
                value = np.broadcast_to(value, (count, *x.shape)).reshape(count, -1)
                self.arrays[name] = blocks.of_rows(value)
            else:
                self.arrays[name] = value.reshape(1, -1).astype(real)
            columns.append(self._column(self.arrays[name]))
        self.addresses = np.stack(columns, axis=1)
        # What is pointed to, so that it lives as long.
        self._owned = [robots, context, limited, addresses]

    def _constants(self, constants: Any, per_state: bool) -> NDArray[Any]:
        """Constants of one robot, or of each state in blocks."""
        numbers = np.frombuffer(constants) if isinstance(constants, bytes) else constants
        numbers = np.asarray(numbers, dtype=self._blocks.real)
        if per_state and numbers.ndim == 1:
            shape = self._blocks.lanes, len(numbers)
            return self._blocks.of_rows(np.broadcast_to(numbers, shape))
        return self._blocks.of_rows(numbers) if per_state else np.atleast_2d(numbers)

    def _column(self, array: NDArray[Any]) -> NDArray[np.uint64]:
        """Addresses (blocks) of the parts of an array that has one for each block, or one."""
        stride = array.strides[0] if len(array) > 1 else 0
        return np.uint64(array.ctypes.data) + np.uint64(stride) * np.arange(
            self._count, dtype=np.uint64
        )


class ProgramSteps:
    """Steps of a program of `count` states, in `blocks`.

    The program's inputs are time, h and x, and then those that `ProgramArguments` has: `values`,
    `constants` by owner, `tables` and `guesses` are as there.

    Raises `CompilerError`, or `CacheError` where the cache cannot be used.
    """

    def __init__(
        self,
        module: ModuleType,
        program: Program,
        values: Mapping[str, Any],
        constants: Mapping[str, Any],
        tables: Sequence[Array],
        guesses: int,
        count: int,
        blocks: Blocks,
    ) -> None:
        """Compile the program, and lay out what it is given."""
        self.count, self.blocks = count, blocks
        self.size = program.inputs[2].size
        robots = [constants[owner] for owner in owners_of(program)]
        per_state = any(isinstance(x, np.ndarray) for x in robots)
        compiler = chosen_compiler()
        self._run = _compiled(module, program, blocks, compiler, per_state=per_state)
        self._count = blocks.count(count)
        inputs = dict(list(zip(program.names, program.inputs, strict=True))[3:])
        laid = values, robots, tables, guesses, count, blocks
        self.arguments = ProgramArguments(inputs, *laid, per_state=per_state)
        # States, and what becomes of each: whether it goes on, was refused, and its steps.
        self._state = blocks.filled(self._count, self.size, blocks.lanes)
        self._progress = np.zeros((self._count, 3, blocks.lanes), dtype=np.int32)
        arrays = self.arguments.addresses, self._state, self._progress
        self._places = [(x.ctypes.data, x.strides[0]) for x in arrays]

    def __call__(
        self,
        time: float,
        states: NDArray[Any],
        step: float,
        steps: int,
        every: int = 1,
        number: int = 0,
        *,
        going: Flags | None = None,
        threads: int = 1,
        samples: Array | None = None,
    ) -> Taken:
        """Take steps with all states, fewer with those that are refused or cannot go on.

        `states` are (count, size). Each `every`-th step is a sample, where `number` steps came
        before; `samples` (count, s, size), if given, takes them. `going` (count): those that are
        flown.
        """
        blocks, kept = self._count, (number + steps) // every - number // every
        self._state[...] = self.blocks.of_rows(states)
        records = np.empty((self.count, kept, self.size)) if samples is None else samples
        self._progress[...] = 0
        flown = np.zeros(blocks * self.blocks.lanes, dtype=np.int32)
        flown[: self.count] = 1 if going is None else going
        self._progress[:, 0] = flown.reshape(blocks, -1)
        lanes, room = self.blocks.lanes, threading.local()

        def fly(k: int) -> None:
            # Each thread has room for the samples of one block, which stay in the cache.
            if not hasattr(room, "block"):
                room.block = self.blocks.filled(kept + 1, self.size, lanes)
            arguments, x, ends = (first + k * stride for first, stride in self._places)
            at = room.block.ctypes.data
            self._run(arguments, time, step, steps, every, number, x, at, None, ends)
            rows = records[k * lanes : (k + 1) * lanes]
            rows[...] = np.moveaxis(room.block[:kept], -1, 0)[: len(rows)]

        if min(threads, blocks) == 1:
            for block in range(blocks):
                fly(block)
        else:  # Block by block, so that Ctrl-C waits for no more than those under way.
            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(fly, range(blocks)))
        last, ended = (
            self.blocks.to_rows(x.copy(), self.count) for x in (self._state, self._progress)
        )
        goes_on, refused, taken = ended.T
        if taken.min() < steps:
            ends = (number + taken) // every - number // every
            for k in np.flatnonzero(ends < kept):
                records[k, ends[k] :] = last[k]
        return Taken(taken, records, last, refused.astype(bool), goes_on.astype(bool))


def steps_source(
    program: Program, robot: Functions, lanes: int = 1, *, per_state: bool = False
) -> str:
    """C that takes many steps of a program; with `per_state` states have constants of their own."""
    engine = [*take_step([program], program.names[3:]), c_source("engine.c")]
    return c_text([program], robot, lanes, per_state=per_state, engine=engine)


@lru_cache(maxsize=16)
def _compiled(
    module: ModuleType, program: Program, blocks: Blocks, compiler: Compiler, *, per_state: bool
) -> Any:
    """The function that takes many steps; with `per_state` states have constants of their own."""
    source = steps_source(program, Functions(module), blocks.lanes, per_state=per_state)
    sources = {f"_{program.name}.c": source}
    functions, single = called([program]), blocks.single
    compiled = library(
        module, functions, sources, "flights side by side", single=single, per_state=per_state
    )
    real, whole, address = ctypes.c_double, ctypes.c_int, ctypes.c_void_p
    compiled.program_run.argtypes = [address, real, real, whole, whole, whole, *[address] * 4]
    compiled.program_run.restype = None
    return compiled.program_run
