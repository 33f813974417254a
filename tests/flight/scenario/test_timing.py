"""The timing of a scenario: what is read, what is refused, and paths by another clock."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.differences import rate

from gibbs_codegen.errors import ScenarioFileError, UsageError
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.orientation import Level, Turn
from gibbs_codegen.flight.scenario.parts import Timing
from gibbs_codegen.flight.scenario.paths import Array, Circle
from gibbs_codegen.flight.scenario.scenario import ScaledPath, slow_motion


def read(table: dict[str, Any]) -> Timing:
    return read_scenario("line", {"timing": table}).timing


def test_every_key_is_read() -> None:
    assert read_scenario("line").timing == Timing()
    table = {
        "law": "fastest",
        "limits": [-1, 5],
        "thrust_rate": 100,
        "effort": {"theta_8": 2},
        "velocity": {"theta_9": 3},
    }
    assert read(table) == Timing("fastest", (-1, 5), 100, {"theta_8": 2}, {"theta_9": 3})


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"law": "quickest"}, "timing.law: must be one of 'uniform', 'fastest', not 'quickest'"),
        ({"limits": [0, 1]}, 'timing.limits: is a limit of the law "fastest"'),
        ({"law": "fastest", "limits": [1, 0]}, "the least thrust must be below the greatest"),
        ({"law": "fastest", "thrust_rate": 0}, "timing.thrust_rate: must be at least 1e-09"),
        ({"law": "fastest", "effort": {"theta_8": -1}}, "timing.effort.theta_8: must be at least"),
        ({"law": "fastest", "velocity": {"a b": 1}}, "must be the name of a joint"),
        ({"law": "fastest", "rate": 1}, "timing.rate: unknown key; did you mean thrust_rate?"),
    ],
)
def test_what_is_wrong_is_told(table: dict[str, Any], words: str) -> None:
    with pytest.raises(ScenarioFileError) as caught:
        read(table)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    "values",
    [
        {"law": "quickest"},
        {"law": "fastest", "limits": (1.0, 0.0)},
        {"law": "fastest", "limits": (1.0,)},
        {"law": "fastest", "thrust_rate": 0.0},
        {"law": "fastest", "effort": {"theta_8": 0.0}},
        {"law": "fastest", "velocity": {"theta_8": -1.0}},
        {"law": "uniform", "limits": (0.0, 1.0)},
    ],
)
def test_python_is_told_too(values: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match=r"Timing\."):
        Timing(**values)


def test_derivatives_by_another_clock() -> None:
    def clock(time: Array) -> Array:
        return np.stack(
            [
                time + 0.3 * np.sin(time),
                1.0 + 0.3 * np.cos(time),
                -0.3 * np.sin(time),
                -0.3 * np.cos(time),
            ],
            axis=-1,
        )

    path = ScaledPath(Circle((1, 2, 3), 2.0, 5.0, (1, 0, 1)), clock)
    time = np.linspace(0.3, 6.0, 9)
    exact = path(time)
    for order in range(3):
        found = rate(lambda t, k=order: path(t)[:, k], time)
        assert_allclose(found, exact[:, order + 1], rtol=1e-9, atol=1e-9)
    assert path(0.5).shape == (4, 3)


def test_a_stretched_scenario_is_the_same_later() -> None:
    attitude = {"kind": "turn", "axis": [0, 0, 1], "angle_deg": 90, "begin": 1, "duration": 3}
    scenario = read_scenario("line", {"base": {"attitude": attitude}})
    slower = slow_motion(scenario, 2.0)
    time = np.linspace(0.0, 8.0, 17)
    assert slower.duration == 16.0
    assert_allclose(slower.base(2.0 * time)[:, 0], scenario.base(time)[:, 0])
    assert_allclose(slower.base(2.0 * time)[:, 1], scenario.base(time)[:, 1] / 2.0)
    assert isinstance(slower.attitude, Turn)
    turns = [s.attitude(s.base, f * time, np.zeros(0)) for s, f in ((scenario, 1), (slower, 2))]
    assert_allclose(turns[1].rotation, turns[0].rotation, atol=1e-12)
    assert_allclose(2.0 * turns[1].velocity, turns[0].velocity, atol=1e-12)
    level = slow_motion(read_scenario("line", {"base": {"attitude": {"rate_deg": 90}}}), 2.0)
    assert level.attitude == Level(0.0, np.pi / 4)
