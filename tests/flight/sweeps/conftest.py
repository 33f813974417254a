"""What tests of sweeps share: a robot's module, compiled in half the time in every process."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture
def robot(shipped, fast, monkeypatch):
    """Folder of the module of a robot with three links, which is compiled."""
    monkeypatch.setenv("CC", f"{os.environ.get('CC') or 'cc'} -O1")
    fast("hexarotor_3link")
    return str(Path(shipped("hexarotor_3link").__file__).parent)
