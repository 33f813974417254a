"""Processes of this machine that compute calls.

As a rule they start as new programs, without what the caller's program is made of: it may be a
notebook, or a script that would do again what it does if it were imported.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from concurrent import futures
from contextlib import contextmanager
from typing import Any

# How Python, and JAX, warn of copies of a process that has threads.
_OF_THREADS = r"This process \(pid=\d+\) is multi-threaded|os\.fork\(\) was called"


class Workers:
    """At most so many processes that compute calls.

    By the method "fork" they are copies of this process, which take no time to begin. No other
    thread of Python may run then, and POSIX alone has them.
    """

    def __init__(self, count: int, method: str = "spawn") -> None:
        self.count, self._method = count, method
        self._pool: futures.ProcessPoolExecutor | None = None

    def submit(self, function: Callable[..., Any], *arguments: Any) -> futures.Future[Any]:
        """Have a call of a module's function computed."""
        if self._pool is None:
            context = multiprocessing.get_context(self._method)
            self._pool = futures.ProcessPoolExecutor(self.count, context, _begin)
        with _without_main(), _uninterrupted(), warnings.catch_warnings():
            # Libraries may run threads when a process is copied; the copy keeps these filters.
            warnings.filterwarnings("ignore", _OF_THREADS)
            return self._pool.submit(function, *arguments)

    def end(self) -> None:
        """End the processes, whatever they are at; the next call starts new ones."""
        pool, self._pool = self._pool, None
        if pool is not None:
            processes = list((pool._processes or {}).values())
            manager: Any = pool._executor_manager_thread  # A thread, which stubs do not know.
            pool.shutdown(wait=False, cancel_futures=True)
            for process in processes:
                process.kill()
            # It waits for the processes; where two threads wait for one, one of them may go on
            # before that process counts as ended.
            if manager is not None:
                manager.join()


def own_count() -> int:
    """The number of processors that this program may use."""
    if hasattr(os, "sched_getaffinity"):
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
