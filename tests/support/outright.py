"""Killing outright: a process at every step it takes on the file system, or at random moments.

For programs that tests start: they fork, so that what is worked with is imported once.
"""

from __future__ import annotations

import itertools
import os
import random
import signal
import sys
import time
from collections.abc import Callable, Iterator

STEPS = ("open", "os.", "shutil.", "tempfile.", "fcntl.")


def killed_at_every_step(work: Callable[[], object]) -> Iterator[int]:
    """Fork a child for each step of `work`, kill it before it is taken, and yield its number.

    The caller looks at what is left and clears it away. Ends with a child that came to its end.
    """
    for step in itertools.count():
        status = _status(_started(work, step))
        if status == 0:
            return
        assert status == signal.SIGKILL, f"step {step}: status {status}"
        yield step


def killed_at_random(work: Callable[[], object], count: int, seed: int) -> Iterator[bool]:
    """Fork `count` children, kill each at a random moment, and yield whether it was at work.

    The first yield follows a child that was left alone: from it is known how long the work takes.
    A third of the moments are towards the end.
    """
    start = time.perf_counter()
    assert _status(_started(work)) == 0
    whole = time.perf_counter() - start
    yield False
    draw = random.Random(seed)  # noqa: S311
    for number in range(count):
        child = _started(work)
        time.sleep(whole * draw.uniform(0.7 if number % 3 == 0 else 0.02, 1.0))
        os.kill(child, signal.SIGKILL)
        status = _status(child)
        assert status in (0, signal.SIGKILL), f"status {status}"
        if status == 0:
            whole *= 0.9  # The machine has less to do now.
        yield status != 0


def _started(work: Callable[[], object], last: int | None = None) -> int:
    child = os.fork()
    if child == 0:
        if last is not None:
            _die_at(last)
        work()
        os._exit(0)
    return child


def _status(child: int) -> int:
    return os.waitpid(child, 0)[1]


def _die_at(step: int) -> None:
    """Python tells of each step before it is taken."""
    left = itertools.count(step, -1)

    def hook(event: str, _: object) -> None:
        if event.startswith(STEPS) and next(left) == 0:
            os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(hook)
