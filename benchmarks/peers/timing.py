"""The timing loop of `harness.c`, which needs none of the peers."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from pathlib import Path

from peers.build import compiled

Timer = Callable[..., float]


def timer(folder: Path) -> Timer:
    """The timing loop of `harness.c`."""
    library = ctypes.CDLL(str(compiled("harness.c", folder / "harness.so")))
    pointer, count = ctypes.c_void_p, ctypes.c_long
    library.time_calls.restype = ctypes.c_double
    library.time_calls.argtypes = [pointer, count, count, *[pointer, count] * 3, pointer, pointer]
    return library.time_calls
