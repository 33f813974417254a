"""Whole flights: the paper's, disturbed ones, other rotor counts, and those that are refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

import numpy as np
import pytest
from support.emitted import emitted_module

from gibbs_codegen.errors import ScenarioFileError, UsageError
from gibbs_codegen.flight import simulation
from gibbs_codegen.flight.desired.inverse_kinematics import UnreachableError
from gibbs_codegen.flight.plant.allocation import AllocationError
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.orientation import Level
from gibbs_codegen.flight.scenario.parts import Control, Motors, Push, Settings
from gibbs_codegen.flight.scenario.paths import Circle, Fixed
from gibbs_codegen.flight.scenario.scenario import ArmTask, Scenario
from gibbs_codegen.flight.simulation import simulate
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.parts.body import RigidBody, Rod
from gibbs_codegen.robot.parts.link import Link
from gibbs_codegen.runtime.load import load

Load = Callable[[str], ModuleType]


@pytest.fixture(scope="module", params=["adaptive", pytest.param("rk4", marks=pytest.mark.slow)])
def paper_flight(request: pytest.FixtureRequest, fast: Load) -> Flight:
    scenario = read_scenario("paper", {"integration": {"method": request.param}})
    return simulate(fast("hexarotor_3link"), scenario)


def paths_of_the_paper(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eqs. 20 and 21 as they stand in the paper."""
    centre = [2 * np.exp(-0.05 * t) * np.cos(t), 2 * np.exp(-0.05 * t) * np.sin(t), np.exp(0.1 * t)]
    tip = [-2 * np.cos(np.pi / 2 + t), -2 + 0 * t, -2 * np.sin(2 * t)]
    return np.stack(centre, axis=-1), np.stack(tip, axis=-1)


def test_the_paper_flight_is_tracked(paper_flight: Flight) -> None:
    flight = paper_flight
    assert not flight.stopped
    assert flight.time[0] == 0
    assert flight.time[-1] == pytest.approx(4 * np.pi, abs=1e-12)
    centre, tip = paths_of_the_paper(flight.time)
    assert np.linalg.norm(flight.point("O2") - centre, axis=1).max() < 1e-6
    assert np.linalg.norm(flight.point("tip") - tip, axis=1).max() < 1e-6
    assert np.abs(flight.q - flight.q_desired)[:, :6].max() < 1e-6


def test_arm_2_stays_tangent_and_the_base_arms_stay_rigid(paper_flight: Flight) -> None:
    flight = paper_flight
    t = flight.time
    h = 1e-6
    ahead, behind = paths_of_the_paper(t + h)[0], paths_of_the_paper(t - h)[0]
    tangent = (ahead - behind) / np.linalg.norm(ahead - behind, axis=1, keepdims=True)
    arm = flight.point("motor2") - flight.point("O2")
    arm /= np.linalg.norm(arm, axis=1, keepdims=True)
    # Differences of a path leave 1e-9; the angle is small, so its sine does.
    assert np.linalg.norm(np.cross(arm, tangent), axis=1).max() < 1e-6
    assert np.all(np.sum(arm * tangent, axis=1) > 0)
    assert flight.heading_error.max() < 1e-6
    degrees = [-120, -60, 0, 60, 120]
    assert np.degrees(flight.base_arm_angles) == pytest.approx(np.tile(degrees, (len(t), 1)))
    assert np.ptp(flight.base_arm_angles, axis=0).max() < 1e-12


def test_the_base_normal_is_the_nearest_to_the_vertical(paper_flight: Flight) -> None:
    """Turned about the tangent either way, the normal would lean more."""
    for rotation in paper_flight.base_rotation[::200]:
        normal, angle = rotation[:, 2], np.radians(-120)
        tangent = rotation @ np.array([np.cos(angle), np.sin(angle), 0])
        for turn in np.radians([-5, -0.5, 0.5, 5]):
            normal_turned = np.cos(turn) * normal + np.sin(turn) * np.cross(tangent, normal)
            assert normal_turned[2] < normal[2]


@pytest.mark.slow
def test_a_disturbed_start_converges_without_much_overshoot(fast: Load) -> None:
    rng = np.random.default_rng(0)
    offset, turn = rng.normal(size=(2, 3))
    start = {
        "offset": (0.2 * offset / np.linalg.norm(offset)).tolist(),
        "turn_deg": (10 * turn / np.linalg.norm(turn)).tolist(),
    }
    scenario = read_scenario("paper", {"start": start, "duration": 4.0})
    flight = simulate(fast("hexarotor_3link"), scenario)
    assert flight.centre_error[0] == pytest.approx(0.2, abs=1e-12)
    wanted = Flight.point(flight, "O2")[0] - flight.centre_desired[0]
    assert wanted == pytest.approx(start["offset"], abs=1e-12)
    turned = flight.base_rotation[0] @ undisturbed_rotation(flight).T
    assert np.degrees(np.arccos((np.trace(turned) - 1) / 2)) == pytest.approx(10, abs=1e-6)
    late = flight.time >= 3
    assert flight.centre_error[late].max() < 1e-3
    assert flight.tip_error[late].max() < 1e-3
    for name, desired in (("O2", flight.centre_desired), ("tip", flight.tip_desired)):
        error = flight.point(name) - desired
        along = error @ error[0] / (error[0] @ error[0])
        assert along.min() > -0.2
        assert np.linalg.norm(error, axis=1).max() < 1.2 * np.linalg.norm(error[0])


def undisturbed_rotation(flight: Flight) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler("XYZ", flight.q_desired[0, :3]).as_matrix()


def test_a_quadrotor_is_refused_with_the_directions_it_lacks(shipped: Load) -> None:
    for name in ("paper", "hover"):
        with pytest.raises(AllocationError, match="force along y and torque about x") as refused:
            simulate(shipped("quadrotor_2link"), read_scenario(name))
        assert refused.value.missing == ("force along y", "torque about x")


def test_a_quadrotor_hovers_in_open_loop(shipped: Load) -> None:
    scenario = read_scenario("hover", {"control": {"law": "open_loop"}, "duration": 0.5})
    flight = simulate(shipped("quadrotor_2link"), scenario)
    assert flight.centre_error.max() < 1e-6


@pytest.mark.slow
def test_a_redundant_arm_follows_a_tip_path(fast: Load) -> None:
    scenario = Scenario(
        "reach",
        1.5,
        Fixed((0.0, 0.0, 1.0)),
        Level(0.3, 0.2),
        ArmTask(tip=Circle((0.35, 0.0, 0.75), 0.1, 2.0, normal=(1.0, 0.2, 0.3))),
    )
    flight = simulate(fast("octorotor_7link"), scenario)
    assert not flight.stopped
    assert flight.tip_error.max() < 1e-6
    assert np.abs(flight.q - flight.q_desired).max() < 1e-6
    assert np.ptp(flight.q[:, 3:10], axis=0).max() > 0.1


@pytest.mark.slow
def test_an_arm_too_short_is_told_when_and_how_far(fast: Load) -> None:
    with pytest.raises(UnreachableError, match=r"from t = 0 s to 12\.5664 s") as refused:
        simulate(fast("octorotor_7link"), read_scenario("paper"))
    assert refused.value.distances.max() > 1.0


@pytest.mark.slow
def test_without_an_arm_there_is_no_tip_to_lead(shipped: Load) -> None:
    with pytest.raises(UsageError, match="has no arm"):
        simulate(shipped("hexarotor"), read_scenario("paper"))
    circle = read_scenario("circle", {"duration": 2.0})
    assert simulate(shipped("hexarotor"), circle).centre_error.max() < 1e-6


@pytest.mark.parametrize("name", ["hover", "line"])
def test_shipped_scenarios_fly(name: str, fast: Load) -> None:
    flight = simulate(
        fast("hexarotor_3link"), read_scenario(name, {"integration": {"method": "rk4"}})
    )
    assert not flight.stopped
    assert flight.centre_error.max() < 1e-6
    assert flight.heading_error.max() < 1e-6


def test_names_of_another_robot_are_refused(shipped: Load) -> None:
    for task in (ArmTask(posture={"theta_6": 0.1}), ArmTask(limits={"theta_6": (0.0, 1.0)})):
        scenario = replace(read_scenario("hover"), arm=task)
        with pytest.raises(UsageError, match=r"no joint theta_6; .* its joints: theta_7"):
            simulate(shipped("hexarotor_3link"), scenario)


def test_parameters_reach_the_machine(fast: Load) -> None:
    heavy = read_scenario("hover", {"parameters": {"gravity": 20.0}, "duration": 0.1})
    flight = simulate(fast("hexarotor_3link"), heavy)
    light = simulate(fast("hexarotor_3link"), replace(heavy, parameters={}))
    assert flight.applied[0, :6:2] == pytest.approx(light.applied[0, :6:2] * 20 / 9.81, rel=1e-6)
    with pytest.raises(UsageError, match="did you mean gravity"):
        simulate(fast("hexarotor_3link"), replace(heavy, parameters={"gravitas": 1.0}))


@pytest.mark.slow
def test_a_push_at_the_tip_moves_it_and_is_overcome(fast: Load) -> None:
    push = Push((3.0, 0.0, 0.0), 0.5, 1.5)
    scenario = replace(read_scenario("line"), push=push, duration=5.0)
    flight = simulate(fast("octorotor_7link"), scenario)
    before, during = flight.time < 0.5, (flight.time > 0.5) & (flight.time < 1.5)
    assert flight.tip_error[before].max() < 1e-6
    assert flight.tip_error[during].max() > 1e-2
    assert flight.tip_error[-1] < 1e-3 * flight.tip_error[during].max()


def test_the_push_is_a_force_on_the_tip(fast: Load) -> None:
    """M a = R + B u + Jᵀf, with J of the tip."""
    push = Push((1.0, -2.0, 0.5), 0.0, 1.0)
    module = fast("hexarotor_3link")
    scenario = replace(read_scenario("circle"), push=push, duration=0.2)
    flight = simulate(module, scenario)
    for k in range(0, len(flight.time), 5):
        q, v, a, u = flight.q[k], flight.v[k], flight.a[k], flight.applied[k]
        left = module.inverse_dynamics(q, v, a) - module.input_matrix(q) @ u
        force = module.tip_jacobian(q)[:3].T @ np.array(push.force)
        assert left == pytest.approx(force, abs=1e-9)


def test_lag_holds_thrusts_back(fast: Load) -> None:
    """After a step the thrusts approach what is asked for as e^(−t/T)."""
    changes = {"motors": {"time_constant": 0.05, "compensation": False}, "duration": 1.0}
    flight = simulate(fast("octorotor_7link"), read_scenario("line", changes))
    rate = np.gradient(flight.applied[:, :8], flight.time, axis=0, edge_order=2)
    excess = (flight.commanded - flight.applied)[:, :8] / 0.05
    assert rate[2:-2] == pytest.approx(excess[2:-2], abs=0.02 * np.abs(excess).max() + 1e-3)
    assert flight.applied[0] == pytest.approx(flight.commanded[0])


def test_control_off_asks_for_nothing(fast: Load) -> None:
    scenario = replace(read_scenario("circle"), control=Control("off"), duration=0.3)
    flight = simulate(fast("hexarotor_3link"), replace(scenario, integration=Settings("rk4")))
    assert not np.any(flight.applied)
    assert not np.any(flight.work)


def test_progress_is_told(fast: Load) -> None:
    told: list[tuple[str, float]] = []
    simulate(
        fast("hexarotor_3link"),
        read_scenario("paper", {"duration": 0.5}),
        progress=lambda what, share: told.append((what, share)),
    )
    for what in ("inverse kinematics", "flying"):
        shares = [share for name, share in told if name == what]
        assert shares == sorted(shares)
        assert shares[-1] == pytest.approx(1.0)


def test_faults_of_a_scenario_come_before_anything_is_compiled(
    shipped: Load, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = Path(shipped("hexarotor").__file__ or "").parent
    known = {"numpy": load(folder)}
    monkeypatch.setattr(simulation, "load", lambda _, backend="numpy": known[backend])
    base = {"path": {"kind": "fixed", "position": [0, 0, 0]}}
    tables = {"name": "up", "duration": 1, "base": base}
    with pytest.raises(UsageError, match=r"push\.frame: hexarotor has no frame hand"):
        simulate(folder, tables | {"push": {"frame": "hand", "force": [1, 0, 0]}})
    with pytest.raises(ScenarioFileError, match="duration: missing"):
        simulate(folder, {"name": "up"})
    no_scenario: Any = 3
    with pytest.raises(UsageError, match="or its tables in a dictionary, not 3"):
        simulate(folder, no_scenario)


def test_names_will_do_for_robot_and_scenario(shipped: Load) -> None:
    folder = Path(shipped("hexarotor").__file__ or "").parent
    by_name = simulate(folder, "hover")
    assert by_name.scenario == "hover"
    module = load(folder, backend="c")
    assert by_name.q == pytest.approx(simulate(module, read_scenario("hover")).q)


def test_open_loop_that_becomes_impossible_is_refused_with_its_time(
    shipped: Load, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The line begins to move at 1 s, sideways of what four rotors command; nothing is compiled."""
    backends = []

    def load_noted(robot: Path, backend: Literal["numpy", "c"] = "numpy") -> ModuleType:
        backends.append(backend)
        return load(robot, backend)

    monkeypatch.setattr("gibbs_codegen.flight.simulation.load", load_noted)
    scenario = read_scenario("line", {"control": {"law": "open_loop"}})
    folder = Path(shipped("quadrotor_2link").__file__ or "").parent
    with pytest.raises(AllocationError, match=r"from t = 1\.005 s on the motion needs force"):
        simulate(folder, scenario)
    assert backends == ["numpy"]


def test_masses_of_no_body_are_refused(shipped: Load) -> None:
    negative = {"parameters": {"link3_mass_per_length": -0.3}}
    with pytest.raises(UsageError, match="mass matrix is not positive definite"):
        simulate(shipped("hexarotor_3link"), read_scenario("hover", negative))


@pytest.mark.slow
def test_a_start_where_the_machine_is_singular_is_refused_as_that() -> None:
    """A massless wrist whose first and last axes are in line, and one that is bent."""
    nothing = Rod(length=0.0)
    hand = RigidBody(0.0, 1.0, (0.3, 0.1, 0.2), (0.1, 0.1, 0.1, 0.0, 0.0, 0.0))
    arm = (
        Link(nothing),
        Link(nothing, alpha_deg=Fraction(90)),
        Link(hand, alpha_deg=Fraction(-90)),
    )
    wrist = emitted_module(replace(paper_family(4, 0), links=arm))
    flight = {"duration": 0.1, "control": {"law": "off"}}
    straight = read_scenario("hover", flight | {"arm": {"posture_deg": {"theta_6": 0.0}}})
    with pytest.raises(UsageError, match="singular at the start"):
        simulate(wrist, straight)
    bent = read_scenario("hover", flight | {"arm": {"posture_deg": {"theta_6": 40.0}}})
    assert np.isfinite(simulate(wrist, bent).q).all()


@pytest.mark.parametrize(
    ("path", "message"),
    [
        (lambda t: np.zeros((*np.shape(t), 3)), r"must give \(…, 4, 3\)"),
        (lambda t: [0.0, 0.0, 0.0], r"must give \(…, 4, 3\)"),
        (lambda t: t["x"], "cannot be evaluated at an array of times"),
        (lambda t: Circle((0, 0, 0), 1, 2)(t)[..., [0, 2, 1, 3], :], "its velocity is not the"),
        (
            lambda t: Circle((0, 0, 0), 1, 2)(t)[..., [0, 1, 2, 0], :],
            "its jerk is not the derivative",
        ),
    ],
)
def test_a_path_of_ones_own_is_checked(path: Any, message: str, shipped: Load) -> None:
    with pytest.raises(UsageError, match=f"the path of the base: .*{message}"):
        simulate(shipped("hexarotor"), Scenario("own", 2.0, path))


@pytest.mark.slow
def test_a_path_of_ones_own_is_flown(shipped: Load) -> None:
    def eight(time: Any) -> np.ndarray:
        return Circle((0, 0, 1), 0.5, 3.0)(time) + Circle((0, 0, 1), 0.2, -1.5)(time)

    flight = simulate(shipped("hexarotor"), Scenario("eight", 1.5, eight))
    assert flight.centre_error.max() < 1e-6


@pytest.mark.parametrize(
    "make",
    [
        lambda: Control("computed-torque"),
        lambda: Control(frequency=0.0),
        lambda: Control(damping_ratio=-1.0),
        lambda: Control(attitude_frequency=0.0),
        lambda: Control(integral=-0.1),
        lambda: Control(rate=0.0),
        lambda: Control(delay=0.01),
        lambda: Control(rate=100.0, delay=-0.01),
        lambda: Motors((30.0, -30.0)),
        lambda: Motors(None, -0.05),
        lambda: Scenario("none", 0.0, Fixed((0, 0, 0))),
        lambda: ArmTask(tip=Fixed((0, 0, 0)), posture={}),
        lambda: ArmTask(guess={"theta_7": 0.0}),
        lambda: ArmTask(limits={"theta_7": (1.0, 0.0)}),
    ],
)
def test_scenarios_that_mean_nothing_cannot_be_made(make: Callable[[], object]) -> None:
    with pytest.raises(UsageError):
        make()
