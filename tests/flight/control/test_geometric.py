"""The geometric law: its error dynamics, its feedforward, what it commands, and recoveries."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.emitted import emitted_module
from support.tools import missing

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.control.choice import control_law
from gibbs_codegen.flight.control.error_polynomials import error_polynomials
from gibbs_codegen.flight.control.geometric import LeaningController
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.compiled_loop import (
    CompiledLoop,
    is_compiled,
)
from gibbs_codegen.flight.integration.state_history import NOTHING
from gibbs_codegen.flight.plant.actuators import Actuators
from gibbs_codegen.flight.plant.allocation import allocation_of, force_axis
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.reference import Motion, Reference
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.parts import Control, Settings
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.simulation import simulate
from gibbs_codegen.robot.file import read_robot

Load = Callable[[str], ModuleType]

CONTROL = Control("geometric", frequency=3.0, damping_ratio=0.8, attitude_frequency=14.0)
ANGLES = "quadrotor with attitude angles"
# Hydrus with its joints at these angles commands three moments, and at zero it does not.
BENT = np.array([1.1, 0.9, 1.3])


@pytest.fixture(scope="module")
def machines(fast: Load) -> Load:
    """Load the C back end of a robot that ships, or NumPy's of the quadrotor with angles y-x-z."""
    robot, _ = read_robot("quadrotor")
    angles = emitted_module(replace(robot, base=replace(robot.base, attitude="yxz")))
    return lambda name: angles if name == ANGLES else fast(name)


@pytest.fixture(scope="module")
def motions(machines: Load) -> Callable[[str], Motion]:
    """A motion of a machine that its rotors can fly, made once."""
    return functools.cache(lambda name: base_motion_of(Vehicle(machines(name))))


def law_of(vehicle: Vehicle, reference: Reference, control: Control = CONTROL) -> LeaningController:
    law = control_law("geometric", control, vehicle, reference, allocation_of(vehicle))
    assert isinstance(law, LeaningController)
    return law


def base_motion_of(vehicle: Vehicle) -> Motion:
    """A motion that the rotors can fly, since they have: from thrusts and torques in time."""
    joints = np.zeros(vehicle.joints) if vehicle.joints != 3 else BENT
    q = vehicle.neutral
    q[vehicle.arm] = joints
    v = np.zeros(vehicle.layout.v.size)
    rng = np.random.default_rng(4)
    weight = law_of(vehicle, resting(vehicle, q)).weight[2]
    thrusts = np.full(vehicle.rotors, weight / vehicle.rotors)
    hold = vehicle.inverse_dynamics(q, v, v)[vehicle.arm_rates]
    size = rng.normal(size=(3, len(thrusts) + len(hold)))
    scale = np.concatenate([0.2 * thrusts, np.full(len(hold), 0.02)])
    step, motion = 2e-3, []

    def growth(time: float, state: Array) -> Array:
        at, rate = vehicle.kinematics.normalised(state[: len(q)]), state[len(q) :]
        wave = size[0] * np.sin(9.0 * time) + size[1] * np.cos(7.0 * time) + size[2] * time
        inputs = np.concatenate([thrusts, hold]) + scale * wave
        acceleration = vehicle.forward_dynamics(at, rate, inputs)
        return np.concatenate([vehicle.kinematics.rates(state[: len(q)], rate), acceleration])

    state = np.concatenate([q, v])
    for time in step * np.arange(120):
        slope = growth(time, state)
        motion.append((time, state[: len(q)], state[len(q) :], slope[len(q) :]))
        second = growth(time + step / 2.0, state + step / 2.0 * slope)
        third = growth(time + step / 2.0, state + step / 2.0 * second)
        fourth = growth(time + step, state + step * third)
        state = state + step / 6.0 * (slope + 2.0 * second + 2.0 * third + fourth)
    return Motion(*(np.array(part) for part in zip(*motion, strict=True)))


def resting(vehicle: Vehicle, q: Array) -> Reference:
    """The reference that rests at coordinates (nq)."""
    still = np.zeros((2, vehicle.layout.v.size))
    motion = Motion(np.array([0.0, 1.0]), np.stack([q, q]), still, still)
    return vehicle.kinematics.reference(motion)


@pytest.mark.parametrize("name", ["quadrotor", ANGLES])
def test_without_errors_the_inputs_are_those_that_flew(
    name: str, machines: Load, motions: Callable[[str], Motion]
) -> None:
    """Feedforward is exact: also while the base leans and turns, and the arms swing."""
    vehicle = Vehicle(machines(name))
    motion = motions(name)
    law = law_of(vehicle, vehicle.kinematics.reference(motion))
    q, v = vehicle.kinematics.normalised(motion.q), motion.v
    inputs = law(motion.time, q, v)
    assert vehicle.forward_dynamics(q, v, inputs) == pytest.approx(motion.a, rel=0, abs=1e-6)
    tilt = vehicle.base_rotation(q[-1])[2, 2]
    assert tilt < 0.999
    assert np.ptp(motion.a, axis=0).min() > 1e-3


@pytest.mark.parametrize(
    ("name", "lag"),
    [
        ("quadrotor", 0.0),
        pytest.param("dual_arm", 0.0, marks=pytest.mark.slow),
        ("quadrotor", 0.02),
    ],
)
def test_small_errors_decay_by_the_polynomials(name: str, lag: float, machines: Load) -> None:
    """Eigenvalues of the loop at a hover, by finite differences of its derivative."""
    vehicle = Vehicle(machines(name))
    law = law_of(vehicle, resting(vehicle, vehicle.neutral))
    actuators = Actuators.unlimited(vehicle)
    actuators.lag[:] = lag
    loop = ClosedLoop(vehicle, law, actuators)
    rest = loop.start(*law.reference(0.0)[:2])
    keep = np.delete(np.arange(loop.size), loop.layout.places.work)
    size, nq = 1e-5, vehicle.layout.q.size
    slopes = [
        (loop.derivative(0.5, rest + step) - loop.derivative(0.5, rest - step))[keep] / (2.0 * size)
        for step in size * np.eye(loop.size)[keep]
    ]
    # The length of the quaternion, which stands for nothing, has a rate of zero.
    scalar = vehicle.layout.q.attitude.stop - 1
    matrix = np.delete(np.delete(np.transpose(slopes), scalar, 0), scalar, 1)
    found = np.linalg.eigvals(matrix)
    assert len(found) == nq - 1 + vehicle.layout.v.size + (vehicle.rotors if lag else 0)
    *heights, sideways = error_polynomials(law, [lag] if lag else [])[-4 if lag else -2 :]
    joints = np.roots(heights[0])
    height, sideways = (np.roots(each) for each in (heights[1 if lag else 0], sideways))
    wanted = [*np.tile(height, 2), *np.tile(sideways, 2), *np.tile(joints, vehicle.joints)]
    for one, other in ((found, wanted), (wanted, found)):
        assert max(np.min(np.abs(one - each)) for each in other) < 1e-3
    assert max(found.real) < -1.0


def test_integrals_decay_by_the_polynomials(machines: Load) -> None:
    """As before, of position and its integral; that of the attitude is not remembered."""
    vehicle = Vehicle(machines("quadrotor"))
    control = replace(CONTROL, integral=2.0)
    law = law_of(vehicle, resting(vehicle, vehicle.neutral), control)
    loop = ClosedLoop(vehicle, law, Actuators.unlimited(vehicle))
    rest = loop.start(*law.reference(0.0)[:2])
    attitude = np.arange(loop.size)[loop.layout.places.memory][vehicle.layout.v.attitude]
    scalar = vehicle.layout.q.attitude.stop - 1
    keep = np.setdiff1d(np.arange(loop.size), [loop.layout.places.work.start, scalar, *attitude])
    size = 1e-5
    slopes = [
        (loop.derivative(0.5, rest + step) - loop.derivative(0.5, rest - step))[keep] / (2.0 * size)
        for step in size * np.eye(loop.size)[keep]
    ]
    found = np.linalg.eigvals(np.transpose(slopes))
    wanted = np.concatenate([np.roots(each) for each in error_polynomials(law, [])])
    assert sorted(len(each) - 1 for each in error_polynomials(law, [])) == [2, 3, 5]
    for one, other in ((found, wanted), (wanted, found)):
        assert max(np.min(np.abs(one - each)) for each in other) < 1e-3


@pytest.mark.parametrize(
    "name", ["quadrotor", ANGLES, "dual_arm", pytest.param("hydrus", marks=pytest.mark.slow)]
)
def test_from_any_state_joints_and_centre_of_mass_move_as_the_law_says(
    name: str, machines: Load, motions: Callable[[str], Motion]
) -> None:
    """Also far from the desired motion: arms pull at the base, and are not let sway its centre."""
    vehicle = Vehicle(machines(name))
    law = law_of(vehicle, vehicle.kinematics.reference(motions(name)))
    rng = np.random.default_rng(8)
    time = rng.uniform(0.0, 0.2, 6)
    desired = law.reference(time)
    q = vehicle.kinematics.normalised(desired[0] + rng.normal(size=desired[0].shape) * 0.2)
    v = desired[1] + rng.normal(size=desired[1].shape) * 0.3
    a = vehicle.forward_dynamics(q, v, law(time, q, v))
    at, rate = vehicle.arm, vehicle.arm_rates
    k, d = (gains[rate] for gains in (law.gains.stiffness, law.gains.damping))
    joints = k * (desired[0] - q)[:, at] + d * (desired[1] - v)[:, rate] + desired[2][:, rate]
    assert a[:, rate] == pytest.approx(joints, abs=1e-8)
    # By momentum, whose rate needs no law: of the centre of mass, by finite differences.
    size = 1e-6
    ahead = [vehicle.integrate(q, sign * size * v + 0.5 * size**2 * a) for sign in (1.0, -1.0)]
    places = [vehicle.centre_of_mass(each) for each in (ahead[0], q, ahead[1])]
    force = law.vehicle.mass * (places[0] - 2.0 * places[1] + places[2]) / size**2 + law.weight
    along = vehicle.base_rotation(q)[:, :, 2]
    thrust = np.sum(force * along, axis=-1, keepdims=True)
    assert force == pytest.approx(thrust * along, abs=2e-2)
    wanted, speed, acceleration = law.centre(time)
    velocity = (places[0] - places[2]) / (2.0 * size)
    wish = 9.0 * (wanted - places[1]) + 2 * 0.8 * 3.0 * (speed - velocity)
    needed = acceleration + law.weight / law.vehicle.mass
    most = 0.8 * np.linalg.norm(needed, axis=-1, keepdims=True)
    wish /= np.sqrt(1.0 + np.sum(wish**2, axis=-1, keepdims=True) / most**2)
    asked = law.vehicle.mass * np.sum((needed + wish) * along, axis=-1, keepdims=True)
    assert thrust == pytest.approx(np.maximum(asked, 0.0), abs=2e-2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "limits", "lag", "integral"),
    [("quadrotor", (0.0, 8.5), 0.0, 0.0)],
)
def test_every_step_in_c_is_that_of_python(
    name: str,
    limits: tuple[float, float],
    lag: float,
    integral: float,
    machines: Load,
    motions: Callable[[str], Motion],
) -> None:
    """From each state that C comes to, Python takes the next step to the same state."""
    vehicle = Vehicle(machines(name))
    if (vehicle.module.__file__ or "").endswith(".py"):
        missing("nothing compiles")
    reference = vehicle.kinematics.reference(motions(name))
    allocation = allocation_of(vehicle, limits=limits)
    control = replace(CONTROL, integral=integral)
    law = control_law("geometric", control, vehicle, reference, allocation)
    actuators = Actuators.unlimited(vehicle)
    actuators.lag[:] = lag
    closed = ClosedLoop(vehicle, law, actuators)
    q, v, _ = reference(0.0)
    rng = np.random.default_rng(6)
    state = closed.start(q, v) + 0.4 * rng.normal(size=closed.size)
    loop = CompiledLoop(closed, np.inf)
    step = 2.0**-8
    taken, samples, _ = loop(0.0, state, step, 30)
    assert taken == 30
    for done, after in enumerate(samples):
        expected = closed.step(done * step, state, step, NOTHING)
        moved = np.linalg.norm(expected - state)
        assert np.linalg.norm(after - expected) <= 1e-10 * (np.linalg.norm(state) + moved)
        state = after


def start(case: int) -> tuple[float, float, float]:
    """A turn at the start, degrees: rolled by 90°, upside down, or anyhow."""
    if case in (0, 7):
        return (90.0 if case == 0 else 180.0, 0.0, 0.0)
    x, y, z = np.degrees(Rotation.random(random_state=case).as_rotvec())
    return (float(x), float(y), float(z))


@pytest.mark.slow
@pytest.mark.parametrize("case", [0])
def test_it_recovers_from_any_attitude(case: int, fast: Load) -> None:
    """With the limits of its motors, and their lag."""
    flight = simulate(fast("quadrotor"), hover(start(case), 4.0))
    assert (flight.stopped, flight.law) == ("", "geometric")
    assert flight.centre_error.max() < 2.0
    assert np.abs(flight.errors[-1]).max() < 1e-4


@pytest.mark.slow
def test_the_heading_may_be_the_opposite(fast: Load) -> None:
    """Half a turn about the thrust axis: there are two ways, and either does."""
    flight = simulate(fast("quadrotor"), hover((0.0, 0.0, 180.0), 3.0))
    assert flight.centre_error.max() < 0.05
    assert np.abs(flight.errors[-1]).max() < 1e-3


def test_a_heading_exactly_opposite_turns(machines: Load) -> None:
    """By half a turn, about which quaternions say nothing more; as fast in C as in Python."""
    vehicle = Vehicle(machines("quadrotor"))
    law = law_of(vehicle, resting(vehicle, vehicle.neutral))
    loop = ClosedLoop(vehicle, law, Actuators.unlimited(vehicle))
    state = loop.start(*law.reference(0.0)[:2])
    state[vehicle.layout.q.attitude] = [0.0, 0.0, 1.0, 0.0]
    rate = loop.derivative(0.0, state)
    spin = rate[len(vehicle.neutral) + vehicle.layout.v.attitude.stop - 1]
    assert np.abs(spin) == pytest.approx(np.pi * CONTROL.frequency**2)
    if is_compiled(loop, NOTHING):
        found = CompiledLoop(loop, np.inf).slope(0.0, state)
        assert found is not None
        assert np.abs(found) == pytest.approx(np.abs(rate), abs=1e-9)  # Either way round.


def test_the_axis_is_that_of_all_rotors() -> None:
    wrenches = np.zeros((6, 4))
    wrenches[2] = [-1.0, 2.0, 2.0, 0.0]
    assert force_axis(wrenches).tolist() == [0.0, 0.0, 1.0]
    assert force_axis(np.stack([wrenches, -wrenches]))[:, 2].tolist() == [1.0, -1.0]
    wrenches[2] = [0.0, -1.0, -1.0, -1.0]
    assert force_axis(wrenches).tolist() == [0.0, 0.0, -1.0]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["rk4"])
@pytest.mark.parametrize("push", [{"force": [1e4, 0, 0]}])
def test_a_machine_that_tumbles_ends_with_the_reason_and_its_data(
    method: str, push: dict[str, object], fast: Load
) -> None:
    acts = {"frame": "base", "begin": 0.1, "end": 0.5, **push}
    integration = {"method": method, "rate": 50}
    flight = simulate(
        fast("quadrotor"), read_scenario("hover", {"push": acts, "integration": integration})
    )
    assert "control is lost" in flight.stopped
    assert flight.time[-1] > 0.1
    assert np.all(np.isfinite(flight.commanded))


def test_without_gravity_nothing_tells_how_the_base_must_lean(fast: Load) -> None:
    words = r"quadrotor: at t = 0 s .*determines how the base leans; set parameters\.gravity"
    with pytest.raises(UsageError, match=words):
        simulate(fast("quadrotor"), read_scenario("hover", {"parameters": {"gravity": 0}}))
    vehicle = Vehicle(fast("quadrotor"), {"gravity": 0})
    with pytest.raises(
        UsageError, match="needs no thrust, and the direction of the thrust determines"
    ):
        law_of(vehicle, resting(vehicle, vehicle.neutral))


def hover(turn: tuple[float, float, float], duration: float) -> Scenario:
    changes = {"start": {"turn_deg": list(turn)}, "duration": duration}
    rk4 = Settings(method="rk4", step=4e-3, rate=50.0)
    return replace(read_scenario("hover", changes), integration=rk4)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["quadrotor"])
def test_a_circle_is_flown_as_planned(name: str, fast: Load) -> None:
    """With an exact model and no lag."""
    changes = {"duration": 3, "motors": {"time_constant": 0}}
    rk4 = Settings(method="rk4", step=4e-3)
    flight = simulate(fast(name), replace(read_scenario("circle", changes), integration=rk4))
    assert (flight.stopped, flight.law) == ("", "geometric")
    assert np.sqrt(np.mean(flight.centre_error**2)) < 1e-4
