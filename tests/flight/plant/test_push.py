"""A force and a torque at any frame: against momentum and energy, and in both loops alike."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.parts import Push
from gibbs_codegen.flight.simulation import simulate

Load = Callable[[str], ModuleType]

FORCE, TORQUE = np.array([0.7, -0.4, 0.5]), np.array([0.02, 0.05, -0.03])
BEGIN, END = 0.1003, 0.3007  # Neither is on the grid of steps.


@pytest.fixture(scope="module")
def dual_arm(fast: Load) -> ModuleType:
    return fast("dual_arm")


def test_an_unknown_frame_is_refused_with_those_there_are(fast: Load) -> None:
    scenario = replace(read_scenario("hover"), push=Push(frame="hand\n"))
    message = r"push.frame: hexarotor_3link has no frame hand\\n; its frames: base, tip"
    with pytest.raises(UsageError, match=message):
        simulate(fast("hexarotor_3link"), scenario)
