"""Long calls cut into pieces, for some of the states and steps each, on one or more threads."""

from __future__ import annotations

import functools
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import wait
from dataclasses import dataclass

from gibbs_codegen.runtime.compiled_function import Pool

# States that a piece has, or a multiple: of those in a block, in either precision.
_STATES = 16
# Steps of single states in the first piece; later ones have as many as take the time of a call.
_FIRST = 16_384
_CALL_SECONDS = 0.05
# With fewer for each, further threads are not worth waking.
_LEAST = 65_536
_WAIT_SECONDS = 0.1


@dataclass(frozen=True)
class Piece:
    """Steps from `begin` to before `end`, of `count` states from `first` on."""

    first: int
    count: int
    begin: int
    end: int


def take_pieces(
    call: Callable[[Piece], None],
    count: int,
    steps: int,
    threads: int,
    progress: Callable[[float], None],
) -> None:
    """Call a function for all steps of all states, in pieces, those of one state in order.

    Threads call it at once for different states. `progress` is told between calls, in this thread,
    the share of all that is done, 0 to 1; what it raises ends the work.
    """
    threads = max(1, min(threads, count * steps // _LEAST))
    pieces = _Pieces(count, steps, threads)
    if threads == 1:
        for _ in pieces.taken(call):
            progress(pieces.share)
        return
    futures = [_pool(threads).executor().submit(pieces.take, call) for _ in range(threads)]
    try:
        while wait(futures, _WAIT_SECONDS).not_done:
            progress(pieces.share)
    finally:
        pieces.given_up = True
        wait(futures)
    for future in futures:
        future.result()
    progress(1.0)


class _Pieces:
    """States that wait for a thread, and how much is done."""

    def __init__(self, count: int, steps: int, threads: int) -> None:
        self._count, self._steps, self._threads = count, steps, threads
        self._lock = threading.Lock()
        self._first = self._done = 0
        self.given_up = False

    @property
    def share(self) -> float:
        """Share of the steps that is taken, 0 to 1."""
        return self._done / (self._count * self._steps)

    def take(self, call: Callable[[Piece], None]) -> None:
        """Take pieces until none are left, or the work is given up."""
        for _ in self.taken(call):
            if self.given_up:
                return

    def taken(self, call: Callable[[Piece], None]) -> Iterator[None]:
        """Take pieces until none are left, and stop after each of them."""
        size = _FIRST
        while (states := self._some_states(size)).count > 0:
            begin = 0
            while begin < self._steps:
                # States are rounded up to whole blocks, and take all their steps even so.
                end = min(self._steps, begin + max(1, 2 * size // states.count))
                started = time.perf_counter()
                call(Piece(states.first, states.count, begin, end))
                seconds = time.perf_counter() - started
                size = max(1, int(size * min(4.0, _CALL_SECONDS / max(seconds, 1e-9))))
                with self._lock:
                    self._done += (end - begin) * states.count
                begin = end
                yield

    def _some_states(self, size: int) -> Piece:
        """All steps of states that follow those taken already, about `size` steps of single states.

        No states are left where their number is 0.
        """
        with self._lock:
            left = self._count - self._first
            fair = left if self._threads == 1 else -(-left // (2 * self._threads))
            blocks = max(1, -(-min(size // self._steps, fair) // _STATES))
            piece = Piece(self._first, min(left, blocks * _STATES), 0, self._steps)
            self._first += piece.count
        return piece


@functools.cache
def _pool(threads: int) -> Pool:
    return Pool(threads)
