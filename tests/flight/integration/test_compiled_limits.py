"""The compiled loop at limits, with rotors that joints move, and with inputs that are held."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest
from numpy.typing import NDArray
from support.tools import missing

from gibbs_codegen.flight.control.laws import Controller, Gains
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.compiled_loop import (
    CompiledLoop,
    CompiledLoops,
)
from gibbs_codegen.flight.integration.state_history import NOTHING, Loads
from gibbs_codegen.flight.plant.actuators import Actuators
from gibbs_codegen.flight.plant.allocation import AllocationError, allocation_of
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.reference import Motion
from gibbs_codegen.flight.scenario.parts import Law
from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.runtime.load import load

pytestmark = pytest.mark.usefixtures("derived_once")

Array = NDArray[np.float64]
Load = Callable[[str], ModuleType]

# Seven rotors, of which three go with a joint: their wrenches and what they load it with change.
MOVING = "moving"
_ROTORS = (
    ("base", "0.3, 0.0, 0.0", "0.2, 0.1, 1.0", "0.01"),
    ("base", "0.0, 0.3, 0.0", "-0.4, 0.3, 1.0", "-0.01"),
    ("base", "-0.3, 0.1, 0.0", "0.1, -0.6, 1.0", "0.02"),
    ("base", "0.0, -0.3, 0.1", "0.7, 0.2, 0.5", "-0.02"),
    ("arm", "0.2, 0.2, 0.0", "-0.3, -0.3, 1.0", "0.01"),
    ("arm", "0.1, -0.3, 0.1", "-0.2, 0.9, 0.5", "-0.01"),
    ("arm", "0.3, 0.1, 0.0", "-0.6, -0.1, 0.8", "0.01"),
)
_ROBOT = """
name = "moving"
gravity = 9.81
[base]
attitude = "quaternion"
origin = "base"
mass = 1.0
com = [0.01, 0.02, -0.03]
inertia = [0.01, 0.02, 0.025, 0.001, 0.0, 0.002]
{rotors}
[[link]]
name = "arm"
joint = "revolute"
axis = "y"
xyz = [0.1, 0.0, -0.1]
mass = 0.4
com = [0.1, 0.0, 0.02]
inertia = [0.001, 0.004, 0.004, 0.0, 0.0, 0.0]
"""
_ROTOR = '[[rotor]]\non = "{}"\nposition = [{}]\ndirection = [{}]\ndrag = {}\n'


@pytest.fixture(scope="module")
def modules(fast: Load, tmp_path_factory: pytest.TempPathFactory) -> Load:
    """Load the C back end of a robot that ships, or of MOVING."""
    folder = tmp_path_factory.mktemp("moving")

    def module(name: str) -> ModuleType:
        if name != MOVING:
            found = fast(name)
        else:
            if not (folder / MOVING).is_dir():
                text = _ROBOT.format(rotors="".join(_ROTOR.format(*each) for each in _ROTORS))
                (folder / "moving.toml").write_text(text, encoding="utf-8")
                robot, text = read_robot(str(folder / "moving.toml"))
                generate_robot(robot, text, folder, verify=False)
            found = load(folder / MOVING, backend="c")
        if (found.__file__ or "").endswith(".py"):
            missing("nothing compiles")
        return found

    return module


def closed_loop_of(
    module: ModuleType, law: Law = "computed_torque", limited: bool = True
) -> ClosedLoop:
    """A loop whose limits many wrenches meet; all motors lag by 1 s, so rates tell commands."""
    vehicle = Vehicle(module)
    layout, count = vehicle.layout, vehicle.layout.v.size
    time, rates = np.linspace(0.0, 0.5, 8), 1.0 + 0.3 * np.arange(count)
    phases = rates * time[:, np.newaxis] + np.arange(count)
    q, v, a = np.sin(phases), rates * np.cos(phases), -(rates**2) * np.sin(phases)
    if layout.is_quaternion:  # The base stays, turned; joints move.
        joints, q = q[:, layout.v.joints], np.zeros((8, layout.q.size))
        q[:, layout.q.joints], q[:, layout.q.attitude] = joints, [0.5, 0.5, -0.5, 0.5]
        v[:, [*range(6)]], a[:, [*range(6)]] = 0.0, 0.0
    typical = np.abs(allocation_of(vehicle).inverse[:, 2]).max() * 30.0
    share = np.linspace(0.6, 1.4, vehicle.rotors)
    limits = np.array([-0.3 * typical * share, typical * share])
    actuators = Actuators.unlimited(vehicle)
    actuators.lag[:] = 1.0
    if limited:
        actuators.thrusts[:] = limits
        actuators.efforts[:] = 0.5
    allocation = allocation_of(vehicle, limits=limits if limited else None)
    gains = Gains.of(np.linspace(4.0, 9.0, count), np.linspace(0.5, 1.1, count), count)
    reference = vehicle.kinematics.reference(Motion(time, q, v, a))
    return ClosedLoop(vehicle, Controller(vehicle, reference, allocation, gains, law), actuators)


def states_near(closed: ClosedLoop, count: int) -> list[tuple[float, Array]]:
    """Times, and states beside the reference there with thrusts of zero."""
    random, found = np.random.default_rng(5), []
    for time in random.uniform(0.0, 0.5, count).tolist():
        q, v, _ = closed.controller.reference(time)
        off = 0.2 * random.standard_normal(len(q)), random.standard_normal(len(v))
        rest = np.zeros(1 + closed.vehicle.rotors)
        found.append((time, np.concatenate([q + off[0], v + off[1], rest])))
    return found


@pytest.mark.parametrize("name", ["hexarotor", "hexarotor_3link", MOVING])
@pytest.mark.parametrize("limited", [True, False])
def test_commands_are_those_of_python(name: str, limited: bool, modules: Load) -> None:
    """Python allocates by singular values, and within limits by SciPy's bounded least squares."""
    closed = closed_loop_of(modules(name), limited=limited)
    assert closed.vehicle.rotors_move == (name == MOVING)
    slope, at_limits = CompiledLoop(closed, np.inf).slope, 0
    for time, state in states_near(closed, 30):
        expected = closed.derivative(time, state)
        thrusts = expected[-closed.vehicle.rotors :]
        at_limits += bool(np.any(np.isclose(thrusts, closed.actuators.thrusts, atol=1e-12)))
        found = slope(time, state)
        assert found == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(thrusts).max())
    assert at_limits >= 20 * limited


def test_what_was_found_before_does_not_matter(modules: Load) -> None:
    """At limits the loop begins with the guesses that were right the last time."""
    closed = closed_loop_of(modules(MOVING))
    loop, states = CompiledLoop(closed, np.inf), states_near(closed, 30)
    once = [loop(time, state, 2.0**-8, 1)[2] for time, state in states]
    again = [loop(time, state, 2.0**-8, 1)[2] for time, state in reversed(states)]
    assert np.allclose(once, again[::-1], rtol=1e-13, atol=1e-12)


def test_steps_at_limits_stay_in_c(modules: Load) -> None:
    closed = closed_loop_of(modules("hexarotor_3link"))
    time, state = states_near(closed, 1)[0]
    taken, samples, _ = CompiledLoop(closed, np.inf)(time, state, 2.0**-8, 20)
    assert taken == 20
    assert closed.saturated(time, state)
    for done, after in enumerate(samples):
        expected = closed.step(time + done * 2.0**-8, state, 2.0**-8, NOTHING)
        assert after == pytest.approx(expected, rel=1e-9, abs=1e-9)
        state = after


def test_a_wrench_that_rotors_cannot_produce_is_left_to_python(modules: Load) -> None:
    closed = closed_loop_of(modules("quadrotor_2link"), limited=False)
    assert closed.controller.allocation.missing
    time, state = states_near(closed, 1)[0]
    loop = CompiledLoop(closed, np.inf)
    assert CompiledLoop(closed, np.inf).slope(time, state) is None
    taken, samples, last = loop(time, state, 2.0**-8, 20)
    assert taken == len(samples) == 0
    assert np.array_equal(last, state)
    with pytest.raises(AllocationError):
        closed.derivative(time, state)


@pytest.mark.parametrize("name", ["hexarotor", MOVING])
def test_held_inputs_act_all_through(name: str, modules: Load) -> None:
    """One compiled loop serves them all, in steps of any length."""
    closed = closed_loop_of(modules(name))
    loops = CompiledLoops(closed, np.inf)
    time, state = states_near(closed, 1)[0]
    for held, step in ((1.0, 2.0**-8), (200.0, 2.0**-9)):
        loads = Loads(inputs=(*held * np.linspace(0.5, 1.0, len(closed.vehicle.inputs)),))
        loop = loops.at(loads)
        assert loop is not None
        assert loop is loops.at(loads._replace())
        taken, samples, _ = loop(time, state, step, 5)
        assert taken == 5
        for done, after in enumerate(samples):
            expected = closed.step(time + done * step, state, step, loads)
            assert after == pytest.approx(expected, rel=1e-11, abs=1e-11)
            state = after
