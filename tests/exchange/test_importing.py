"""Features of published files: anchors, welds, locks, rotors, snapping, names, other roots."""

from __future__ import annotations

import math
import re
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from conftest import ROOT
from numpy.typing import NDArray
from support.pinocchio_oracle import free_flyer, placed

from gibbs_codegen.cli.app import main
from gibbs_codegen.errors import GibbsCodegenError
from gibbs_codegen.exchange.importing import ImportOptions, import_robot
from gibbs_codegen.exchange.sources import Finding
from gibbs_codegen.robot.file import parse_robot, read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.body import RigidBody
from gibbs_codegen.robot.parts.pose import Pose
from gibbs_codegen.robot.parts.servo import Servo
from gibbs_codegen.robot.text import robot_text

Array = NDArray[np.float64]
SOURCES = Path(__file__).parent / "sources"
FEATURES = (SOURCES / "features.urdf").read_text()


def imported(text: str, folder: Path, **options: object) -> tuple[Robot, list[Finding]]:
    """Import a text, with angles for the attitude."""
    path = folder / ("robot.xml" if "<mujoco" in text else "robot.urdf")
    path.write_text(text)
    return import_robot(path, ImportOptions("xyz", **options))  # type: ignore[arg-type]


def told(report: list[Finding], kind: str) -> list[str]:
    """What the report says was done."""
    return [line.subject for line in report if line.kind == kind]


def test_features_of_published_files(tmp_path: Path) -> None:
    robot, report = imported(FEATURES, tmp_path)
    assert robot.name == "features_of_published_files"
    left, right = robot.links
    assert told(report, "base") == ["hub"]
    assert told(report, "welded") == ["prop_0", "prop_1", "stiff", "shifted"]
    assert told(report, "locked") == ["spin_0", "spin_1", "stuck", "slid"]
    left_out = ["transmissions", "rolling moments of rotors", "x"]
    assert told(report, "gear") == ["right"]
    assert sorted(told(report, "left out")) == sorted(left_out)
    assert {"boom-left", "boom_left", "x", "rotors"} == set(told(report, "note"))
    assert set(told(report, "snapped")) == {
        *("x", "right", "spin_1", "inertia of boom-left", "hub")
    }
    assert left.pose is not None
    assert right.pose is not None
    # What was 1.5708 is 90 degrees, and an axis of 3e-6 beside 1 is x.
    assert left.pose.rpy_deg == (0, 0, 90)
    assert (left.axis, right.axis) == ((0.0, 0.0, -1.0), (1.0, 0.0, 0.0))
    assert (left.name, left.coordinate, left.passive.damping) == ("boom-left", "x_joint", 0.05)
    assert (left.limits.low, left.limits.effort, left.limits.velocity) == (-1.0, None, 2.0)
    assert (right.limits.low, right.limits.high) == (None, None)
    # In generated code boom-left and boom_left would be one name.
    assert right.name == "boom_left_link"
    assert robot.allow_impossible_inertia
    # The slider stands at 0.1 for good.
    assert robot.frames[-1].pose.xyz == pytest.approx((0.0, 0.0, -0.3))
    assert isinstance(robot.base.body, RigidBody)
    assert robot.base.body.com[0] == robot.base.body.inertia[3] == 0.0
    ccw, cw = robot.thrusters
    assert (ccw.drag, cw.drag, cw.time_constant) == (-0.016, 0.016, 0.0125)
    assert cw.direction == (0.0, 0.0, -1.0)
    assert cw.limits == pytest.approx((0.0, 8.54858e-06 * 838**2))


def test_without_snapping_every_digit_stays(tmp_path: Path) -> None:
    robot, report = imported(FEATURES, tmp_path, snap=False)
    assert not told(report, "snapped")
    pose = robot.links[0].pose
    assert pose is not None
    assert pose.rpy_deg[2] == Fraction(repr(np.rad2deg(1.5708).item()))
    assert robot.links[1].axis[2] == pytest.approx(3e-6)
    assert isinstance(robot.base.body, RigidBody)
    assert robot.base.body.inertia[3] == 1e-21


def test_locks_are_where_they_were_asked_for(tmp_path: Path) -> None:
    robot, _ = imported(FEATURES, tmp_path, lock={"x": 0.5, "stuck": 0.0, "root_joint": 0.0})
    assert not robot.links  # The joint right follows x.
    boom = next(frame for frame in robot.frames if frame.name == "boom-left")
    # About -z, on a mount that stands at 90 degrees.
    turned = placed(boom.pose).rotation
    assert np.allclose(turned, pin.utils.rotate("z", np.pi / 2 - 0.5), atol=1e-15)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"lock": {"rigth": 0.0}}, "--lock rigth: no such joint; did you mean right?"),
        ({"base": "hab"}, "--base hab: no such link or motion; did you mean hub?"),
    ],
)
def test_unknown_names(options: dict[str, object], message: str, tmp_path: Path) -> None:
    with pytest.raises(GibbsCodegenError, match=re.escape(message)):
        imported(FEATURES, tmp_path, **options)


FAULTS = [
    ('<link name="hub">', '<link name="prop_0">', "there is another link of that name", 13),
    ('<joint name="right"', '<joint name="x"', "there is another joint of that name", 11),
    ('<child link="stiff"/>', '<child link="stif"/>', "there is no link stif; did you mean", 19),
    ('<child link="stiff"/>', '<child link="hub"/>', "is carried by joint root_joint already", 19),
    ('<mass value="1.5"/>', '<mass value="nan"/>', "must be a finite number", 6),
    ('<mass value="1.5"/>', '<mass value="-1"/>', "value must be at least 0, not -1", 6),
    ('<mass value="1.5"/>', '<mass value="1e60"/>', "must be a finite number up to", 6),
    ('type="floating"', 'type="loating"', "type must be one of revolute, continuous", 5),
    ('xyz="0 0.2 0"', 'xyz="0 0.2"', "xyz must have 3 numbers, not 2", 9),
    ('<axis xyz="0 0 -1"/><limit', '<axis xyz="0 0 0"/><limit', "its axis has no length", 9),
    ('lower="-1" upper="1"', 'lower="1" upper="-1"', "lower 1 is above upper -1", 9),
    (
        'type="continuous"><origin xyz="0 -',
        'type="planar"><origin xyz="0 -',
        "at the root may be",
        11,
    ),
    ('<joint name="x"', '<joint name=""', "has no name", 9),
    ("ccw</turn", "left</turn", "<turningDirection> must be cw or ccw, not left", 24),
    (
        "<linkName>prop_0",
        "<linkName>prop_9",
        "rotor prop_9 is on link prop_9, which is missing",
        None,
    ),
    ('<robot name="', '<!DOCTYPE robot><robot name="', "declares a document type", 3),
]


@pytest.mark.parametrize(("right", "wrong", "message", "line"), FAULTS)
def test_faults_have_their_lines(
    right: str, wrong: str, message: str, line: int | None, tmp_path: Path
) -> None:
    assert right in FEATURES
    with pytest.raises(GibbsCodegenError) as caught:
        imported(FEATURES.replace(right, wrong, 1), tmp_path)
    assert message in str(caught.value)
    if line is not None:
        assert f"robot.urdf:{line}:" in str(caught.value)


def moving(robot: Robot, q: Array, v: Array, frame: str) -> tuple[pin.SE3, Array, float]:
    """Pose and local velocity of a frame, and the kinetic energy."""
    model = free_flyer(robot)
    state = model.configuration(q), model.spread(v)
    pin.forwardKinematics(model.model, model.data, *state)
    found = next((f for f in robot.frames if f.name == frame), None)
    on = found.on if found else [link.name for link in robot.links].index(frame) + 1
    seat = placed(found.pose) if found else pin.SE3.Identity()
    joint, at = model.bodies[on]
    velocity = (at * seat).actInv(model.data.v[joint]).vector
    energy = pin.computeKineticEnergy(model.model, model.data, *state)
    return model.data.oMi[joint] * at * seat, velocity, energy


@pytest.mark.parametrize("base", ["a4", "b2", "tilt_left", "finger_1", "battery"])
def test_another_base_is_the_same_machine(base: str) -> None:
    rotors = SOURCES / "everything_rotors.toml"
    path = SOURCES / "everything.urdf"
    robot, _ = import_robot(path, ImportOptions("xyz", rotors=rotors, snap=False))
    other, _ = import_robot(path, ImportOptions("xyz", rotors=rotors, snap=False, base=base))
    random = np.random.default_rng(3)
    names = [link.coordinate for link in robot.links]
    order = [names.index(link.coordinate) for link in other.links]
    assert sorted(order) == [*range(10)]
    q, v = random.uniform(-1.0, 1.0, 17), random.uniform(-1.0, 1.0, 16)
    q[3:7] /= np.linalg.norm(q[3:7])
    pose, velocity, energy = moving(robot, q, v, base)
    turn = pin.Quaternion(pose.rotation).coeffs()
    its_q = np.concatenate([pose.translation, turn, q[7:][order]])
    its_v = np.concatenate([velocity, v[6:][order]])
    back, _, its_energy = moving(other, its_q, its_v, "frame")
    assert its_energy == pytest.approx(energy, rel=1e-12)
    assert np.allclose(back.homogeneous, pin.XYZQUATToSE3(q[:7]).homogeneous, atol=1e-12)


def test_mjcf_is_what_mujoco_makes_of_it() -> None:
    import mujoco

    path = SOURCES / "arm_with_ball_joint.xml"
    robot, report = import_robot(path, ImportOptions("xyz", snap=False))
    names = [link.coordinate for link in robot.links]
    assert names == ["s1", "s2", "slide", "b_x", "b_y", "b_z", "t"]
    assert told(report, "left out")[-1] == "b"
    first = robot.links[0]
    assert (first.passive.armature, first.passive.stiffness) == (0.01, 2.0)
    # Angles count from ref, 10 degrees.
    assert first.passive.rest == pytest.approx(np.deg2rad(10.0))
    assert first.limits.low == pytest.approx(np.deg2rad(-100.0))
    assert robot.links[-1].limits.effort == 3.0
    (rotor,) = robot.thrusters
    assert (rotor.on, rotor.limits) == (7, (0.0, 10.0))
    assert rotor.drag == pytest.approx(-0.02)
    assert [frame.name for frame in robot.frames if frame.on == 3] == ["tool"]
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    random = np.random.default_rng(5)
    q = random.uniform(-1.0, 1.0, 14)
    q[3:7] /= np.linalg.norm(q[3:7])
    data.qpos[:7] = q[[0, 1, 2, 6, 3, 4, 5]]
    data.qpos[7:10] = q[7:10] + model.qpos0[7:10]
    ball = (
        pin.utils.rotate("x", q[10]) @ pin.utils.rotate("y", q[11]) @ pin.utils.rotate("z", q[12])
    )
    data.qpos[10:14] = np.roll(pin.Quaternion(ball).coeffs(), 1)
    data.qpos[14] = q[13]
    mujoco.mj_fwdPosition(model, data)
    matrix = np.empty((model.nv, model.nv))
    for row, unit in zip(matrix, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, row, unit)
    to_mujoco = np.eye(model.nv)  # Linear velocity in world axes; of the ball, ω in its own.
    to_mujoco[:3, :3] = pin.Quaternion(q[3:7]).toRotationMatrix()
    z, yz = pin.utils.rotate("z", q[12]).T, pin.utils.rotate("y", q[11]).T
    to_mujoco[9:12, 9:12] = np.column_stack([z @ yz @ np.eye(3)[0], z @ np.eye(3)[1], np.eye(3)[2]])
    armature = np.diag(model.dof_armature)
    expected = to_mujoco.T @ (matrix - armature) @ to_mujoco
    found = free_flyer(robot).dynamics(q, np.zeros(13), np.zeros(8)).mass_matrix
    assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()


def test_pictures_of_mjcf_are_not_needed(tmp_path: Path) -> None:
    text = """<mujoco model="X"><compiler meshdir="assets" coordinate="local" convexhull="false"/>
    <option collision="all" gravity="0 0 -3.7"/>
    <default><default class="m"><geom mass="0"/><default class="v"><geom type="mesh"/></default>
    </default></default>
    <asset><texture type="2d" file="a.png"/><material name="a" texture="a"/>
      <mesh file="b.obj"/></asset>
    <worldbody><body name="quad" childclass="m"><freejoint/><geom class="v" mesh="b" material="a"/>
      <geom type="box" size=".1 .2 .3" mass="2" material="a"/><site name="s" pos="1 0 0"/></body>
    </worldbody>
    <actuator><motor name="u" site="s" gear="0 0 2 0 0 -.04" ctrlrange="0 3"/>
      <motor name="roll" site="s" gear="0 0 0 1 0 0"/></actuator></mujoco>"""
    robot, report = imported(text, tmp_path)
    assert robot.total_mass == 2.0
    assert robot.gravity == 3.7
    assert [(r.drag, r.limits) for r in robot.thrusters] == [(-0.02, (0.0, 6.0))]
    assert "roll" in told(report, "left out")


DETAILS = """<mujoco><worldbody>
  <body name="quad"><freejoint name="root"/><geom size=".1" mass="1"/>
    <body name="b" gravcomp="1"><joint name="j" stiffness="1 2" damping="1 0 3" {j}/>
      <joint name="k" axis="1 0 0"/><geom size=".1" mass="1"/>
      <body name="b_j"><joint name="ball" type="ball" armature="0.1"/><geom size=".1" mass="1"/>
        <site name="s" pos="0 0 1"/></body></body></body></worldbody>
  <actuator><general name="servo" joint="j" gainprm="50" biastype="affine" biasprm="0 -50 0"
      ctrlrange="-1.5 1.5"/>
    <general site="s" gear="0 0 2 0 0 .04" gainprm="-3" ctrlrange="0 1"/></actuator></mujoco>"""


def test_mjcf_is_told_where_it_is_not_imported(tmp_path: Path) -> None:
    text = DETAILS.format(j='actuatorfrcrange="-4 4"')
    robot, report = imported(text, tmp_path, lock={"root": 0.0})
    assert robot.name == "robot"  # The file's, since the model has none.
    assert "on b_j, drag 0.02 m, 0 to 6 N (motor at a site)" in [line.detail for line in report]
    assert [line[1:] for line in map(_as_tuple, report) if line[0] == "left out"] == [
        ("servo", "limits of its commands, -1.5 to 1.5"),
        ("b", "compensation of its weight"),
        ("j", "stiffness of higher order, damping of higher order"),
        ("ball", "armature"),
    ]
    assert ("note", "ball", "a ball joint, as three hinges about x, y and z") in map(
        _as_tuple, report
    )
    # The first of the body's two links gives way to the link that has its name.
    assert [link.name for link in robot.links[:3]] == ["b_j_2", "b", "b_j_ball_x"]
    assert [link.limits.effort for link in robot.links[:2]] == [4.0, None]
    assert [link.servo for link in robot.links[:2]] == [Servo(stiffness=50.0, torque=4.0), None]
    (rotor,) = robot.thrusters
    assert (rotor.name, rotor.direction, rotor.limits) == ("rotor_2", (0.0, 0.0, -1.0), (0.0, 6.0))
    assert rotor.drag == pytest.approx(0.02)
    # The control of a servo is an angle, and says nothing of its torque.
    assert imported(DETAILS.format(j=""), tmp_path)[0].links[0].limits.effort is None


def _as_tuple(line: Finding) -> tuple[str, str, str]:
    return line.kind, line.subject, line.detail


def spinning(name: str, bounds: str, kind: str = "revolute") -> str:
    """A propeller on a joint that turns about its thrust."""
    return (
        f'<link name="{name}"><inertial><mass value="0.01"/><inertia ixx="1e-5" iyy="1e-5" '
        f'izz="2e-5"/></inertial></link><joint name="{name}_joint" type="{kind}"><origin '
        f'xyz="0.1 0 0"/><parent link="hub"/><child link="{name}"/><axis xyz="0 0 1"/>'
        f'<limit effort="0" velocity="0" {bounds}/></joint>'
    )


def arm(joint: str, root: str = "world") -> str:
    """A heavy hub with a joint that moves, on a massless root by a joint of such a text."""
    hub = spinning("hub", "").partition("<joint")[0]
    ends = f'<parent link="{root}"/><child link="hub"/><origin xyz="1 2 3" rpy="0 0 0.5236"/>'
    held = f'<link name="{root}"/><joint name="held" {joint}{ends}</joint>'
    return f'<robot name="r">{held}{hub}{spinning("lift", "", "continuous")}</robot>'


FIXED = arm('type="fixed">', "World")
ACROSS = 'type="planar"><axis xyz="{}"/>'
THERE = Pose((1.0, 2.0, 3.0), (Fraction(0), Fraction(0), Fraction(30)))
BESIDE = Pose((0.1, 0.0, 0.0))


@pytest.mark.parametrize(
    ("text", "options", "base", "motion", "pose"),
    [
        (FIXED, {}, "hub", "fixed", THERE),
        (FIXED, {"motion": "free"}, "hub", "free", Pose()),
        (FIXED, {"motion": "planar"}, "hub", "planar", THERE),
        (FIXED, {"base": "World"}, "World", "fixed", Pose()),
        (FIXED, {"base": "lift"}, "lift", "free", Pose()),
        (FIXED, {"base": "lift", "motion": "fixed"}, "lift", "fixed", THERE @ BESIDE),
        (arm('type="floating">', "any"), {}, "hub", "free", Pose()),
        (arm('type="floating">', "any"), {"motion": ("x", "yaw")}, "hub", ("x", "yaw"), THERE),
        (arm(ACROSS.format("0 0 -1")), {}, "hub", "planar", THERE),
        (arm('type="planar">'), {}, "hub", "planar", THERE),
        (arm(ACROSS.format("0.5 0.8660254 0")), {}, "hub", ("x", "z", "pitch"), THERE),
        # A rail and a mast are links of a fixed base, since they have names, or forces on them.
        (arm('type="prismatic"><axis xyz="1 0 0"/>'), {}, "world", "fixed", Pose()),
        (arm('type="prismatic"><axis xyz="1 0 0"/>'), {"base": "hub"}, "hub", "free", Pose()),
        # A mast is no world, but cannot move of its own, either.
        (arm('type="continuous"><axis xyz="1 0 0"/>', "mast"), {}, "mast", "fixed", Pose()),
        (arm('type="fixed">', "mast"), {}, "mast", "free", Pose()),
        (arm('type="fixed">', "mast"), {"motion": "fixed", "base": "hub"}, "hub", "fixed", THERE),
    ],
)  # fmt: skip
def test_what_holds_the_base_is_how_it_moves(
    text: str, options: dict[str, Any], base: str, motion: Any, pose: Pose, tmp_path: Path
) -> None:
    robot, report = imported(text, tmp_path, **options)
    assert told(report, "base")[-1] == base
    # The joint of `lift` turns without end.
    assert ("wheels" in told(report, "note")) == (motion == "planar")
    assert (base, motion) != ("hub", "free") or "hub" not in told(report, "snapped")
    assert robot.base.motion == motion
    assert robot.base.pose.rpy_deg == pose.rpy_deg
    assert robot.base.pose.xyz == pytest.approx(pose.xyz)
    assert "hub" in {base, *(link.name for link in robot.links), *(f.name for f in robot.frames)}
    assert parse_robot(robot_text(robot)).base == robot.base


def test_a_lock_of_what_leads_to_the_base_is_told(tmp_path: Path) -> None:
    text = arm('type="prismatic"><axis xyz="0 0 1"/>').replace('"held"', '"z"')
    robot, report = imported(text, tmp_path, lock={"z": 0.5})
    assert robot.base.motion == ("z",)
    (note,) = (line for line in report if line.subject == "z" and line.kind == "note")
    assert note.detail.startswith(
        "leads to the base and cannot be locked; give the motion of the base with --base MOTION"
    )


def test_a_plane_across_no_axis_of_the_world_is_refused(tmp_path: Path) -> None:
    with pytest.raises(GibbsCodegenError, match=r'<joint "held">.*normal to an axis.*--base'):
        imported(arm(ACROSS.format("0 1 1")), tmp_path)
    assert imported(arm(ACROSS.format("0 1 1")), tmp_path, motion="free")[0].base.moves_freely


@pytest.mark.parametrize(
    ("words", "motion", "done"),
    [
        (["fixed"], "fixed", ""),
        (["x,z,pitch"], ("x", "z", "pitch"), ""),
        (["lift", "fixed"], "fixed", ""),
        (["fixed", "yaw", "roll"], None, "--base roll: give at most one link and one motion"),
        ([], "free", "base, which moves freely; --base fixed holds it"),
        (["fixed", "planar"], None, "--base planar: no such link or motion"),
        (["yaw,x"], None, "'x' comes after a rotation"),
        (["planar", "--attitude", "xyz"], None, "--attitude needs a base that moves freely"),
        (["planr"], None, "--base planr: no such link or motion; did you mean planar?"),
    ],
)
def test_motions_of_the_base_are_asked_for(
    words: list[str], motion: Any, done: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "r.urdf", tmp_path / "out.toml"
    hub = spinning("hub", "").partition("<joint")[0]
    path.write_text(f'<robot name="r">{hub}{spinning("lift", "", "continuous")}</robot>')
    options = [
        part
        for word in words
        for part in (["--base"] * (word[0] not in "-x" or "," in word) + [word])
    ]
    code = main(["import", str(path), *options, "--out", str(out)])
    said = " ".join("".join(capsys.readouterr()).split())
    assert (code, done in said) == (2 if motion is None else 0, True), said
    if motion is not None:
        assert read_robot(str(out))[0].base.motion == motion


CART = """<mujoco><worldbody><body name="stone"><geom size="1" mass="9"/></body>
  <body name="cart" pos="0 0 1"><joint name="{joint}" type="slide" axis="1 0 0"/>
    <geom size=".1" mass="1"/><body name="pole"><joint name="hinge" axis="0 1 0"/>
      <geom size=".1" pos="0 0 .5" mass="1"/></body></body></worldbody>
  <actuator>{end}</actuator></mujoco>"""


def test_mjcf_moves_as_its_bodies_are_held(tmp_path: Path) -> None:
    def read(joint: str, end: str = "", **options: Any) -> tuple[Any, list[str | None], list[Any]]:
        robot, report = imported(CART.format(joint=joint, end=end), tmp_path, **options)
        names = [link.coordinate for link in robot.links]
        return robot.base.motion, names, told(report, "left out")

    assert read("slider") == ("fixed", ["slider", "hinge"], [])
    assert read("x") == (("x",), ["hinge"], [])
    assert read("x", motion="free") == ("free", ["hinge"], ["x"])
    # A robot is what has motors, and not a stone that flies.
    stone = CART.replace('"stone">', '"stone"><freejoint/>').format(joint="x", end="{}")
    driven = stone.format('<motor joint="x"/>')
    assert [link.name for link in imported(driven, tmp_path)[0].links] == ["cart", "pole"]
    # What a motor drives is a link with an input.
    assert read("x", '<motor joint="x"/>') == ("fixed", ["x_joint", "hinge"], [])
    assert read("slider", base="cart") == ("free", ["hinge"], ["slider"])
    assert read("slider", motion="planar") == ("planar", ["hinge"], ["slider"])
    two = CART.replace('<body name="stone">', '<body name="arm"><joint name="j"/>')
    (tmp_path / "two.xml").write_text(two.format(joint="slider", end=""))
    with pytest.raises(GibbsCodegenError, match=r"2 robots \(arm, cart\).*--base world takes"):
        import_robot(tmp_path / "two.xml", ImportOptions("xyz"))
    robot, _ = import_robot(tmp_path / "two.xml", ImportOptions("xyz", base="world"))
    assert [link.coordinate for link in robot.links] == ["j", "slider", "hinge"]
    assert robot.parents == (0, 0, 2)


ACTUATORS = {
    '<position name="u" joint="hinge" kp="20" kv="3" gear="2" forcerange="-7 7"/>': (1 / 2, 0.0),
    '<position name="u" joint="hinge" kp="20" timeconst="0.1" ctrlrange="-1 1"/>': (1.0, 0.0),
    '<general name="u" joint="hinge" gainprm="3" biastype="affine" biasprm="2 -6 -1"/>': (
        0.5,
        1 / 3,
    ),
    '<velocity name="u" joint="hinge" kv="5" gear="-1" ctrlrange="-2 1"/>': (-1.0, 0.0),
}


@pytest.mark.parametrize("text", ACTUATORS)
def test_servos_push_as_in_mujoco(text: str, tmp_path: Path) -> None:
    import mujoco

    whole = CART.format(joint="slider", end=text)
    robot, report = imported(whole, tmp_path)
    servo, (unit, more) = robot.links[-1].servo, ACTUATORS[text]
    assert servo is not None
    notes = [line.detail for line in report if line.subject == "u" and line.kind == "note"]
    factor = f"its command is {unit:.6g} times its control" + (
        f", and {more:g} more" if more else ""
    )
    assert notes == [factor] * ((unit, more) != (1.0, 0.0))
    model = mujoco.MjModel.from_xml_string(whole)
    data = mujoco.MjData(model)
    for control, q, v in ((0.3, 0.1, 0.2), (0.9, -1.0, -0.5)):
        data.ctrl[:], data.qpos[1], data.qvel[1], data.act[:] = control, q, v, control
        mujoco.mj_forward(model, data)
        command = unit * control + more
        by_rate = servo.command == "rate"
        ours = servo.damping * (command * by_rate - v) + servo.stiffness * (command - q)
        limit = servo.torque or math.inf
        assert min(max(ours, -limit), limit) == pytest.approx(data.qfrc_actuator[1], rel=1e-12)
    assert servo.torque == (14.0 if "forcerange" in text else None)
    assert servo.delay == (0.1 if "timeconst" in text else 0.0)
    assert servo.rate == (2.0 if "velocity" in text else None)
    limits = ["limits of its commands, -1 to 1"] * ("-1 1" in text)
    assert [line.detail for line in report if line.kind == "left out"] == limits


def test_limits_that_nothing_reaches_let_a_rotor_spin_as_none_do(tmp_path: Path) -> None:
    """Of the iris made from PX4's model: revolute joints with limits of 1e16 for its propellers."""
    hub = spinning("hub", "").partition("<joint")[0].replace('"0.01"', '"1.5"')
    joints = {
        "iris": 'lower="-1e+16" upper="1e+16"',
        "turns": 'lower="-100" upper="100"',
        "wrist": 'lower="-6.3" upper="6.3"',
        "ratchet": 'lower="0" upper="1e16"',
    }
    links = "".join(spinning(name, bounds) for name, bounds in joints.items())
    shoulder = spinning("shoulder", "", "continuous")
    arm = shoulder + spinning("wrist_roll", 'lower="0" upper="1"').replace('"hub"', '"shoulder"')
    text = f'<robot name="r">{hub}{links}{spinning("plain", "", "continuous")}{arm}</robot>'
    robot, report = imported(text, tmp_path)
    assert len(robot.links) == 7
    (hint,) = [line.detail for line in report if line.subject == "rotors"]
    assert hint.endswith("turn without end: iris_joint, turns_joint, plain_joint")
    rotors = tmp_path / "rotors.toml"
    rotors.write_text("".join(f'[[rotor]]\non = "{name}"\n' for name in (*joints, "plain")))
    robot, report = imported(text, tmp_path, rotors=rotors)
    assert told(report, "locked") == ["iris_joint", "turns_joint", "plain_joint"]
    assert [link.name for link in robot.links] == ["wrist", "ratchet", "shoulder", "wrist_roll"]


def test_limits_that_nothing_reaches_in_mjcf(tmp_path: Path) -> None:
    text = """<mujoco><compiler angle="radian"/><worldbody><body name="hub"><freejoint/>
      <geom size=".1" mass="1"/>
      <body name="prop"><joint name="spin" axis="0 0 1" range="-1e6 1e6"/>
        <geom size=".01" mass=".01"/><site name="s"/></body></body></worldbody>
      <actuator><motor site="s" gear="0 0 1 0 0 .01"/></actuator></mujoco>"""
    _, report = imported(text, tmp_path)
    assert told(report, "locked") == ["spin"]


def test_sections_that_are_left_out_are_told_with_what_they_are(tmp_path: Path) -> None:
    text = """<mujoco><size/><size memory="1M"/><statistic extent="2"/><custom>
      <numeric name="n" data="1"/></custom><visual><map znear="1"/></visual><extension>
      <plugin plugin="mujoco.elasticity.cable"/></extension><sensor/><visual/><contact>
      <exclude body1="a" body2="b"/><exclude body1="b" body2="a"/></contact><worldbody>
      <body name="a"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
    _, report = imported(text, tmp_path)
    assert [line[1:] for line in map(_as_tuple, report) if line[0] == "left out"] == [
        ("plugins, and what they do to the motion", "1"),
        ("contacts", "2"),
    ]


def test_rotors_of_jsk_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    link = FEATURES.partition('<link name="prop_1">')[2].partition("</link>")[0]
    parts = [
        f'<link name="thrust{k}">{link}</link><joint name="rotor{k}" type="continuous">'
        f'<parent link="hub"/><child link="thrust{k}"/><axis xyz="0 0 1"/></joint>'
        for k in (10, 2, 1)
    ]
    hub = FEATURES.partition('<link name="hub">')[2].partition("</link>")[0]
    text = f'<robot name="r"><link name="hub">{hub}</link>{"".join(parts)}</robot>'
    robot, _ = imported(text, tmp_path)
    assert [rotor.name for rotor in robot.thrusters] == ["rotor1", "rotor2", "rotor10"]


def test_other_plugins_of_gazebo_are_told(tmp_path: Path) -> None:
    plugin = (
        '<gazebo><plugin name="imu" filename="imu.so"><linkName>hub</linkName></plugin></gazebo>'
    )
    _, report = imported(FEATURES.replace("</robot>", f"{plugin}</robot>"), tmp_path)
    told_of = [line.detail for line in report if line.subject == "plugins other than motors"]
    assert told_of == ["1"]


def test_a_follower_needs_no_range_of_its_own(tmp_path: Path) -> None:
    text = FEATURES.replace(
        'type="continuous"><origin xyz="0 -', 'type="revolute"><origin xyz="0 -', 1
    )
    text = text.replace('<mimic joint="x"', '<limit effort="1" velocity="1"/><mimic joint="x"')
    _, report = imported(text, tmp_path)
    assert {"moved by joint x: -1 × x", "limits of a joint that another moves"} == {
        line.detail for line in report if line.subject == "right" and line.kind != "snapped"
    }


def test_faults_of_numbers_name_links_and_rotors_of_the_source(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "r.urdf"
    for right, wrong, message in (
        (
            'revolute"><origin xyz="0 0 -0.1"',
            'revolute"><origin xyz="0 0 1e30"',
            "link hub: inertia",
        ),
        ("<maxRotVelocity>838", "<maxRotVelocity>1e47", "rotor prop_1: limits"),
    ):
        assert right in FEATURES
        path.write_text(FEATURES.replace(right, wrong, 1))
        assert main(["import", str(path), "--out", str(tmp_path / "o.toml")]) == 2
        assert f"r.urdf: {message}" in capsys.readouterr().err


def test_platform_of_eagle_mpc(tmp_path: Path) -> None:
    platform = tmp_path / "platform.yaml"
    platform.write_text(
        "platform:\n  cf: 1.0e-5\n  cm: 2.0e-7\n  max_thrust: 9.0\n  min_thrust: 0.1\n"
        "  $rotors:\n    - translation: [0.1, 0.2, 0.3]\n      orientation: [0.0, 1.0, 0.0, 1.0]\n"
        "      spin_direction: [-1]\n"
    )
    robot, _ = imported(FEATURES, tmp_path, rotors=platform)
    (rotor,) = robot.thrusters
    assert rotor.name == "rotor_1"
    assert rotor.direction == (1.0, 0.0, 0.0)
    assert rotor.drag == pytest.approx(-0.02)
    # The joints of the rotors that it replaces stay locked.
    assert len(robot.links) == 2


def test_the_worked_example_of_the_docs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (ROOT / "docs" / "howto" / "import.md").read_text(encoding="utf-8")
    (source,) = re.findall(r"^```xml\n(.*?)^```", page, flags=re.DOTALL | re.MULTILINE)
    (shown,) = re.findall(r"^```text\n(.*?)^```", page, flags=re.DOTALL | re.MULTILINE)
    monkeypatch.chdir(tmp_path)
    Path("prop.urdf").write_text(source)
    assert main(["import", "prop.urdf"]) == 0
    printed = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert printed == [line.split() for line in shown.splitlines()[1:]]
    # Without the convention, its rotors come from a file.
    (rotors,) = re.findall(r"^```toml\n(.*?)^```", page, flags=re.DOTALL | re.MULTILINE)
    Path("rotors.toml").write_text(rotors)
    Path("plain.urdf").write_text(re.sub('<m_f_rate.*/>|rotor(?=1")', "", source))
    assert main(["import", "plain.urdf", "--out", "none.toml"]) == 0
    assert "give them with --rotors FILE; these joints turn without end: 1" in " ".join(
        capsys.readouterr().out.split()
    )
    assert main(["import", "plain.urdf", "--rotors", "rotors.toml", "--out", "given.toml"]) == 0
    given, found = (read_robot(name)[0] for name in ("given.toml", "prop.toml"))
    rotor, *others = given.thrusters
    assert (rotor.position, rotor.drag, others) == (
        *(found.thrusters[0].position, found.thrusters[0].drag),
        [],
    )
    assert given.total_mass == found.total_mass


def test_servos_are_no_rotors(tmp_path: Path) -> None:
    servo = FEATURES.replace("</motorNumber>", "</motorNumber><motorType>position</motorType>", 1)
    robot, _ = imported(servo, tmp_path)
    assert [rotor.name for rotor in robot.thrusters] == ["prop_0"]
    assert [link.coordinate for link in robot.links] == ["x_joint", None, "spin_1"]


XACRO = """<robot name="Two" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:include filename="part.xacro"/><xacro:arg name="mass"/><xacro:arg name="old"/>
  <xacro:include filename="no.xacro" optional="true"/>
  <link name="b"><inertial><mass value="${m * factor}"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="package://unknown/a.stl"/></geometry></visual></link></robot>"""
PART = """
<?xml version="1.0"?>
<!-- an empty line -- and two hyphens -->
<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="factor" default="2"/>
  <xacro:property name="m" value="$(arg mass)"/>
  <xacro:property name="factor" value="${1 *
    int(xacro.arg('factor'))}"/>
</robot>"""


@pytest.mark.parametrize(
    ("words", "mass", "message"),
    [
        (["mass:=1.5"], 3.0, ""),
        (["--force", "factor:=4", "mass:=1.5"], 6.0, ""),
        ([], 0.0, "argument mass has no value; give mass:=VALUE after the file"),
        (["mas:=1.5"], 0.0, "no argument mas; did you mean mass?; there are mass, old, factor"),
        (["mass:=1", "colour:=red"], 0.0, "it has no argument colour"),
        (["mass:=1", "old:=1"], 0.0, "its argument old is not used; leave it out"),
        (["mass:="], 0.0, "value must be a finite number up to 1e+50 in size, not an empty"),
        (["mass=1"], 0.0, "mass=1: after FILE come arguments of xacro as NAME:=VALUE"),
        (["mass:=${n}"], 0.0, "xacro cannot evaluate it (name 'n' is not defined"),
        (["mass:=heavy"], 0.0, "robot.urdf.xacro (expanded):5: <mass>: value must be a finite"),
    ],
)
def test_xacro_is_expanded_with_arguments(
    words: list[str],
    mass: float,
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (tmp_path / "robot.urdf.xacro").write_text(XACRO)
    (tmp_path / "part.xacro").write_text(PART)
    monkeypatch.chdir(ROOT)  # Files are included from beside the one that includes them.
    out = tmp_path / "out.toml"
    file, *named = str(tmp_path / "robot.urdf.xacro"), *words[:1]
    code = main(["import", file, *named, "--out", str(out), *words[1:]])
    assert code == (2 if message else 0)
    assert message in capsys.readouterr().err
    if not message:
        assert read_robot(str(out))[0].total_mass == mass


def test_a_package_that_xacro_does_not_find_is_named(tmp_path: Path) -> None:
    file = tmp_path / "robot.urdf.xacro"
    file.write_text(XACRO.replace('"part', '"$(find no_package)/part'))
    with pytest.raises(GibbsCodegenError, match=r"ROS package no_package; .* or run `xacro robot"):
        import_robot(file, ImportOptions("xyz"))


def test_arguments_are_for_xacro_only(tmp_path: Path) -> None:
    with pytest.raises(GibbsCodegenError, match=r"robot.urdf: NAME:=VALUE is an argument of xacro"):
        imported(FEATURES, tmp_path, arguments={"mass": 2.0})


SEAT = """<robot name="seat"><link name="base"><inertial><mass value="1"/></inertial></link>
  <link name="arm"/><joint name="weld" type="fixed">
    <origin xyz="0.1 0 0" rpy="0 0 1.5707963267948966"/><parent link="base"/>
    <child link="arm"/></joint><link name="prop"><inertial><mass value="0.01"/></inertial></link>
  <joint name="spin" type="continuous"><origin xyz="0.1 0 0.02"/><parent link="arm"/>
    <child link="prop"/><axis xyz="0 0 1"/></joint></robot>"""


@pytest.mark.parametrize(
    ("rotor", "locked"),
    [
        ('on = "base"\nposition = [0.1, 0.1, 0.02]', True),
        ('on = "arm"\nposition = [0.1, 0, 0.025]', True),
        ('on = "prop"', True),
        ('on = "base"\nposition = [0.1, 0.11, 0.02]', False),
        ('on = "base"\nposition = [0.1, 0.1, 0.2]', False),
        ('on = "base"\nposition = [0.1, 0.1, 0.02]\ndirection = "y"', False),
    ],
)
def test_a_rotor_at_a_joint_without_end_lets_it_spin(
    rotor: str, locked: bool, tmp_path: Path
) -> None:
    """Also where it is given on what carries the joint, or on a link that is fixed to that."""
    file = tmp_path / "rotors.toml"
    file.write_text(f"[[rotor]]\n{rotor}\n")
    robot, report = imported(SEAT, tmp_path, rotors=file)
    assert (told(report, "locked") == ["spin"]) == locked
    assert len(robot.links) == (not locked)


def test_motors_of_gazebo_are_commanded_speeds_if_so_asked(tmp_path: Path) -> None:
    """By the formulas of Gazebo: thrust by the square of the speed, drag by speed and velocity."""
    more = (
        "<timeConstantDown>0.025</timeConstantDown>"
        "<rotorDragCoefficient>8.1e-5</rotorDragCoefficient>"
        "<rollingMomentCoefficient>1e-6</rollingMomentCoefficient></plugin>"
    )
    source, out = tmp_path / "robot.urdf", tmp_path / "robot.toml"
    source.write_text(FEATURES.replace("</plugin>", more, 1))
    assert main(["import", str(source), "--command", "speed", "--out", str(out)]) == 0
    robot, text = read_robot(str(out))
    assert "rolling moments of rotors (2)" in " ".join(text.replace("#", " ").split())
    first, second = robot.thrusters
    assert (first.name, second.name) == ("prop_0", "prop_1")
    for rotor in (first, second):
        assert (rotor.drive.command, rotor.drive.limits) == ("speed", (0.0, 838.0))
        assert rotor.drive.thrust(500.0) == pytest.approx(8.54858e-06 * 500.0**2, rel=1e-15)
        assert rotor.limits is None
    # Where the file is silent, it is as in Gazebo.
    assert first.hub_drag == 1e-4
    assert second.hub_drag == 8.1e-5
    drives = robot.drives
    assert (drives[0].up, drives[0].down) == (0.0125, 0.025)
    assert (drives[1].up, drives[1].down) == (0.0125, 0.025)
    thrusts, report = imported(FEATURES, tmp_path)
    assert not thrusts.has_actuators
    assert [r.limits for r in thrusts.thrusters] == [drive.thrust_limits for drive in drives]
    robot, report = imported(FEATURES, tmp_path, command="speed")
    assert "on prop_0, drag -0.016 m, speed 0 to 838 rad/s (Gazebo)" in {r.detail for r in report}


def test_that_no_motor_takes_a_speed_is_told(tmp_path: Path) -> None:
    text = '<robot name="r"><link name="a"><inertial><mass value="1"/></inertial></link></robot>'
    _, report = imported(text, tmp_path, command="speed")
    words = "--command speed needs motors of Gazebo, and FILE has none; leave it out"
    assert words in [line.detail for line in report if line.kind == "note"]


def test_rotors_of_a_file_have_all_that_rotors_of_robot_files_have(tmp_path: Path) -> None:
    """But for where they are, which is in the frames of the source."""
    keys = (
        'drag = 0.02\ncommand = "throttle"\nmax_thrust = 9\nfull_speed = 900\nhub_drag = 1e-4\n'
        "time_constants = [0.02, 0.03]\nspin_inertia = 1e-5\n"
    )
    file = tmp_path / "rotors.toml"
    file.write_text(f'[[rotor]]\non = "hub"\n{keys}')
    robot, report = imported(FEATURES, tmp_path, rotors=file)
    (expected,) = parse_robot(
        f'name = "r"\n[base]\nmass = 1\n[[rotor]]\nname = "rotor_1"\n{keys}'
    ).thrusters
    assert robot.thrusters == (expected,)
    assert "on hub, drag 0.02 m, throttle 0 to 1 (rotors.toml)" in {r.detail for r in report}


LIGHT = """
<robot name="light">
  <link name="base"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
  <link name="wrist"><inertial><origin xyz="0 0 0.01"/><mass value="0.04"/>
    <inertia ixx="2e-5" iyy="3e-5" izz="4e-5"/></inertial></link>
  <joint name="j1" type="revolute"><parent link="base"/><child link="wrist"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="2"/></joint>
  <link name="finger"><inertial><mass value="0.01"/><inertia ixx="1e-6" iyy="1e-6" izz="1e-6"/>
    </inertial></link>
  <joint name="j2" type="TYPE"><origin xyz="0.02 0 0"/><parent link="wrist"/><child link="finger"/>
    <axis xyz="1 0 0"/><limit lower="-1" upper="1"/></joint>
</robot>
"""


def test_joints_that_turn_little_are_noted_with_a_servo_to_begin_with(tmp_path: Path) -> None:
    """The wrist turns 3e-5 + 0.04·0.01² and the finger's 1e-6 + 0.01·0.02²: 3.9e-5 kg m²."""
    _, report = imported(LIGHT.replace("TYPE", "prismatic"), tmp_path)
    (line,) = [line for line in report if line.subject == "wrist" and line.kind == "note"]
    stiffness = 2.0 / np.radians(5.0)
    damping = 2.0 * (stiffness * 3.9e-5) ** 0.5
    assert line.detail == (
        "turns 3.9e-05 kg m² and would be moved by torques alone: if a servo drives it, give "
        f"servo = {{ stiffness = {stiffness:.3g}, damping = {damping:.2g} }} "
        "(N m/rad, N m s/rad), and armature for the inertia of gears"
    )
    _, report = imported(LIGHT.replace("TYPE", "revolute"), tmp_path)
    (line,) = [line for line in report if line.detail.startswith("turn ")]
    assert line.subject == "wrist, finger"
    # The finger, which turns least, has no effort.
    assert line.detail == (
        "turn 1e-06 to 3.9e-05 kg m² and would be moved by torques alone: if servos drive them, "
        "give servo = { stiffness = …, damping = … } (N m/rad, N m s/rad; for the least), and "
        "armature for the inertia of gears"
    )
    heavy = LIGHT.replace("TYPE", "prismatic").replace('0.04"', '10"')
    assert "wrist" not in told(imported(heavy, tmp_path)[1], "note")
