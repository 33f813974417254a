"""What a source says and import does not take is reported; what it needs not is no hindrance."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from gibbs_codegen.errors import GibbsCodegenError
from gibbs_codegen.exchange.importing import ImportOptions, import_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.body import RigidBody, inertia_matrix

HEAVY = '<mass value="1"/><inertia ixx="1" iyy="2" izz="2.5" ixy="0" ixz="0" iyz="0"/>'
MASS = f"<inertial>{HEAVY}</inertial>"
URDF = f"""<robot name="r" version="{{version}}" xmlns:x="http://www.ros.org/wiki/xacro">
<link name="a">{MASS}{{link}}</link><link name="b"><inertial>{{inertial}}</inertial></link>
<joint name="j" type="{{type}}">{{joint}}<parent link="a"/><child link="b"/></joint>{{robot}}
</robot>"""
LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
SDF = """<sdf version="1.9"><world name="w">{world}<model name="m" {model}>
<link name="a">{link}<inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia>
</inertial></link><link name="b"><inertial>{inertial}</inertial></link>{more}
<joint name="j" type="{type}"><parent>a</parent><child>b</child><axis>{axis}</axis></joint>
</model></world></sdf>"""
SOLID = "<mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia>"
MJCF = """<mujoco>{top}<worldbody><body name="a">{free}
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><site name="s"/>{body}
<body name="b"><joint name="j" {joint}/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
</body></worldbody>{end}</mujoco>"""
USUAL = {
    URDF: {"version": "1.1", "inertial": HEAVY, "type": "revolute", "joint": LIMIT},
    SDF: {"inertial": SOLID, "type": "revolute", "axis": "<xyz>0 0 1</xyz>"},
    MJCF: {"free": '<freejoint name="root"/>'},
}
FREE = '<joint name="root" type="free" {}/>'
FIELDS = r"(?<!\{)\{(\w+)\}(?!\})"


def imported(form: str, folder: Path, **parts: str) -> tuple[Robot, set[str]]:
    """A robot of a form with parts, and what was left out or noted."""
    filled = dict.fromkeys(re.findall(FIELDS, form), "") | USUAL[form] | parts
    path = folder / "source.xml"
    path.write_text(form.format(**filled))
    robot, report = import_robot(path, ImportOptions("quaternion"))
    lines = [line for line in report if line.kind in ("left out", "note")]
    return robot, {f"{line.subject}: {line.detail}" for line in lines if line.subject != "rotors"}


REPORTED: list[tuple[str, dict[str, str], str, str]] = [
    # Elements and attributes that nobody has foreseen.
    (URDF, {"link": "<buoyancy>3</buoyancy>"}, "<buoyancy> in <link>", "3, line 2"),
    (URDF, {"link": MASS}, "<inertial> in <link>", "line 2"),
    (
        URDF,
        {"robot": '<gazebo reference="a"><dampingFactor>0.1</dampingFactor></gazebo>' * 4},
        "<dampingFactor> in <gazebo>",
        "4 of them, 0.1, lines 3, 3, 3 …",
    ),
    *(
        (URDF, {"robot": f'<gazebo reference="a">{flag}</gazebo>'}, "a", "no gravity acts on it")
        for flag in ("<gravity>0</gravity>", "<turnGravityOff>true</turnGravityOff>")
    ),
    (SDF, {"link": "<gravity>false</gravity>"}, "b", "no gravity acts on it in Gazebo; here it"),
    (SDF, {"link": "<gravity>0.5</gravity>"}, "a", "its gravity flag is 0.5, not true or false"),
    *(
        (URDF, {"robot": f'<gazebo reference="{name}"><gravity>no</gravity></gazebo>'}, name, words)
        for name, words in {
            "a": "its gravity flag is no, not true or false; here it has its weight",
            "aa": "<gazebo> refers to it in line 3; there is no such link or joint; did you mean a",
        }.items()
    ),
    (URDF, {"joint": '<dynamics damping="1" coulomb="2"/>'}, "coulomb of <dynamics>", "2, line 3"),
    (URDF, {"robot": '<loop_joint name="l"/>'}, "<loop_joint> in <robot>", "l, line 3"),
    (URDF, {"inertial": '<mass value="1"/>'}, "b", "no inertia in the file"),
    (URDF, {"inertial": HEAVY.replace("value", "kg")}, "b", "no mass in the file"),
    (URDF, {"joint": '<dynamics friction="1e60"/><limit upper="1"/>'}, "j", "dry friction 1e"),
    (SDF, {"world": "<wind><linear_velocity>3 0 0</linear_velocity></wind>"}, "in <wind>", "3 0 0"),
    (SDF, {"more": "<gripper name='g'/>"}, "<gripper> in <model>", "g, line 3"),
    (SDF, {"link": "<velocity_decay><linear>0.1</linear></velocity_decay>"}, "<linear> in", "0.1"),
    (SDF, {"inertial": SOLID.replace("mass>", "weight>")}, "b", "no mass in the file, so SDF's"),
    (SDF, {"inertial": SOLID.replace("iyy>", "yy>")}, "b", "no iyy in the file, so SDF's"),
    (SDF, {"axis": "<dynamics><friction>5e80</friction></dynamics>"}, "j", "dry friction 5e"),
    (MJCF, {"top": '<option><flag spring="disable"/></option>'}, "spring of <flag>", "disable"),
    (MJCF, {"top": '<option viscosity="1.8e-5"/>'}, "viscosity of <option>", "1.8e-5, line 1"),
    (MJCF, {"body": '<flexcomp name="f" type="grid"/>'}, "<flexcomp> in <body>", "f, line 2"),
    (MJCF, {"joint": 'springyield="1"'}, "springyield of <joint>", "1, j, line 3"),
    (
        MJCF,
        {"end": "<actuator>" + '<cylinder joint="j" area="1"/>' * 2 + "</actuator>"},
        "<cylinder> in <actuator>",
        "2 of them, lines 4, 4",
    ),
    # What acts on the base, also by defaults, and inputs that are none.
    (
        MJCF,
        {"free": FREE.format(""), "top": '<default><joint armature="1"/></default>'},
        "root",
        "armature of the joint of the base",
    ),
    (MJCF, {"free": FREE.format('stiffness="1" frictionloss="2"')}, "root", "dry friction 2, st"),
    (
        MJCF,
        {"end": '<actuator><motor name="lift" joint="root" gear="0 0 1 0 0 0"/></actuator>'},
        "lift",
        "an actuator on joint root, which has no input",
    ),
    (
        MJCF,
        {"end": '<actuator><motor name="roll" site="s" gear="0 0 0 1 0 0"/></actuator>'},
        "roll",
        "an actuator with a torque and no force",
    ),
    (
        MJCF,
        {"end": '<actuator><general name="u" joint="j" dyntype="filter" dynprm="1"/></actuator>'},
        "u",
        "dynamics of an actuator",
    ),
    (
        MJCF,
        {"end": '<actuator><motor name="u" joint="j" gear="5" ctrlrange="-1 2"/></actuator>'},
        "u",
        "limits of its force, -5 to 10: the larger holds both ways",
    ),
    (
        MJCF,
        {"end": '<actuator><motor joint="j"/><motor name="u2" joint="j"/></actuator>'},
        "u2",
        "one more actuator on joint j",
    ),
    (
        MJCF,
        {
            "top": '<compiler angle="radian"/>',
            "joint": 'ref="0.25"',
            "end": '<actuator><position name="u" joint="j" kp="1"/></actuator>',
        },
        "u",
        "its command is 1 times its control, and -0.25 more",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("form", "parts", "subject", "detail"), REPORTED)
def test_what_is_not_taken_is_reported(
    form: str, parts: dict[str, str], subject: str, detail: str, tmp_path: Path
) -> None:
    lines = imported(form, tmp_path, **parts)[1] - imported(form, tmp_path)[1]
    assert len([line for line in lines if subject in line and detail in line]) == 1, lines


# What has no part in the motion, or says what holds anyway, is no line of the report, nor a fault.
SILENT: list[tuple[str, dict[str, str]]] = [
    (URDF, {"robot": "<drake:collision_filter_group/><sensor:camera/>"}),
    (URDF, {"robot": '<gazebo reference="a"><mu1>1</mu1><gravity>1</gravity></gazebo>'}),
    (URDF, {"type": "fixed", "joint": '<axis xyz="0"/><dynamics damping="x"/><limit upper="x"/>'}),
    (URDF, {"type": "continuous", "joint": '<limit lower="nan" upper="" effort="1"/>'}),
    (SDF, {"link": "<gravity>1</gravity><velocity_decay><linear>0.0</linear></velocity_decay>"}),
    (SDF, {"type": "fixed", "axis": "<xyz>0</xyz><limit><lower>x</lower></limit>"}),
    (SDF, {"type": "continuous", "axis": "<limit><lower>x</lower></limit>"}),
    (MJCF, {"top": '<option timestep="1" density="0"><flag spring="enable"/></option>'}),
    (MJCF, {"top": '<custom><numeric name="n" data="inf"/></custom><statistic extent="nan"/>'}),
    (MJCF, {"top": '<asset><mesh file="n.obj"/></asset><default><geom rgba="1 0 0 1"/></default>'}),
]  # fmt: skip


@pytest.mark.parametrize(("form", "parts"), SILENT)
def test_what_has_no_part_is_neither_reported_nor_refused(
    form: str, parts: dict[str, str], tmp_path: Path
) -> None:
    assert imported(form, tmp_path, **parts)[1] == imported(form, tmp_path)[1] == set()


REFUSED: list[tuple[str, dict[str, str], str]] = [
    (URDF, {"inertial": f'{HEAVY}<x:if value="1"/>'}, "source.xml:2: <x:if>: is xacro, not URDF"),
    (URDF, {"joint": '<origin rpy="0 0 0" quat_xyzw="0 0 0 1"/>'}, "has both rpy and quat_xyzw"),
    (URDF, {"joint": '<origin quat_xyzw="0 0 0 0"/>'}, "has a quaternion that is zero"),
    (MJCF, {"top": '<option gravity="0 -9.81 0"/>'}, ":1: <option>: gravity 0 -9.81 0 must point"),
    (MJCF, {"top": '<option gravity="0 0 9.81"/>'}, "must point along -z, as 0 0 -9.81 does"),
    (MJCF, {"joint": 'type="hing"'}, 'xml:3: <joint "j">: MuJoCo refuses it: invalid keyword'),
    (MJCF, {"top": "<include file='no.xml'/>"}, "<include>: no.xml: no such file beside source."),
    (MJCF, {"body": '<body name="c"><joint/></body>'}, '<body "c">: MuJoCo refuses it: mass and'),
]  # fmt: skip


@pytest.mark.parametrize(("form", "parts", "message"), REFUSED)
def test_what_cannot_be_imported_is_refused_with_its_place(
    form: str, parts: dict[str, str], message: str, tmp_path: Path
) -> None:
    with pytest.raises(GibbsCodegenError, match=re.escape(message)):
        imported(form, tmp_path, **parts)


def test_shapes_in_frames_with_a_class_have_the_mass_of_their_body(tmp_path: Path) -> None:
    shape = '<frame childclass="c"><geom size="0.1" mass="3"/></frame>'
    text = f"""<mujoco><default><default class="c"/></default><worldbody><body name="b"><freejoint/>
        {shape}</body></worldbody></mujoco>"""
    (tmp_path / "source.xml").write_text(text)
    robot, _ = import_robot(tmp_path / "source.xml", ImportOptions("quaternion"))
    assert robot.total_mass == 3.0


def test_gravity_that_is_switched_off_is_none(tmp_path: Path) -> None:
    flag = '<option gravity="0 3 0"><flag gravity="disable"/></option>'
    assert imported(MJCF, tmp_path, top=flag)[0].gravity == 0.0


@pytest.mark.parametrize("version", ["1.0", "1.1"])
def test_quaternions_are_read_as_pinocchio_reads_them(version: str, tmp_path: Path) -> None:
    """Pinocchio's urdfdom knows them from version 1.1 on."""
    origin = '<origin xyz="1 2 3" quat_xyzw="0.1 -0.4 0.8 0.3"/>'
    parts = {"version": version, "joint": f'{origin}{LIMIT}<axis xyz="0 0 1"/>'}
    robot, lines = imported(URDF, tmp_path, inertial=origin + HEAVY, **parts)
    path = str(tmp_path / "source.xml")
    model = pin.buildModelFromUrdf(path, pin.JointModelFreeFlyer())
    (link,), its = robot.links, model.inertias[2]
    assert link.pose is not None
    roll, pitch, yaw = np.deg2rad([float(angle) for angle in link.pose.rpy_deg])
    turn = pin.rpy.rpyToMatrix(roll, pitch, yaw)
    assert np.allclose(turn, model.jointPlacements[2].rotation, rtol=0.0, atol=1e-12)
    assert isinstance(link.body, RigidBody)
    assert np.allclose(inertia_matrix(link.body.inertia), its.inertia, rtol=0.0, atol=1e-12)
    assert any("quat_xyzw of <origin>" in line for line in lines) == (version == "1.0")


ARM = """<mujoco model="arm"><compiler angle="radian" {compiler}/><default><joint damping="0.3"/>
</default>{top}<worldbody><body name="b"><joint name="j" axis="0 1 0"/>{mass}</body></worldbody>
{end}</mujoco>"""
INERTIAL = '<inertial pos="0 0 0" mass="0.3" diaginertia="1 1 1"/>'
# A tetrahedron of 1/6 m³.
MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
BASE = '<body name="a"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>{}</body>'
ATTACHED = (
    '<mujoco><asset><model name="arm" file="{}"/></asset><worldbody>'
    + BASE.format('<frame euler="0 90 0"><attach model="arm" {} prefix="p_"/></frame>')
    + "</worldbody></mujoco>"
)
MESHED = {
    "compiler": 'meshdir="shapes"',
    "top": '<asset><mesh file="m.obj"/></asset>',
    "mass": '<geom type="mesh" mesh="m" density="6"/>',
}


def arm(**parts: str) -> str:
    """The text of a model of an arm."""
    return ARM.format(**{"compiler": "", "top": "", "end": "", "mass": INERTIAL, **parts})


SEVERAL: dict[str, tuple[dict[str, str], float]] = {
    "included by an included file, beside it": (
        {
            "robot.xml": '<mujoco><include file="parts\\all.xml"/></mujoco>',
            "parts/all.xml": '<mujoco><include file="d.xml"/><worldbody>'
            + BASE.format(f'<body name="b"><joint name="p_j"/>{INERTIAL}</body>')
            + "</worldbody></mujoco>",
            "parts/d.xml": '<any><default><joint damping="0.3"/></default></any>',
        },
        0.3,
    ),
    "attached": ({"robot.xml": ATTACHED.format("c/arm.xml", 'body="b"'), "c/arm.xml": arm()}, 0.3),
    "attached whole, with a mesh beside it": (
        {
            "robot.xml": ATTACHED.format("c/arm.xml", ""),
            "c/arm.xml": arm(**MESHED),
            "c/shapes/m.obj": MESH,
        },
        1.0,
    ),
    "attached by what is attached": (
        {
            "robot.xml": ATTACHED.format("c/d/mid.xml", 'body="a"').replace("p_", "o_"),
            "c/d/mid.xml": ATTACHED.format("../arm.xml", 'body="b"').replace("<freejoint/>", ""),
            "c/arm.xml": arm(end='<actuator><motor joint="j"/></actuator>'),
        },
        0.3,
    ),
    "a mesh beside an included file": (
        {
            "robot.xml": '<mujoco><include file="c/arm.xml"/></mujoco>',
            "c/arm.xml": f"<any>{MESHED['top']}<worldbody>"
            + BASE.format(f'<body><joint name="p_j" damping="0.3"/>{MESHED["mass"]}</body>')
            + "</worldbody></any>",
            "c/m.obj": MESH,
        },
        1.0,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SEVERAL)
def test_a_model_in_several_files(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are found beside each other; what is of their names in the working folder is not."""
    files, mass = SEVERAL[name]
    for each, text in files.items():
        path = tmp_path / "robot" / each
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    here = tmp_path / "here"
    here.mkdir()
    for each in ("model_0.xml", "arm.xml", "all.xml", "d.xml", "m.obj"):
        (here / each).write_text("wrong")
    monkeypatch.chdir(here)
    robot, _ = import_robot(Path("../robot/robot.xml"), ImportOptions("quaternion"))
    (link,) = robot.links
    assert isinstance(link.body, RigidBody)
    assert (link.body.mass, link.passive.damping) == (pytest.approx(mass), 0.3)
    assert link.coordinate is not None
    assert link.coordinate.endswith("p_j")


def test_a_model_that_attaches_itself_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "robot.xml"
    path.write_text(ATTACHED.format("robot.xml", ""))
    with pytest.raises(GibbsCodegenError, match="or models that attach themselves"):
        import_robot(path, ImportOptions("quaternion"))
