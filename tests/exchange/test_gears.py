"""Gears of URDF, SDF and MJCF: read, written, and left out where they lead nowhere."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from gibbs_codegen.exchange.exporting import Format, export_robot
from gibbs_codegen.exchange.importing import ImportOptions, import_robot
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.gear import Gear
from gibbs_codegen.robot.parts.motor import Motor

INERTIA = "inertia = [1e-3, 1e-3, 1e-3, 0, 0, 0]"
HAND = f"""
name = "hand"
base = {{ mass = 1, {INERTIA}, attitude = "quaternion" }}
[[link]]
name = "driver"
xyz = [0, 0, 0.1]
mass = 0.1
{INERTIA}
limits = [-1, 1]
[[link]]
name = "rack"
parent = "base"
joint = "prismatic"
xyz = [0, 0.1, 0.1]
mass = 0.1
{INERTIA}
gear = {{ of = "driver", ratio = 0.25, offset = 0.5 }}
[[link]]
name = "tip"
xyz = [0, 0, 0.1]
mass = 0.1
{INERTIA}
gear = {{ of = "rack", ratio = -2 }}
"""


def imported(text: str, tmp_path: Path, **options: object) -> tuple[Robot, dict[str, list[str]]]:
    """The robot of a text, and what is told of each joint's gear."""
    path = tmp_path / "hand.xml"
    path.write_text(text, encoding="utf-8")
    robot, findings = import_robot(path, replace(ImportOptions("quaternion"), **options))
    told: dict[str, list[str]] = {}
    for line in findings:
        if line.kind in ("gear", "motor", "left out") and "joint" in line.detail:
            told.setdefault(line.subject, []).append(line.detail)
    return robot, told


@pytest.mark.parametrize("form", ["urdf", "sdf", "mjcf"])
def test_gears_come_back_as_they_were(form: Format, tmp_path: Path) -> None:
    if form == "mjcf":
        pytest.importorskip("mujoco")
    text, _ = export_robot(parse_robot(HAND), form)
    robot, told = imported(text, tmp_path)
    gears = [link.gear for link in robot.links]
    assert gears == [None, Gear(of=1, ratio=0.25, offset=0.5), Gear(of=2, ratio=-2.0)]
    assert [link.limits.low for link in robot.links] == [-1.0, None, None]
    of = [detail for details in told.values() for detail in details]
    assert len(of) == 2
    assert of == [
        "moved by joint driver: 0.25 × driver + 0.5",
        "moved by joint rack: -2 × rack",
    ]


URDF, _ = export_robot(parse_robot(HAND), "urdf")


@pytest.mark.parametrize(
    ("old", "new", "joint", "mover"),
    [
        ('joint="rack"', 'joint="none"', "tip", "none"),
        ('multiplier="-2.0"', 'multiplier="0"', "tip", "rack"),
        ('joint="driver"', 'joint="tip"', "rack", "tip"),
    ],
)
def test_what_leads_nowhere_is_left_out(
    old: str, new: str, joint: str, mover: str, tmp_path: Path
) -> None:
    assert old in URDF
    robot, told = imported(
        URDF.replace(f"<mimic {old}", f"<mimic {new}").replace(old, new), tmp_path
    )
    assert told[joint] == [f"its gear to joint {mover}, which does not move it"]
    assert joint in [robot.links[i - 1].coordinate for i in robot.moving]


def test_limits_of_a_joint_that_follows_are_told(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    text, _ = export_robot(parse_robot(HAND), "mjcf")
    assert text.count('name="tip" type="hinge"') == 1
    limited = text.replace('name="tip" type="hinge"', 'name="tip" type="hinge" range="-0.2 0.3"')
    _, told = imported(limited, tmp_path)
    assert told["tip"][1:] == ["limits of a joint that another moves"]


def test_joints_that_follow_a_locked_one_are_locked_where_it_puts_them(tmp_path: Path) -> None:
    path = tmp_path / "hand.urdf"
    path.write_text(URDF, encoding="utf-8")
    robot, findings = import_robot(path, ImportOptions("quaternion", lock={"driver": 0.2}))
    assert not robot.links
    told = {x.subject: x.detail for x in findings if x.kind == "locked"}
    assert told["rack"] == "at 0.55; follows joint driver"
    assert told["tip"] == "at -1.1; follows joint rack"


DIFFERENTIAL = HAND.replace(
    'of = "rack", ratio = -2', 'of = ["driver", "rack"], ratio = [0.5, -2], offset = 0.1'
)


def test_differentials_of_mjcf_come_back_and_lose_what_is_locked(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    text, _ = export_robot(parse_robot(DIFFERENTIAL), "mjcf")
    robot, told = imported(text, tmp_path)
    assert robot.links[2].gear == Gear(of=(1, 2), ratio=(0.5, -2.0), offset=0.1)
    assert told["tip"] == ["moved by joints driver and rack: 0.5 × driver - 2 × rack + 0.1"]
    free = text.replace('joint1="rack"', 'active="false" joint1="rack"')
    robot, _ = imported(free, tmp_path, lock={"driver": 0.2})
    assert [link.gear for link in robot.links] == [None, Gear(of=1, ratio=-2.0, offset=0.2)]
    path = tmp_path / "whole.xml"
    path.write_text(text, encoding="utf-8")
    _, findings = import_robot(path, ImportOptions("quaternion", lock={"driver": 0.2}))
    locked = {x.subject: x.detail for x in findings if x.kind == "locked"}
    assert locked["tip"] == "at -0.9; follows joints driver and rack"


def test_constraints_stand_beside_gears(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    held = f'{HAND}[[constraint]]\nname = "grip"\ntype = "point"\nframe = "base"'
    text, _ = export_robot(parse_robot(held), "mjcf")
    robot, _ = imported(text, tmp_path)
    assert len(robot.constraints) == 1
    assert robot.links[1].gear == Gear(of=1, ratio=0.25, offset=0.5)


def test_sdf_counts_from_a_reference(tmp_path: Path) -> None:
    text, _ = export_robot(parse_robot(HAND), "sdf")
    robot, _ = imported(text.replace("<reference>0.0<", "<reference>0.2<"), tmp_path)
    assert robot.links[1].gear.offset == pytest.approx(0.45)


def test_equalities_of_mjcf_that_are_no_gears_are_told(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    text, _ = export_robot(parse_robot(HAND), "mjcf")
    robot, _ = imported(text.replace("0.5 0.25 0.0 0.0", "0.5 0.25 0.1 0.0"), tmp_path)
    assert [link.gear for link in robot.links] == [None, None, Gear(of=2, ratio=-2.0)]
    twice = '<joint name="again" joint1="rack" joint2="tip"/></equality>'
    robot, told = imported(text.replace("</equality>", twice), tmp_path)
    assert robot.links[1].gear == Gear(of=1, ratio=0.25, offset=0.5)
    assert told["again"] == ["one more equality that moves joint rack"]
    text, _ = export_robot(parse_robot(DIFFERENTIAL), "mjcf")
    path = tmp_path / "slack.xml"
    path.write_text(text.replace('joint="tip" coef="1.0"', 'joint="tip" coef="0"'))
    robot, findings = import_robot(path, ImportOptions("quaternion"))
    assert robot.links[2].gear is None
    assert "an equality of tendons that is not a gear" in {line.detail for line in findings}


GEARBOX = """
<sdf version="1.9"><model name="reducer">
<link name="housing"><inertial><mass>1</mass><inertia><ixx>1e-3</ixx><iyy>1e-3</iyy><izz>1e-3</izz>
</inertia></inertial></link>
{links}
<joint name="input" type="revolute"><parent>housing</parent><child>pinion</child>
<axis><xyz>0 0 1</xyz></axis></joint>
<joint name="output" type="revolute"><pose>0 0 0 3.141592653589793 0 0</pose>
<parent>housing</parent><child>wheel</child><axis><xyz>0 0 1</xyz></axis></joint>
<joint name="mesh" type="gearbox"><parent>pinion</parent><child>wheel</child>
<gearbox_ratio>3</gearbox_ratio><gearbox_reference_body>{reference}</gearbox_reference_body>
<axis><xyz>0 0 1</xyz></axis><axis2><xyz>0 0 1</xyz></axis2></joint>
</model></sdf>
"""
WHEELS = "".join(
    f'<link name="{name}"><pose>{x} 0 0.1 0 0 0</pose><inertial><mass>0.1</mass><inertia>'
    "<ixx>1e-4</ixx><iyy>1e-4</iyy><izz>1e-4</izz></inertia></inertial></link>"
    for name, x in (("pinion", 0.1), ("wheel", -0.1))
)


def test_gearboxes_of_sdf_are_gears_along_the_axes_of_joints(tmp_path: Path) -> None:
    """θ₂ = −3 θ₁ about z up; the joint of the wheel counts about z down, so that it is 3 here."""
    robot, told = imported(GEARBOX.format(links=WHEELS, reference="housing"), tmp_path)
    assert [link.gear for link in robot.links] == [None, Gear(of=1, ratio=3.0)]
    assert told["output"] == ["moved by joint input: 3 × input"]
    path = tmp_path / "hand.xml"
    path.write_text(GEARBOX.format(links=WHEELS, reference="pinion"), encoding="utf-8")
    robot, findings = import_robot(path, ImportOptions("quaternion"))
    assert len(robot.moving) == 2
    assert any(x.subject == "mesh" and "a gearbox of links" in x.detail for x in findings)


DRIVEN = """
<transmission name="drive"><type>transmission_interface/SimpleTransmission</type>
<joint name="driver"/><actuator name="motor">{}</actuator></transmission></robot>
"""


def test_rotors_of_transmissions_are_motors_behind_gears(tmp_path: Path) -> None:
    rotor = '<drake:gear_ratio value="-60"/><drake:rotor_inertia value="2e-5"/>'
    robot, told = imported(URDF.replace("</robot>", DRIVEN.format(rotor)), tmp_path)
    assert robot.links[0].motor == Motor(rotor_inertia=2e-5, gear_ratio=-60.0)
    turns = "turns -60 times for each turn of the joint, its rotor with 2e-05 kg m²"
    assert turns in told["driver"]
    text, findings = export_robot(robot, "mjcf")
    assert f'armature="{2e-5 * 60.0**2!r}"' in text
    assert any("the reaction of its motor's rotor on the parent link" in line for line in findings)
    for form in ("urdf", "sdf"):
        text, findings = export_robot(robot, form)
        assert not any("armature" in line or "motor" in line for line in findings)
        back, _ = imported(text, tmp_path)
        assert [link.motor for link in back.links] == [link.motor for link in robot.links]
        assert [link.passive for link in back.links] == [link.passive for link in robot.links]
    sliding = tmp_path / "sliding.sdf"
    sliding.write_text(text.replace('type="revolute"', 'type="prismatic"'), encoding="utf-8")
    robot, told = import_robot(sliding, ImportOptions("quaternion"))
    assert not any(link.motor for link in robot.links)
    assert "<drake:rotor_inertia> in <joint>" in {
        line.subject for line in told if line.kind == "left out"
    }
    reduced = "<mechanicalReduction>60</mechanicalReduction>"
    path = tmp_path / "hand.xml"
    path.write_text(URDF.replace("</robot>", DRIVEN.format(reduced)), encoding="utf-8")
    robot, told = import_robot(path, ImportOptions("quaternion"))
    assert robot.links[0].motor is None
    lost = {line.subject: line.detail for line in told if line.kind == "left out"}
    assert lost["driver"].startswith("a reduction of 60: the file has no inertia of a rotor")
    assert lost["transmissions"] == "1"
    several = f"{rotor}</actuator><actuator>"
    path.write_text(URDF.replace("</robot>", DRIVEN.format(several)), encoding="utf-8")
    robot, told = import_robot(path, ImportOptions("quaternion"))
    assert robot.links[0].motor is None
    assert "transmissions" in {line.subject for line in told if line.kind == "left out"}
    robot, _ = imported(URDF.replace("</robot>", DRIVEN.format(rotor + reduced)), tmp_path)
    assert robot.links[0].motor == Motor(rotor_inertia=2e-5, gear_ratio=-60.0)
