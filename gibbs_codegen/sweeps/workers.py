"""Processes of this machine that fly chunks: those of the standard library, made anew if one dies.

They start as new programs, without what the caller's program is made of: it may be a notebook, or a
script that would call `sweep` again if it were imported.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any

# How often a worker looks whether the program that it works for is still there, s.
_LOOK_SECONDS = 1.0


class Workers:
    """At most so many processes that compute calls."""

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool: ProcessPoolExecutor | None = None

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Have a call of a module's function computed."""
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(self.count, context, _begin, (os.getpid(),))
        with _without_main():
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
    """How many processors this program may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def _without_main() -> Iterator[None]:
    """Keep a process that starts meanwhile from importing the caller's main program."""
    main: dict[str, Any] = vars(sys.modules["__main__"])
    names: list[str] = [name for name in ("__spec__", "__file__") if name in main]
    held = {name: main.pop(name) for name in names}
    main["__spec__"] = None
    try:
        yield
    finally:
        main.update(held)


def _begin(parent: int) -> None:
    """What a worker does first: Ctrl-C is the caller's, without whom there is nothing to do.

    `parent` is the number of the caller's process.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_LOOK_SECONDS)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
