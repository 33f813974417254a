"""The desired motion of scenarios: paths met between samples too, limits, and progress."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.attitude import SingularAttitudeError
from gibbs_codegen.flight.desired.base_trajectory import KNOT_SPACING
from gibbs_codegen.flight.desired.trajectory import desired_motion, starting_state
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.orientation import Level
from gibbs_codegen.flight.scenario.paths import Fixed
from gibbs_codegen.flight.scenario.scenario import ArmTask, Scenario


@pytest.fixture(scope="module")
def hexa(fast: Callable[[str], ModuleType]) -> Vehicle:
    return Vehicle(fast("hexarotor_3link"))


def hover(arm: ArmTask) -> Scenario:
    return Scenario("hover", 0.1, Fixed((0.0, 0.0, 2.0)), Level(), arm)


def beside(start: list[float], end: list[float], duration: float = 1.0) -> Scenario:
    """Hovering, with the tip on a line beside the base."""
    line = {"kind": "line", "start": start, "end": end, "duration": duration}
    return read_scenario("hover", {"duration": duration, "arm": {"tip_beside_base": line}})


def tip_error(vehicle: Vehicle, scenario: Scenario) -> float:
    """Farthest that the tip comes from its path, at many more instants than there are knots."""
    assert scenario.arm.tip is not None
    instants = np.linspace(0.0, scenario.duration, 50_021)
    q, _, _ = desired_motion(vehicle, scenario)(instants)
    tip = vehicle.positions(q)[:, vehicle.points.index("tip")]
    off = np.linalg.norm(tip - scenario.arm.tip(instants)[:, 0], axis=-1)
    return float(off.max())


@pytest.mark.parametrize("aside", [0.1])
def test_past_the_axis_of_a_joint_the_tip_keeps_to_its_path(hexa: Vehicle, aside: float) -> None:
    """The first joint turns by half a turn in milliseconds, where default samples see nothing."""
    assert tip_error(hexa, beside([1.5, aside, -3], [-1.5, aside, -3])) < 2e-7


def test_too_near_past_the_axis_is_refused(hexa: Vehicle) -> None:
    with pytest.raises(
        UsageError, match=r"at t = 0\.\d+ s the arm.*off by \S+ m; slow it .* joint axes"
    ):
        desired_motion(hexa, beside([1.5, 1e-4, -3], [-1.5, 1e-4, -3]))


def test_from_the_axis_of_a_joint_outwards(hexa: Vehicle) -> None:
    assert tip_error(hexa, beside([0, 0, -3], [3, 0, -3])) < 2e-7


@pytest.mark.slow
def test_the_paper_s_motion_takes_no_more_knots_and_little_time(hexa: Vehicle) -> None:
    paper = read_scenario("paper")
    begin = time.process_time()
    reference = desired_motion(hexa, paper)
    assert time.process_time() - begin < 5.0
    assert len(reference.coefficients) == np.ceil(paper.duration / KNOT_SPACING)


# --- limits


@pytest.mark.parametrize(
    ("arm", "message"),
    [
        (
            ArmTask(posture={"theta_8": 1.2}, limits={"theta_8": (-1.0, 1.0)}),
            "arm.posture.theta_8: 1.2 rad is outside its limits, -1 to 1 rad",
        ),
        (
            ArmTask(posture={"theta_7": 0.1}, limits={"theta_9": (0.5, 1.0)}),
            "arm.posture.theta_9: 0 rad is outside its limits, 0.5 to 1 rad; a joint left out",
        ),
        (
            ArmTask(
                Fixed((2.0, 0.0, 0.0)), guess={"theta_7": -0.5}, limits={"theta_7": (0.0, 1.0)}
            ),
            "arm.guess.theta_7: -0.5 rad is outside its limits, 0 to 1 rad",
        ),
        (
            ArmTask(
                posture={"theta_8": math.radians(170)},
                limits={"theta_8": (-1.0, math.radians(150))},
                named=frozenset({("theta_8", "posture_deg")}),
            ),
            "arm.posture_deg.theta_8: 170° is outside its limits, -57.2958 to 150°",
        ),
        (
            ArmTask(
                posture={"theta_7": 9.0, "theta_8": 8.0},
                limits={"theta_7": (-1.0, 1.0), "theta_8": (-1.0, 1.0)},
            ),
            "(?s)arm.posture.theta_7: 9 rad is outside .*\narm.posture.theta_8: 8 rad is outside",
        ),
        (ArmTask(posture={"theta_3": 0.0}), "arm.posture.theta_3: .* has no joint theta_3"),
        (
            ArmTask(posture={"theta_3": 0.0}, named=frozenset({("theta_3", "posture_deg")})),
            "arm.posture_deg.theta_3: hexarotor_3link has no joint theta_3; .* its joints: theta_7",
        ),
        (
            ArmTask(posture={"theta_7": 0.0}, named=frozenset({("theta_7", "posture")})),
            "arm.posture.theta_7: the joint is revolute; give it as arm.posture_deg.theta_7",
        ),
    ],
)
def test_what_is_outside_limits_is_named(hexa: Vehicle, arm: ArmTask, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        desired_motion(hexa, hover(arm))


def test_at_its_limits_a_posture_is_held(hexa: Vehicle) -> None:
    limits = {"theta_8": (-1.0, 0.0), "theta_7": (0.2, 0.4)}
    arm = ArmTask(posture={"theta_8": -1.0, "theta_7": 0.4}, limits=limits)
    q, _, _ = desired_motion(hexa, hover(arm))(0.05)
    assert q[hexa.arm] == pytest.approx([0.4, -1.0, 0.0])


def test_a_guess_need_not_name_joints_that_cannot_be_at_zero(hexa: Vehicle) -> None:
    arm = ArmTask(Fixed((3.0, 0.0, -1.0)), guess={"theta_7": 0.1}, limits={"theta_9": (-3.0, -0.2)})
    q, _, _ = desired_motion(hexa, hover(arm))(0.0)
    assert -3.0 <= q[hexa.arm][2] <= -0.2


# --- the start, and progress


def test_a_start_turned_to_the_singularity_names_what_turns_it(hexa: Vehicle) -> None:
    scenario = read_scenario("hover", {"start": {"turn_deg": [0, 90, 0]}})
    reference = desired_motion(hexa, scenario)
    with pytest.raises(SingularAttitudeError, match=r"at t = 0 s.*start\.turn_deg.*rotation"):
        starting_state(hexa, reference, scenario.start)


def test_progress_is_told_of_every_stage(hexa: Vehicle) -> None:
    told: dict[str, list[float]] = {}
    scenario = beside([2, 0, -3], [3, 0, -2])
    desired_motion(hexa, scenario, lambda what, share: told.setdefault(what, []).append(share))
    assert list(told) == ["desired motion", "inverse kinematics"]
    for shares in told.values():
        assert shares == sorted(shares)
        assert shares[-1] == 1.0


def test_angles_are_told_from_lengths(hexa: Vehicle) -> None:
    assert hexa.is_angle.tolist() == [True] * 6 + [False] * 3
