"""The lock of a folder of modules: processes that write there take turns."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from gibbs_codegen.errors import OutputError, printable

# Writing a module takes moments.
_NOTICE_SECONDS = 2.0
_PATIENCE_SECONDS = 60.0

_log = logging.getLogger("gibbs_codegen")


@contextmanager
def alone_in(folder: Path, held: Sequence[int] = ()) -> Iterator[None]:
    """Keep other processes that write modules into a folder waiting, where it can be locked.

    Between two renames a module is not there, which is not for others to see. A lock that is held
    for a minute, longer than many that take turns need, ends in an `OutputError`. The first of the
    signals `held`, which have come, ends the waiting.
    """
    from filelock import unlock_descriptor  # Late, as a lock is needed by few commands.

    number = None
    with suppress(OSError):  # Windows opens no folders.
        number = os.open(folder, os.O_RDONLY)
    if number is None:
        yield
        return
    try:
        _wait_for_lock(number, folder, held)
        yield
    finally:
        # Closing is not enough where a child that was forked meanwhile has it open too.
        with suppress(OSError):
            unlock_descriptor(number)
        os.close(number)


def _wait_for_lock(number: int, folder: Path, held: Sequence[int]) -> None:
    """Wait for a lock of an open folder, by its descriptor, and say so if it takes long.

    The first of the signals `held`, which have come, ends it. Raises `OutputError` after a minute.
    """
    from filelock import lock_descriptor

    begin, said = time.monotonic(), False
    while not held:
        try:
            if lock_descriptor(number, blocking=False):
                return
        except OSError:  # Not every file system has locks; a module is written whole without.
            return
        waited = time.monotonic() - begin
        if waited > _PATIENCE_SECONDS:
            raise OutputError(
                f"{printable(folder)}: {_holder(number)} has held the lock of this folder for "
                f"{_PATIENCE_SECONDS:.0f} s, as one does that writes a module there; wait until it "
                "ends, or end it, or choose another --out; nothing was changed"
            )
        if waited > _NOTICE_SECONDS and not said:
            _log.warning("%s: waiting for %s to let go", printable(folder), _holder(number))
            said = True
        time.sleep(0.01)


def _holder(number: int) -> str:
    """What holds the lock of an open folder, as far as the system tells."""
    inode = os.fstat(number).st_ino
    with suppress(OSError, ValueError):
        for line in Path("/proc/locks").read_text(encoding="ascii").splitlines():
            _, kind, _, _, process, place, *_ = line.split()
            if kind == "FLOCK" and place.endswith(f":{inode}") and int(process) > 0:
                return f"process {process}"
    return "another process"
