"""Chunks of a sweep on an executor, until each is in the store.

A chunk whose worker dies is tried again. If it dies again it is flown by itself, in a process of
this machine, and halved until the one case is found that no process survives, which is recorded. So
no case is blamed for what another did.

Without an executor processes of this machine fly chunks, as of `workers`, made anew if one dies.
"""

from __future__ import annotations

import logging
import math
import pickle
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent import futures
from dataclasses import replace

from gibbs_codegen.errors import GibbsCodegenError, UsageError, printable
from gibbs_codegen.flight.sweeps.chunks import Chunk, ResultFile, Row, fly
from gibbs_codegen.flight.sweeps.measures import Measure, packed
from gibbs_codegen.flight.sweeps.workers import Workers

# How often the process of a chunk may die before the chunk is flown by itself, and of one case by
# itself before it is given up.
_DEATHS = 2
# So many chunks in a row that die are the fault of the executor.
_MOST_IN_A_ROW = 20
# Chunks that are with an executor at a time, of which it is not known how many workers it has.
_MANY = 1000
# Errors raised because nothing can be computed there, not because a worker died.
_NOT_THERE = (ImportError, AttributeError, NameError, TypeError, pickle.PickleError)
# Errors of calls whose process dies.
_BROKEN = (futures.BrokenExecutor, futures.CancelledError)
_DEAD = "the process that flew it died in every attempt, from a crash or lack of memory"

_KEPT = "finished flights are kept; repeat the call with a working executor to continue"

_log = logging.getLogger("gibbs_codegen")


class Execution:
    """The run of a sweep, whose cases have `digests` by their numbers.

    `executor` computes, or if None so many processes of this machine; `tell` is called with the
    number of further cases done.
    """

    def __init__(
        self,
        measures: Mapping[str, Measure],
        digests: Sequence[str],
        store: ResultFile,
        executor: futures.Executor | None,
        workers: int,
        tell: Callable[[int], None],
    ) -> None:
        self._digests, self._store, self._tell = digests, store, tell
        self._measures, self._count = packed(measures), len(measures)
        self._workers, self._executor = Workers(workers), executor
        count = getattr(executor, "_max_workers", None) if executor else workers
        self._window = 2 * count if isinstance(count, int) else _MANY
        self._in_a_row = 0

    def run(self, chunks: Sequence[Chunk]) -> None:
        """Fly chunks, and keep them; `GibbsCodegenError` if nothing can be computed, or kept."""
        try:
            suspects = self._on_all_workers(deque(chunks))
            self._workers.end()
            self._executor = None  # It may not blame others for what one case does.
            for chunk in suspects:
                self._isolate(chunk)
        finally:
            self._workers.end()

    def _on_all_workers(self, waiting: deque[Chunk]) -> list[Chunk]:
        """Fly chunks on all workers; return those that died too often."""
        running: dict[futures.Future[list[Row]], Chunk] = {}
        suspects: list[Chunk] = []
        try:
            while waiting or running:
                while waiting and len(running) < self._window:
                    chunk = waiting.popleft()
                    running[self._submit(chunk)] = chunk
                for future in futures.wait(running, return_when=futures.FIRST_COMPLETED).done:
                    left = self._left(future, running.pop(future))
                    if len(left):
                        (waiting if left.deaths < _DEATHS else suspects).append(left)
        finally:
            for future in running:
                future.cancel()
        return suspects

    def _submit(self, chunk: Chunk) -> futures.Future[list[Row]]:
        """Have a chunk flown; a pool that is broken answers like one that breaks."""
        try:
            return (self._executor or self._workers).submit(fly, chunk.task(self._measures))
        except futures.BrokenExecutor as error:
            broken: futures.Future[list[Row]] = futures.Future()
            broken.set_exception(error)
            return broken
        except RuntimeError as error:  # So do executors of any kind refuse after they were ended.
            raise UsageError(f"the executor accepts no work: {printable(error)}; {_KEPT}") from None

    def _left(self, future: futures.Future[list[Row]], chunk: Chunk) -> Chunk:
        """The rest of a chunk once the flights that were done are kept; all if it died.

        Raises `GibbsCodegenError` if nothing can be computed, or kept.
        """
        try:
            rows = future.result()
        except _NOT_THERE as error:
            raise _cannot_fly(error) from None
        except GibbsCodegenError:
            raise
        except (Exception, futures.CancelledError) as error:  # Every executor has words of its own.
            if self._executor is None and not isinstance(error, _BROKEN):
                raise _cannot_fly(error) from None
            self._in_a_row += 1
            _log.info("a worker died: %s", printable(f"{type(error).__name__}: {error}"))
            if self._executor is None:
                self._workers.end()
            elif self._in_a_row > _MOST_IN_A_ROW:
                raise UsageError(
                    f"the executor has failed {self._in_a_row} times in a row, the last time with "
                    f"{type(error).__name__}: {printable(error)}; {_KEPT}"
                ) from None
            return replace(chunk, deaths=chunk.deaths + 1)
        self._in_a_row = 0
        return self._keep(chunk, rows)

    def _keep(self, chunk: Chunk, rows: Sequence[Row]) -> Chunk:
        """Keep the first rows of a chunk, and return the rest of it."""
        self._store.add([self._digests[place] for place in chunk.cases[: len(rows)]], rows)
        self._tell(len(rows))
        return chunk.after(len(rows))

    def _isolate(self, chunk: Chunk) -> None:
        """Fly a chunk with nothing beside it; of one that dies what is left is halved.

        Raises as `_left` does.
        """
        is_one = len(chunk) == 1
        most = chunk.deaths + (_DEATHS if is_one else 1)
        while len(chunk) and chunk.deaths < most:
            chunk = self._left(self._submit(chunk), chunk)
        if is_one and len(chunk):
            self._keep(chunk, [([math.nan] * self._count, "", _DEAD, "")])
        elif len(chunk):
            for half in chunk.halves():
                self._isolate(half)


def _cannot_fly(error: Exception) -> UsageError:
    """The error where a worker lives, and cannot compute."""
    words = printable(f"{type(error).__name__}: {error}", 400)
    return UsageError(f"a worker cannot fly: {words}")
