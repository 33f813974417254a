"""Motions as fast as limits allow: at a limit at all times, over none, and against an optimum."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.control.laws import required_inputs
from gibbs_codegen.flight.desired.trajectory import TimedMotion, timed_motion
from gibbs_codegen.flight.plant.allocation import Allocation
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.simulation import simulate

THRUSTS = (-100.0, 100.0)


@pytest.fixture(scope="module")
def hexa(fast: Callable[[str], ModuleType]) -> Vehicle:
    return Vehicle(fast("hexarotor_3link"))


def fastest(vehicle: Vehicle, name: str, **changes: Any) -> TimedMotion:
    motors = changes.pop("motors", {"limits": list(THRUSTS)})
    timing = {"law": "fastest", **changes.pop("timing", {})}
    return timed_motion(
        vehicle, read_scenario(name, {"motors": motors, "timing": timing, **changes})
    )


def inputs_of(vehicle: Vehicle, motion: TimedMotion, count: int = 8001) -> tuple[Array, Array]:
    """Times, and inputs that the motion takes, by the inverse dynamics that controllers use."""
    time = np.linspace(0.0, motion.reference.end, count)
    allocation = Allocation(vehicle.thrust_wrenches())
    return time, required_inputs(vehicle, allocation, *motion.reference(time))


def test_a_line_is_flown_in_the_least_time(hexa: Vehicle) -> None:
    """The analytic optimum: a machine that only shifts is a double integrator.

    Its thrusts grow linearly with the acceleration along the line: the greatest acceleration and
    braking are those at which the first thrust comes to a limit.
    """
    motion = fastest(hexa, "line")
    way = np.array([4.0, 2.4, 1.8])
    q, v, _ = motion.reference(0.0)
    mass = hexa.mass_matrix(q)[hexa.layout.v.position, hexa.layout.v.position][0, 0]
    still = hexa.inverse_dynamics(q, v, v)
    a = np.zeros_like(v)
    a[hexa.layout.v.position] = way / np.linalg.norm(way)
    thrusts = np.linalg.pinv(hexa.thrust_wrenches())
    hover = thrusts @ hexa.base_wrench(q, still)
    push = thrusts @ hexa.base_wrench(q, hexa.inverse_dynamics(q, v, a)) - hover
    up, down = (
        np.min(np.where(sign * push > 0, 100.0 - hover, 100.0 + hover) / np.abs(push))
        for sign in (1, -1)
    )
    assert mass == pytest.approx(9.0)
    optimum = np.sqrt(2.0 * np.linalg.norm(way) * (1.0 / up + 1.0 / down))
    taken = motion.reference.end - 2.0  # a second of rest before and after, as in the scenario
    assert optimum < taken < optimum + 0.03
    assert taken < 6.0
    assert f"{motion.reference.end:.4g} s instead of 8 s" in motion.explanation


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "changes", "least"),
    [("line", {}, 0.98)],
)
def test_some_limit_is_reached_at_nearly_all_times_and_none_exceeded(
    hexa: Vehicle, name: str, changes: dict[str, Any], least: float
) -> None:
    motion = fastest(hexa, name, **changes)
    time, inputs = inputs_of(hexa, motion)
    most = motion.scenario.motors.limits
    assert most is not None
    share = np.abs(inputs[:, :6]).max(axis=1) / most[1]
    assert share.max() < 1.0 + 1e-9
    moves = np.linalg.norm(motion.reference(time)[1], axis=1) > 1e-6
    assert np.mean(share[moves] > 0.98) > least
    # What is said to bind does.
    for each in motion.binding:
        kind, _, rotor = each.limit.partition(" ")
        sign = 1.0 if kind == "greatest" else -1.0
        series = sign * inputs[:, hexa.inputs.index(rotor)]
        inside = (time >= each.begin) & (time <= each.end)
        assert np.median(series[inside]) > 0.97 * most[1]
    covered = np.any([(time >= b.begin) & (time <= b.end) for b in motion.binding], axis=0)
    assert np.mean(covered[moves]) > least


@pytest.mark.slow
def test_it_flies_where_the_scenario_does_and_leaves_its_record(hexa: Vehicle) -> None:
    scenario = read_scenario(
        "line",
        {
            "motors": {"limits": list(THRUSTS)},
            "timing": {"law": "fastest"},
            "integration": {"method": "rk4", "step": 0.0025},
        },
    )
    flight = simulate(hexa.module, scenario)
    assert not flight.stopped
    assert flight.time[-1] < 5.0
    assert_allclose(flight.point(flight.centre)[-1], [4.0, 2.4, 3.8], atol=1e-5)
    assert flight.centre_error.max() < 1e-5
    assert np.abs(flight.applied[:, :6]).max() <= 100.0
    assert flight.timing.startswith("fastest within limits")
    assert len(flight.binding) == len(flight.binding_times) > 0
    # It stays on its line, whatever its timing.
    off = np.cross(flight.point(flight.centre) - [0.0, 0.0, 2.0], [4.0, 2.4, 1.8])
    assert np.abs(off).max() < 1e-4


@pytest.mark.slow
def test_rates_of_thrusts_are_kept(hexa: Vehicle) -> None:
    quick = fastest(hexa, "line")
    motion = fastest(hexa, "line", timing={"thrust_rate": 400.0})
    time, inputs = inputs_of(hexa, motion, 4001)
    rates = np.abs(np.diff(inputs[:, :6], axis=0)) / np.diff(time)[:, np.newaxis]
    assert 0.95 * 400.0 < rates.max() < 400.0
    assert np.abs(inputs[:, :6]).max() < 100.0
    assert quick.reference.end < motion.reference.end < quick.reference.end + 1.0
    assert any(each.limit.startswith("rate of") for each in motion.binding)


@pytest.mark.slow
def test_limits_of_joints_are_kept_and_a_motion_that_exceeds_them_is_slowed_down(
    hexa: Vehicle,
) -> None:
    tip = {"kind": "line", "start": [1.5, 0.5, -3], "end": [2.5, -1, -2.5], "duration": 1}
    motors = {"limits": [-300, 300]}
    changes = {"duration": 1.2, "arm": {"tip_beside_base": tip}, "motors": motors}
    velocity = {"velocity": {"theta_7": 0.4}}
    motion = fastest(hexa, "hover", timing=velocity, **changes)
    time = np.linspace(0.0, motion.reference.end, 2001)
    rates = np.abs(motion.reference(time)[1][:, hexa.arm_rates])
    assert rates[:, 0].max() == pytest.approx(0.4, rel=2e-3)
    assert motion.reference.end > 1.3
    assert "velocity of theta_7" in {each.limit for each in motion.binding}
    effort = {"effort": {"theta_8": 150.0}}
    motion = fastest(hexa, "hover", timing=effort, **changes)
    _, inputs = inputs_of(hexa, motion)
    assert 0.98 * 150.0 < np.abs(inputs[:, 7]).max() < 150.0


@pytest.mark.parametrize("name", ["hexarotor_3link", "quadrotor"])
def test_rest_stays_rest(name: str, fast: Callable[[str], ModuleType]) -> None:
    motion = fastest(Vehicle(fast(name)), "hover")
    assert motion.reference.end == motion.scenario.duration == 5.0
    assert "nothing moves" in motion.explanation
    assert motion.binding == ()


@pytest.mark.parametrize(
    ("name", "changes", "words"),
    [
        ("hexarotor_3link", {"motors": {}}, r'timing.law "fastest" needs limits'),
        (
            "hexarotor_3link",
            {"motors": {"limits": [-20, 20]}},
            r"at t = 0 s .* F_\d is .*, outside its limits",
        ),
        ("hexarotor_3link", {"timing": {"effort": {"theta_1": 3}}}, "has no joint theta_1"),
        ("quadrotor", {"timing": {"effort": {"theta_1": 3}}}, "has no joint theta_1"),
    ],
)
def test_what_cannot_be_timed_is_refused(
    name: str, changes: dict[str, Any], words: str, fast: Callable[[str], ModuleType]
) -> None:
    with pytest.raises(UsageError, match=words):
        fastest(Vehicle(fast(name)), "line", **changes)


@pytest.mark.slow
def test_a_base_that_leans_is_stretched_as_a_whole(fast: Callable[[str], ModuleType]) -> None:
    vehicle = Vehicle(fast("quadrotor"))
    path = {"kind": "waypoints", "times": [0, 3], "points": [[0, 0, 0], [0, 0, 2]]}
    limits = [1.0, 4.6]
    motion = fastest(vehicle, "line", duration=3, base={"path": path}, motors={"limits": limits})
    factor = motion.scenario.duration / 3.0
    # Straight up, thrusts are a quarter of m (g + a), and a falls with the square of the factor.
    hover = 4.0 * 3.679 / 9.81 * 9.81 / 4.0
    acceleration = read_scenario("line", {"base": {"path": path}}).base(np.linspace(0, 3, 3001))
    most = acceleration[:, 2, 2].max() / 9.81 * hover
    needed = np.sqrt(most / (4.6 - hover))
    assert needed < factor < 1.01 * needed
    assert f"stretched by {factor:.3g}" in motion.explanation
    assert "any faster, F_" in motion.explanation
    assert "would exceed 4.6 N at t = " in motion.explanation
    assert_allclose(
        motion.scenario.base(factor * 0.7)[0],
        read_scenario("line", {"base": {"path": path}}).base(0.7)[0],
        atol=1e-12,
    )
