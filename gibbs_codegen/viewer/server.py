"""viser's server on this machine."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import Any

import rich

from gibbs_codegen.runtime.load import require

# Where viser looks for a free port from.
PORT = 8080


@contextmanager
def empty_server(port: int = PORT, told: bool = False) -> Iterator[Any]:
    """A server with an empty scene, which only this machine can reach; it stops in the end.

    Args:
        port: The port; the next free one if another program has it.
        told: Whether viser may say where it is to be seen.

    Yields:
        viser's server.

    Raises:
        UsageError: viser is not installed.
    """
    require("viser", "the viewer", "viewer")
    import viser

    # It says so however quiet it is told to be.
    with nullcontext() if told else _silence():
        server = viser.ViserServer(host="127.0.0.1", port=port, verbose=False)
    # A button that would ask another machine.
    server.gui.configure_theme(show_share_button=False, show_logo=False)
    try:
        yield server
    finally:
        with _silence():
            server.stop()


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
    """Where a server is.

    Args:
        server: viser's server.

    Returns:
        The address for a browser.
    """
    return f"http://{server.get_host()}:{server.get_port()}"
