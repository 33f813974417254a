"""Flights of any robot: a quaternion, several arms, rotors on links, damped joints."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.emitted import emitted_module

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.analysis.trim import trim
from gibbs_codegen.flight.attitude import SingularAttitudeError
from gibbs_codegen.flight.control.laws import Controller, Gains, required_inputs
from gibbs_codegen.flight.desired.trajectory import desired_motion, starting_state
from gibbs_codegen.flight.figures.results import write_results
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.compiled_loop import CompiledLoop
from gibbs_codegen.flight.integration.state_history import Loads
from gibbs_codegen.flight.plant.actuators import Actuators
from gibbs_codegen.flight.plant.allocation import AllocationError, allocation_of
from gibbs_codegen.flight.plant.environment import Environment
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.record.series import point_parents
from gibbs_codegen.flight.rollouts.rollout import rollout
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.orientation import Tangent
from gibbs_codegen.flight.scenario.parts import Push, Settings
from gibbs_codegen.flight.scenario.paths import Circle
from gibbs_codegen.flight.simulation import simulate
from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import Base
from gibbs_codegen.robot.parts.body import RigidBody
from gibbs_codegen.robot.parts.link import Link
from gibbs_codegen.robot.parts.pose import Pose
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.runtime.load import load

pytestmark = pytest.mark.usefixtures("derived_once")

Load = Callable[[str], ModuleType]

RK4 = Settings(method="rk4", step=0.002)
TIGHT = Settings(relative_tolerance=1e-12, absolute_tolerance=1e-13)
OFF = {"control": {"law": "off"}, "start": {"turn_deg": [60, 80, 30]}}


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Load:
    """Load the C back end of a robot that ships; as "quaternion", of the paper's with one."""
    folder = tmp_path_factory.mktemp("any")
    made: dict[str, ModuleType] = {}

    def module(name: str) -> ModuleType:
        if name not in made:
            robot, text = read_robot("hexarotor_3link" if name == "quaternion" else name)
            if name == "quaternion":
                robot = replace(robot, base=replace(robot.base, attitude="quaternion"))
                text = robot_text(robot)
            generate_robot(robot, text, folder / name, verify=False)
            made[name] = load(folder / name / robot.name, backend="c")
        return made[name]

    return module


@pytest.fixture(scope="module")
def everything() -> ModuleType:
    """Load NumPy's back end of a robot with nearly all features."""
    file = os.fspath(Path(__file__).parents[1] / "robots/everything.toml")
    return emitted_module(read_robot(file)[0], "default")


@pytest.mark.slow
def test_a_quaternion_flies_where_angles_are_singular(compiled: Load, fast: Load) -> None:
    """Turned upside down about y, past the pitch of 90° at which x-y-z is singular."""
    turn = {"kind": "turn", "axis": [0, 1, 0], "angle_deg": 180, "duration": 2, "begin": 0.2}
    scenario = replace(
        read_scenario("hover", {"base": {"attitude": turn}}), integration=RK4, duration=2.5
    )
    flight = simulate(compiled("quaternion"), scenario)
    assert not flight.stopped
    assert flight.centre_error.max() < 1e-9
    upside_down = np.diag([-1.0, 1.0, -1.0])
    assert flight.base_rotation[-1] == pytest.approx(upside_down, abs=1e-9)
    with pytest.raises(SingularAttitudeError, match="xyz"):
        simulate(fast("hexarotor_3link"), scenario)


@pytest.mark.slow
def test_errors_under_control_decay_as_the_gains_say(compiled: Load) -> None:
    """From rest each obeys ë + 2 w ė + w² e = 0, the attitude's along its rotation vector."""
    start = {"offset": [0.2, 0.1, -0.1], "turn_deg": [60, 80, 30]}
    scenario = replace(
        read_scenario("hover", {"start": start}),
        duration=0.5,
        integration=replace(RK4, step=0.0005),
    )
    flight = simulate(compiled("quaternion"), scenario)
    w, time = scenario.control.frequency, flight.time[:, np.newaxis]
    decay = (1.0 + w * time) * np.exp(-w * time)
    off = (flight.q - flight.q_desired)[:, :3]
    assert off == pytest.approx(decay * off[0], abs=1e-6)
    turned = Rotation.from_matrix(flight.base_rotation).as_rotvec()
    assert turned == pytest.approx(decay * np.radians(start["turn_deg"]), abs=1e-6)


@pytest.mark.slow
def test_every_step_with_a_quaternion_is_that_of_python(compiled: Load) -> None:
    lag = 0.1
    vehicle = Vehicle(compiled("quaternion"))
    scenario = replace(
        read_scenario("hover", {"start": {"turn_deg": [60, 80, 30], "offset": [0.1, 0.2, 0.3]}}),
        base=Circle((0.0, 0.0, 2.0), 1.5, 3.0, normal=(0.3, 0.2, 1.0)),
        duration=0.3,
    )
    reference = desired_motion(vehicle, scenario)
    count = vehicle.layout.v.size
    gains = Gains.of(np.linspace(4.0, 9.0, count), np.linspace(0.5, 1.1, count), count)
    controller = Controller(vehicle, reference, allocation_of(vehicle), gains, "computed_torque")
    push = Push((0.7, -0.4, 0.5), 0.0, 1.0, (0.2, 0.3, -0.1), "base")
    actuators = Actuators.unlimited(vehicle)
    actuators.lag[1:] = lag  # The first motor does not lag.
    environment = Environment(vehicle, push) if push else None
    closed = ClosedLoop(vehicle, controller, actuators, environment, bool(lag))
    state = closed.start(*starting_state(vehicle, reference, scenario.start))
    state[vehicle.layout.q.size :] += 0.3 * np.cos(np.arange(len(state) - vehicle.layout.q.size))
    state[vehicle.layout.q.attitude] *= 1.3  # of any length
    # The damping of light links makes for modes of 10⁴/s.
    step = 2.0**-14
    loop = CompiledLoop(closed, np.inf, Loads(push=True))
    taken, samples, _ = loop(0.0, state, step, 25)
    assert taken == 25
    for number, sample in enumerate(samples):
        state = closed.step(number * step, state, step, loads=Loads(push=True))
        assert sample == pytest.approx(state, rel=1e-9, abs=1e-9)
        state = sample


@pytest.mark.slow
def test_energy_balances_without_inputs(compiled: Load) -> None:
    """To roundoff, where no joint is damped."""
    module = compiled("quaternion")
    joints = Vehicle(module).joint_names
    posture = dict(zip(joints, 0.3 + 0.2 * np.arange(len(joints)), strict=True))
    scenario = read_scenario(
        "circle", {**OFF, "base": {"attitude": {"kind": "level", "rate_deg": 90}}}
    )
    scenario = replace(scenario, arm=replace(scenario.arm, posture=posture), duration=0.5)
    flight = simulate(module, replace(scenario, integration=TIGHT))
    assert not flight.stopped
    assert np.ptp(flight.kinetic_energy) > 1e-3
    assert np.abs(flight.energy_error).max() < 1e-9 * np.ptp(flight.potential_energy)
    assert not np.any(Vehicle(module).damping)
    assert np.all(flight.work == 0.0)


@pytest.mark.slow
def test_damping_is_what_the_file_says(compiled: Load) -> None:
    damping = Vehicle(compiled("hextilt_flying_arm_5")).damping
    assert damping == pytest.approx([0.0] * 6 + [0.1] * 5, abs=1e-12)


def test_rotors_on_links_are_allocated_by_configuration(everything: ModuleType) -> None:
    """Inputs that inverse dynamics finds for a motion give that motion, where one is possible."""
    vehicle = Vehicle(everything)
    assert vehicle.rotors_move
    rng = np.random.default_rng(5)
    q, v = rng.uniform(-0.5, 0.5, (2, 4, vehicle.layout.q.size))
    inputs = rng.uniform(0.5, 1.5, (4, len(vehicle.inputs)))
    a = vehicle.forward_dynamics(q, v, inputs)
    found = required_inputs(vehicle, allocation_of(vehicle), q, v, a)
    assert vehicle.forward_dynamics(q, v, found) == pytest.approx(a, rel=1e-8, abs=1e-8)
    thrusts = [each[:, : vehicle.rotors] for each in (found, inputs)]
    assert np.all(np.linalg.norm(thrusts[0], axis=1) <= np.linalg.norm(thrusts[1], axis=1) + 1e-9)


@pytest.mark.slow
def test_a_robot_without_arms_hovers_in_open_loop(compiled: Load) -> None:
    """Coplanar rotors, no joints, limits and lag from the robot file."""
    scenario = replace(read_scenario("hover", {"control": {"law": "open_loop"}}), duration=0.1)
    flight = simulate(compiled("quadrotor"), scenario)
    assert not flight.stopped
    assert flight.centre_error.max() < 1e-9
    assert flight.parents[1:5].tolist() == [0] * 4


def test_several_arms_have_no_tip_to_lead(everything: ModuleType) -> None:
    with pytest.raises(UsageError, match="everything: has no tip"):
        simulate(everything, read_scenario("paper", {"control": {"law": "off"}}))


@pytest.mark.slow
def test_an_arm_at_any_azimuth_follows_the_path() -> None:
    """What points along the velocity of the base is the arm, from the centre to its motor."""
    arm = 4
    robot, _ = read_robot("hexarotor")
    azimuths = tuple(map(Fraction, (10, 60, 130, 175, 250, 300)))
    base = replace(robot.base, azimuth_deg=azimuths)
    scenario = replace(read_scenario("circle"), attitude=Tangent(arm), duration=0.05)
    flight = simulate(emitted_module(replace(robot, base=base)), scenario)
    assert not flight.stopped
    along = flight.point(f"motor{arm}") - flight.point("O2")
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    velocity = scenario.base(flight.time)[:, 1]
    velocity /= np.linalg.norm(velocity, axis=1, keepdims=True)
    assert along == pytest.approx(velocity, abs=1e-9)
    assert flight.heading_error == pytest.approx(0.0, abs=1e-9)
    expected = np.array(azimuths[1:], dtype=float)
    off = np.degrees(flight.base_arm_angles_desired) - expected
    assert np.sin(np.radians(off) / 2.0) == pytest.approx(0.0, abs=1e-9)
    assert flight.base_arm_angles == pytest.approx(
        np.tile(flight.base_arm_angles_desired, (len(flight.time), 1)), abs=1e-9
    )


@pytest.mark.slow
def test_points_hang_together_as_the_links_do(everything: ModuleType, compiled: Load) -> None:
    """The first two joints of the paper's arm have one place; a slide along an axis has none."""
    mast = RigidBody(0.0, 0.2, inertia=(0.01, 0.01, 0.01, 0.0, 0.0, 0.0))
    turned = (
        Link(mast, pose=Pose(), name="mast"),
        Link(mast, pose=Pose(), joint="prismatic", name="slide"),
        Link(mast, pose=Pose(), name="other", parent=0),  # So that there is no tip.
    )
    machine = emitted_module(Robot("machine", Base(body=mast, origin="base"), turned))
    for module, expected in (
        (compiled("quaternion"), {"joint8": "joint7", "tip": "joint9", "motor3": "O2"}),
        (machine, {"joint_slide": "joint_mast", "joint_other": "base"}),
        (
            everything,
            {
                "joint_a3": "joint_a2",
                "joint_finger_2": "joint_a4",
                "rotor_4": "joint_b2",
                "rotor_1": "joint_tilt_right",
                "joint_b1": "base",
            },
        ),
    ):
        vehicle = Vehicle(module)
        parents = point_parents(vehicle)
        for point, parent in expected.items():
            assert vehicle.points[parents[vehicle.points.index(point)]] == parent, point


@pytest.mark.slow
def test_without_rotors_only_a_free_fall_is_flown(tmp_path: Path) -> None:
    body = RigidBody(0.0, 2.0, inertia=(0.1, 0.1, 0.1, 0.0, 0.0, 0.0))
    robot = Robot("stone", Base(attitude="quaternion", origin="base", body=body), ())
    module = emitted_module(robot)
    with pytest.raises(AllocationError, match=r'cannot command force along x, .* to "off"'):
        simulate(module, read_scenario("hover", {"duration": 0.2}))
    falling = read_scenario("hover", {"duration": 0.2, "control": {"law": "off"}})
    flight = simulate(module, falling)
    fallen = flight.point("base")[0, 2] - flight.point("base")[-1, 2]
    assert fallen == pytest.approx(robot.gravity * 0.2**2 / 2)
    assert "inputs" not in {path.stem for path in write_results(flight, tmp_path)}
    many = rollout(module, None, None, falling, 10, 0.02)
    assert many.q[0, -1] == pytest.approx(flight.q[-1], abs=1e-9)
    # Whatever carries it bears its weight but for rounding.
    off = trim(module, wrenches={"base": [0.0, 1e-15, 2.0 * robot.gravity, 0.0, 0.0, 0.0]})
    assert off.residual == pytest.approx(0.0, abs=1e-9)
