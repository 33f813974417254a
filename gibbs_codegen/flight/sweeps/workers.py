"""Processes of this machine that compute calls.

They start as new programs, without what the caller's program is made of: it may be a notebook, or a
script that would do again what it does if it were imported.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent import futures
from contextlib import contextmanager
from typing import Any


class Workers:
    """At most so many processes that compute calls.

    If modules are to be imported `ahead`, one process does so from now on, of which the workers are
    copies: POSIX alone has that.
    """

    def __init__(self, count: int, ahead: Sequence[str] = ()) -> None:
        self.count = count
        self._context = multiprocessing.get_context("forkserver" if ahead else "spawn")
        self._pool: futures.ProcessPoolExecutor | None = None
        if ahead:
            from multiprocessing.forkserver import ensure_running  # Late: Windows has none.

            self._context.set_forkserver_preload([*ahead])
            with _without_main(), _uninterrupted():
                ensure_running()

    def submit(self, function: Callable[..., Any], *arguments: Any) -> futures.Future[Any]:
        """Have a call of a module's function computed."""
        if self._pool is None:
            self._pool = futures.ProcessPoolExecutor(self.count, self._context, _begin)
        with _without_main(), _uninterrupted():
            return self._pool.submit(function, *arguments)

    def end(self) -> None:
        """End the processes, whatever they are at; the next call starts new ones."""
        pool, self._pool = self._pool, None
        if pool is not None:
            processes = list((pool._processes or {}).values())
            pool.shutdown(wait=False, cancel_futures=True)
            for process in processes:
                process.kill()
            for process in processes:
                process.join()


def own_count() -> int:
    """The number of processors that this program may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def _without_main() -> Iterator[None]:
    """Keep a process that starts meanwhile from importing the caller's main program."""
    main: dict[str, Any] = vars(sys.modules["__main__"])
    names: list[str] = [name for name in ("__spec__", "__file__") if name in main]
    removed = {name: main.pop(name) for name in names}
    main["__spec__"] = None
    try:
        yield
    finally:
        main.update(removed)


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Put Ctrl-C off, also for a process that starts meanwhile, until that has begun."""
    if sys.platform == "win32":  # It has no masks of signals.
        yield
    else:
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin() -> None:
    """The start of a worker: Ctrl-C is the caller's, without whom there is nothing to do."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        if caller := multiprocessing.parent_process():
            caller.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
