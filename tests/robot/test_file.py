"""Robot files: what is read, what is refused, and how a refusal reads."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pytest
from hypothesis import given, settings
from support.random_robots import random_tree, robots

from gibbs_codegen.errors import RobotFileError, UsageError
from gibbs_codegen.files.shipped import MAX_BYTES
from gibbs_codegen.pipeline import module_files
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.file import parse_robot, read_robot, shipped_robots
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.body import RigidBody, Rod, inertia_fault
from gibbs_codegen.robot.parts.numbers import AXES
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.verification.verify import refuse_wrong

pytestmark = pytest.mark.usefixtures("derived_once")

BASE = """
name = "test"
[base]
rotors = 3
arm = { length = 0.5, mass_per_length = 1.0 }
"""


def faults(text: str) -> list[str]:
    """Lines of the refusal of a file."""
    with pytest.raises(RobotFileError) as refusal:
        parse_robot(text, "robot.toml")
    return str(refusal.value).splitlines()


def test_table_1_is_read_as_it_stands() -> None:
    robot = read_robot("hexarotor_3link")[0]
    assert (robot.rotors, len(robot.links), robot.gravity) == (6, 3, 9.81)
    assert robot.base.arm(4) == Rod(
        length=0.5, mass_per_length=1.0, section_inertia=(212e-8, 21.2e-8, 190.8e-8)
    )
    assert [link.body.length for link in robot.links] == [0.0, 3.0, 3.0]
    assert [link.body.total_mass for link in robot.links] == [0.0, 3.0, 3.0]
    assert [link.alpha_deg for link in robot.links] == [0, 90, 0]
    assert robot.base.thrust == (AXES["z"], AXES["y"]) * 3
    angles = [robot.base.arm_angle_deg(k) for k in range(2, 7)]
    assert angles == [-120, -60, 0, 60, 120]


def test_robots_that_ship() -> None:
    assert set(shipped_robots()) == {
        "hexarotor",
        "hexarotor_3link",
        "quadrotor_2link",
        "octorotor_7link",
        "decarotor_3link",
        "hextilt_flying_arm_5",
        "hydrus",
        "quadrotor",
        "quadrotor_arm_2link",
        "dual_arm",
        "ur5e",
        "panda",
        "cart_pole",
        "planar_quadrotor_arm",
        "delta_hexarotor",
        "rover_arm",
    }
    for name in shipped_robots():
        assert read_robot(name)[0].name == name
    for body in (link.body for link in read_robot("octorotor_7link")[0].links):
        assert isinstance(body, RigidBody)
        assert all(body.com)
        assert all(body.inertia)


@pytest.mark.parametrize(("rotors", "links"), [(6, 3), (4, 2), (10, 3)])
def test_family_members_that_ship_are_the_family_s(rotors: int, links: int) -> None:
    robot = paper_family(rotors, links)
    assert read_robot(robot.name) == (robot, robot_text(robot))


def test_the_comment_of_the_attitude_fits_it_and_new_files_tell_of_both() -> None:
    robot = paper_family(2, 0)
    assert "quaternion" not in robot_text(robot)
    assert '# Instead of angles, "quaternion"' in robot_text(robot, to_start_from=True)
    quaternion = replace(robot, base=replace(robot.base, attitude="quaternion"))
    assert 'attitude = "quaternion"  # or an intrinsic sequence' in robot_text(quaternion)


def test_defaults() -> None:
    robot = parse_robot(BASE + "[[link]]\nmass = 1\n")
    assert robot.gravity == 9.81
    assert (robot.base.attitude, robot.base.origin) == ("xyz", "motor1")
    assert robot.base.thrust == (AXES["z"], AXES["y"], AXES["z"])
    link = robot.links[0]
    assert (link.a, link.d, link.alpha_deg, link.joint) == (None, 0.0, Fraction(0), "revolute")


@pytest.mark.slow
@settings(max_examples=60)
@given(robot=robots())
def test_text_of_any_robot_reads_back_as_it(robot: Robot) -> None:
    assert parse_robot(robot_text(robot)) == robot


@pytest.mark.parametrize("seed", range(100))
def test_text_of_any_tree_reads_back_as_it(seed: int) -> None:
    assert parse_robot(robot_text(random_tree(seed))) == random_tree(seed)


def test_directions_are_normalised() -> None:
    thrust = 'thrust = ["z", [3.0, 0.0, 4.0], [0, 1e-300, 0]]'
    robot = parse_robot(BASE.replace("rotors = 3", f"rotors = 3\n{thrust}"))
    assert robot.base.thrust == (AXES["z"], pytest.approx((0.6, 0.0, 0.8)), AXES["y"])


def test_all_faults_are_reported_together_with_path_line_and_hint() -> None:
    text = """name = "class"
gravity = "9.81"
[base]
rotor = 6
attitude = "yaw"
arm = { length = -1.0, mass = true }

[[link]]
mass = 1.0
inertia = [1, 1, 5, 0, 0, 0]

[[link]]
lenght = 1.0
"""
    assert faults(text) == [
        "robot.toml:1: name: 'class' is a keyword of Python and cannot name a module; "
        "add a word, e.g. class_arm",
        "robot.toml:2: gravity: must be a number, not a string",
        "robot.toml:4: base.rotor: unknown key; did you mean rotors?",
        "robot.toml:5: base.attitude: must be one of 'xyz', 'xzy', 'yxz', 'yzx', 'zxy', 'zyx', "
        "'quaternion', not 'yaw'",
        "robot.toml:6: base.arm.length: must be at least 0, not -1.0",
        "robot.toml:6: base.arm.mass: must be a number, not a boolean",
        "robot.toml:10: link 1: inertia: violates the triangle inequality: no principal moment "
        "may exceed the sum of the other two; to allow it, give allow_impossible_inertia = true",
        "robot.toml:13: link 2: lenght: unknown key; did you mean length?",
    ]


def test_an_unknown_key_gets_its_suggestion_among_many_other_faults() -> None:
    links = "[[link]]\nmass = -1\n" * 25
    found = faults("gravty = 9.81\n" + BASE + links)
    assert found[0] == "robot.toml:1: gravty: unknown key; did you mean gravity?"
    assert len(found) == 26


def test_a_dotted_key_has_a_line() -> None:
    assert faults('name = "x"\nbase.rotors = 4\nbase.arm.length = 1\n') == [
        "robot.toml:3: base.arm: the robot has no mass; give its base or links some"
    ]


def test_a_key_that_is_given_twice() -> None:
    (found,) = faults('name = "x"\nname = "y"\n')
    assert found.startswith("robot.toml:2: not valid TOML: Cannot overwrite a value")
    assert found.endswith("the key or table appears twice: remove one")


@pytest.mark.parametrize("key", ["alpha_deg", "theta_deg"])
@pytest.mark.parametrize("angle", ["1e10", "-360.5", "361"])
def test_angles_beyond_a_turn_are_refused(key: str, angle: str) -> None:
    (line,) = faults(BASE + f"[[link]]\nmass = 1\n[[link]]\nmass = 1\n{key} = {angle}\n")
    assert line.startswith(f"robot.toml:10: link 2: {key}: must be from -360 to 360 degrees, not ")
    assert line.endswith("leave out whole turns")


@pytest.mark.parametrize(
    "angle",
    [pytest.param("360", marks=pytest.mark.slow), "-360", "359.9999999999", "1e-30", "-1e-300"],
)
def test_angles_within_a_turn_make_a_module(angle: str) -> None:
    """Its functions agree with formulations in plain numbers."""
    text = BASE + f"[[link]]\nalpha_deg = {angle}\ntheta_deg = {angle}\nlength = 1\nmass = 1\n"
    robot = parse_robot(text + "inertia = [1, 1, 1, 0, 0, 0]\n")
    _, files = module_files(robot, text, ["numpy"], False, lambda _: None)
    refuse_wrong(robot, files["numpy_module.py"])


def test_places_count_from_one_and_keys_in_quotes_stay_as_they_are() -> None:
    arms = "arm = [{ length = 1, mass = 1 }, { length = 1, mass = 1, com = [0, 0, nan] }, {}]"
    lines = faults(
        BASE.replace("arm = { length = 0.5, mass_per_length = 1.0 }", arms)
        + "[[link]]\nmass = 1\n'x[1].y' = 2\n"
    )
    assert [line.partition(": ")[2] for line in lines] == [
        "base.arm 2: com 3: must be a finite number, not nan",
        "base.arm 3: length: missing: the distance from the base centre to the motor, in m",
        "link 1: 'x[1].y': unknown key; known keys: xyz, rpy_deg, name, parent, alpha_deg, a, d, "
        "theta_deg, axis, joint, constrained, coordinate, damping, armature, stiffness, rest, "
        "limits, limits_deg, effort, velocity, servo, friction, gear, motor, mass, com, inertia, "
        "length, mass_per_length, section_inertia",
    ]


@pytest.mark.parametrize(
    ("replaced", "by", "message"),
    [
        ("rotors = 3", "rotors = 1", "base.rotors: must be from 2 to"),
        ("rotors = 3", "rotors = 3.0", "base.rotors: must be a whole number, not 3.0"),
        ("rotors = 3", "rotors = true", "base.rotors: must be a whole number, not a boolean"),
        ("rotors = 3", "rotors = 99999999999999999999999", "not a huge number"),
        ("length = 0.5", "length = nan", "base.arm.length: must be a finite number"),
        ("length = 0.5", "length = inf", "base.arm.length: must be a finite number"),
        ("length = 0.5", "length = 1e999", "base.arm.length: must be a finite number"),
        ("length = 0.5, ", "", "base.arm.length: missing"),
        ("mass_per_length = 1.0", "mass_per_length = -1", "must be at least 0, not -1"),
        ("mass_per_length = 1.0", "mass = 1, mass_per_length = 1", "belongs to a rod"),
        ("mass_per_length = 1.0", "com = [0, 0, 0]", "base.arm.mass: missing"),
        ("mass_per_length = 1.0", "mass = 1, com = [0, 0]", "must have 3 numbers, not 2"),
        (
            "mass_per_length = 1.0",
            "mass = 1, inertia = [1, 1, 1, 5, 0, 0]",
            "negative principal moment",
        ),
        ("mass_per_length = 1.0", "mass_per_length = 0", "the robot has no mass"),
        (
            "mass_per_length = 1.0",
            "mass = 0, inertia = [1, 1, 1, 0, 0, 0]",
            "is not zero although the body has no mass",
        ),
        ("arm = {", "drag = [1]\narm = {", "base.drag: must have 3 numbers, not 1"),
        ("arm = {", 'thrust = ["z", "y", "w"]\narm = {', "base.thrust 3: must be"),
        ("arm = {", 'thrust = ["z", "y", [0, 0, 0]]\narm = {', "direction of length zero"),
        ("arm = {", 'origin = "center"\narm = {', "did you mean 'centre'?"),
        (
            "arm = { length = 0.5, mass_per_length = 1.0 }",
            "arm = [{length = 1}]",
            "a list of 1 for 3 rotors",
        ),
        ("arm = { length = 0.5, mass_per_length = 1.0 }", "arm = 1979-05-27", "a date or time"),
        ("rotors = 3", "rotors = 3\nrotors = 4", "not valid TOML"),
        ("arm = {", "attitude = [0x" + "f" * 5000 + "]\narm = {", "not a list"),
        ("arm = {", "attitude = { x = 1 }\narm = {", "'quaternion', not a table"),
        ("rotors = 3", "rotors = " + "9" * 5000, "robot.toml:4: not valid TOML: a number has more"),
        ("rotors = 3", "rotors = 3\nx = [", "robot.toml:6: not valid TOML"),
        ("[base]", "[base]\n[base]", "not valid TOML"),
        ('"test"', '"test', "not valid TOML"),
        ('name = "test"', "", "name: missing"),
        ('name = "test"', "name = 3", "name: must be a string"),
        ('name = "test"', 'name = "test"\nlink = 3', "must be an array of tables"),
        ('name = "test"', 'name = "test"\nlink = [3]', "link 1: must be a table"),
    ],
)
def test_refusals(replaced: str, by: str, message: str) -> None:
    assert replaced in BASE
    assert message in "\n".join(faults(BASE.replace(replaced, by)))


def test_a_file_to_import_is_told_from_a_broken_one() -> None:
    (told,) = faults('\n<?xml version="1.0"?>\n<robot name="x"/>\n')
    assert told.startswith(
        "robot.toml:1: not valid TOML: it is XML; if it is URDF, xacro, MJCF or SDF"
    )
    assert told.endswith("with gibbs-codegen import FILE")


def test_deep_nesting_is_refused() -> None:
    for text in ("x = " + "[" * 5000, "x" + ".x" * 5000 + " = 1", "[" + "x . " * 5000 + "x]"):
        assert faults(text) == [
            "robot.toml:1: nested too deeply: at most 16 tables and lists in one another"
        ]


def test_a_file_of_ten_megabytes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "big.toml"
    path.write_text("# " + "x" * 10_000_000)
    with pytest.raises(RobotFileError, match=f"larger than {MAX_BYTES} bytes"):
        read_robot(str(path))


def test_a_file_that_is_not_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "binary.toml"
    path.write_bytes(b"\xff\xfe\x00name")
    with pytest.raises(RobotFileError, match="not UTF-8"):
        read_robot(str(path))


def test_a_missing_file_names_the_robots_that_ship() -> None:
    with pytest.raises(UsageError, match="hexarotor_3link"):
        read_robot("nowhere.toml")


def test_too_many_links_are_refused() -> None:
    assert "at most 64" in "\n".join(faults(BASE + "[[link]]\nmass = 1\n" * 65))


def test_section_inertia_on_the_edge_of_the_triangle_inequality_is_a_body_s() -> None:
    """21.2e-8 + 190.8e-8 is 212e-8 but for rounding: Table 1's own value."""
    edge = 21.2e-8 + 190.8e-8
    for excess in (0.0, 1e-15):
        assert inertia_fault(1.0, (edge * (1 + excess), 21.2e-8, 190.8e-8, 0, 0, 0)) is None
    assert inertia_fault(1.0, (edge * 1.001, 21.2e-8, 190.8e-8, 0, 0, 0))


def test_a_byte_order_mark_and_windows_line_ends_are_welcome(tmp_path: Path) -> None:
    path = tmp_path / "windows.toml"
    path.write_bytes(b"\xef\xbb\xbf" + BASE.replace("\n", "\r\n").encode())
    assert read_robot(str(path))[0] == parse_robot(BASE)


def test_one_mistake_is_one_fault() -> None:
    assert len(faults(BASE.replace("mass_per_length = 1.0", "mass_per_length = -1.0"))) == 1
    section = "section_inertia = [1, 1, 1]"
    with_section = BASE.replace("length = 0.5, mass", f"length = -0.5, {section}, mass")
    assert len(faults(with_section)) == 1


def test_what_several_keys_get_wrong_is_told_beside_faults_of_each() -> None:
    arms = "arm = [{ length = -1, mass = 1, mass_per_length = 1 }, { inertia = 3 }]"
    lines = faults(BASE.replace("arm = { length = 0.5, mass_per_length = 1.0 }", arms))
    assert [line.partition(": ")[2].partition(";")[0] for line in lines] == [
        "base.arm: a list of 2 for 3 rotors",
        "base.arm 1: mass_per_length: belongs to a rod, but mass describes a rigid body: give "
        "mass_per_length and section_inertia, or mass, com and inertia",
        "base.arm 1: length: must be at least 0, not -1",
        "base.arm 2: mass: missing: a rigid body needs its mass in kg",
        "base.arm 2: length: missing: the distance from the base centre to the motor, in m",
        "base.arm 2: inertia: must be a list of 6 numbers, xx, yy, zz, xy, xz, yz, not a number",
    ]


def test_a_single_bracket_is_explained_with_its_line() -> None:
    (line,) = faults(BASE + "[link]\nmass = 1\n[link]\nmass = 1\n")
    assert line.startswith("robot.toml:8: not valid TOML")
    assert "[[link]], in double brackets" in line


def test_blanks_without_end_do_not_slow_a_refusal() -> None:
    blanks = "\n".join(["name = 3", 'x = """', " " * 500_000, '"""'])
    assert "name: must be a string" in "\n".join(faults(blanks))


def test_a_flood_of_faults_is_cut_short() -> None:
    lines = faults(BASE + "".join(f"k{i} = 1\n" for i in range(1000)))
    assert len(lines) == 51
    assert lines[-1] == "robot.toml: and 950 more"


def test_a_near_miss_is_suggested() -> None:
    with pytest.raises(UsageError, match="did you mean hexarotor_3link"):
        read_robot("hexarotor_3lnk")
    with pytest.raises(UsageError, match="did you mean quadrotor_2link"):
        read_robot("quadrotor_2lnk.toml")
    with pytest.raises(UsageError, match="is not a file"):
        read_robot(".")


def test_lines_are_right_after_values_of_several_lines() -> None:
    text = """name = "lines"
[base]
rotors = 3
thrust = [
  [0, 0, 1],
  ["no"],  # ]
  "z",
]
drag = [0, 0,
  nan]
arm = { length = -1 }
\"link\" = 3
"""
    lines = {line.split(": ")[1]: int(line.split(":")[1]) for line in faults(text)}
    assert lines == {"base.thrust 2": 4, "base.drag 3": 9, "base.arm.length": 11, "base.link": 12}


def test_a_scenario_is_told_from_a_robot_file() -> None:
    assert faults('duration = 5\n[base]\npath = { kind = "point" }\n') == [
        "robot.toml:1: duration: a key of a scenario; give a robot file here"
    ]
