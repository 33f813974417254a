"""What is exported is loaded by Pinocchio and MuJoCo, agrees with them, and is imported again."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray
from support.actuated import actuated
from support.emitted import emitted_module
from support.pinocchio_oracle import Oracle, free_flyer, placed
from support.random_robots import random_tree

from gibbs_codegen.cli.app import main
from gibbs_codegen.errors import UsageError
from gibbs_codegen.exchange.exporting import FILES, Format, export_robot
from gibbs_codegen.exchange.importing import ImportOptions, import_robot
from gibbs_codegen.files.shipped import shipped_names
from gibbs_codegen.robot.file import parse_robot, read_robot
from gibbs_codegen.robot.layout import frames_of, layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import coordinate_of, identifier
from gibbs_codegen.robot.parts.constraint import Constraint
from gibbs_codegen.robot.parts.friction import Friction
from gibbs_codegen.robot.parts.link import JointLimits, Passive
from gibbs_codegen.robot.parts.pose import Pose
from gibbs_codegen.verification.newton_euler import NewtonEuler
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Tree

Array = NDArray[np.float64]
SOURCES = Path(__file__).parent / "sources"
FORMATS = ("urdf", "mjcf", "sdf")
TREES = ("hextilt_flying_arm_5", "hydrus", "everything")
PAPERS = ("hexarotor_3link", "quadrotor_2link")


def tree(name: str) -> Robot:
    """A robot that was imported."""
    rotors = SOURCES / f"{name}_rotors.toml"
    options = ImportOptions("xyz", rotors=rotors if rotors.exists() else None)
    return import_robot(SOURCES / f"{name}.urdf", options)[0]


def again(robot: Robot, form: Format, folder: Path, friction: bool = False) -> Robot:
    """The robot, exported and imported, with dry friction of joints if asked for."""
    path = folder / FILES[form].format("robot")
    path.write_text(export_robot(robot, form)[0])
    return import_robot(path, ImportOptions("xyz", snap=False, friction=friction))[0]


def assert_properties_come_back(robot: Robot, back: Robot, form: Format) -> None:
    """What no equation of motion shows, but for what the format has no place for."""
    names = [identifier(str(link.coordinate)) for link in back.links]
    for i in robot.moving:
        one, other = robot.links[i - 1], back.links[names.index(coordinate_of(robot, i))]
        assert other.limits.effort == one.limits.effort
        assert other.passive.damping == one.passive.damping
        if form != "mjcf":
            assert other.limits == one.limits
        if form == "sdf":
            assert other.passive == replace(one.passive, armature=0.0)
        elif form == "mjcf":
            assert other.passive == one.passive
            if None not in (one.limits.low, one.limits.high):
                assert (other.limits.low, other.limits.high) == (one.limits.low, one.limits.high)
    for rotor, its in zip(robot.thrusters, back.thrusters[robot.base.rotors :], strict=True):
        if form == "sdf":  # Gazebo knows no least thrust, and its greatest is k Ω².
            assert rotor.limits is None or its.limits == pytest.approx((0.0, rotor.limits[1]))
        else:
            assert its.limits == rotor.limits
        if form != "urdf":
            assert its.time_constant == rotor.time_constant
    found = {frame.name: frame for frame in back.frames}
    lines = export_robot(robot, form)[1]
    for frame in frames_of(robot)[1:]:
        in_sdf = f"{frame.name}_frame"  # Where a rotor or another thing has the name.
        renamed = f"renamed: frame {frame.name} is {in_sdf}" in lines
        its_frame = found[in_sdf if renamed else frame.name]
        if frame.on in robot.moving:
            assert coordinate_of(robot, frame.on) == names[its_frame.on - 1]
            pose, its_pose = placed(frame.pose).homogeneous, placed(its_frame.pose).homogeneous
            assert np.allclose(its_pose, pose, rtol=0.0, atol=1e-12)


def state(nv: int, seed: int = 0) -> tuple[Array, Array]:
    """A state of the free-flyer with so many velocities."""
    random = np.random.default_rng(seed)
    q = random.uniform(-1.0, 1.0, nv + 1)
    q[3:7] /= np.linalg.norm(q[3:7])
    return q, random.uniform(-1.0, 1.0, nv)


@pytest.mark.parametrize("name", TREES)
def test_pinocchio_agrees_with_exported_urdf(name: str) -> None:
    robot = tree(name)
    ours = free_flyer(robot)
    model = pin.buildModelFromXML(export_robot(robot, "urdf")[0], pin.JointModelFreeFlyer())
    q, v = state(model.nv)
    found = ours.dynamics(q, v, np.zeros(len(robot.thrusters) + len(robot.links)))
    places = [model.joints[model.getJointId(str(link.coordinate))].idx_v for link in robot.links]
    order = [*range(6), *places]
    own_q, own_v = q.copy(), np.zeros_like(v)
    own_q[np.array(places) + 1], own_v[order] = q[7:], v
    data = model.createData()
    matrix = pin.crba(model, data, own_q)
    matrix = (np.triu(matrix) + np.triu(matrix, 1).T)[np.ix_(order, order)]
    assert np.abs(matrix - found.mass_matrix).max() < 1e-12 * np.abs(matrix).max()
    nonlinear = pin.nonLinearEffects(model, data, own_q, own_v)[order]
    assert np.abs(nonlinear - found.nonlinear).max() < 1e-12 * np.abs(nonlinear).max()


@pytest.mark.parametrize("name", TREES)
def test_mujoco_agrees_with_exported_mjcf(name: str) -> None:
    import mujoco

    robot = tree(name)
    ours = free_flyer(robot)
    model = mujoco.MjModel.from_xml_string(export_robot(robot, "mjcf")[0])
    q, v = state(model.nv)
    found = ours.dynamics(q, v, np.zeros(len(robot.thrusters) + len(robot.links)))
    data = mujoco.MjData(model)
    places = [int(model.joint(str(link.coordinate)).qposadr[0]) for link in robot.links]
    data.qpos[:7] = q[[0, 1, 2, 6, 3, 4, 5]]
    data.qpos[places] = q[7:]
    mujoco.mj_fwdPosition(model, data)
    matrix = np.empty((model.nv, model.nv))
    for row, unit in zip(matrix, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, row, unit)
    turn = np.eye(model.nv)  # MuJoCo has the linear velocity in world axes.
    turn[:3, :3] = pin.Quaternion(q[3:7]).toRotationMatrix()
    order = [*range(6), *(place - 1 for place in places)]
    matrix = (turn.T @ matrix @ turn)[np.ix_(order, order)]
    assert np.abs(matrix - found.mass_matrix).max() < 1e-12 * np.abs(matrix).max()


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("name", TREES)
def test_trees_come_back(name: str, form: Format, tmp_path: Path) -> None:
    robot = tree(name)
    back = again(robot, form, tmp_path)
    assert [link.coordinate for link in back.links] == [link.coordinate for link in robot.links]
    assert_properties_come_back(robot, back, form)
    q, v = state(6 + len(robot.links))
    u = np.ones(len(robot.thrusters) + len(robot.links))
    for found, expected in zip(
        free_flyer(back).dynamics(q, v, u), free_flyer(robot).dynamics(q, v, u), strict=True
    ):
        assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("name", PAPERS)
def test_paper_robots_come_back(
    name: str, form: Format, tmp_path: Path, shipped: Callable[[str], ModuleType]
) -> None:
    robot, module = read_robot(name)[0], shipped(name)
    back = again(robot, form, tmp_path)
    assert_properties_come_back(robot, back, form)
    size, joints = len(module.COORDINATES), len(robot.links)
    q = np.random.default_rng(1).uniform(-1.0, 1.0, size)
    turn, rates = np.eye(3), np.zeros((3, 3))
    for k, letter in reversed([*enumerate(robot.base.attitude)]):
        # The rate about an axis, in the axes that the turns after it lead to.
        rates[:, k] = turn.T @ np.eye(3)["xyz".index(letter)]
        turn = pin.utils.rotate(letter, q[k]) @ turn
    jacobian = np.zeros((size, size))  # From q̇ to v of the free-flyer.
    jacobian[:3, -3:] = turn.T
    jacobian[3:6, :3] = rates
    jacobian[6:, 3 : 3 + joints] = np.eye(joints)
    free = np.concatenate([q[-3:], pin.Quaternion(turn).coeffs(), q[3 : 3 + joints]])
    found = free_flyer(back).dynamics(free, np.zeros(size), np.zeros(robot.rotors + joints))
    matrix, inputs = module.mass_matrix(q), module.input_matrix(q)
    assert np.abs(jacobian.T @ found.mass_matrix @ jacobian - matrix).max() < 1e-11
    assert np.abs(jacobian.T @ found.inputs - inputs).max() < 1e-12


def on_the_ground(motion: Any) -> Robot:
    """A tree, without what a format has no place for, whose base moves so."""
    robot = random_tree(9, "quaternion")
    pose = Pose((0.1, -0.2, 0.3), (Fraction(20), Fraction(-35), Fraction(60)))
    links = (replace(link, passive=Passive(), constrained=False) for link in robot.links)
    base = replace(robot.base, attitude="xyz", motion=motion, pose=pose)
    return replace(robot, base=base, links=tuple(links), gravity=9.81)


def by_newton_and_euler(robot: Robot, states: States) -> tuple[Array, Array]:
    """Mass matrix and inverse dynamics of a robot at one state, without the fixed base."""
    found, size = NewtonEuler(Tree(robot)).at(states), states.v.shape[1]
    return found.mass_matrix[0, :size, :size], found.inverse_dynamics[0, :size]


def by_pinocchio(text: str, names: list[str], q: Array, v: Array, a: Array) -> tuple[Array, Array]:
    """Mass matrix and inverse dynamics of a URDF, joints in such an order."""
    model = pin.buildModelFromXML(text)
    order = [model.joints[model.getJointId(name)].idx_v for name in names]
    own_q, own_v, own_a = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
    for name, angle in zip(names, q, strict=True):
        joint = model.joints[model.getJointId(name)]
        turning = (np.cos(angle), np.sin(angle)) if joint.nq == 2 else angle
        own_q[joint.idx_q : joint.idx_q + joint.nq] = turning
    own_v[order], own_a[order] = v, a
    data = model.createData()
    efforts = pin.rnea(model, data, own_q, own_v, own_a)[order]
    upper = np.triu(pin.crba(model, data, own_q))
    return (upper + np.triu(upper, 1).T)[np.ix_(order, order)], efforts


def by_mujoco(text: str, names: list[str], q: Array, v: Array, a: Array) -> tuple[Array, Array]:
    """Mass matrix and inverse dynamics of MJCF, joints in such an order."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    order = [int(model.joint(name).dofadr[0]) for name in names]
    data.qpos[order], data.qvel[order], data.qacc[order] = q, v, a
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    mujoco.mj_inverse(model, data)
    matrix = np.empty((model.nv, model.nv))
    for row, unit in zip(matrix, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, row, unit)
    return matrix[np.ix_(order, order)], data.qfrc_inverse[order]


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("motion", ["fixed", ("yaw",), ("z", "x", "pitch"), ("y", "yaw", "roll")])
def test_bases_are_exported_as_they_move(motion: Any, form: Format, tmp_path: Path) -> None:
    """Pinocchio, MuJoCo and import have the mass matrix and the efforts of the robot."""
    robot = on_the_ground(motion)
    names = list(layout_of(robot).q.names)
    states = States.random(Tree(robot), 1, 1)
    ours = by_newton_and_euler(robot, states)
    text, _ = export_robot(robot, form)
    q, v, a = states.q[0], states.v[0], states.a[0]
    theirs = []
    if form != "sdf":
        theirs.append((by_pinocchio if form == "urdf" else by_mujoco)(text, names, q, v, a))
    back = again(robot, form, tmp_path)
    assert back.base.motion == motion
    assert np.allclose(back.base.pose.matrix, robot.base.pose.matrix, rtol=0.0, atol=1e-12)
    assert np.allclose(back.base.pose.xyz, robot.base.pose.xyz, rtol=0.0, atol=1e-12)
    order = [names.index(name) for name in layout_of(back).q.names]
    wrenches = np.zeros((1, len(frames_of(back)), 6))
    q, v, a = (x[:, order] for x in (states.q, states.v, states.a))
    same = replace(states, q=q, v=v, a=a, W=wrenches)
    place = np.argsort(order)
    mass, efforts = by_newton_and_euler(back, same)
    theirs.append((mass[np.ix_(place, place)], efforts[place]))
    for one in theirs:
        for found, expected in zip(one, ours, strict=True):
            assert np.abs(found - expected).max() < 1e-11 * np.abs(expected).max()


def test_a_base_turns_where_it_stands() -> None:
    """Not about the world's origin, and so in URDF and MJCF too."""
    import mujoco

    text = "[base]\nmotion = ['yaw']\nxyz = [1, 0, 0]\nmass = 2\ninertia = [2, 2, 3, 0, 0, 0]\n"
    robot, turned = parse_robot(f"name = 'mast'\n{text}"), 2.0
    module = emitted_module(robot)
    (there,) = module.frame_poses([turned])
    assert module.mass_matrix([turned]) == pytest.approx(3.0)
    model = pin.buildModelFromXML(export_robot(robot, "urdf")[0])
    data, q = model.createData(), np.array([np.cos(turned), np.sin(turned)])
    pin.framesForwardKinematics(model, data, q)
    at_base = data.oMf[model.getFrameId("base")]
    machine = mujoco.MjModel.from_xml_string(export_robot(robot, "mjcf")[0])
    state = mujoco.MjData(machine)
    state.qpos[:] = turned
    mujoco.mj_kinematics(machine, state)
    for place, axes in (
        (there[:3, 3], there[:3, :3]),
        (at_base.translation, at_base.rotation),
        (state.body("base").xpos, state.body("base").xmat.reshape(3, 3)),
    ):
        np.testing.assert_allclose(place, [1.0, 0.0, 0.0], atol=1e-12)
        np.testing.assert_allclose(axes[:2, 0], [np.cos(turned), np.sin(turned)], atol=1e-12)


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize(
    ("motion", "moved"), [("planar", ("x", "y", "yaw")), ("upright", ("x", "y", "z", "yaw"))]
)
def test_level_bases_are_exported_by_what_moves(
    motion: str, moved: tuple[str, ...], form: Format, tmp_path: Path
) -> None:
    text, lines = export_robot(on_the_ground(motion), form)
    assert text == export_robot(on_the_ground(moved), form)[0]
    assert any(f"--base {motion}" in line for line in lines)
    path = tmp_path / FILES[form].format("robot")
    path.write_text(text)
    assert import_robot(path, ImportOptions("xyz"))[0].base.motion == moved
    assert import_robot(path, ImportOptions("xyz", motion=motion))[0].base.motion == motion


MACHINE = """
name = "machine"
gravity = 9.81
[base]
attitude = "quaternion"
mass = 2.0
inertia = [0.01, 0.01, 0.02, 0, 0, 0]
[[rotor]]
name = "r"
time_constant = 0.02
[[rotor]]
name = "tau_j"
[[link]]
name = "thrust1"
coordinate = "rotor1"
joint = "revolute"
xyz = [0.1, 0, 0]
limits = [-1.0, inf]
velocity = 3.0
effort = 2.0
stiffness = 0.5
rest = 0.1
mass = 0.1
inertia = [1e-4, 1e-4, 1e-4, 0, 0, 0]
[[link]]
name = "a"
coordinate = "root"
xyz = [0.1, 0, 0]
joint = "revolute"
mass = 0.1
inertia = [1e-4, 1e-4, 1e-4, 0, 0, 0]
[[link]]
name = "b"
coordinate = "j"
xyz = [0.1, 0, 0]
joint = "prismatic"
mass = 0.1
inertia = [1e-4, 1e-4, 1e-4, 0, 0, 0]
[[link]]
name = "c\\u0001d"
joint = "fixed"
constrained = true
xyz = [0.1, 0, 0]
mass = 0.1
inertia = [1e-4, 1e-4, 1e-4, 0, 0, 0]
[[link]]
name = "world"
joint = "fixed"
xyz = [0.1, 0, 0]
mass = 0.1
inertia = [1e-4, 1e-4, 1e-4, 0, 0, 0]
[[frame]]
name = "r"
on = "a"
[[frame]]
name = "a"
on = "b"
xyz = [0, 0, 0.1]
"""


@pytest.mark.parametrize("form", FORMATS)
def test_clashing_and_hostile_names_come_back_as_the_same_machine(
    form: Format, tmp_path: Path
) -> None:
    robot = parse_robot(MACHINE)
    _, lines = export_robot(robot, form)
    back = again(robot, form, tmp_path)
    assert [link.coordinate for link in back.links] == ["rotor1", "root", "j"]
    assert [rotor.name for rotor in back.thrusters] == ["r", "tau_j"]
    assert [link.limits.effort for link in back.links] == [2.0, None, None]
    q, v = state(9)
    found, expected = free_flyer(back).dynamics(q, v, np.ones(5)), Oracle(robot, rigid_base=True)
    assert np.allclose(found.mass_matrix, expected.mass_matrix(q), rtol=0.0, atol=1e-12)
    assert np.allclose(found.inputs, expected.input_matrix(q), rtol=0.0, atol=1e-12)
    if form == "mjcf":
        assert_properties_come_back(robot, back, form)
    renamed = {
        "urdf": ["link thrust1 is thrust1_", "frame a is a_2"],
        "mjcf": ["link world is world_2"],
        "sdf": ["link world is world_link", "frame r is r_frame", "frame a is a_frame"],
    }
    assert {f"renamed: {line}" for line in renamed[form]} < {*lines}
    assert "renamed: link c\\x01d is c_d" in lines
    assert (
        "left out: c\\x01d: the constraint torque that holds it; the link is welded instead"
        in lines
    )
    lost = {"urdf": "stiffness", "mjcf": "velocity and limits, of which the format has only one"}
    told = [line for line in lines if line.startswith("left out: joint rotor1")]
    assert told == [f"left out: joint rotor1: {lost[form]}"] if form in lost else told == []
    assert ("left out: time constants of r" in lines) == (form == "urdf")


def test_a_joint_that_is_no_rotor_is_none_for_its_name(tmp_path: Path) -> None:
    robot = parse_robot(MACHINE.replace('"c\\u0001d"', '"c"'))
    robot = replace(robot, thrusters=(), links=robot.links[:1], frames=())
    back = again(robot, "urdf", tmp_path)
    assert [link.coordinate for link in back.links] == ["rotor1"]
    assert back.thrusters == ()


def test_impossible_inertias_are_warned_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "machine.toml"
    text = MACHINE.replace("inertia = [0.01,", "inertia = [0.1,")
    path.write_text(f"allow_impossible_inertia = true\n{text}")
    with contextlib.chdir(tmp_path):
        assert main(["export", str(path), "--format", "urdf"]) == 0
    assert "warning: the base: its inertia violates" in capsys.readouterr().err
    assert (tmp_path / f"{parse_robot(MACHINE).name}.urdf").is_file()


@pytest.mark.parametrize("name", shipped_names("robots"))
def test_mujoco_loads_every_robot_that_ships(name: str) -> None:
    """Thin rods and points among their bodies, too."""
    import mujoco

    robot = read_robot(name)[0]
    model = mujoco.MjModel.from_xml_string(export_robot(robot, "mjcf")[0])
    assert model.body_mass.sum() == pytest.approx(robot.total_mass)


def test_mujoco_s_limits_are_told() -> None:
    robot = import_robot(SOURCES / "features.urdf", ImportOptions("xyz"))[0]
    with pytest.raises(UsageError, match=r"inertia of link .* export URDF"):
        export_robot(robot, "mjcf")


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("seed", range(12))
def test_random_trees_come_back(seed: int, form: Format, tmp_path: Path) -> None:
    robot = random_tree(seed)
    robot = replace(robot, base=replace(robot.base, attitude="quaternion"))
    back = again(robot, form, tmp_path)
    ours, theirs = Oracle(robot, rigid_base=True), free_flyer(back)
    names = [coordinate_of(robot, i) for i in robot.moving]
    its_names = [identifier(str(link.coordinate)) for link in back.links]
    assert sorted(names) == sorted(its_names)
    order = [*range(6), *(6 + its_names.index(name) for name in names)]
    q, v = state(6 + len(names), seed)
    its_q = q.copy()
    its_q[[place + 1 for place in order[6:]]] = q[7:]
    count = len(robot.thrusters) + robot.base.rotors
    found = theirs.dynamics(its_q, np.zeros_like(v), np.zeros(count + len(names)))
    armature = np.zeros(len(v))
    armature[6:] = [robot.links[i - 1].passive.armature for i in robot.moving]
    matrix = ours.mass_matrix(q) - np.diag(armature)
    difference = found.mass_matrix[np.ix_(order, order)] - matrix
    assert np.abs(difference).max() < 1e-12 * np.abs(matrix).max()
    inputs = ours.input_matrix(q)[:, :count]
    assert np.allclose(found.inputs[order, :count], inputs, rtol=0.0, atol=1e-12)
    assert_properties_come_back(robot, back, form)


@pytest.mark.parametrize("form", FORMATS)
def test_constraints_that_no_file_holds_are_told(form: Format) -> None:
    rope = Constraint("rope", "distance", "camera", distance=1.0)
    robot = replace(read_robot("quadrotor")[0], constraints=(rope,))
    assert "left out: constraints: rope" in export_robot(robot, form)[1]


@pytest.mark.parametrize(("limit", "kind"), [(1e16, "continuous"), (6.3, "revolute")])
def test_limits_that_nothing_reaches_are_none_in_urdf(limit: float, kind: str) -> None:
    robot = read_robot("quadrotor_2link")[0]
    far = replace(robot.links[1], limits=JointLimits(-limit, limit))
    text = export_robot(replace(robot, links=(robot.links[0], far)), "urdf")[0]
    assert f'<joint name="{coordinate_of(robot, 2)}" type="{kind}">' in text


@pytest.mark.parametrize("form", ["urdf", "mjcf"])
def test_of_actuators_what_a_file_cannot_hold_is_told(form: Format, tmp_path: Path) -> None:
    """Rotors have the limits of their thrusts, and in MJCF their lag."""
    robot = actuated()
    _, lines = export_robot(robot, form)
    labels = "front_left, rear_left, rear_right"
    assert f"left out: thrust curves of the rotors: {labels}" in lines
    assert "left out: air on rotors: front_left" in lines
    assert "left out: the battery" in lines
    is_urdf = form == "urdf"
    lost = (
        "servo, except its greatest torque and rate"
        if is_urdf
        else "velocity and servo, except its greatest torque"
    )
    assert f"left out: joint upper: {lost} and static friction" in lines
    assert not any(line.startswith("left out: joint wrist") for line in lines)
    back = again(robot, form, tmp_path)
    assert not back.has_actuators
    # The torque of a servo is its joint's effort where it says none.
    assert [link.limits.effort for link in back.links] == [4.0, 20.0, 1.0]
    rates = [link.limits.velocity for link in back.links]
    assert rates == ([6.0, None, None] if is_urdf else [None] * 3)
    rubbing = [link.friction for link in again(robot, form, tmp_path, friction=True).links]
    assert rubbing == [Friction(0.02, 0.02), None, Friction(0.005, 0.005)]
    for rotor, drive in zip(back.thrusters, robot.drives, strict=True):
        assert rotor.limits == pytest.approx(drive.thrust_limits)
        assert rotor.time_constant == ((drive.up or None) if form == "mjcf" else None)
