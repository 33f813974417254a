"""What tests of sweeps share: a robot's module, compiled before processes want it."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def robot(shipped, fast):
    """Folder of the module of a robot with three links, which is compiled."""
    fast("hexarotor_3link")
    return str(Path(shipped("hexarotor_3link").__file__).parent)
