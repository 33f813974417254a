"""Gears of robot files: what they make of coordinates, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gibbs_codegen.errors import RobotFileError
from gibbs_codegen.robot.balance import holding_efforts, implausible
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.file import parse_robot, read_robot
from gibbs_codegen.robot.parts.gear import Gear
from gibbs_codegen.robot.parts.motor import Motor
from gibbs_codegen.robot.posture import AT_ORIGIN, frames_on
from gibbs_codegen.robot.text import robot_text

GEAR = 'gear = { of = "driver", ratio = 0.5, offset = 0.1 }'
HAND = f"""
name = "hand"
gravity = 10
base = {{ mass = 1, inertia = [1e-3, 1e-3, 1e-3, 0, 0, 0] }}
[[link]]
name = "last"
axis = "y"
xyz = [0, 0, 0]
mass = 0.1
com = [1, 0, 0]
gear = {{ of = "slider", ratio = -2 }}
[[link]]
name = "driver"
parent = "base"
axis = "y"
xyz = [0, 0, 0]
mass = 0.3
com = [1, 0, 0]
limits = [-1, 1]
[[link]]
name = "slider"
parent = "base"
joint = "prismatic"
axis = "x"
xyz = [0, 0, 0]
mass = 0.1
stiffness = 4
rest = 0.6
{GEAR}
"""


def test_one_coordinate_moves_all_joints() -> None:
    robot = parse_robot(HAND)
    assert (robot.moving, [*robot.gearing]) == ((2,), [1, 2, 3])
    assert robot.gearing[1] == Gear(of=2, ratio=-1.0, offset=-0.2)
    assert parse_robot(robot_text(robot)) == robot
    assert robot.positions([0.4]) == pytest.approx({1: -0.6, 2: 0.4, 3: 0.3})
    description = Description(robot)
    assert description.layout.v.names[3:-3] == ("driver",)
    assert [entry.name for entry in description.inputs] == ["tau_driver"]
    assert {"joint_last", "joint_driver", "joint_slider"} <= {*description.points}
    assert frames_on(robot, AT_ORIGIN, [0.4]).links[2].origin == pytest.approx([0.3, 0, 0])


WRIST = """
name = "wrist"
[base]
motion = "fixed"
mass = 1
inertia = [1e-3, 1e-3, 1e-3, 0, 0, 0]
""" + "".join(
    f"""
[[link]]
name = "{name}"
parent = "{parent}"
axis = "{axis}"
xyz = [0, 0, 0]
mass = 0.1
com = [0.1, 0, 0]
inertia = [1e-4, 2e-4, 2e-4, 0, 0, 0]
{more}
"""
    for name, parent, axis, more in (
        ("left", "base", "y", ""),
        ("right", "base", "y", ""),
        ("tilt", "base", "y", 'gear = { of = ["left", "right"], ratio = [0.5, 0.5] }'),
        ("twist", "tilt", "x", 'gear = { of = ["left", "right"], ratio = [0.5, -0.5] }'),
        ("pointer", "twist", "x", 'gear = { of = ["twist", "left"], ratio = [2, -1] }'),
    )
)


def test_two_coordinates_move_a_differential() -> None:
    robot = parse_robot(WRIST)
    assert robot.moving == (1, 2)
    assert robot.positions([0.3, 0.1]) == pytest.approx({1: 0.3, 2: 0.1, 3: 0.2, 4: 0.1, 5: -0.1})
    assert robot.gearing[5].ratios == {1: 0.0, 2: -1.0}
    assert parse_robot(robot_text(robot)) == robot


def test_efforts_that_hold_joints_count_through_ratios() -> None:
    """By hand, at a coordinate of 0: −0.3·10·1 of the driver's weight about y, and so on."""
    last, spring = -0.1 * 10 * 0.98006657784, 4 * (0.1 - 0.6)
    efforts = holding_efforts(parse_robot(HAND), [])
    assert efforts == pytest.approx([-3.0 + -1.0 * last + 0.5 * spring])


def test_rotors_that_are_more_than_their_carriers_are_warned_of() -> None:
    """The base has 1e-3 kg m² about y; a reflected inertia is no rotor's."""
    motor = "limits = [-1, 1]\nmotor = {{ rotor_inertia = {}, gear_ratio = 50 }}"
    robots = [parse_robot(HAND.replace("limits = [-1, 1]", motor.format(x))) for x in (1e-4, 0.25)]
    assert not [x for x in implausible(robots[0]) if "rotor_inertia" in x]
    (warning,) = (x for x in implausible(robots[1]) if "rotor_inertia" in x)
    assert warning.startswith("rotor_inertia of driver is 0.25 kg m², more than the 0.001 kg m²")
    cart = read_robot("cart_pole")[0]  # The cart has no inertia, and never turns.
    pole = replace(cart.links[1], motor=Motor(rotor_inertia=1e-5, gear_ratio=50.0))
    assert implausible(replace(cart, links=(cart.links[0], pole))) == implausible(cart)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"driver", ratio', '"last", ratio', "'last' is itself moved by this joint; break"),
        ('"driver", ratio', '"slider", ratio', "'slider' is itself moved by this joint; break"),
        ('"driver", ratio', '"drver", ratio', "not 'drver'; did you mean 'driver'?"),
        ('"driver", ratio', '"base", ratio', "name of another link whose joint moves, not 'base'"),
        (
            "ratio = 0.5",
            "ratio = 0",
            'must not be 0, or the joint would not move; give joint = "f',
        ),
        (
            GEAR,
            f"{GEAR}\nlimits = [0, 1]",
            "limits: must be left out, because a gear moves the joint",
        ),
        (GEAR, f"{GEAR}\nfriction.coulomb = 1", "friction: must be left out, because a gear moves"),
        ("limits = [-1, 1]", 'joint = "fixed"', "'driver' is fixed"),
        (
            '"driver", ratio = 0.5',
            '["driver", "driver"], ratio = [1, 1]',
            "a name twice; give it once",
        ),
        (
            '"driver", ratio = 0.5',
            '["driver", "last"], ratio = [1, 1]',
            "gear.of 2: must be the",
        ),
        ('"driver", ratio = 0.5', '["driver"], ratio = [1, 1]', "a ratio for each name in of, 1"),
        ('"driver", ratio = 0.5', "[], ratio = []", "gear.of: must have the name of a link whose"),
        ("ratio = 0.5", 'ratio = "half"', "gear.ratio: must be a number, not a string"),
        (GEAR, f"{GEAR}\nmotor = {{ rotor_inertia = 1, gear_ratio = 9 }}", "motor: belongs to a"),
        (
            "limits = [-1, 1]",
            "motor = { rotor_inertia = 0, gear_ratio = 9 }",
            "motor.rotor_inertia: must be above 0",
        ),
    ],
)
def test_faults_of_gears(old: str, new: str, message: str) -> None:
    assert old in HAND
    with pytest.raises(RobotFileError) as refused:
        parse_robot(HAND.replace(old, new))
    assert message in str(refused.value)
