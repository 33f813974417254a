"""viser's server on this machine."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from typing import Any

from gibbs_codegen.errors import UsageError

# Where viser looks for a free port from.
PORT = 8080


@contextmanager
def empty_server(port: int = PORT) -> Iterator[Any]:
    """A server with an empty scene, which only this machine can reach; it stops in the end.

    Args:
        port: The port; the next free one if another program has it.

    Yields:
        viser's server.

    Raises:
        UsageError: viser is not installed.
    """
    try:
        import viser
    except ModuleNotFoundError as error:
        if error.name != "viser":
            raise
        raise UsageError(
            "the viewer: the package viser is not installed; "
            "install it with: pip install 'gibbs_codegen[viewer]'"
        ) from None
    # What it says of itself, however quiet it is told to be, is for the caller to say.
    with redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host="127.0.0.1", port=port, verbose=False)
    try:
        yield server
    finally:
        with redirect_stdout(io.StringIO()):
            server.stop()
