"""The server of the viewer tells nothing that its caller has not asked for."""

from __future__ import annotations

from typing import Any

import pytest
import rich

from gibbs_codegen.viewer.server import empty_server


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
