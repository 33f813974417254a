"""Keys of actuators that do not go together are refused with what would be right."""

from __future__ import annotations

import re

import numpy as np
import pytest
from support.actuated import TEXT, by_rates
from support.emitted import emitted_module

from gibbs_codegen.errors import RobotFileError
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.text import robot_text

FAST = "thrust_constant = 1e-5\ncommand_limits  = [0, 950]"
CURVED = FAST.replace("constant = 1e-5", "curve = [0, 2e-2, -1e-5]")


@pytest.mark.parametrize(
    ("good", "bad", "words"),
    [
        (
            "[13.2, 14.8, 15.2, 16.8]",
            "[16.8, 15.2, 14.8, 13.2]",
            "battery.voltage: must rise with the charge, from empty to full, but 15.2 V follow "
            "16.8 V",
        ),
        (
            "static = 0.03",
            "static = 0.01",
            "link 1: friction.static: must be at least coulomb, 0.02, because friction is greatest",
        ),
        (
            "full_speed          = 900",
            "full_speed = 900\ntime_constant = 0.03",
            "rotor 1: time_constants: excludes time_constant; give time_constants "
            "if slowing down takes another time than speeding up, else time_constant",
        ),
        (
            "limits        = [0, 9]",
            "max_thrust = 9",
            'rotor 4: command: missing: give "throttle"; thrusts are commanded without max_thrust',
        ),
        (
            "limits        = [0, 9]",
            "thrust_constant = 1e-5",
            'rotor 4: command: missing: give "speed"; thrusts are commanded without thrust_con',
        ),
        (
            FAST,
            f"{FAST}\nmax_thrust = 9",
            "rotor 3: max_thrust: excludes thrust_constant; give thrust_curve or",
        ),
        (
            FAST,
            f"{FAST}\nfull_speed = 900",
            'rotor 3: full_speed: needs command = "throttle" beside it, since speeds are',
        ),
        (FAST, "", "rotor 3: command: needs the thrust of the speed beside it: give thrust_curve"),
        (
            FAST,
            CURVED.replace("950", "1001"),
            "rotor 3: command_limits: lets the thrust fall beyond a speed of "
            "1000; give command_limits that end there or before",
        ),
        (
            FAST,
            CURVED.partition("\n")[0],
            "rotor 3: thrust_curve: lets the thrust fall beyond a speed of",
        ),
        (
            FAST,
            CURVED.replace("2e-2", "-2e-2"),
            "rotor 3: thrust_curve: must rise with the speed: give a k1 or a k2 above 0",
        ),
        (
            FAST,
            "thrust_curve = [1, 0, 0]",
            "rotor 3: thrust_curve: must rise with the speed: give a k1 or a k2 above 0",
        ),
        (
            "servo   = { stiffness = 400, damping = 8",
            'servo = { stiffness = 400, command = "rate"',
            "link 2: servo.stiffness: must be left out if rates are commanded",
        ),
        (
            "servo   = { stiffness = 400, damping = 8",
            'servo = { command = "rate"',
            "link 2: servo.damping: must be given, above 0, because it drives the servo towards a",
        ),
        (
            "servo   = { stiffness = 400,",
            "servo = {",
            "link 2: servo.stiffness: missing: torque or force per distance from the reference, "
            "N m/rad or N/m",
        ),
        (FAST, "thrust_curve = 'square'", "rotor 3: thrust_curve: must be a list of 3 numbers"),
        (
            'command             = "throttle"',
            "command = ['throttle']",
            "rotor 1: command: must be one of 'thrust', 'speed', 'throttle', not a list",
        ),
    ],
)
def test_what_does_not_go_together_is_refused(good: str, bad: str, words: str) -> None:
    assert good in TEXT
    with pytest.raises(RobotFileError, match=re.escape(words)):
        parse_robot(TEXT.replace(good, bad))


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        ('comand = "throttle"\nmax_thrust = 8\ncommand_limits = [0.1, 1]', "comand: unknown key"),
        ('command = "throtle"\nhub_drag = 0.1', "command: must be one of"),
        (
            "thrust_curve = [0, 0, 1e-6]\nhub_drag = 1e-4",
            'command: missing: give "speed" or "throttle"',
        ),
        (
            "full_speed = 900\nthrust_constant = 1e-5\ncommand_limits = [0, 1]",
            'command: missing: give "throttle"; thrusts are commanded without thrust_constant, '
            "command_limits, full_speed",
        ),
        ("hub_drag = 1e-4", "hub_drag: needs the rotor's speed: give speed_per_sqrt_thrust"),
        (
            "command = 'throttle'\nfull_sped = 900\nmax_thrust = 9",
            "full_sped: unknown key; did you mean full_speed?",
        ),
        (
            "command = 'throttle'\nfull_speed = 900\nmax_trust = 9",
            "max_trust: unknown key; did you mean max_thrust?",
        ),
    ],
)
def test_a_command_that_is_wrong_or_missing_is_one_fault(bad: str, words: str) -> None:
    with pytest.raises(RobotFileError, match=f"rotor 4: {re.escape(words)}") as refused:
        parse_robot(TEXT.replace("limits        = [0, 9]", bad))
    assert len(refused.value.faults) == 1


def test_a_misspelt_command_of_a_servo_is_one_fault() -> None:
    with pytest.raises(RobotFileError, match="did you mean 'rate'") as refused:
        parse_robot(TEXT.replace("stiffness = 400, damping = 8", "command = 'rat', damping = 8"))
    assert len(refused.value.faults) == 1


def test_what_is_no_table_of_rotors_is_refused_beside_a_battery() -> None:
    battery = TEXT[TEXT.index("[battery]") :].partition("[[")[0]
    with pytest.raises(RobotFileError, match=re.escape("rotor: must be an array of tables")):
        parse_robot(f"name = 'flat'\nrotor = 0.5\nbase = {{ mass = 1 }}\n{battery}")


@pytest.mark.slow
def test_servos_by_rate_are_commanded_rates_within_limits() -> None:
    robot = by_rates()
    module = emitted_module(robot)
    assert module.COMMANDS[4:6] == ("upper_rate", "slider_rate")
    assert module.COMMAND_UNITS[4:6] == ("rad/s", "m/s")
    assert module.COMMAND_LIMITS["upper_rate"] == (-6.0, 6.0)
    assert "slider_rate" not in module.COMMAND_LIMITS
    assert module.ACTUATOR_STATES[-2:] == ("upper_reference", "charge")
    assert parse_robot(robot_text(robot)) == robot
    # Of the numbers that are listed, those that are zero in the file are no parameters.
    listed = {name for own in module.DRIVE_PARAMETERS.values() for name in own.values()}
    assert listed - {*module.PARAMETERS} == {"slider_servo_delay", "wrist_armature"}
    drives = {x for x in module.PARAMETERS if "_servo_" in x or "_friction_" in x}
    assert drives <= listed
    # A servo at once pushes with 80 N s/m times what its rate lacks, at most 20 N.
    q, v = np.array(layout_of(robot).neutral), np.zeros(9)
    v[7] = 0.05
    command, x = np.zeros(7), np.zeros(len(module.ACTUATOR_STATES))
    for rate, force in ((0.1, 80 * 0.05), (1.0, 20.0), (-1.0, -20.0)):
        command[5] = rate
        assert module.inputs_of(q, v, x, command)[5] == pytest.approx(force)


@pytest.mark.slow
def test_a_curve_that_falls_beyond_its_commands_is_inverted_where_it_rises() -> None:
    """Its thrusts go up to 9.975 N; beyond 10 N at 1000 rad/s there are none."""
    robot = parse_robot(TEXT.replace(FAST, CURVED))
    assert robot.drives[2].thrust_limits == pytest.approx((0.0, 9.975))
    module, q, v = emitted_module(robot), np.array(layout_of(robot).neutral), np.zeros(9)
    for speed in (1.0, 400.0, 950.0, 999.0):
        thrust = 2e-2 * speed - 1e-5 * speed**2
        levels = module.command_of(q, v, np.array([1.0, 1.0, thrust, 1.0, 0.0, 0.0, 0.0]))
        assert levels[2] == pytest.approx(speed, rel=1e-12)
        assert robot.drives[2].level(thrust) == pytest.approx(speed, rel=1e-12)
    beyond = module.command_of(q, v, np.array([1.0, 1.0, 11.0, 1.0, 0.0, 0.0, 0.0]))
    assert beyond[2] == pytest.approx(1000.0, rel=1e-15)
