"""The server of the viewer tells nothing that its caller has not asked for."""

from __future__ import annotations

import socket
from typing import Any

import pytest
import rich

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.viewer.page import address, empty_server


@pytest.mark.parametrize("notebook", [False, True])
def test_the_server_is_silent(
    notebook: bool, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a notebook Rich hands what it prints to IPython, and not to a stream."""
    shown: list[Any] = []
    monkeypatch.setattr("rich.jupyter.display", lambda *parts: shown.append(parts))
    monkeypatch.setattr(rich.get_console(), "is_jupyter", notebook)
    with empty_server():
        rich.print("between")
    assert "viser" not in str(shown) + capfd.readouterr().out
    assert not rich.get_console().quiet


@pytest.mark.parametrize("port", [-1, 0, 65536, 70000])
def test_a_port_that_does_not_exist_is_refused(port: int) -> None:
    with pytest.raises(UsageError, match="number from 1 to 65535"), empty_server(port):
        pass


def test_a_taken_port_is_passed_by_and_the_last_one_refused() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with empty_server(port) as server:
            assert int(address(server).rpartition(":")[2]) > port
    with socket.socket() as last:
        try:
            last.bind(("127.0.0.1", 65535))
            last.listen()
        except OSError:
            pass  # Somebody has it, which does as well.
        with pytest.raises(UsageError, match="port 65535: this port and all"), empty_server(65535):
            pass
