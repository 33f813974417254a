"""Limits and lag of motors and joints: those of the robot file where the scenario is silent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from support.actuated import TEXT

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.plant.actuators import actuators_of, joint_place
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.parts import Settings
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.simulation import simulate
from gibbs_codegen.flight.sweeps.sources import robot_data
from gibbs_codegen.pipeline import generate
from gibbs_codegen.runtime.load import load

pytestmark = pytest.mark.usefixtures("derived_once")

Load = Callable[[str], ModuleType]

JOINTS = [f"flying_arm_5__j_{a}" for a in ("base_link_link_1", "link_1_link_2")]
RK4 = Settings(method="rk4", step=0.002)
ROBOT = """
name = "mixed"
[base]
mass = 2.0
inertia = [0.02, 0.03, 0.04, 0, 0, 0]
attitude = "quaternion"
[[rotor]]
position = [0.3, 0, 0]
limits = [-1, 12]
drag = 0.02
spin_inertia = 1e-4
speed_per_sqrt_thrust = 300
[[rotor]]
position = [-0.3, 0, 0]
drag = -0.02
time_constant = 0.05
[[link]]
xyz = [0, 0, -0.1]
axis = "y"
mass = 0.2
com = [0, 0, -0.1]
inertia = [0.001, 0.001, 0.001, 0, 0, 0]
limits_deg = [-90, 30]
velocity = 2.5
[[link]]
joint = "fixed"
xyz = [0, 0, -0.2]
mass = 0.1
inertia = [0.001, 0.001, 0.001, 0, 0, 0]
[[link]]
joint = "prismatic"
xyz = [0, 0, -0.1]
mass = 0.1
inertia = [0.001, 0.001, 0.001, 0, 0, 0]
limits = [0, inf]
effort = 3
[[frame]]
name = "hand"
on = "link3"
"""


@pytest.fixture(scope="module")
def folders(shipped: Load, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Folders of the modules of a robot with some limits, and of one that ships with all."""
    folder = tmp_path_factory.mktemp("limits")
    (folder / "mixed.toml").write_text(ROBOT, encoding="utf-8")
    return {
        "mixed": generate(folder / "mixed.toml", folder, verify=False),
        "hextilt": Path(str(shipped("hextilt_flying_arm_5").__file__)).parent,
    }


def hover(**changes: Any) -> Scenario:
    return read_scenario("hover", {"duration": 0.5, **changes})


@pytest.mark.slow
def test_the_robot_file_tells_what_the_scenario_does_not(folders: dict[str, Path]) -> None:
    """Fixed links have no entry, and what is not given is not limited."""
    vehicle, inf = Vehicle(load(folders["mixed"], "numpy")), np.inf
    found = actuators_of(vehicle, hover())
    assert found.thrusts.tolist() == [[-1, -inf], [12, inf]]
    assert found.lag.tolist() == [0, 0.05]
    assert found.joints[:, 0] == pytest.approx([-np.pi / 2, np.pi / 6], rel=1e-15)
    assert found.joints[:, 1].tolist() == [0, inf]
    assert found.efforts.tolist() == [inf, 3]
    assert found.velocities.tolist() == [2.5, inf]
    # A rotor with a positive drag spins clockwise, seen from the tip of its thrust.
    assert found.spins == pytest.approx([-0.03, 0.0])
    assert found.inputs.tolist() == [[-1, -inf, -inf, -3], [12, inf, inf, 3]]


def test_the_scenario_overrides_the_robot_file(folders: dict[str, Path]) -> None:
    """Thrusts and lag of all motors at once, joints one by one."""
    vehicle = Vehicle(load(folders["mixed"]))
    turning, sliding = vehicle.joint_names
    arm = {
        "limits_deg": {turning: [-10, 10]},
        "effort": {turning: 4},
        "velocity": {sliding: 0.1},
    }
    found = actuators_of(vehicle, hover(arm=arm, motors={"limits": [0, 9], "time_constant": 0}))
    assert found.thrusts.tolist() == [[0, 0], [9, 9]]
    assert found.lag.tolist() == [0, 0]
    assert found.joints[:, 0] == pytest.approx(np.radians([-10, 10]))
    assert found.joints[:, 1].tolist() == [0, np.inf]
    assert found.efforts.tolist() == [4, 3]
    assert found.velocities.tolist() == [2.5, 0.1]
    arm = {"effort": {"elbow": 1}, "velocity": {"wrist": 1}}
    words = (
        r"arm\.effort\.elbow: mixed has no joint elbow; its .*\narm\.velocity\.wrist: mixed has "
    )
    with pytest.raises(UsageError, match=words):
        actuators_of(vehicle, hover(arm=arm))


def test_a_link_that_a_gear_moves_is_not_called_unknown(tmp_path: Path) -> None:
    path = tmp_path / "actuated.toml"
    geared = '[[link]]\nname = "jaw"\nxyz = [0, 0, 0]\nmass = 0.1\ninertia = [1, 1, 1, 0, 0, 0]\n'
    path.write_text(f'{TEXT}{geared}gear = {{ of = "upper", ratio = 1 }}\n', encoding="utf-8")
    with pytest.raises(UsageError, match="no joint jaw: that link moves by a gear, or its joint"):
        joint_place(robot_data(path), "jaw")


def test_thrusts_that_no_command_makes_are_no_limits(tmp_path: Path) -> None:
    """Of throttles and speeds: the least of one rotor is 0.11 N, the greatest of others 9 N."""
    path = tmp_path / "actuated.toml"
    path.write_text(TEXT, encoding="utf-8")
    robot = robot_data(path)
    found = actuators_of(robot, hover(motors={"limits": [0.11, 9]}))
    assert found.thrusts.tolist() == [[0.11] * 4, [9] * 4]
    for limits in ((0.11, 30), (0, 9)):
        with pytest.raises(UsageError, match=r"the rotors of actuated .* 0\.11 to 9 N; give"):
            actuators_of(robot, hover(motors={"limits": limits}))
    # 1.2e-5 (1000)² − 2e-4 (1000) + 0.01 N is more than 9 N.
    path.write_text(TEXT.replace("[100, 900]", "[1000, 1200]"), encoding="utf-8")
    with pytest.raises(UsageError, match=r"one makes at least 11\.81 N and one at most 9 N; leave"):
        actuators_of(robot_data(path), hover(motors={"limits": (9, 12)}))


def test_a_module_that_does_not_say_its_limits_is_to_be_generated_again(
    folders: dict[str, Path],
) -> None:
    module = load(folders["mixed"])
    del module.INPUT_LIMITS
    with pytest.raises(UsageError, match=r"mixed: has no INPUT_LIMITS, .* generate it again"):
        actuators_of(Vehicle(module), hover())


@pytest.mark.slow
def test_joints_give_no_more_than_their_effort(folders: dict[str, Path]) -> None:
    """A start that is off asks for more than the limits of the robot file."""
    method = "rk4"
    module = load(folders["hextilt"], "c")
    start = {"offset": [0.15, 0.1, -0.1]}
    scenario = hover(start=start, integration={"method": method, "step": 0.002})
    arm = {"effort": dict.fromkeys(Vehicle(module).joint_names, 0.05)}
    weak = hover(start=start, arm=arm, integration={"method": method, "step": 0.002})
    flights = [simulate(module, each) for each in (scenario, replace(weak, duration=0.2))]
    for flight, most in zip(flights, ([1, 1, 0.3, 0.3, 0.3], [0.05] * 5), strict=True):
        asked, given = (np.abs(inputs[:, 6:]) for inputs in (flight.commanded, flight.applied))
        assert np.all(given <= most)
        assert np.array_equal(given, np.minimum(asked, most))
        assert np.abs(flight.energy_error).max() < 1e-4
    assert np.any(np.abs(flights[1].commanded[:, 6:]) > 0.05)
    assert np.min(flights[0].applied[:, :6]) >= 0.0854858


@pytest.mark.slow
def test_only_motors_with_a_time_constant_lag(folders: dict[str, Path]) -> None:
    """In open loop, along a path on which the thrusts change."""
    path = {"kind": "line", "start": [0, 0, 2], "end": [0, 0, 2.5], "duration": 0.5}
    finely = {"rate": 1000}
    control = {"control": {"law": "open_loop"}, "motors": {"compensation": False}}
    scenario = hover(**control, base={"path": path}, integration=finely)
    arm = {"limits_deg": {Vehicle(load(folders["mixed"])).joint_names[0]: [-90, 90]}}
    scenario = replace(scenario, arm=hover(arm=arm).arm)
    flight = simulate(load(folders["mixed"], "c"), scenario)
    late = flight.commanded[:, :2] - flight.applied[:, :2]
    assert np.ptp(flight.commanded[:, 0]) > 1.0
    assert not np.any(late[:, 0])
    assert late[0, 1] == 0.0
    assert np.abs(late[:, 1]).max() > 0.1
    # ds/dt = (commanded - s) / time constant, by central differences
    s, time = flight.applied[:, 1], flight.time
    rate = (s[2:] - s[:-2]) / (time[2:] - time[:-2])
    assert rate == pytest.approx(late[1:-1, 1] / 0.05, rel=1e-3, abs=0.1)


def test_a_motion_that_is_too_fast_for_a_joint_is_refused(fast: Load) -> None:
    arm = {"velocity": {"theta_9": 0.1}}
    paper = read_scenario("paper", {"duration": 1, "arm": arm})
    message = r"arm: at t = [\d.]+ s theta_9 has to move at [\d.]+ rad/s, faster than its limit of"
    with pytest.raises(UsageError, match=message + r" 0\.1 rad/s; .* arm\.velocity\.theta_9"):
        simulate(fast("hexarotor_3link"), paper)
