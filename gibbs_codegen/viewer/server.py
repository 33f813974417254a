"""viser's server on this machine."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from typing import Any

import rich

from gibbs_codegen.errors import UsageError
from gibbs_codegen.runtime.load import require

# Where a free port is looked for from, and the address that no other machine reaches.
PORT, _HOST = 8080, "127.0.0.1"
_LAST = 65535


@contextmanager
def empty_server(port: int = PORT, told: bool = False) -> Iterator[Any]:
    """A server with an empty scene, which listens on 127.0.0.1 only; it stops in the end.

    It gets the next free port if another program has `port`; `told` is whether viser may say where
    it is to be seen. Raises `UsageError` if viser is not installed, or there is no such port, or
    none is free from it on.
    """
    require("viser", "the viewer", "viewer")
    import viser

    port = _free_port(port)

    # It says so however quiet it is told to be.
    with nullcontext() if told else _silence():
        server = viser.ViserServer(host=_HOST, port=port, verbose=False)
    # A button that would ask another machine.
    server.gui.configure_theme(show_share_button=False, show_logo=False)
    try:
        yield server
    finally:
        with _silence():
            server.stop()


def _free_port(port: int) -> int:
    """The first port that is free; viser, which also looks for one, does so without an end."""
    if not 1 <= port <= _LAST:
        raise UsageError(f"port {port}: a port is a number from 1 to {_LAST}")
    for tried in range(port, _LAST + 1):
        with socket.socket() as bound, suppress(OSError):
            # As the server does; on Windows it would take ports that others have.
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, int(os.name == "posix"))
            bound.bind((_HOST, tried))
            return tried
    raise UsageError(f"port {port}: neither it nor one after it is free; give a smaller one")


@contextmanager
def _silence() -> Iterator[None]:
    """Let nothing be written to Rich's console, which in a notebook is no stream."""
    console = rich.get_console()
    quiet, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = quiet


def address(server: Any) -> str:
    """The address of viser's server for a browser."""
    return f"http://{server.get_host()}:{server.get_port()}"
