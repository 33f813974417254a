"""Frames led along paths by bases that lean: against poses and wrenches of the module itself."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import qmc

from gibbs_codegen import simulate
from gibbs_codegen.errors import ScenarioFileError, UsageError
from gibbs_codegen.flight.desired.trajectory import desired_motion
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.vectors import halton

Load = Callable[[str], ModuleType]

# Eq. 21, along which the thrust goes from a fifth of the weight to nearly twice the weight.
STEEP = {
    "kind": "harmonic",
    "x": [{"amplitude": 2, "frequency": 1, "phase_deg": -90}],
    "z": [{"amplitude": -2, "frequency": 2, "phase_deg": -90}],
}


def beside(*position: float) -> dict[str, Any]:
    return {"tip_beside_base": {"kind": "fixed", "position": position}}


def hands(left: dict[str, Any], right: dict[str, Any]) -> dict[str, Any]:
    return {"frames": {"left_hand": left, "right_hand": right}}


HELD = {"kind": "fixed", "position": [0.25, -0.15, 1.65]}
ROUND = {"kind": "circle", "centre": [0.25, 0.15, 1.65], "radius": 0.08, "period": 3}
BELOW = {"path": {"kind": "fixed", "position": [0, 0, 2]}}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "scenario", "base", "arm"),
    [
        pytest.param(
            *("quadrotor_arm_2link", "hover", {"path": STEEP}, beside(0.1, 0, -0.25)),
            marks=pytest.mark.slow,
        )
    ],
)
def test_frames_keep_to_their_paths_without_lateral_force(
    robot: str, scenario: str, base: dict[str, Any], arm: dict[str, Any], fast: Load
) -> None:
    """The desired motion between knots too, within limits of joints, and the flight along it."""
    wanted = read_scenario(scenario, {"base": base, "arm": arm, "duration": 4.0})
    vehicle = Vehicle(fast(robot))
    time = np.linspace(0.0, 4.0, 3001)
    q, v, a = desired_motion(vehicle, wanted)(time)
    for name, path in wanted.arm.paths.items():
        led = vehicle.frame_poses(q)[:, vehicle.frames.index(name), :3, 3]
        assert np.linalg.norm(led - path(time)[:, 0], axis=-1).max() < 1e-6
    wrench = vehicle.base_wrench(q, vehicle.inverse_dynamics(q, v, a))
    assert np.abs(wrench[:, :2]).max() < 1e-3 * wrench[:, 2].mean()
    flight = simulate(fast(robot), wanted)
    assert not flight.stopped
    for name, path in wanted.arm.paths.items():
        off = np.linalg.norm(flight.point(name) - path(flight.time)[:, 0], axis=-1)
        assert np.sqrt(np.mean(off**2)) < 1e-4
    low, high = flight.joint_limits
    joints = flight.q[:, flight.layout.q.joints]
    assert np.all((low < joints) & (joints < high))


@pytest.mark.parametrize(
    ("robot", "arm", "message"),
    [
        ("quadrotor_arm_2link", {"frames": {"tipp": ROUND}}, "arm.frames.tipp: .* mean tip"),
        ("dual_arm", {"frames": {"base": ROUND}}, "arm.frames.base: no joint"),
        ("hexarotor_3link", {"frames": {"tip": ROUND}}, "only robots whose base leans"),
    ],
)
def test_frames_that_cannot_be_led_are_refused(
    robot: str, arm: dict[str, Any], message: str, fast: Load
) -> None:
    with pytest.raises(UsageError, match=message):
        desired_motion(Vehicle(fast(robot)), read_scenario("hover", {"arm": arm, "duration": 1.0}))


def test_a_tip_has_one_path() -> None:
    with pytest.raises(ScenarioFileError, match="already has its path"):
        read_scenario("paper", {"arm": {"frames": {"tip": HELD}}})


def test_points_are_those_of_haltons_sequence() -> None:
    theirs = qmc.Halton(40, scramble=False).random(50)
    assert_allclose(halton(50, 40), theirs, atol=1e-15)
