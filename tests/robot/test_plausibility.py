"""Numbers that are probably in another unit, and robots without any."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from gibbs_codegen.robot.balance import implausible
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.file import parse_robot, read_robot, shipped_robots
from gibbs_codegen.robot.parts.body import Rod
from gibbs_codegen.robot.parts.link import MAX_LINKS

GOOD = """name = "quad"
[base]
mass = 1.5
inertia = [0.01, 0.01, 0.02, 0, 0, 0]
[[rotor]]
position = [0.2, 0, 0]
drag = 0.02
[[rotor]]
position = [-0.2, 0, 0]
drag = -0.02
[[link]]
xyz = [0, 0, -0.1]
mass = 0.1
com = [0.1, 0, 0]
inertia = [1e-4, 1e-4, 1e-4, 0, 0, 0]
limits_deg = [-180, 180]
"""


@pytest.mark.parametrize("name", [*shipped_robots(), "everything"])
def test_robots_that_ship_are_plausible(name: str) -> None:
    path = Path(__file__).parents[1] / "robots" / f"{name}.toml"
    assert implausible(read_robot(str(path) if path.exists() else name)[0]) == ()


@pytest.mark.parametrize(
    ("good", "bad", "words"),
    [
        (
            "position = [0.2",
            "position = [200",
            "the robot is 200.2 m long and weighs 1.6 kg; are lengths in mill",
        ),
        (
            "xyz = [0, 0, -0.1]",
            "xyz = [0, 0, -100]",
            "the robot is 100 m long and weighs 1.6 kg; are lengths in mill",
        ),
        (
            "com = [0.1",
            "com = [100",
            "the robot is 100.2 m long and weighs 1.6 kg; are lengths in mill",
        ),
        (
            "mass = 0.1",
            "mass = 0.1\nlength = 300",
            "the robot is 300.2 m long and weighs 1.6 kg; are lengths in mill",
        ),
        ("mass = 1.5", "mass = 1500", "the robot weighs 1500 kg at a size of 0.4 m"),
        (
            "0.01, 0.01, 0.02",
            "1e4, 1e4, 2e4",
            "the inertia of the base has a radius of gyration of",
        ),
        ("1e-4, 1e-4, 1e-4", "1e2, 1e2, 1e2", "the inertia of link 1 has"),
        ("drag = -0.02", "drag = -20", "the drag of rotor 2 is -20 m"),
        (
            "drag = -0.02",
            "drag = -0.02\ntime_constant = 40",
            "the greatest time constant of rotor 2 is 40 s; is it in milliseconds? (these would be "
            "0.04 s)",
        ),
        ("limits_deg", "limits", "a limit of link 1 is -180 rad, more than a turn"),
    ],
)
def test_other_units_are_warned_of(good: str, bad: str, words: str) -> None:
    assert implausible(parse_robot(GOOD)) == ()
    (warning,) = implausible(parse_robot(GOOD.replace(good, bad)))
    assert warning.startswith(words)


def test_rods_in_millimetres_are_warned_of_and_the_longest_of_arms_is_not() -> None:
    """The inertia of rods grows with their length, so that only the weight tells."""
    robot = paper_family(4, MAX_LINKS)
    assert implausible(robot) == ()
    base = replace(robot.base, arms=(Rod(length=500.0, mass_per_length=1.0),))
    (warning,) = implausible(replace(robot, base=base, links=()))
    assert warning.startswith(
        "the robot is 1000 m long and weighs 2000 kg; are lengths in millimetres?"
    )


def test_a_frame_far_away_is_no_part_of_the_robot() -> None:
    text = 'name = "mark"\n[base]\nmass = 1\ninertia = [0.01, 0.01, 0.02, 0, 0, 0]\n'
    rotor = "[[rotor]]\nposition = [0.2, 0, 0]\n"
    assert (
        implausible(parse_robot(f"{text}{rotor}[[frame]]\nname = 'mark'\nxyz = [25, 0, 0]\n")) == ()
    )


THROTTLES = """name = "throttles"
battery = { voltage = [13, 16.8], resistance = 0.02, capacity = 5 }
[base]
mass = 1.5
inertia = [0.01, 0.01, 0.02, 0, 0, 0]
[[rotor]]
position = [0.2, 0, 0]
drag = 0.016
command = "throttle"
max_thrust = 9
full_speed = 900
time_constant = 0.03
disc_radius = 0.12
hub_drag = 1e-4
[[rotor]]
position = [-0.2, 0, 0]
drag = -0.02
command = "speed"
thrust_constant = 1e-5
command_limits = [0, 900]
"""


@pytest.mark.parametrize(
    ("good", "bad", "words"),
    [
        (
            "full_speed = 900",
            "full_speed = 9000",
            "the greatest speed of rotor 1 is 9000 rad/s; is it in turns a minute? "
            "(these would be 942.5 rad/s)",
        ),
        (
            "time_constant = 0.03",
            "time_constant = 0.03\ncommand_limits = [0, 100]",
            "the greatest throttle of rotor 1 is 100, and 1 is full; is it in percent?",
        ),
        ("disc_radius = 0.12", "disc_radius = 0.4", "the greatest speed of rotor 1 is 900 rad/s"),
        ("[0, 900]", "[0, 5000]", "the greatest speed of rotor 2 is 5000 rad/s"),
        (
            "capacity = 5",
            "capacity = 5200",
            "the capacity of the battery is 5200 A h; is it in mA h? (these would be 5.2 A h)",
        ),
        (
            "drag = -0.02",
            "drag = 0",
            "the battery model lacks the drag or the speed of rotors 2; give",
        ),
        (
            'command = "speed"\nthrust_constant = 1e-5\ncommand_limits = [0, 900]',
            "limits = [0, 9]",
            "the battery model lacks the drag or the speed of rotors 2; give",
        ),
    ],
)
def test_turns_a_minute_and_milliamperes_are_warned_of(good: str, bad: str, words: str) -> None:
    assert implausible(parse_robot(THROTTLES)) == ()
    assert good in THROTTLES
    (warning,) = implausible(parse_robot(THROTTLES.replace(good, bad)))
    assert warning.startswith(words)


def test_what_two_rotors_have_in_common_is_warned_of_once() -> None:
    rotor = THROTTLES.split("[[rotor]]")[1].replace("full_speed = 900", "full_speed = 9000")
    top = THROTTLES.partition("[[rotor]]")[0]
    (warning,) = implausible(parse_robot(f"{top}[[rotor]]{rotor}[[rotor]]{rotor}"))
    assert warning.startswith("the greatest speed of rotors 1, 2 is 9000 rad/s; is")
