"""Constraints of URDF and MJCF: against MuJoCo's own rows and accelerations, and by hand."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import numpy as np
import pinocchio as pin
import pytest
from support.emitted import emitted_module
from support.pinocchio_oracle import Oracle, placed

from gibbs_codegen.exchange.attaching import Attachment, joined
from gibbs_codegen.exchange.exporting import export_robot
from gibbs_codegen.exchange.importing import ImportOptions, import_robot
from gibbs_codegen.exchange.sources import SourceFileError
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.pose import Pose
from gibbs_codegen.robot.text import robot_text

Array = np.ndarray
MJCF = """<mujoco><compiler angle="radian"/><option gravity="0 0 -9.81"/>
<default><equality solref="0.002 1" solimp="0.9999 0.9999 0.001 0.5 2"/></default>
<worldbody><site name="hook" pos="1 2 3" euler=".1 .2 .3"/>
<body name="hub" pos="0 0 1"><freejoint/>
  <inertial pos="0 .01 0" mass="1" diaginertia=".01 .01 .02"/>
  <body name="a" pos=".1 0 0"><joint name="ja" axis="0 1 0"/>
    <inertial pos=".1 0 0" mass=".2" diaginertia=".001 .002 .003"/>
    <site name="tool" pos=".2 0 .1" euler=".3 0 .1"/>
    <body name="b" pos=".2 0 0" euler="0 .3 0"><joint name="jb" axis="0 0 1"/>
      <inertial pos=".1 0 0" mass=".2" diaginertia=".001 .002 .003"/>
      <body name="d" pos=".2 0 0" euler=".2 0 0"><joint name="jd" axis="0.6 0.8 0" pos="0 .01 0"/>
        <inertial pos=".1 0 0" mass=".2" diaginertia=".001 .002 .003"/>
        <site name="end" pos=".1 0 0"/></body></body></body>
  <body name="c" pos="-.1 0 0"><joint name="jc" axis="1 0 0"/>
    <inertial pos=".1 0 0" mass=".2" diaginertia=".001 .002 .003"/>
    <site name="seat" pos=".1 0 0"/></body></body></worldbody>
<equality>{}</equality></mujoco>"""
EQUALITIES = """
<connect name="connect" body1="d" body2="c" anchor=".3 0 .1"/>
<connect name="the world connected" body1="world" body2="b" anchor=".1 .2 .3"/>
<connect name="sites" site1="end" site2="seat"/>
<weld name="weld" body1="hub" body2="d" anchor=".01 .02 .03" relpose="{relpose}"/>
<weld name="the world welded" site1="hook" site2="tool"/>"""

JOINTS, ANGLES = ("ja", "jb", "jd", "jc"), {"ja": 0.3, "jb": -0.4, "jd": 0.5}


def of_text(text: str, folder: Path, snap: bool = False) -> tuple[Robot, dict[str, str]]:
    """The robot of a text as its robot file has it, and the findings' details by their subjects."""
    path = folder / ("robot.xml" if "<mujoco" in text else "robot.urdf")
    path.write_text(text)
    robot, findings = import_robot(path, ImportOptions("quaternion", snap=snap))
    details = {each.subject: f"{each.kind}: {each.detail}" for each in findings}
    return parse_robot(robot_text(robot)), details


def weld_met() -> str:
    """`relpose` of the weld where joints are at ANGLES: its place in the hub, and the turn of d."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(MJCF.format(""))
    data = mujoco.MjData(model)
    for name, angle in ANGLES.items():
        data.joint(name).qpos[0] = angle
    mujoco.mj_kinematics(model, data)
    place = data.body("d").xpos + data.body("d").xmat.reshape(3, 3) @ [0.01, 0.02, 0.03]
    way = place - data.body("hub").xpos  # The hub is level.
    return " ".join(map(repr, [*way.tolist(), *data.body("d").xquat.tolist()]))


def met(module: ModuleType, active: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """A state in which the active constraints are met, and stay so."""
    for _ in range(20):
        q = rng.normal(size=len(module.COORDINATES))
        q[3:7] /= np.linalg.norm(q[3:7])
        q[7:] = [ANGLES.get(name, 0.0) + 0.2 * x for name, x in zip(JOINTS, q[7:], strict=True)]
        for _ in range(60):
            step = module.constraint_projection(q, active)
            if np.abs(step).max() < 1e-14:
                break
            q = module.integrate(q, step * min(1.0, 0.3 / max(np.abs(step).max(), 1e-9)))
        rows = np.repeat(active, [each.stop - each.start for each in places(module)])
        if np.abs(rows * module.constraint_errors(q)).max() < 1e-13:
            v = rng.normal(size=len(module.VELOCITIES))
            return q, module.impact(q, v, active, 0.0 * active)[0]
    raise AssertionError("the constraint is out of reach")


def places(module: ModuleType) -> list[slice]:
    """The rows of each constraint."""
    found: list[slice] = [*module.CONSTRAINT_PLACES.values()]
    return found


@pytest.mark.slow
def test_rows_and_accelerations_are_those_of_mujoco(tmp_path: Path) -> None:
    import mujoco

    kinds = "\n".join(EQUALITIES.splitlines()[2:5])  # One of each: the others have the same rows.
    text = MJCF.format(kinds.format(relpose=weld_met()))
    robot, _ = of_text(text, tmp_path)
    written, missing = export_robot(robot, "mjcf")
    assert not missing
    hard = text[text.index("<default>") : text.index("<worldbody>")]
    written = written.replace("<equality>", f"{hard}<equality>")
    module = emitted_module(robot, "constraints", "integrate")
    assert ("x", "y", "z", "qx", "qy", "qz", "qw", *JOINTS) == module.COORDINATES
    for k, active in enumerate(np.eye(len(module.CONSTRAINTS))):
        for seed, source in [(0, text), (1, written)][k % 2 :][:1]:
            model = mujoco.MjModel.from_xml_string(source)
            model.opt.tolerance, model.opt.iterations = 0.0, 1000
            data = mujoco.MjData(model)
            q, v = met(module, active, np.random.default_rng([k, seed]))
            data.qpos[:] = [*q[:3], q[6], *q[3:6], *q[7:]]
            turn = np.eye(len(v))
            turn[:3, :3] = pin.Quaternion(q[6], *q[3:6]).toRotationMatrix()
            data.qvel[:] = turn @ v
            data.eq_active[:] = active
            mujoco.mj_forward(model, data)
            ours = module.constraint_jacobian(q)[places(module)[k]]
            theirs = data.efc_J.reshape(data.nefc, model.nv) @ turn
            assert theirs.shape == ours.shape
            # Both span the same rows: forces of one are forces of the other.
            shares = np.linalg.lstsq(ours.T, theirs.T, rcond=None)[0]
            assert np.abs(shares.T @ ours - theirs).max() < 1e-9
            ranks = [np.linalg.matrix_rank(x, tol=1e-9) for x in (ours, theirs)]
            assert ranks[0] == ranks[1]
            if len(ours) == 3:  # They differ by a turn of the axes.
                assert np.abs(shares.T @ shares - np.eye(3)).max() < 1e-9
            u = np.zeros(len(module.INPUTS))
            a, _ = module.constrained_forward_dynamics(q, v, u, active)
            # The linear velocity is in axes that turn: its rate in the world has ω × v more.
            soft = data.qacc.copy()
            soft[:3] -= turn[:3, :3] @ np.cross(v[3:6], v[:3])
            soft = np.linalg.solve(turn, soft)
            # MuJoCo's rows give way, by 1e-4 of what they hold and more. That is taken back.
            rows = module.constraint_jacobian(q)[places(module)[k]]
            given = rows @ soft + module.constraint_bias(q, v)[places(module)[k]]
            yielded = np.linalg.lstsq(rows, given, rcond=None)[0]
            hard = soft - yielded + module.impact(q, yielded, active, 0.0 * active)[0]
            assert np.abs(yielded).max() < 0.1 * np.abs(a).max()
            assert np.abs(hard - a).max() < 1e-9 * np.abs(a).max()


def test_what_holds_no_frame_of_the_robot_is_told(tmp_path: Path) -> None:
    text = MJCF.format(
        '<joint name="j" joint1="ja" joint2="jb"/><connect name="off" body1="b" anchor="0 0 0" '
        'active="false"/><weld name="k" body1="hub" body2="a"/><weld body1="hub"/>'
    )
    robot, told = of_text(text, tmp_path)
    assert [each.name for each in robot.constraints] == ["off", "k", "equality_4"]
    assert told["ja"] == "gear: moved by joint jb: 1 × jb"
    assert told["off"].startswith("note") or told["off"].startswith("constraint")
    locked, _ = import_robot(
        tmp_path / "robot.xml", ImportOptions("xyz", lock={"ja": 0.0, "jb": 0.0})
    )
    assert [each.name for each in locked.constraints] == ["off", "equality_4"]


URDF = """<robot name="four_bar"><link name="hub"><inertial><mass value="1"/>
  <inertia ixx=".01" iyy=".01" izz=".02" ixy="0" ixz="0" iyz="0"/></inertial></link>
{links}
<constraint name="closing" type="{kind}"><parent link="rocker"/>
  <parent_origin xyz="0.3 0 0" rpy="0 0 0.5"/><parent_axis xyz="0 1 0"/><child link="{child}"/>
  <child_origin xyz="0.4 0 0.1"/><child_axis xyz="0 0 2"/>{more}</constraint></robot>"""
LINK = """<link name="{0}"><inertial><origin xyz=".1 0 0"/><mass value=".2"/>
  <inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j_{0}" type="continuous"><origin xyz="{2} 0 0"/><parent link="{1}"/>
  <child link="{0}"/><axis xyz="0 1 0"/></joint>"""
LINKS = "".join(
    LINK.format(*each)
    for each in (("crank", "hub", 0), ("coupler", "crank", 0.2), ("rocker", "hub", 0.4))
)


def urdf(kind: str = "revolute", child: str = "coupler", more: str = "") -> str:
    """A loop of three links on a hub."""
    return URDF.format(links=LINKS, kind=kind, child=child, more=more)


@pytest.mark.parametrize(("kind", "rows"), [("revolute", 5), ("fixed", 6), ("spherical", 3)])
def test_loops_of_urdf_hold_what_their_frames_say(kind: str, rows: int, tmp_path: Path) -> None:
    robot, told = of_text(urdf(kind), tmp_path)
    oracle = Oracle(robot, rigid_base=True)
    assert len(emitted_module(robot, "constraint_errors").CONSTRAINT_ROWS) == rows
    assert told["closing"].startswith("constraint")
    q = np.random.default_rng(3).normal(size=10)
    q[3:7] /= np.linalg.norm(q[3:7])
    (held,) = robot.constraints
    poses = {}
    for frame in (held.frame, held.to):
        assert frame is not None
        poses[frame] = oracle.point_jacobian(q, oracle.frames[frame])[1]
    # Frames by hand: of links by the number, with the place in the file.
    by_hand = {
        "closing_child": ("coupler", (0.4, 0.0, 0.1)),
        "closing_parent": ("rocker", (0.3, 0.0, 0.0)),
    }
    for name, (link, xyz) in by_hand.items():
        number = 2 + [each.name for each in robot.links].index(link)
        expected = oracle.point_jacobian(q, (number, placed(Pose(xyz))))[1]
        assert np.abs(poses[name].translation - expected.translation).max() < 1e-12
    if kind == "revolute":
        axis = np.array(held.axis)
        child, parent = (poses[f"closing_{end}"].rotation @ axis for end in ("child", "parent"))
        number = {link.name: k for k, link in enumerate(robot.links, 2)}
        own = oracle.point_jacobian(q, (number["coupler"], placed(Pose())))[1].rotation
        rocker = oracle.point_jacobian(q, (number["rocker"], placed(Pose())))[1].rotation
        assert np.abs(child - own[:, 2]).max() < 1e-12
        turn = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
        assert np.abs(parent - rocker[:, :2] @ turn[:, 1]).max() < 1e-12


def test_constraints_to_the_world_and_faults(tmp_path: Path) -> None:
    world = '<link name="world"/><joint name="w" type="floating"><parent link="world"/>'
    world += '<child link="hub"/></joint>'
    text = urdf("fixed", "world").replace("<link", world + "<link", 1)
    robot, _ = of_text(text, tmp_path)
    (held,) = robot.constraints
    assert (held.kind, held.frame, held.to) == ("frame", "closing_parent", None)
    assert held.anchor.xyz == (0.4, 0.0, 0.1)
    hinge = text.replace('name="closing" type="fixed"', 'name="closing" type="revolute"')
    _, told = of_text(hinge, tmp_path)
    assert "hinge to the world" in told["closing"]
    for wrong, words in {
        urdf("universal"): "type must be one of fixed, revolute, continuous, spherical",
        urdf(child="nobody"): "there is no link nobody",
        urdf(more="<limit/>"): "is not known here",
        urdf().replace("0 0 2", "0 0 0"): "has no length",
    }.items():
        with pytest.raises(SourceFileError, match=words):
            of_text(wrong, tmp_path)


def test_constraints_of_an_arm_come_with_it(tmp_path: Path) -> None:
    equalities = (
        '<connect name="k" site1="end" site2="seat"/><weld name="w" body1="hub" body2="d"/>'
    )
    of_text(MJCF.format(equalities), tmp_path)
    arm = Attachment(tmp_path / "robot.xml", prefix="l_")
    robot, _ = joined(Path("quadrotor"), ImportOptions("quaternion"), [arm])
    # The file of what was joined is accepted: its constraints refer to frames that are there.
    again = parse_robot(robot_text(robot))
    held = {each.name: (each.frame, each.to) for each in again.constraints}
    assert held["l_k"] == ("l_end", "l_seat")
    on = {frame.name: frame.on for frame in again.frames}
    assert [on[str(each)] for each in held["l_w"]] == [0, 3]
