"""Mass properties, hover thrusts and margins of robots whose rotors stand anywhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import ROOT
from scipy.integrate import solve_ivp
from support.actuated import TEXT
from support.emitted import emitted_module

from gibbs_codegen.errors import RobotFileError
from gibbs_codegen.robot.balance import (
    arrangement,
    balance_lines,
    carried_rotors,
    holding_efforts,
    hover,
    hover_commands,
    hover_lines,
    ranks_in_motion,
    wrench_matrix,
)
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.file import parse_robot, read_robot
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.posture import carried_inertia, whole_properties
from gibbs_codegen.robot.text import placed_robot_text

ACTUATED = parse_robot(TEXT)
QUADROTOR = read_robot("quadrotor")[0]
DUAL_ARM = read_robot("dual_arm")[0]
HYDRUS = read_robot("hydrus")[0]
EVERYTHING = parse_robot((ROOT / "tests" / "robots" / "everything.toml").read_text())
# The mass of the last link, 0.2 kg, is 0.1 m in front of both joints, which lift it by axes -y.
FOREARM = parse_robot(
    placed_robot_text("arm")
    .replace("mass       = 0.16", "mass = 0.2")
    .replace("com        = [0, 0, -0.08]", "com = [0.1, 0, -0.08]")
)


OF_DUAL_ARM = ("mass_matrix", "centre_of_mass", "inverse_dynamics", "forward_dynamics")


@pytest.mark.slow
def test_whole_machine_is_that_of_the_emitted_functions() -> None:
    """At any configuration of the joints, the base at the origin of the world."""
    module, layout = emitted_module(DUAL_ARM, *OF_DUAL_ARM), layout_of(DUAL_ARM)
    joints = np.random.default_rng(1).normal(size=len(DUAL_ARM.moving))
    q = np.array(layout.neutral)
    q[layout.q.joints] = joints
    found = whole_properties(DUAL_ARM, joints)
    matrix, (x, y, z) = module.mass_matrix(q), found.com
    assert np.allclose(found.com, module.centre_of_mass(q), atol=1e-12)
    assert found.mass == pytest.approx(matrix[0, 0], rel=1e-12)
    xx, yy, zz, xy, xz, yz = found.inertia
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    assert np.allclose(matrix[3:6, 3:6], inertia - found.mass * skew @ skew, atol=1e-12)


@pytest.mark.slow
def test_what_a_joint_carries_is_its_entry_of_the_emitted_mass_matrix() -> None:
    layout = layout_of(EVERYTHING)
    matrix = emitted_module(EVERYTHING, "mass_matrix").mass_matrix(np.array(layout.neutral))
    turning = [
        (i, place)
        for i, place in zip(EVERYTHING.moving, layout.v.joint_places, strict=True)
        if EVERYTHING.links[i - 1].joint == "revolute"
    ]
    assert len(turning) > 2
    for i, place in turning:
        armature = EVERYTHING.links[i - 1].passive.armature
        assert carried_inertia(EVERYTHING, i) == pytest.approx(matrix[place, place] - armature)


@pytest.mark.slow
def test_wrenches_are_those_of_the_emitted_input_matrix() -> None:
    """Rotors on links, joints bent; generalised forces of the base are the wrench itself."""
    robot = replace(HYDRUS, base=replace(HYDRUS.base, attitude="quaternion"))
    module, layout = emitted_module(robot, "input_matrix"), layout_of(robot)
    joints = np.array([0.4, -0.9, 1.3])
    q = np.array(layout.neutral)
    q[layout.q.joints] = joints
    matrix = module.input_matrix(q)
    assert np.allclose(wrench_matrix(robot, joints), matrix[:6, : robot.rotors], atol=1e-12)


@pytest.mark.slow
def test_hover_holds_the_machine_with_joints_at_zero() -> None:
    module, layout = emitted_module(DUAL_ARM, *OF_DUAL_ARM), layout_of(DUAL_ARM)
    q, still = np.array(layout.neutral), np.zeros(layout.v.size)
    thrusts = hover(DUAL_ARM).thrusts
    assert thrusts is not None
    u = np.zeros(len(module.INPUTS))
    u[: DUAL_ARM.rotors] = thrusts
    u[DUAL_ARM.rotors :] = module.inverse_dynamics(q, still, still)[layout.v.joints]
    assert np.allclose(module.forward_dynamics(q, still, u), 0.0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("robot", [HYDRUS, EVERYTHING])
def test_efforts_that_hold_the_joints_are_those_of_the_emitted_functions(robot: Robot) -> None:
    """Also with rotors on links, springs and joints that slide, and thrusts that do not hover."""
    module, layout = emitted_module(robot), layout_of(robot)
    q, still = np.array(layout.neutral), np.zeros(layout.v.size)
    thrusts = np.random.default_rng(2).normal(size=robot.rotors)
    force = module.inverse_dynamics(q, still, still)
    force -= module.input_matrix(q)[:, : robot.rotors] @ thrusts
    assert holding_efforts(robot, thrusts) == pytest.approx(force[layout.v.joints])
    assert any(effort != 0.0 for effort in holding_efforts(robot, thrusts))


def test_hover_thrusts_are_told_with_the_torques_of_the_joints() -> None:
    told = hover_lines(FOREARM, hover(FOREARM))[1]
    assert told == "joint torques that hold it there: shoulder 0.1962 N m, elbow 0.1962 N m"
    delta = read_robot("delta_hexarotor")[0]
    assert hover_lines(delta, hover(delta))[1].endswith(
        "see trim, because loops carry part of them"
    )
    upper, lower = FOREARM.links
    sliding = replace(FOREARM, links=(upper, replace(lower, joint="prismatic", axis=(0, 0, 1))))
    assert hover_lines(sliding, hover(sliding))[1].endswith("shoulder 0.1962 N m, elbow 1.962 N")


def test_no_torques_are_told_of_an_arm_that_hangs() -> None:
    """Where it hangs is not looked for; there a joint that slides, or has a spring, takes some."""
    hanging = paper_family(6, 1)
    slider = replace(hanging.links[0], joint="prismatic")
    assert "torques" not in str(balance_lines(replace(hanging, links=(slider,))))


def test_the_margin_is_how_much_heavier_the_robot_may_be() -> None:
    found = hover(QUADROTOR)
    assert found.thrusts == pytest.approx([1.5 * 9.81 / 4] * 4)
    assert found.margin == pytest.approx(4 * 8.5 / (1.5 * 9.81))
    assert not found.beyond
    weak = replace(
        QUADROTOR, thrusters=tuple(replace(r, limits=(0.0, 3.0)) for r in QUADROTOR.thrusters)
    )
    found = hover(weak)
    assert found.margin == pytest.approx(12 / (1.5 * 9.81))
    assert found.beyond == (1, 2, 3, 4)
    *_, margin, beyond = hover_lines(weak, found)
    assert margin == "thrust margin: the limits carry 0.815 times the weight"
    assert beyond.endswith("front_left, rear_left, rear_right, front_right")
    unlimited = replace(QUADROTOR, thrusters=(replace(QUADROTOR.thrusters[0], limits=None),) * 4)
    assert hover(unlimited).margin is None


def test_what_thrusts_leave_that_carry_the_weight_is_told() -> None:
    """A rotor beside the centre of mass lifts the robot and tilts it; another one balances it."""
    text = 'name = "one"\n[base]\nmass = 2\n[[rotor]]\nposition = [0.1, 0, 0]\nlimits = [0, 9]\n'
    one = parse_robot(f"gravity = 10\n{text}")
    found = hover(one)
    assert found.thrusts is None
    assert found.moment == pytest.approx((0.0, 2.0, 0.0))
    line = "hover thrusts: no thrusts hold it level; a moment of 0, 2, 0 N m remains (level)"
    assert found.lifting == pytest.approx((20.0,))
    lifts = "thrusts that carry the weight: 20 N"
    assert balance_lines(one)[2:] == [line, lifts]
    keys = 'command = "throttle"\nfull_speed = 900\nmax_thrust = 80\n'
    throttled = parse_robot(f"gravity = 10\n{text.replace('limits = [0, 9]', keys)}")
    assert balance_lines(throttled)[2:] == [line, lifts, "hover throttle: 50 %; 50 % remain"]
    two = parse_robot(f"{text}[[rotor]]\nposition = [0.05, 0, 0]\nlimits = [0, 9]\n")
    assert hover(two).moment is None
    assert (
        hover_lines(two, hover(two))[1] == "thrust margin: no thrusts within the limits hover here"
    )


def test_a_robot_without_rotors_is_told_plainly() -> None:
    robot = parse_robot('name = "bare"\n[base]\nmass = 1\ninertia = [1, 1, 1, 0, 0, 0]\n')
    assert hover(robot).thrusts is None
    assert arrangement(robot).rank == 0
    assert balance_lines(robot)[-1] == "hover thrusts: the robot has no rotors"


def test_rotors_on_links_command_other_wrenches_as_the_joints_move() -> None:
    assert carried_rotors(HYDRUS) == (2, 3, 4)
    assert arrangement(HYDRUS).rank == 3
    assert arrangement(HYDRUS, [0.5, 0.5, 0.5]).rank == 4
    assert ranks_in_motion(HYDRUS) == (4, 4)
    assert ranks_in_motion(QUADROTOR) is None


@pytest.mark.parametrize(
    ("changes", "until"),
    [
        ({}, "it is empty"),
        ({"resistance": 0.15}, "the throttle no longer suffices"),
        ({"resistance": 0.25, "nominal": 9.0}, "its power no longer suffices"),
        ({"resistance": 0.9}, "its power no longer suffices"),
    ],
)
def test_a_battery_lasts_as_long_as_the_emitted_rates_discharge_it(
    changes: dict[str, float], until: str
) -> None:
    """The voltage is what a rotor's level rises to; SciPy integrates, and looks for the end."""
    robot = replace(ACTUATED, battery=replace(ACTUATED.battery, **changes))
    thrusts = hover(robot).thrusts
    assert thrusts is not None
    found = hover_commands(robot, thrusts)
    assert found.battery is not None
    assert found.left is not None
    module = emitted_module(ACTUATED)
    own = {f"battery_{key}": value for key, value in changes.items()}
    constants = module.prepare(module.PARAMETERS | own)
    q = np.array(layout_of(ACTUATED).neutral)
    u = np.append(thrusts, np.zeros(3))
    levels = module.command_of(q, np.zeros(9), u, constants=constants)
    x = module.actuator_state_of(levels, constants=constants)
    battery = robot.battery
    assert battery is not None
    first, last = module.ACTUATOR_STATES.index("throttle_front_left"), len(x) - 1
    most = np.where(np.arange(len(u)) == 0, 1.0, levels)

    def rates(charge: float) -> tuple[float, float]:
        """The rate of the charge, and the voltage that the rotor's level rises to, V."""
        state = np.append(x[:-1], charge)
        found = module.actuator_rates(state, most, constants=constants)
        pace = 0.03 if found[first] > 0.0 else 0.05
        return found[last], battery.nominal * (pace * found[first] + x[first])

    def room(_: float, y: np.ndarray) -> float:
        """Above 0 where there is charge, throttle and power."""
        rate, voltage = rates(y[0])
        power = -rate * 3600.0 * battery.capacity * voltage
        needed = max(levels[0] * battery.nominal, np.sqrt(battery.resistance * power) * (1 + 1e-9))
        return min(y[0], voltage - needed)

    room.terminal = True  # type: ignore[attr-defined]
    _, voltage = rates(1.0)
    assert found.battery.voltage == pytest.approx(voltage, rel=1e-12)
    current = -rates(1.0)[0] * 3600.0 * battery.capacity
    assert found.battery.current == pytest.approx(current, rel=1e-12)
    assert found.commands[:3] == pytest.approx(
        [levels[0] * battery.nominal / voltage, *levels[1:3]], rel=1e-9
    )
    assert found.left == pytest.approx(1.0 - found.commands[0])
    assert found.battery.until == until
    if room(0.0, np.ones(1)) < 0.0:
        assert (found.battery.time, found.battery.charge) == (0.0, 1.0)
        return
    end = solve_ivp(
        lambda _, y: [rates(y[0])[0]], (0.0, 1e5), [1.0], events=room, rtol=1e-9, max_step=20.0
    )
    assert found.battery.time == pytest.approx(end.t_events[0][0], rel=1e-5)
    assert found.battery.charge == pytest.approx(end.y_events[0][0, 0], abs=1e-5)


def test_a_battery_of_constant_voltage_lasts_for_its_charge_by_the_current() -> None:
    """Four rotors carry 10 N each: half of what they can, at 0.5 of the throttle when linear."""
    rotors = "".join(
        f"""
[[rotor]]
position = [{x}, {y}, 0]
drag = {-0.02 * x * y}
command = "throttle"
max_thrust = 20
thrust_model_factor = 0
full_speed = 600
time_constant = 0.02
"""
        for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1))
    )
    robot = parse_robot(
        f"""
name = "constant"
gravity = 10
base = {{ mass = 4 }}
battery = {{ voltage = [20, 20], resistance = 0, capacity = 3, efficiency = 0.8, auxiliary = 10 }}
{rotors}"""
    )
    # 4 · 0.02 m · 10 N · 300 rad/s = 240 W of 300 W, and 10 W more: 15.5 A of 3 A h.
    assert hover_lines(robot, hover(robot))[1:] == [
        "hover throttle: 50, 50, 50, 50 %, with a full battery; 50 % remain",
        "battery in hover: 20 V and 15.5 A when full; 11.61 min until it is empty",
        "thrust margin: the limits carry 2 times the weight",
    ]
    faster = replace(robot, battery=replace(robot.battery, voltages=(0.0, 20.0)))  # type: ignore[type-var]
    assert hover_lines(faster, hover(faster))[2].endswith(
        "15.5 A when full; 4.355 min until the throttle no longer suffices, with 50 % of its charge"
    )


def test_a_throttle_that_has_no_way_up_does_not_hover_for_a_moment() -> None:
    front = ACTUATED.thrusters[0]
    held = replace(front, command_limits=(0.0, 0.0))
    robot = replace(ACTUATED, thrusters=(held, *ACTUATED.thrusters[1:]))
    thrusts = hover(robot).thrusts
    assert thrusts is not None
    found = hover_commands(robot, thrusts)
    assert found.battery is not None
    assert (found.battery.time, found.battery.until) == (0.0, "the throttle no longer suffices")
    idle = replace(robot, battery=None)
    assert hover_commands(idle, thrusts).battery is None


def test_commands_of_other_units_are_told_with_the_names_of_their_rotors() -> None:
    found = hover(ACTUATED)
    assert found.margin == pytest.approx(1.984, abs=1e-3)
    lines = hover_lines(ACTUATED, found)
    assert lines[1].startswith("hover throttle: 67 % (rotor front_left), with a full")
    assert lines[2] == "hover speed: 622.6, 673.6 rad/s (rotors rear_left, rear_right)"


def test_throttles_beyond_their_limits_leave_nothing_and_have_no_time() -> None:
    weak = replace(ACTUATED, gravity=2.5 * ACTUATED.gravity)
    lines = hover_lines(weak, hover(weak))
    assert lines[1].endswith("(rotor front_left), with a full battery, which is beyond the limits")
    assert not any("battery in hover" in line or "are left" in line for line in lines)


def test_limits_of_thrusts_are_where_the_curve_rises() -> None:
    """A rotor that may turn both ways pushes the same way: least where it stands still."""
    given = "command_limits  = [0, 950]"
    both = parse_robot(TEXT.replace(given, "command_limits = [-900, 900]")).drives[2]
    assert both.thrust_limits == (0.0, 1e-5 * 900**2)
    # 0.01 - 2e-4 x + 1.2e-5 x² is least at x = 2e-4/2.4e-5.
    low = parse_robot(TEXT.replace("[100, 900]", "[0, 900]")).drives[1].thrust_limits
    assert low == pytest.approx((0.01 - 1e-8 / 1.2e-5, 9.55), rel=1e-12)
    with pytest.raises(
        RobotFileError, match=r"rotor 3: command_limits: .* from .* on, beyond the greatest .* -100"
    ):
        parse_robot(TEXT.replace(given, "command_limits = [-900, -100]"))
    with pytest.raises(RobotFileError, match=r"rotor 2: thrust_curve: lets the thrust rise"):
        parse_robot(TEXT.replace("-2e-4, 1.2e-5", "-2e-2, 1e-5"))
