"""Arms joined to drones, against Pinocchio's `appendModel` of the same two files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from support.actuated import TEXT as ACTUATED
from support.emitted import emitted_module

from gibbs_codegen.cli.app import main
from gibbs_codegen.robot.file import parse_robot, read_robot

DRONE = """<robot name="drone">
  <link name="frame"><inertial><origin xyz="0.01 0 -0.02"/><mass value="1.5"/>
    <inertia ixx="0.01" iyy="0.012" izz="0.02" ixy="0" ixz="1e-4" iyz="0"/></inertial></link>
  <link name="gimbal"><inertial><origin xyz="0 0 -0.03" rpy="0.1 0.2 0"/><mass value="0.2"/>
    <inertia ixx="2e-4" iyy="3e-4" izz="2e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="pan" type="revolute"><origin xyz="0.1 0 -0.05" rpy="0 0 0.3"/>
    <parent link="frame"/><child link="gimbal"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="2" velocity="3"/></joint>
  <link name="plate"/>
  <joint name="plate_mount" type="fixed"><origin xyz="0 0.02 -0.04" rpy="0.4 0 0.1"/>
    <parent link="gimbal"/><child link="plate"/></joint>
</robot>"""
ARM = """<robot name="arm">
  <link name="foot"><inertial><origin xyz="0 0.01 0.02" rpy="0.3 0 0"/><mass value="0.3"/>
    <inertia ixx="2e-4" iyy="3e-4" izz="4e-4" ixy="1e-5" ixz="0" iyz="0"/></inertial></link>
  <link name="upper"><inertial><origin xyz="0 0 -0.1"/><mass value="0.2"/>
    <inertia ixx="1e-3" iyy="1.1e-3" izz="2e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><origin xyz="0 0 -0.05" rpy="0 0.2 0"/>
    <parent link="foot"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="2" velocity="3"/></joint>
  <link name="fore"><inertial><origin xyz="0.1 0 -0.1"/><mass value="0.1"/>
    <inertia ixx="1e-3" iyy="1e-3" izz="2e-4" ixy="0" ixz="0" iyz="1e-5"/></inertial></link>
  <joint name="slide" type="prismatic"><origin xyz="0 0 -0.2" rpy="0.5 0 0"/>
    <parent link="upper"/><child link="fore"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="2" velocity="3"/></joint>
</robot>"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where drone.urdf and arm.urdf are, made the working folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "drone.urdf").write_text(DRONE)
    (tmp_path / "arm.urdf").write_text(ARM)
    return tmp_path


@pytest.mark.parametrize("on", ["frame", "gimbal", "plate"])
@pytest.mark.parametrize("arm", ["arm.urdf", "arm.toml"])
def test_mass_matrix_and_gravity_are_those_of_appended_models(
    on: str, arm: str, folder: Path
) -> None:
    if arm == "arm.toml":
        assert main(["import", "arm.urdf", "--no-snap"]) == 0
    place = ["--xyz", "0.03", "-0.02", "-0.1", "--rpy_deg", "10", "-20", "130", "--prefix", "l_"]
    assert main(["import", "drone.urdf", "--attach", arm, "--on", on, *place]) == 0
    robot = read_robot("drone_arm.toml")[0]
    module = emitted_module(robot, "mass_matrix", "gravity_forces", "frame_poses")

    drone = pin.buildModelFromXML(DRONE, pin.JointModelFreeFlyer())
    pose = pin.SE3(pin.rpy.rpyToMatrix(np.deg2rad([10, -20, 130])), np.array([0.03, -0.02, -0.1]))
    whole = pin.appendModel(drone, pin.buildModelFromXML(ARM), drone.getFrameId(on), pose)
    data = whole.createData()
    joints = ["pan", "shoulder", "slide"]
    places = [whole.joints[whole.getJointId(name)] for name in joints]
    in_q, in_v = [[*range(7)], [*range(6)]]
    in_q += [joint.idx_q for joint in places]
    in_v += [joint.idx_v for joint in places]
    assert module.COORDINATES[7:] == ("pan", "l_shoulder", "l_slide")
    rng = np.random.default_rng(5)
    for _ in range(5):
        q = rng.normal(size=10)
        q[3:7] /= np.linalg.norm(q[3:7])
        there = np.empty(10)
        there[in_q] = q
        mass = pin.crba(whole, data, there)
        mass = np.triu(mass) + np.triu(mass, 1).T
        gravity = pin.computeGeneralizedGravity(whole, data, there)
        np.testing.assert_allclose(module.mass_matrix(q), mass[np.ix_(in_v, in_v)], atol=1e-13)
        np.testing.assert_allclose(module.gravity_forces(q), -gravity[in_v], atol=1e-12)
        pin.framesForwardKinematics(whole, data, there)
        foot = data.oMf[whole.getFrameId("foot")].homogeneous
        ours = module.frame_poses(q)[
            module.FRAMES.index("l_foot" if arm == "arm.urdf" else "l_arm")
        ]
        np.testing.assert_allclose(ours, foot, atol=1e-14)


def test_robot_files_keep_what_they_have(folder: Path) -> None:
    """Arms come one after the other, and the drone's rotors and frames stay."""
    sides = ["--attach", "arm.urdf", "--prefix", "l_", "--attach", "arm.urdf", "--prefix", "r_"]
    assert main(["import", "quadrotor_arm_2link", *sides, "--out", "two.toml"]) == 0
    drone, robot = read_robot("quadrotor_arm_2link")[0], parse_robot(Path("two.toml").read_text())
    assert robot.thrusters == drone.thrusters
    assert robot.links[:2] == drone.links
    assert [link.name for link in robot.links[2:]] == ["l_upper", "l_fore", "r_upper", "r_fore"]
    assert robot.parents == (0, 1, 0, 3, 0, 5)
    frames = [frame.name for frame in robot.frames]
    kept = {frame.name for frame in drone.frames} | {"tip"}
    assert {*frames} == kept | {"l_foot", "l_tip", "r_foot", "r_tip"}
    assert robot.total_mass == pytest.approx(drone.total_mass + 1.2)


TOOL = """<link name="flange"/><joint name="f" type="fixed"><origin xyz="0.1 0 0"/>
    <parent link="fore"/><child link="flange"/></joint>
  <link name="tool0"/><joint name="t" type="fixed"><origin xyz="0.1 0 -0.2" rpy="0 0.3 0"/>
    <parent link="flange"/><child link="tool0"/></joint></robot>"""


def test_the_tip_of_an_arm_is_its_end_effector(folder: Path) -> None:
    (folder / "arm.urdf").write_text(ARM.replace("</robot>", TOOL))
    assert main(["import", "drone.urdf", "--attach", "arm.urdf", "--prefix", "l_"]) == 0
    frames = {frame.name: frame for frame in read_robot("drone_arm.toml")[0].frames}
    assert frames["l_tip"] == replace(frames["l_tool0"], name="l_tip")
    assert frames["l_tip"].pose.xyz == pytest.approx((0.2, 0.0, -0.2))


CRANE = """
name = "crane"
[base]
attitude = "quaternion"
mass = 1
com = [0.01, 0, 0.02]
inertia = [0.01, 0.02, 0.02, 0, 0, 0]
[[rotor]]
name = "side"
position = [0.1, 0.2, 0.3]
direction = [0.3, 0, 1]
drag = 0.01
[[link]]
alpha_deg = 70
theta_deg = 20
a = 0.1
d = 0.05
length = 0.3
mass_per_length = 1
[[link]]
length = 0.2
mass_per_length = 1
[[rotor]]
name = "end"
on = "link2"
position = [0.1, 0.02, 0]
direction = "y"
"""


@pytest.mark.slow
def test_rods_keep_their_lengths_and_rotors_their_thrusts(folder: Path) -> None:
    """A crane by Denavit and Hartenberg on the middle of another: each is where it is by itself."""
    (folder / "crane.toml").write_text(CRANE)
    place = ["--on", "link1", "--xyz", "0.1", "0.02", "0.03", "--rpy_deg", "10", "20", "30"]
    command = ["import", "crane.toml", "--attach", "crane.toml", *place, "--prefix", "l_"]
    assert main(command) == 0
    few = "frame_poses", "positions", "input_matrix"
    one, two = (emitted_module(read_robot(f"{n}.toml")[0], *few) for n in ("crane", "crane_crane"))
    q = np.random.default_rng(2).normal(size=11)
    q[3:7] /= np.linalg.norm(q[3:7])
    poses = dict(zip(two.FRAMES, two.frame_poses(q), strict=True))
    foot = poses["l_crane"]
    below = pin.SE3(foot[:3, :3], foot[:3, 3])
    arm = np.concatenate([pin.SE3ToXYZQUAT(below), q[9:]])
    above = pin.XYZQUATToSE3(q[:7]).rotation
    for own, prefix, turn in ((q[:9], "", above), (arm, "l_", foot[:3, :3])):
        tip = one.frame_poses(own)[one.FRAMES.index("tip")]
        np.testing.assert_allclose(poses[f"{prefix}tip"], tip, atol=1e-14)
        for rotor in ("side", "end"):
            here, there = one.POINTS.index(rotor), two.POINTS.index(prefix + rotor)
            found = two.positions(q)[there]
            np.testing.assert_allclose(found, one.positions(own)[here], atol=1e-14)
            thrust = two.input_matrix(q)[:3, two.INPUTS.index(f"F_{prefix}{rotor}")]
            alone = one.input_matrix(own)[:3, one.INPUTS.index(f"F_{rotor}")]
            np.testing.assert_allclose(above @ thrust, turn @ alone, atol=1e-14)


def test_actuators_and_the_battery_stay(folder: Path) -> None:
    (folder / "actuated.toml").write_text(ACTUATED)
    assert (
        main(
            ["import", "actuated.toml", "--attach", "arm.urdf", "--on", "slider", "--prefix", "l_"]
        )
        == 0
    )
    drone, robot = parse_robot(ACTUATED), read_robot("actuated_arm.toml")[0]
    assert (robot.thrusters, robot.battery) == (drone.thrusters, drone.battery)
    upper, slider, wrist, *_ = robot.links
    assert (upper, wrist) == (drone.links[0], drone.links[2])
    assert slider == replace(drone.links[1], body=slider.body)
    assert slider.body.total_mass == pytest.approx(0.1 + 0.3)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["drone.urdf", "--attach", "arm.urdf", "--on", "gimbel"], "did you mean gimbal?"),
        (["drone.urdf", "--attach", "drone.urdf"], "--prefix NAME_ after --attach"),
        (["drone.urdf", "--attach", "hexarotor_3link"], "has a base of rods with motors"),
        (["quadrotor"], "is a robot file already"),
        (
            ["quadrotor", "--attach", "arm.urdf", "--lock", "a"],
            "--lock: quadrotor is a robot file; change the",
        ),
    ],
)
def test_what_cannot_be_joined_is_refused(
    options: list[str], words: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["import", *options]) == 2
    assert words in capsys.readouterr().err
    assert sorted(path.name for path in folder.iterdir()) == ["arm.urdf", "drone.urdf"]


def test_what_is_said_of_an_arm_follows_it(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for options, words in (
        (["--on", "frame", "--attach", "arm.urdf"], "give --attach ARM before it"),
        (["--attach", "arm.urdf", "--xyz", "0", "0", "inf"], "must be a finite number, not inf"),
    ):
        with pytest.raises(SystemExit):
            main(["import", "drone.urdf", *options])
        assert words in capsys.readouterr().err
