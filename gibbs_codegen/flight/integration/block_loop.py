"""Closed loops in blocks: many flights of one robot side by side, in compiled code.

`native/rk4.c` is compiled for numbers of LANES states, and calls the module's functions for blocks.
"""

from __future__ import annotations

import ctypes
import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.compiled_loop import (
    FUNCTIONS,
    NUMBERS,
    Loop,
    addresses,
    compiled_law,
    compiled_steps,
    layout_text,
    values_of,
)
from gibbs_codegen.flight.integration.envelope import Envelope
from gibbs_codegen.flight.integration.integrators import StepGrid, whole_history
from gibbs_codegen.flight.integration.state_history import (
    InputRanges,
    Loads,
    SmoothInterval,
    StateHistory,
)
from gibbs_codegen.flight.plant.vehicle import Array, Flags
from gibbs_codegen.flight.scenario.parts import Settings
from gibbs_codegen.interface import LANES
from gibbs_codegen.runtime.c_library import (
    Compiler,
    CompilerError,
    ModuleLibrary,
    chosen_compiler,
)
from gibbs_codegen.runtime.cache import CacheError

_log = logging.getLogger("gibbs_codegen")
# Bytes to a multiple of which blocks are laid, so that a number of them is one load.
_ALIGNMENT = 8 * LANES
# Steps that a call takes on at most, so that progress shows and Ctrl-C is heard: the same however
# many flights there are, since each call rounds the time anew.
_STEPS_A_CALL = 1000


class Blocks(NamedTuple):
    """What became of flights: steps `taken` (count), samples (count, s, size), `last` states.

    `refused` (count) tells which flights ended because the rotors cannot produce a wrench, of which
    `ClosedLoop.derivative` says more. Samples after the end of a flight repeat its last state.
    """

    taken: NDArray[np.int64]
    samples: Array
    last: Array
    refused: Flags


@dataclass(frozen=True)
class BlockLoop:
    """Closed loops of many flights of one robot in compiled code, while the same acts on them.

    They share times, desired motion, and what surrounds them.
    """

    library: ctypes.CDLL
    # For each block one `Loop`, as words (blocks, words).
    loops: NDArray[np.uint64]
    room: int
    count: int
    size: int
    # What the structures point to, so that it lives as long.
    owned: list[Any]

    @classmethod
    def of(
        cls, closed: ClosedLoop, bounds: Array | float, loads: Loads, count: int
    ) -> BlockLoop | None:
        """The compiled loops of `count` flights; None where module, law or loop is not compiled.

        In `closed`, one more leading axis of length `count` may be on constants of plant and model,
        damping, wrenches and centre of the rotors, lag, limits, gains, and what the geometric law
        knows. `bounds` of errors, then their rates, are (2 nv), (count, 2 nv) or one number.
        """
        if compiled_law(closed, loads) is None:
            return None
        try:
            compiler = chosen_compiler()
            flags = f"-DLANES={LANES}", f"-DLAYOUT={layout_text(closed)}"
            steps = compiled_steps(compiler, *flags)
            words, owned = _structures(closed, bounds, loads, count, compiler)
        except (CompilerError, CacheError) as error:
            _log.warning("flights are taken one by one: %s", error)
            return None
        room = int(steps.gibbs_codegen_loop_room(words.ctypes.data))
        return cls(steps, words, room, count, closed.size, owned)

    def __call__(
        self,
        time: float,
        states: Array,
        step: float,
        steps: int,
        every: int = 1,
        number: int = 0,
        going: Flags | None = None,
        threads: int = 1,
    ) -> Blocks:
        """Take steps with all flights, fewer with those that are refused or cannot go on.

        `states` are (count, size). Each `every`-th step is a sample, where `number` steps came
        before. `going` (count): the flights that are flown.
        """
        blocks, kept = len(self.loops), (number + steps) // every - number // every
        state = _in_blocks(states)
        samples = _aligned((blocks, kept, self.size, LANES))
        going = np.ones(self.count, dtype=bool) if going is None else going
        # What C calls Progress: flights that go on, all bits ones; those refused; steps.
        progress = _aligned((blocks, 3, LANES), np.int64)
        progress[...] = 0
        progress[:, :1] = _in_blocks(-going[:, np.newaxis].astype(np.int64), fill=False)
        loops = self.loops.copy()

        def fly(some: NDArray[np.int64]) -> None:
            scratch = _aligned((self.room, LANES))
            loops[some, Loop.scratch.offset // 8] = scratch.ctypes.data
            for k in some:
                places = (each[k].ctypes.data for each in (state, samples))
                where = loops[k].ctypes.data, progress[k].ctypes.data
                self.library.gibbs_codegen_rk4(
                    where[0], time, step, steps, every, number, *places, None, where[1]
                )

        shares = np.array_split(np.arange(blocks), min(threads, blocks))
        with ThreadPoolExecutor(len(shares)) as pool:
            list(pool.map(fly, shares))
        _, refused, taken = np.moveaxis(_out_of_blocks(progress, self.count), -1, 0)
        last, found = (_out_of_blocks(each, self.count) for each in (state, samples))
        ends = (number + taken) // every - number // every
        for flight in np.flatnonzero(ends < kept):
            found[flight, ends[flight] :] = last[flight]
        return Blocks(taken, found, last, refused != 0)


class _Pointers:
    """Arrays that a `Loop` points to, of which some have a part for each block."""

    def __init__(self) -> None:
        self.owned: list[Any] = []
        self._strides: dict[int, int] = {}

    def to(self, at: int, array: NDArray[Any]) -> int:
        """The address of an array, (1 or blocks, …), at an offset of the structure."""
        self.owned.append(array)
        self._strides[at // 8] = array.strides[0] if len(array) > 1 else 0
        return array.ctypes.data

    def repeated(self, loop: Loop, blocks: int) -> NDArray[np.uint64]:
        """The structure for each block, with pointers to its parts: words (blocks, words)."""
        self.owned.append(loop)
        words = np.tile(np.frombuffer(bytes(loop), dtype=np.uint64), (blocks, 1))
        for word, stride in self._strides.items():
            words[:, word] += (stride * np.arange(blocks)).astype(np.uint64)
        return words


def _structures(
    closed: ClosedLoop, bounds: Array | float, loads: Loads, count: int, compiler: Compiler
) -> tuple[NDArray[np.uint64], list[Any]]:
    """A `Loop` for each block, as words (blocks, words), and what must live as long.

    Raises `CompilerError` or `CacheError` where functions of constants of each state cannot be
    compiled or kept.
    """
    loop, pointers, blocks = Loop(), _Pointers(), -(-count // LANES)
    _bind(loop, pointers, closed, count, compiler)
    for part, name, value in values_of(closed, bounds, loads):
        holder = getattr(loop, part) if part else loop
        at = (getattr(Loop, part).offset if part else 0) + getattr(type(holder), name).offset
        if (part, name) in NUMBERS:
            value = pointers.to(at, _for_all_or_each(value, NUMBERS[part, name], count))
        elif isinstance(value, np.ndarray):
            array = np.ascontiguousarray(value, dtype=np.float64)
            pointers.owned.append(array)
            value = array.ctypes.data
        setattr(holder, name, value)
    guesses = _aligned((blocks, closed.vehicle.rotors, LANES))
    guesses[...] = 0.0
    loop.guesses = pointers.to(Loop.guesses.offset, guesses)
    return pointers.repeated(loop, blocks), pointers.owned


def _bind(
    loop: Loop, pointers: _Pointers, closed: ClosedLoop, count: int, compiler: Compiler
) -> None:
    """Put functions for blocks into a structure, with constants for all or of each state."""
    vehicle, model = closed.vehicle, closed.controller.vehicle
    constants = {"plant": vehicle.constants, "model": model.constants}
    if any(isinstance(values, np.ndarray) for values in constants.values()):
        folder = Path(vehicle.module.__path__[0])
        library = ModuleLibrary(folder, vehicle.name, FUNCTIONS, compiler, each=True)
        ending = "_batch_each"
    else:
        library, ending = vehicle.module.compiled, "_batch"
    pointers.owned.append(library)
    loop.functions = type(loop.functions)(*addresses(library, ending))
    for name, values in constants.items():
        values = vehicle.module.prepare({}) if values is None else values
        if ending == "_batch_each":
            numbers = np.frombuffer(values) if isinstance(values, bytes) else values
            values = pointers.to(getattr(Loop, name).offset, _for_all_or_each(numbers, 1, count))
        setattr(loop, name, values)


def _for_all_or_each(value: Any, axes: int, count: int) -> Array:
    """Numbers in blocks (1 or blocks, entries, LANES): the same for all flights, or of each.

    `value` has `axes` axes if it is the same for all; else one more, of length `count`.
    """
    array = np.asarray(value, dtype=np.float64)
    if array.ndim == axes:
        array = np.broadcast_to(array, (LANES, *array.shape))
    return _in_blocks(array.reshape(len(array), -1))


def _aligned(shape: tuple[int, ...], kind: type[np.generic] = np.float64) -> NDArray[Any]:
    """An array of numbers of 8 bytes that begins where a block may, with anything in it."""
    size = 8 * int(np.prod(shape))
    memory = np.empty(size + _ALIGNMENT, dtype=np.uint8)
    begin = -memory.ctypes.data % _ALIGNMENT
    return memory[begin : begin + size].view(kind).reshape(shape)


def _in_blocks(rows: NDArray[Any], fill: bool = True) -> NDArray[Any]:
    """Rows (count, entries) in blocks (blocks, entries, LANES), in memory that is aligned.

    With `fill` the last row fills what is left of the last block, else zeros do.
    """
    count, entries = rows.shape
    blocks = _aligned((-(-count // LANES), entries, LANES), rows.dtype.type)
    padded = np.zeros((len(blocks) * LANES, entries), dtype=rows.dtype)
    padded[:count], padded[count:] = rows, rows[-1] if fill else 0
    blocks[...] = np.swapaxes(padded.reshape(len(blocks), LANES, entries), 1, 2)
    return blocks


def _out_of_blocks(blocks: NDArray[Any], count: int) -> NDArray[Any]:
    """Rows (count, …) of blocks (blocks, …, LANES)."""
    rows = np.moveaxis(blocks, -1, 1)
    states = rows.shape[0] * rows.shape[1]  # There may be no samples, of which -1 is no number.
    return np.ascontiguousarray(rows.reshape(states, *rows.shape[2:])[:count])


@dataclass(frozen=True)
class BlockIntegration:
    """Many flights that differ in parameters of the plant, in lag and in where they start.

    `loop` is the closed loop of all, whose arrays have an axis of the flights where these differ.
    `one` gives the closed loop of a flight by its number.
    """

    loop: ClosedLoop
    one: Callable[[int], ClosedLoop]
    settings: Settings
    duration: float
    threads: int = 1

    def __call__(
        self, starts: Array, progress: Callable[[float], None] = lambda time: None
    ) -> list[StateHistory | None]:
        """Histories from states (n, size) at time 0 on, as `integrate` gives them.

        None for a flight to be integrated by itself: its law refuses a state, or there are no
        compiled blocks. `progress` is told the time reached, s.
        """
        states = _BlockStates(self, starts)
        for interval in self.loop.smooth_intervals(0.0, self.duration):
            states.advance(interval, progress)
        return states.histories()

    def envelope(self, loop: ClosedLoop) -> Envelope:
        """Where control counts as lost, of all flights or of one."""
        return Envelope(loop, self.settings.divergence, self.duration)


class _BlockStates:
    """How far flights have come, and their samples."""

    def __init__(self, plan: BlockIntegration, starts: Array) -> None:
        self._plan, self._grid = plan, StepGrid(plan.settings)
        self._bounds = plan.envelope(plan.loop).bounds
        count = len(starts)
        self._times, self._samples = [np.zeros(1)], [starts[:, np.newaxis]]
        self._kept = np.ones(count, dtype=np.int64)
        self._last, self._ends = starts.copy(), np.zeros(count)
        # Flights that are still under way, and those that must be integrated by themselves.
        self._flies, self._alone = np.ones(count, dtype=bool), np.zeros(count, dtype=bool)
        self._reasons: dict[int, str] = {}
        for i in np.flatnonzero(~self._goes_on()).tolist():
            self._end(i)

    def advance(self, interval: SmoothInterval, progress: Callable[[float], None]) -> None:
        """Integrate over an interval, which begins where the last one ended."""
        plan, count = self._plan, len(self._last)
        block = BlockLoop.of(plan.loop, self._bounds, interval.loads, count)
        if block is None:
            self._alone[:] = True
            return
        self._times.append(self._grid.sample_times(interval))
        time = interval.begin
        for stretch in self._grid.stretches(interval):
            for done in range(0, stretch.steps, _STEPS_A_CALL):
                if not self._flies.any():
                    return
                steps, number = min(_STEPS_A_CALL, stretch.steps - done), stretch.first + done
                found = block(
                    time,
                    self._last,
                    stretch.step,
                    steps,
                    stretch.every,
                    number,
                    self._flies,
                    plan.threads,
                )
                taken = found.taken
                self._kept += (number + taken) // stretch.every - number // stretch.every
                self._samples.append(found.samples)
                time = min((number + steps) * self._grid.size, interval.end)
                ends = np.where(taken < steps, (number + taken) * self._grid.size, time)
                self._go_on(found, np.minimum(ends, interval.end), taken == steps)
                progress(time)

    def histories(self) -> list[StateHistory | None]:
        """The histories; None of flights that must be integrated by themselves."""
        loop = self._plan.loop
        time, states = np.concatenate(self._times), np.concatenate(self._samples, axis=1)
        envelope, ranges = self._plan.envelope(loop), InputRanges.none(len(loop.vehicle.inputs))
        found: list[StateHistory | None] = []
        for i, kept in enumerate(self._kept.tolist()):
            reason, end = self._reasons.get(i, ""), float(self._ends[i])
            history = StateHistory(time[:kept], states[i, :kept], reason, ranges)
            # Of a flight that went on to the end, all samples have been looked at.
            if reason or end > time[kept - 1]:
                history = whole_history(history, end, self._last[i], envelope)
            found.append(None if self._alone[i] else history)
        return found

    def _go_on(self, found: Blocks, ends: Array, finished: Flags) -> None:
        """Take the states to which flights under way have come, at times `ends` (n), s.

        `finished` (n) says whether all steps were taken.
        """
        flies = self._flies
        self._last[flies], self._ends[flies] = found.last[flies], ends[flies]
        self._alone |= flies & found.refused
        self._flies = flies & ~found.refused
        for i in np.flatnonzero(self._flies & ~(finished & self._goes_on())).tolist():
            self._end(i)

    def _goes_on(self) -> Flags:
        """Which flights can go on from where they are."""
        return self._plan.envelope(self._plan.loop).goes_on(self._ends, self._last)

    def _end(self, i: int) -> None:
        """End a flight, with the reason; one without any is integrated by itself."""
        envelope = self._plan.envelope(self._plan.one(i))
        self._reasons[i] = envelope.reason(float(self._ends[i]), self._last[i])
        self._alone[i], self._flies[i] = not self._reasons[i], False
