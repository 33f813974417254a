"""What acts from outside: against analytic motions, momentum, energy and other formulations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import cumulative_simpson, solve_ivp
from support.emitted import emitted_module

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.control.laws import Controller, Gains
from gibbs_codegen.flight.desired.trajectory import desired_motion
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.compiled_loop import CompiledLoop, is_compiled
from gibbs_codegen.flight.integration.state_history import NOTHING, Loads
from gibbs_codegen.flight.plant.actuators import Actuators
from gibbs_codegen.flight.plant.allocation import allocation_of
from gibbs_codegen.flight.plant.environment import Environment, RotorSpin
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.reference import Motion, Reference
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.parts import Gust, Payload, Push, Wind
from gibbs_codegen.flight.scenario.walls import Cylinder, Plane
from gibbs_codegen.flight.simulation import simulate
from gibbs_codegen.machine.state import State
from gibbs_codegen.robot.file import parse_robot

Array = NDArray[np.float64]
Load = Callable[[str], ModuleType]

GRAVITY = 9.81
# Of the base `hexarotor`, kg.
MASS = 3.0
# A base of which the principal axes are those of the frame, so that much can be told on paper.
TOP = """
name = "top"
[base]
attitude = "quaternion"
mass = 2.0
inertia = [0.03, 0.03, 0.05, 0, 0, 0]
[[rotor]]
position = [0.2, 0, 0]
drag = -0.02
spin_inertia = 1e-4
speed_per_sqrt_thrust = 300
[[rotor]]
position = [-0.2, 0, 0]
drag = -0.02
spin_inertia = 1e-4
speed_per_sqrt_thrust = 300
"""
# Two arms side by side, so that there is no tip, with a rotor on each.
BRANCHES = """
name = "branches"
[base]
mass = 1
inertia = [0.02, 0.02, 0.03, 0, 0, 0]
[[link]]
name = "left"
axis = "x"
xyz = [0, 0.2, 0]
mass = 0.3
inertia = [0.001, 0.002, 0.003, 0, 0, 0]
[[link]]
name = "right"
parent = "base"
axis = "y"
xyz = [0, -0.2, 0]
mass = 0.3
inertia = [0.001, 0.002, 0.003, 0, 0, 0]
[[rotor]]
on = "left"
drag = 0.01
direction = [0.1, 0.2, 1]
[[rotor]]
on = "right"
drag = -0.01
direction = [0.3, -0.2, 1]
[[rotor]]
position = [0.3, 0, 0]
[[frame]]
name = "hand"
on = "left"
rpy_deg = [30, 40, 50]
"""


def flown(module: ModuleType, name: str = "hover", /, **changes: Any) -> Flight:
    """A flight, in tight tolerances."""
    tight = {"relative_tolerance": 1e-11, "absolute_tolerance": 1e-12, "rate": 200}
    scenario = read_scenario(name, {"integration": tight, **changes})
    flight = simulate(module, scenario)
    assert not flight.stopped
    assert np.abs(flight.energy_error).max() < 1e-8
    return flight


def wrenches(
    environment: Environment, q: Array, v: Array, inputs: Array, time: float | Array = 0.0
) -> Array:
    """Wrenches (…, f, 6) on the frames where nothing is pushed or carried."""
    vehicle = environment.vehicle
    reference = resting(vehicle)
    gains = Gains.of(1.0, 1.0, vehicle.layout.v.size)
    law = Controller(vehicle, reference, allocation_of(vehicle), gains, "off")
    loop = ClosedLoop(vehicle, law, Actuators.unlimited(vehicle), environment)
    none = np.zeros((*q.shape[:-1], 0))
    parts = State(q, v, none, none, none, none)
    return loop.motion(time, parts, inputs, inputs, NOTHING)["wrenches"]


def resting(vehicle: Vehicle) -> Reference:
    """The motion that rests where all coordinates are 0."""
    q, still = np.stack([vehicle.neutral] * 2), np.zeros((2, vehicle.layout.v.size))
    return vehicle.kinematics.reference(Motion(np.array([0.0, 1.0]), q, still, still))


# Wind


def test_wind_carries_a_falling_base_as_the_exponential_function_says(fast: Load) -> None:
    drag, wind = 0.8, np.array([3.0, -1.0, 0.5])
    flight = flown(
        fast("hexarotor"),
        control={"law": "off"},
        duration=3,
        wind={"velocity": wind.tolist(), "drag": {"base": drag}},
    )
    terminal = wind - [0.0, 0.0, MASS * GRAVITY / drag]
    settled = 1.0 - np.exp(-drag / MASS * flight.time)[:, np.newaxis]
    velocity = np.gradient(flight.point(flight.centre), flight.time, axis=0, edge_order=2)
    assert velocity[1:-1] == pytest.approx((terminal * settled)[1:-1], abs=1e-4)
    places = terminal * (flight.time[:, np.newaxis] - MASS / drag * settled)
    assert flight.point(flight.centre) - flight.point(flight.centre)[0] == pytest.approx(
        places, abs=1e-9
    )
    force = flight.frame_wrench("base")[:, :3]
    assert force == pytest.approx(drag * (wind - terminal * settled), abs=1e-9)


# Walls


def test_a_base_comes_to_rest_where_the_wall_carries_its_weight(fast: Load) -> None:
    stiffness, damping = 300.0, 2.0 * np.sqrt(300.0 * MASS)
    flight = flown(
        fast("hexarotor"),
        control={"law": "off"},
        duration=4,
        wall=[
            {
                "frame": "base",
                "point": [7, 8, 1.9],
                "normal": [0, 0, 5],
                "stiffness": stiffness,
                "damping": damping,
            }
        ],
    )
    depth = MASS * GRAVITY / stiffness
    assert flight.point(flight.centre)[-1, 2] == pytest.approx(1.9 - depth, abs=1e-7)
    force = flight.frame_wrench("base")
    assert force[-1] == pytest.approx([0, 0, MASS * GRAVITY, 0, 0, 0], abs=1e-5)
    assert force[:, 2].min() == 0.0


def test_a_wall_gives_back_what_it_takes_and_never_pulls(fast: Load) -> None:
    """Without a damper the base bounces to where it fell from; with one it is let go of."""
    wall = {"frame": "base", "point": [0, 0, 1.5], "normal": [0, 0, 1], "stiffness": 2000}
    off = {"law": "off"}
    flight = flown(fast("hexarotor"), control=off, duration=1.2, wall=[wall])
    height = flight.point(flight.centre)[:, 2]
    fallen = np.sqrt(2.0 * 0.5 / GRAVITY)
    frequency = np.sqrt(2000.0 / MASS)
    hang = GRAVITY / frequency**2
    contact = 2.0 * (np.pi - np.arctan(np.sqrt(2.0 * GRAVITY * 0.5) / (frequency * hang)))
    again = 2.0 * fallen + contact / frequency
    place = int(np.argmin(np.abs(flight.time - again)))
    assert height[place] == pytest.approx(2.0, abs=1e-3)
    damped = flown(fast("hexarotor"), control=off, duration=1.2, wall=[{**wall, "damping": 60}])
    pushed, depth = damped.frame_wrench("base")[:, 2], 1.5 - damped.point(damped.centre)[:, 2]
    assert pushed.min() == 0.0
    assert np.any((depth > 0.0) & (pushed == 0.0))
    assert np.all(pushed[depth <= 0.0] == 0.0)


def test_a_cylinder_pushes_away_from_its_axis(fast: Load) -> None:
    """A base that falls beside the highest line of a pipe slides off: by numbers, and by energy."""
    pipe = {"kind": "cylinder", "frame": "base", "point": [4, 0.1, 1], "axis": [2, 0, 0]}
    pipe |= {"radius": 0.5, "stiffness": 3000}
    flight = flown(fast("hexarotor"), control={"law": "off"}, duration=0.6, wall=[pipe])
    away = flight.point(flight.centre) - [4, 0.1, 1]
    distance = np.hypot(away[:, 1], away[:, 2])
    depth = np.maximum(0.5 - distance, 0.0)
    assert depth.max() > 0.05
    assert depth[-1] == 0.0
    expected = 3000.0 * depth[:, np.newaxis] * away * [0, 1, 1] / distance[:, np.newaxis]
    assert flight.frame_wrench("base")[:, :3] == pytest.approx(expected, abs=1e-6)
    assert flight.wall_forces[:, 0] == pytest.approx(3000.0 * depth, abs=1e-6)
    assert flight.v[-1, flight.layout.v.position][1] < -0.5
    speed = np.linalg.norm(flight.v[-1, flight.layout.v.position])
    fallen = flight.point(flight.centre)[0, 2] - flight.point(flight.centre)[-1, 2]
    assert speed == pytest.approx(np.sqrt(2.0 * GRAVITY * fallen), rel=1e-6)


def test_steps_that_are_too_long_for_a_wall_are_refused_with_those_that_serve(fast: Load) -> None:
    wall = {"frame": "base", "point": [0, 0, 1.999], "normal": [0, 0, 1], "stiffness": 3e7}
    rk4 = {"method": "rk4", "step": 0.001}
    changes = {"duration": 0.05, "control": {"law": "off"}, "wall": [wall], "integration": rk4}
    scenario = read_scenario("hover", changes)
    with pytest.raises(UsageError, match=r"because of the wall at base, which feels a mass of 3"):
        simulate(fast("hexarotor"), scenario)
    longest = 2.0 / np.sqrt(3e7 / MASS)
    serves = replace(scenario, integration=replace(scenario.integration, step=longest))
    flight = simulate(fast("hexarotor"), serves)
    assert not flight.stopped
    assert flight.point(flight.centre)[:, 2].max() < 2.01


def test_steps_that_are_too_long_for_drag_are_refused(fast: Load) -> None:
    rk4 = {"method": "rk4", "step": 0.002}
    wind = {"drag": {"base": 9000.0}}
    scenario = read_scenario("hover", {"duration": 0.05, "wind": wind, "integration": rk4})
    with pytest.raises(UsageError, match="makes errors grow, because of the drag; use steps of"):
        simulate(fast("hexarotor"), scenario)


@pytest.mark.slow
def test_inspection_pushes_with_the_force_of_two_springs_in_a_row(fast: Load) -> None:
    """Wall and controller: the controller's stiffness at the tip is that of the mass it moves."""
    module = fast("hexarotor_3link")
    scenario = read_scenario("inspection")
    flight = simulate(module, scenario)
    assert not flight.stopped
    # Fixed steps go across the jump by which the damper sets in.
    assert np.abs(flight.energy_error).max() < 1e-4
    (wall,) = scenario.walls
    force, depth = -flight.frame_wrench("tip")[:, 0], flight.point("tip")[:, 0] - wall.point[0]
    pushing = (flight.time > 7.5) & (flight.time < 9.0)
    assert force[pushing] == pytest.approx(wall.stiffness * depth[pushing], rel=1e-3)
    assert np.ptp(force[pushing]) < 1e-3
    q = flight.q_desired[np.argmax(pushing)]
    across = module.tip_jacobian(q)[0]
    mass = 1.0 / (across @ np.linalg.solve(module.mass_matrix(q), across))
    held = mass * scenario.control.frequency**2
    wanted = flight.tip_desired[np.argmax(pushing), 0] - wall.point[0]
    # The posture gives way, by a few percent of what moves the tip.
    assert force[pushing][0] == pytest.approx(
        wanted / (1.0 / wall.stiffness + 1.0 / held), rel=0.05
    )
    assert 5.0 < force[pushing][0] < 8.0
    assert np.all(force[(flight.time < 4.5) | (flight.time > 11.0)] == 0.0)
    assert flight.tip_error[-1] < 1e-3


@pytest.mark.slow
def test_an_arm_that_is_pressed_along_its_length_buckles(fast: Load) -> None:
    """What the page on scenarios says of walls."""
    frequency = 60
    module = fast("hextilt_flying_arm_5")
    vehicle, stiffness, tip = Vehicle(module), 400.0, module.FRAMES.index("tip")
    # The arm hangs where its joints are at 0.
    posture = dict(zip(vehicle.joint_names, [90.0, 0.0, 0.0, 0.0, 0.0], strict=True))
    q = vehicle.neutral
    q[vehicle.arm] = np.radians([*posture.values()])
    across = -module.frame_jacobians(q)[tip, 0]
    mass = 1.0 / (across @ np.linalg.solve(module.mass_matrix(q), across))
    pushing = np.zeros((len(module.FRAMES), 6))
    pushing[tip, 0] = -1.0
    moves = 1e-5 * np.eye(len(across))
    ends = (module.wrench_forces(module.integrate(q, x), pushing) for x in (moves, -moves))
    slopes = np.subtract(*ends).T / 2e-5
    worst = np.linalg.eigvals(np.linalg.solve(module.mass_matrix(q), slopes)).real.max()
    assert frequency**2 / worst == pytest.approx(9.18, rel=0.01)
    depth = 5.0 * (1.0 / stiffness + 1.0 / (mass * frequency**2))
    place = module.frame_poses(q)[tip, :3, 3] + [0.05, 0.0, 0.0]
    path = {"kind": "line", "start": [0, 0, 0], "end": [0.05 + depth, 0, 0], "duration": 3}
    wall = {"frame": "tip", "point": place.tolist(), "normal": [-1, 0, 0]}
    changes = {
        "duration": 8,
        "base": {"path": path},
        "arm": {"posture_deg": posture, "effort": dict.fromkeys(posture, 100.0)},
        "control": {"law": "computed_torque", "frequency": frequency},
        "wall": [wall | {"stiffness": stiffness, "damping": 40}],
        "integration": {"method": "rk4", "step": 5e-4},
    }
    flight = simulate(module, read_scenario("hover", changes))
    assert not flight.stopped
    assert flight.wall_forces[-1, 0] == pytest.approx(5.0, rel=0.01)


# Payloads


@pytest.mark.slow
def test_a_payload_is_a_heavier_body() -> None:
    """At the origin of a base it adds to the mass, which `[plant]` can as well."""
    module = emitted_module(parse_robot(TOP))
    common: dict[str, Any] = {
        "control": {"law": "off"},
        "start": {"turn_deg": [10, 20, 30]},
        "duration": 0.5,
        "wind": {"velocity": [5, 1, 2], "drag": {"base": 1.3}},
    }
    heavier = flown(module, **common, plant={"base_mass": 2.7})
    carried = flown(module, **common, payload=[{"frame": "base", "mass": 0.7}])
    free = flown(module, **common)
    assert carried.q == pytest.approx(heavier.q, abs=1e-10)
    assert carried.a == pytest.approx(heavier.a, abs=1e-9)
    assert np.abs(free.q - heavier.q).max() > 1e-2


def test_momentum_changes_as_gravity_and_the_recorded_wrenches_say(fast: Load) -> None:
    module = fast("hexarotor_3link")
    flight = flown(
        module,
        control={"law": "off"},
        start={"turn_deg": [10, 20, 30]},
        duration=0.6,
        push={"frame": "base", "force": [3, 2, 1], "torque": [0.1, 0.2, 0.3]},
        wind={"velocity": [4, 1, 0], "drag": {"base": 0.5, "tip": 0.3}},
        payload=[{"frame": "tip", "mass": 0.2}],
        wall=[{"frame": "tip", "point": [0, 0, -4.5], "normal": [0.1, 0.2, 1], "stiffness": 300}],
    )
    assert flight.frames == module.FRAMES
    momentum = module.centroidal_momentum(flight.q, flight.v)
    wrenches = flight.frame_wrenches
    lever = module.frame_poses(flight.q)[..., :3, 3] - module.centre_of_mass(flight.q)[:, None]
    weight = np.array([0.0, 0.0, -9.0 * GRAVITY])
    force = wrenches[..., :3].sum(axis=1) + weight
    torque = (wrenches[..., 3:] + np.cross(lever, wrenches[..., :3])).sum(axis=1)
    growth = np.concatenate([force, torque], axis=1)
    gained = cumulative_simpson(growth, x=flight.time, axis=0)
    assert (momentum - momentum[0])[1:] == pytest.approx(gained, abs=5e-3)


# Rotors that spin


@pytest.mark.slow
def test_a_spinning_top_precesses_as_euler_says() -> None:
    """A ω̇ + ω × (I ω + h) = 0: the transverse spin turns at ((C − A) ω_z + h) / A."""
    module = emitted_module(parse_robot(TOP))
    vehicle = Vehicle(module)
    thrust, spins = 4.0, np.array([0.03, 0.03])
    environment = Environment(vehicle, spins=spins)
    inputs = np.array([thrust, thrust])

    def derivative(time: float, state: Array) -> Array:
        q, v = vehicle.kinematics.normalised(state[:7]), state[7:]
        acting = wrenches(environment, q, v, inputs)
        return np.concatenate(
            [
                vehicle.kinematics.rates(state[:7], v),
                vehicle.forward_dynamics_with_wrenches(q, v, inputs, acting),
            ]
        )

    v = np.zeros(6)
    spin = vehicle.layout.v.attitude
    v[spin] = [0.3, 0.0, 0.5]
    found = solve_ivp(
        derivative, (0.0, 1.0), np.concatenate([vehicle.neutral, v]), rtol=1e-11, atol=1e-12
    ).y[7:, -1][spin]
    # The drag of both rotors turns it faster and faster.
    growth = -2.0 * 0.02 * thrust / 0.05
    held = 2.0 * 0.03 * np.sqrt(thrust)
    angle = ((0.05 - 0.03) * (0.5 + growth / 2.0) + held) / 0.03
    expected = [0.3 * np.cos(angle), 0.3 * np.sin(angle), 0.5 + growth]
    assert found == pytest.approx(expected, abs=1e-8)


@pytest.mark.slow
def test_a_rotor_on_a_link_resists_as_the_links_own_turning_says() -> None:
    """−ω × h by the Jacobian of a frame on the link; another frame that serves gives the same."""
    module = emitted_module(parse_robot(BRANCHES))
    vehicle = Vehicle(module)
    rng = np.random.default_rng(3)
    q, v = rng.uniform(-0.9, 0.9, (2, len(vehicle.coordinates)))
    inputs = np.array([5.0, 4.0, 3.0, 0.0, 0.0])
    environment = Environment(vehicle, spins=np.array([0.02, 0.0, -0.01]))
    acting = wrenches(environment, q, v, inputs)
    expected = np.zeros(len(v))
    jacobians, poses = module.frame_jacobians(q), module.frame_poses(q)
    for name, axis, momentum in (
        ("hand", None, 0.02 * np.sqrt(5.0)),
        ("base", [0.0, 0.0, 1.0], -0.01 * np.sqrt(3.0)),
    ):
        frame = module.FRAMES.index(name)
        turning = jacobians[frame, 3:]
        if axis is None:
            world = vehicle.base_rotation(q) @ vehicle.thrust_wrenches(q)[:3, 0]
        else:
            world = poses[frame, :3, :3] @ axis
        expected -= turning.T @ np.cross(turning @ v, momentum * world)
    assert module.wrench_forces(q, acting) == pytest.approx(expected, abs=1e-12)
    assert module.wrench_forces(q, acting) @ v == pytest.approx(0.0, abs=1e-12)
    assert np.abs(expected).max() > 1e-3
    with pytest.raises(UsageError, match=r"rotor 2 has a spin_inertia, but no frame moves with it"):
        RotorSpin(vehicle, np.array([0.0, 0.01, 0.0]))


# Four links whose turns at joint values in arithmetic progression cancel, and a rotor on the last.
FOLDED = """
name = "folded"
[base]
mass = 2
inertia = [0.02, 0.02, 0.03, 0, 0, 0]
{links}
[[rotor]]
on = "link4"
position = [0.2, 0.1, 0]
drag = 0.01
spin_inertia = 1e-4
speed_per_sqrt_thrust = 300
[[frame]]
name = "hand"
on = "link4"
"""
FOLDED_LINK = """
[[link]]
name = "link{number}"
joint = "{joint}"
axis = "{axis}"
xyz = [0.1, 0, 0]
mass = 0.3
inertia = [0.001, 0.002, 0.003, 0, 0, 0]
"""


def folded(joint: str, axes: tuple[str, ...]) -> Vehicle:
    links = [FOLDED_LINK.format(number=k, joint=joint, axis=x) for k, x in enumerate(axes, start=1)]
    return Vehicle(emitted_module(parse_robot(FOLDED.format(links="".join(links)))))


@pytest.mark.slow
def test_a_rotor_gives_its_torque_to_the_link_that_carries_it() -> None:
    vehicle = folded("revolute", ("y", "-y", "-y", "y"))
    rng = np.random.default_rng(3)
    q, v = rng.uniform(-0.9, 0.9, (2, len(vehicle.coordinates)))
    inputs = np.array([5.0, 0.0, 0.0, 0.0, 0.0])
    environment = Environment(vehicle, spins=np.array([0.02]))
    acting = wrenches(environment, q, v, inputs)
    turning = vehicle.function("frame_jacobians")(q)[vehicle.frames.index("hand"), 3:]
    axis = vehicle.frame_poses(q)[vehicle.frames.index("hand"), :3, 2]
    expected = -turning.T @ np.cross(turning @ v, 0.02 * np.sqrt(5.0) * axis)
    assert np.abs(expected).max() > 1e-3
    assert vehicle.wrench_forces(q, acting) == pytest.approx(expected, abs=1e-12)


@pytest.mark.slow
def test_rotors_move_with_slides_whose_travels_cancel() -> None:
    assert folded("prismatic", ("x", "-x", "-x", "x")).rotors_move


@pytest.mark.slow
def test_a_module_that_does_not_say_what_carries_its_rotors_is_asked_for_again() -> None:
    vehicle = folded("revolute", ("y", "-y", "-y", "y"))
    vars(vehicle.module).pop("CARRIERS", None)
    with pytest.raises(UsageError, match=r"folded: has no CARRIERS, .* earlier .* generate it aga"):
        RotorSpin(Vehicle(vehicle.module), np.array([0.02]))


# In C


@pytest.mark.slow
def test_every_compiled_step_is_that_of_python(fast: Load) -> None:
    module = fast("hexarotor_3link")
    model, vehicle = Vehicle(module), Vehicle(module, {"gravity": 9.7}, "plant")
    reference = desired_motion(model, read_scenario("circle"))
    gains = Gains.of(5.0, 1.0, len(vehicle.coordinates))
    controller = Controller(model, reference, allocation_of(model), gains)
    closed = ClosedLoop(vehicle, controller, Actuators.unlimited(vehicle))
    frame = vehicle.frames[-1]
    place = vehicle.frame_poses(closed.controller.reference(0.0)[0])[-1, :3, 3]
    environment = Environment(
        vehicle,
        Push((1, 2, 3), 0.0, 1.0, (0.1, 0.2, 0.1), "base"),
        (Payload("base", 0.5), Payload(frame, 0.2), Payload("base", 0.0)),
        Wind({"base": 0.4, frame: 0.1}, (3, 1, 0), (Gust((2, 0, 1), 0.01),), {"base": 0.01}),
        (
            Plane(frame, tuple(place + 0.05), (-1, 0.2, -3), 200.0, 3.0),
            Cylinder(frame, tuple(place + 0.2), (1, 2, -3), 0.4, 30.0, 1.0),
        ),
        np.array([0.01, -0.02, 0.03, 0.01, 0.0, 0.01]),
    )
    closed = replace(closed, environment=environment)
    q, v, _ = closed.controller.reference(0.0)
    state = closed.start(q, v + 0.3 * np.cos(np.arange(len(v))))
    for loads in (Loads(True, (True, True, True)), Loads(False, (False, True, False)), Loads()):
        if not is_compiled(closed, loads):
            pytest.skip("nothing compiles")
        loop = CompiledLoop(closed, np.inf, loads)
        after, step = state, 2.0**-10
        for done in range(8):
            time = done * step
            expected = closed.step(time, after, step, loads)
            taken, _, found = loop(time, after, step, 1)
            assert taken == 1
            moved = np.linalg.norm(expected - after)
            # The functions that Python calls were compiled with few optimisations, and the arm's
            # inertia about its own axis is 1e-5 kg m²: their rounding differs by as much.
            assert np.linalg.norm(found - expected) <= 1e-10 * (1.0 + moved)
            after = found


# What is refused


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"payload": [{"frame": "tipp", "mass": 1}]},
            r"payload 1: frame: hexarotor_3link has no frame tipp; did you mean tip\? its frames:"
            " base, tip",
        ),
        (
            {"wall": [{"frame": "x", "point": [0] * 3, "normal": [1, 0, 0], "stiffness": 1}]},
            r"wall 1: frame: hexarotor_3link has no frame x; its frames: base, tip",
        ),
        (
            {
                "payload": [{"frame": "tipp", "mass": 1}],
                "hold": [{"constraint": "stand"}],
                "arm.posture_deg": {"elbow": 1},
                "parameters": {"gravty": 9, "full_speed": 900},
                "plant": {"gravty": 8},
            },
            "(?s)parameters: unknown parameter 'gravty': .* unknown parameter 'full_speed': .*\n"
            "hexarotor_3link: plant: unknown parameter 'gravty': .*\n"
            "arm.posture_deg.elbow: .*\npayload 1: frame: .*\nhold 1: constraint: ",
        ),
        ({"wind": {"drag": {"arm": 1}}}, r"wind.drag: hexarotor_3link has no frame arm"),
        (
            {"wind": {"drag": {"base": 1}, "rotational_drag": {"arm": 1}}},
            r"wind.rotational_drag: hexarotor_3link has no frame arm",
        ),
        (
            {"plant": {"gravty": 9}},
            r"hexarotor_3link: plant: unknown parameter 'gravty': did you mean gravity\?; "
            r"PARAMETERS of the module lists all \d+$",
        ),
        ({"plant": {"zzz": 9}}, r"'zzz': PARAMETERS has all names; its parameters: gravity, "),
        (
            {"plant": {"gravity": 9, "link2_mass_per_length": -100}},
            r"acceleration undetermined: .*; given: gravity = 9, link2_mass_per_length = -100$",
        ),
        ({"plant": {"link2_mass_per_length": -100}}, "3link: plant: these parameters leave an"),
    ],
)
def test_what_the_robot_does_not_have_is_refused(
    changes: dict[str, Any], message: str, fast: Load
) -> None:
    with pytest.raises(UsageError, match=message):
        simulate(fast("hexarotor_3link"), read_scenario("hover", changes))
