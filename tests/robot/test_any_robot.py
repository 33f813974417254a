"""Robot files of any aerial robot: central bodies, placed rotors, trees, frames; faults in them."""

from __future__ import annotations

import math
from fractions import Fraction
from pathlib import Path

import pytest

from gibbs_codegen.errors import RobotFileError
from gibbs_codegen.robot.balance import impossible_inertias
from gibbs_codegen.robot.file import parse_robot, read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.body import RigidBody, Rod
from gibbs_codegen.robot.parts.frame import Frame
from gibbs_codegen.robot.parts.link import JointLimits, Passive
from gibbs_codegen.robot.parts.numbers import AXES
from gibbs_codegen.robot.parts.pose import Pose
from gibbs_codegen.robot.parts.rotor import Rotor
from gibbs_codegen.robot.text import robot_text

EVERYTHING = Path(__file__).parents[1] / "robots" / "everything.toml"
CARRIED = """
name = "carried"
[base]
mass = 2
"""
RODS = """
name = "rods"
[base]
rotors = 3
arm = { length = 0.5, mass_per_length = 1.0 }
"""


def robot(text: str) -> Robot:
    """The robot of a file, which its own text describes as well."""
    found = parse_robot(CARRIED + text)
    assert parse_robot(robot_text(found)) == found
    return found


def faults(text: str, before: str = CARRIED) -> list[str]:
    """Faults of a file, without its name."""
    with pytest.raises(RobotFileError) as refusal:
        parse_robot(before + text, "robot.toml")
    return [line.removeprefix("robot.toml:") for line in str(refusal.value).splitlines()]


def test_a_robot_with_everything() -> None:
    found, _ = read_robot(str(EVERYTHING))
    assert parse_robot(robot_text(found)) == found
    assert (found.rotors, found.base.rotors, found.base.origin) == (5, 0, "base")
    assert isinstance(found.base.body, RigidBody)
    assert found.base.body.mass == 2.6
    assert found.parents == (0, 0, 0, 3, 4, 5, 6, 6, 0, 9)
    assert found.moving == tuple(range(1, 11))
    assert [rotor.on for rotor in found.thrusters] == [1, 1, 2, 2, 10]
    assert found.thrusters[4] == Rotor(
        position=(0.2, 0.02, 0.03),
        direction=(-1.0, 0.0, 0.0),
        drag=0.03,
        on=10,
        name="rotor_4",
        limits=(0.0, 15.0),
    )
    assert [frame.on for frame in found.frames] == [7, 8, 10]
    a1, a2, a3 = found.links[2:5]
    assert a1.pose == Pose(
        (0.1, 0.02, -0.08),
        (
            Fraction("171.88733853924697"),
            Fraction("14.32394487827058"),
            Fraction("-22.918311805232932"),
        ),
    )
    assert a1.axis == (0.6, 0.0, 0.8)
    assert a1.passive == Passive(damping=0.1)
    assert a1.limits.high == pytest.approx(2.0, abs=1e-11)
    assert (a2.joint, a2.axis) == ("prismatic", (0.0, -1.0, 0.0))
    assert a2.limits == JointLimits(0.0, 0.25)
    assert a3.body == Rod(length=0.0)


def test_defaults() -> None:
    found = robot('[[rotor]]\n[[link]]\nxyz = [0, 0, 1]\nmass = 1\n[[frame]]\nname = "eye"\n')
    assert found.thrusters == (Rotor(),)
    assert found.frames == (Frame("eye"),)
    (link,) = found.links
    assert (link.axis, link.parent, link.name, link.coordinate) == (AXES["z"], None, None, None)
    assert (link.passive, link.limits) == (Passive(), JointLimits())
    assert link.pose == Pose((0.0, 0.0, 1.0))


def test_a_rotor_that_spins() -> None:
    text = "[[rotor]]\ndrag = -0.02\nspin_inertia = 1e-4\nspeed_per_sqrt_thrust = 210\n"
    (rotor,) = robot(text).thrusters
    assert rotor == Rotor(drag=-0.02, spin_inertia=1e-4, speed_per_sqrt_thrust=210.0)


def test_an_arm_that_is_carried_needs_no_rotor() -> None:
    found = robot('[[link]]\nname = "boom"\nmass = 1\nlength = 1\n')
    assert (found.rotors, found.base.arms, found.links[0].pose) == (0, (), None)


def test_a_central_body_adds_to_the_rods() -> None:
    text = RODS + "mass = 2\ncom = [0, 0, 0.1]\nazimuth_deg = [0, 100, -100.5]\n"
    found = parse_robot(text)
    assert parse_robot(robot_text(found)) == found
    assert found.total_mass == pytest.approx(3.5)
    assert found.base.origin == "motor1"
    assert [found.base.arm_angle_deg(k) for k in (1, 2, 3)] == [0, 100, Fraction("-100.5")]


def test_what_joints_do_by_themselves_and_their_limits() -> None:
    turned, slid = robot(
        '[[link]]\nname = "elbow"\nmass = 1\ncoordinate = "bend"\ndamping = 0.1\narmature = 0.2\n'
        "stiffness = 3\nrest = -0.5\nlimits_deg = [-90, inf]\neffort = 4\nvelocity = 5\n"
        '[[link]]\nname = "slide"\njoint = "prismatic"\nmass = 1\nlimits = [0, 0.25]\n'
    ).links
    assert turned.passive == Passive(damping=0.1, armature=0.2, stiffness=3.0, rest=-0.5)
    assert turned.limits == JointLimits(-math.pi / 2, None, 4.0, 5.0)
    assert turned.coordinate == "bend"
    assert slid.limits == JointLimits(0.0, 0.25)


def test_links_that_are_welded_and_links_that_are_held() -> None:
    found = robot(
        '[[link]]\nname = "mount"\njoint = "fixed"\nmass = 1\n'
        '[[link]]\nname = "sensor"\njoint = "fixed"\nconstrained = true\ncoordinate = "load"\n'
        'rpy_deg = [0, 0, 30]\naxis = "-y"\nmass = 1\n[[link]]\nname = "tool"\nmass = 1\n'
    )
    assert (found.moving, found.constrained) == ((3,), (2,))


def test_a_link_without_a_name_is_called_by_its_number() -> None:
    found = robot(
        '[[link]]\nmass = 1\ncoordinate = "a"\n[[link]]\nmass = 1\ncoordinate = "b"\n'
        '[[link]]\nmass = 1\ncoordinate = "c"\nparent = "link1"\n[[rotor]]\non = "link2"\n'
    )
    assert found.parents == (0, 1, 1)
    assert found.thrusters[0].on == 2


@pytest.mark.parametrize(
    "name",
    ["left arm/élbow", 'a"b\\c', "\x00\x1b[31m\n", "*/ int evil(void); /*", "班", "1", "\x7f"],
)
def test_any_text_may_be_a_name(name: str) -> None:
    from gibbs_codegen.robot.text import quoted

    word = quoted(name)
    found = robot(
        f"[[link]]\nname = {word}\nmass = 1\n[[link]]\nname = 'c'\nmass = 1\ncoordinate = '1.x'\n"
        f"parent = {word}\n[[rotor]]\nname = '1st'\non = {word}\n"
        f"[[frame]]\nname = {word}\non = {word}\n"
    )
    assert (found.links[0].name, found.frames[0].name) == (name, name)
    assert (found.thrusters[0].on, found.frames[0].on, found.parents) == (1, 1, (0, 1))


def test_impossible_inertias_pass_where_the_file_says_so_and_are_warned_of() -> None:
    link = '[[link]]\nname = "big\\nhead"\nmass = 1\ninertia = [1, 1, 5, 0, 0, 0]\n'
    weightless = '[[link]]\nname = "ghost"\nmass = 0\ninertia = [1, 1, 1, 0, 0, 0]\n'
    assert [line.partition(":")[0] for line in faults(link + weightless)] == ["8", "12"]
    text = "allow_impossible_inertia = true\n" + CARRIED
    found = parse_robot(text + "inertia = [-1, 1, 1, 0, 0, 0]\n" + link + weightless)
    assert parse_robot(robot_text(found)) == found
    base, head, ghost = impossible_inertias(found)
    assert base.startswith("the base: its inertia has a negative principal moment")
    assert head.startswith("big\\nhead: its inertia violates the triangle inequality")
    assert ghost.startswith("ghost: its inertia is not zero although the body has no mass")
    assert impossible_inertias(robot("")) == ()


LINK = '[[link]]\nname = "a"\nmass = 1\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("xyz = [0, 0, 1]\nd = 1", "9: link 1: d: belongs to Denavit–Hartenberg parameters, but"),
        ("rpy_deg = [0, 0, 1]\na = 1", "9: link 1: a: belongs to Denavit–Hartenberg parameters"),
        ('axis = "x"', "8: link 1: axis: needs a pose"),
        ('alpha_deg = 90\naxis = "x"', "9: link 1: axis: needs a pose"),
        ('xyz = [0, 0, 1]\naxis = "-w"', '9: link 1: axis: must be "x", "y", "z", "-x", "-y"'),
        ("xyz = [0, 0, 1]\naxis = [0, 0, 0]", "9: link 1: axis: a direction of length zero"),
        ("rpy_deg = [0, 0, 361]", "8: link 1: rpy_deg 3: must be from -360 to 360 degrees"),
        ("xyz = [0, 1]", "8: link 1: xyz: must have 3 numbers, not 2"),
        ("constrained = true", "8: link 1: constrained: needs a joint that does not move: give j"),
        ("constrained = 1", "8: link 1: constrained: must be true or false, not a number"),
        ('joint = "welded"', "8: link 1: joint: must be one of 'revolute', 'prismatic', 'fixed'"),
        ('joint = "fixed"\ndamping = 1', "9: link 1: damping: must be left out, because a fixed"),
        (
            'joint = "fixed"\nlimits_deg = [0, 1]',
            "9: link 1: limits_deg: must be left out, because",
        ),
        ('joint = "fixed"\ncoordinate = "b"', "9: link 1: coordinate: must be left out, because a"),
        ("damping = -1", "8: link 1: damping: must be at least 0, not -1"),
        ("rest = nan", "8: link 1: rest: must be a finite number, not nan"),
        ("effort = inf", "8: link 1: effort: must be a finite number, not inf"),
        ("limits = [1, 0]", "8: link 1: limits: must be [lower, upper], not [1, 0]"),
        ("limits = [inf, inf]", "8: link 1: limits: must be [lower, upper], not [inf, inf]"),
        ("limits = [nan, 1]", "8: link 1: limits 1: must be a number, or inf where there is no"),
        ("limits = [-1e60, 1]", "8: link 1: limits 1: must be 0 or from 1e-50 to 1e+50 in size"),
        ("limits = [0, 1]\nlimits_deg = [0, 1]", "9: link 1: limits_deg: must be left out, or"),
        (
            'joint = "prismatic"\nlimits_deg = [0, 1]',
            "9: link 1: limits_deg: belongs to a joint th",
        ),
        (
            'parent = "a"',
            '8: link 1: parent: must be "base" or the name of a link given earlier: a',
        ),
        ('parent = "bse"', "not 'bse'; did you mean 'base'?"),
        ('parent = ""', "8: link 1: parent: must be 1 to 128 characters, not 0"),
        (
            'parent = "b"\n[[link]]\nname = "b"\nparent = "base"\nmass = 1',
            "'b' comes later; move t",
        ),
        ('parent = "b"\n[[link]]\nname = "b"\nmass = 1', "carried by this link, which makes a cyc"),
        ('coordinate = ""', "8: link 1: coordinate: must be 1 to 128 characters, not 0"),
        ('coordinate = "theta_1"', "coordinate: 'theta_1' is the name of a coordinate of the base"),
        ('coordinate = "q.x"\n[[link]]\nmass = 1\ncoordinate = "q_x"', "of link 1 already; give"),
        ("[[link]]\nmass = 1\nname = 'b'\ncoordinate = 'a'", "the coordinate of link 1 already"),
        ("[[link]]\nmass = 1\nname = 'x'", "10: link 2: name: 'x' is the name of a coordinate of"),
        (
            'coordinate = "tau_prime_2"',
            "begins like names of constraint torques; give it another name",
        ),
        ("[[link]]\nmass = 1\nname = 'a'", "10: link 2: name: 'a' is the name of link 1 already"),
        ("[[link]]\nmass = 1\nname = 'base'", "10: link 2: name: 'base' is the name of the base"),
        ("[[link]]\nmass = 1\nname = ''", "10: link 2: name: must be 1 to 128 characters, not 0"),
        ("[[rotor]]\nname = 'a'", "9: rotor 1: name: 'a' is the name of link 1 already; give an"),
        ("[[rotor]]\n[[rotor]]\nname = 'rotor1'", "10: rotor 2: name: 'rotor1' is the name of r"),
        ("[[rotor]]\n[[rotor]]\nname = '1'", "'1', in generated code _1, is the name of rotor 1"),
        ("[[rotor]]\non = 'b'", "9: rotor 1: on: must be \"base\" or the name of a link, not 'b'"),
        ("[[rotor]]\ndirection = 'up'", '9: rotor 1: direction: must be "x", "y", "z", "-x"'),
        ("[[rotor]]\nlimits = [3, 1]", "9: rotor 1: limits: must be [lower, upper], not [3, 1]"),
        ("[[rotor]]\nlimits = [0, inf]", "9: rotor 1: limits 2: must be a finite number, not in"),
        ("[[rotor]]\ntime_constant = -1", "9: rotor 1: time_constant: must be at least 0, not"),
        (
            "[[rotor]]\ndrag = 1\nspin_inertia = 1e-4",
            "rotor 1: spin_inertia: needs speed_per_sqrt_thrust beside it: give both or none",
        ),
        (
            "[[rotor]]\nspeed_per_sqrt_thrust = 1",
            "speed_per_sqrt_thrust: needs spin_inertia beside it: give both or none",
        ),
        (
            "[[rotor]]\nspin_inertia = 1e-4\nspeed_per_sqrt_thrust = 200",
            "spin_inertia: needs a drag other than 0, because its sign gives the direction of spin",
        ),
        (
            "[[rotor]]\ndrag = 1\nspin_inertia = -1\nspeed_per_sqrt_thrust = 200",
            "rotor 1: spin_inertia: must be at least 0, not -1",
        ),
        ("[[rotor]]\nxyz = [0, 0, 0]", "rotor 1: xyz: unknown key; did you mean position?"),
        ("[[frame]]\nname = 'f'\nposition = [0, 0, 0]", "unknown key; did you mean xyz?"),
        ("position = [0, 0, 0]", "link 1: position: unknown key; did you mean xyz?"),
        ("joint = 'continuous'", 'link 1: joint: must be "revolute", without limits, for URDF'),
        ("[[rotor]]\nthrust = 'z'", "9: rotor 1: thrust: unknown key; did you mean max_thrust?"),
        ("[rotor]\n", "rotor: must be an array of tables, [[rotor]], not a table"),
        ("[rotor]\n[rotor]", "write each rotor as [[rotor]], in double brackets"),
        ("[[frame]]\n", "8: frame 1: name: missing: name of the frame"),
        ("[[frame]]\nname = 'base'", "9: frame 1: name: 'base' is the name of the base's own fra"),
        ("[[frame]]\nname = 'f 1'\n[[frame]]\nname = 'f_1'", "'f_1' is the name of frame 1 alre"),
        ("[[frame]]\nname = 'f'\non = 'x'", '10: frame 1: on: must be "base" or the name of a'),
    ],
)
def test_one_fault_has_its_key_line_and_remedy(text: str, message: str) -> None:
    (line,) = faults(LINK + text + "\n")
    assert message in line


@pytest.mark.parametrize(
    ("before", "text", "message"),
    [
        (RODS, "[[rotor]]\n", "6: rotor: belongs to a base without arms, but base.rotors gives"),
        (RODS, 'origin = "bas"\n', "6: base.origin: must be one of 'motor1', 'centre', 'base', no"),
        (RODS, "azimuth_deg = [0, 1]\n", "6: base.azimuth_deg: must have 3 numbers, not 2"),
        (RODS, "azimuth_deg = [0, 1, 400]\n", "base.azimuth_deg 3: must be from -360 to 360"),
        (RODS, "com = [0, 0, 1]\n", "base.mass: missing: a rigid body needs its mass in kg"),
        (RODS, "[[link]]\nmass = 1\nname = 'base_arm'\n", "is the name of the base's arms alrea"),
        (RODS, "[[link]]\nmass = 1\nname = 'theta_3'\n", "is the name of the angle of base arm 3"),
        (CARRIED, 'origin = "centre"\n', '5: base.origin: must be "base" where the base has no a'),
        (CARRIED, "inertia = [1, 1, 3, 0, 0, 0]\n", "5: base.inertia: violates the triangle ineq"),
        (CARRIED, "inertia = [1, 0, 0, 1, 0, 1]\n", "seems to be in that of URDF, xx, xy, xz, yy"),
        (CARRIED, "inertia = [1, 1, 1]\n", "must have 6 numbers, xx, yy, zz, xy, xz, yz, not 3"),
        (CARRIED, "[[link]]\nmass = 1\n", "5: link 1: theta_1 is a coordinate of the base: give"),
        ('name = "x"\n[base]\n', "[[link]]\nname = 'a'\n", "2: base: the robot has no mass; give"),
        ('name = "x"\n', "", "base: missing: the flying base"),
        (CARRIED, "allow_impossible_inertia = true\n", "unknown key; known keys: mass, com"),
    ],
)
def test_faults_of_the_base(before: str, text: str, message: str) -> None:
    (line,) = faults(text, before)
    assert message in line


def test_rods_must_be_whole() -> None:
    assert [line.partition(";")[0] for line in faults("thrust = ['z', 'z']\n")] == [
        "3: base.rotors: missing: the number of rotors and arms, N",
        "3: base.arm: missing: one table for all arms, or a list of one for each",
    ]


def test_faults_of_names_are_told_beside_those_of_values() -> None:
    lines = faults(
        '[[rotor]]\non = "elbo"\ndrag = "much"\n'
        '[[link]]\nname = "elbow"\nparent = "wrist"\nmass = 1\nmasss = 2\n'
        '[[link]]\nname = "elbow"\njoint = "fixed"\nlimits = [2, 1]\n'
        '[[frame]]\nname = "eye"\non = 3\n'
    )
    assert [line.partition(";")[0] for line in lines] == [
        "6: rotor 1: on: must be \"base\" or the name of a link, not 'elbo'",
        "7: rotor 1: drag: must be a number, not a string",
        "10: link 1: parent: must be \"base\" or the name of a link given earlier, not 'wrist'",
        "12: link 1: masss: unknown key",
        "14: link 2: name: 'elbow' is the name of link 1 already",
        "16: link 2: limits: must be left out, because a fixed joint does not move",
        "16: link 2: limits: must be [lower, upper], not [2, 1]",
        "19: frame 1: on: must be a string, not a number",
    ]


def test_one_bad_reference_hides_no_other() -> None:
    text = "".join(f'[[link]]\nname = "l{i}"\nmass = 1\nparent = "l{i + 1}"\n' for i in range(3))
    later, last, unknown = faults(text)
    assert "'l1' comes later" in later
    assert "'l2' comes later" in last
    assert "not 'l3'" in unknown
