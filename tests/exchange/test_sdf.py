"""SDF: what libsdformat reads is what is written and imported, and robots come back from it."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from support import tools
from support.actuated import actuated, by_rates
from support.pinocchio_oracle import Oracle, free_flyer

from gibbs_codegen.errors import GibbsCodegenError, UsageError
from gibbs_codegen.exchange.exporting import export_robot
from gibbs_codegen.exchange.importing import ImportOptions, import_robot
from gibbs_codegen.exchange.sources import Finding
from gibbs_codegen.robot import posture
from gibbs_codegen.robot.file import parse_robot, read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.body import inertia_matrix
from gibbs_codegen.robot.parts.friction import Friction
from gibbs_codegen.robot.parts.numbers import LEVEL
from gibbs_codegen.robot.parts.pose import Pose
from gibbs_codegen.robot.placement import mounted_rotors

Array = NDArray[np.float64]
PROGRAM = Path(__file__).parent / "sdf_reader.cpp"


def with_quaternion(name: str) -> Robot:
    """A robot that ships, with a quaternion at the centre of its base."""
    robot, _ = read_robot(name)
    return replace(robot, base=replace(robot.base, attitude="quaternion"))


class Read(NamedTuple):
    """What libsdformat reads: mass, centre of mass and inertia of all, and names with numbers."""

    mass: float
    com: Array
    inertia: Array
    links: dict[str, Array]
    joints: dict[str, Array]


@pytest.fixture(scope="session")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A program that prints what libsdformat reads; to look at its headers alone takes seconds."""
    found = subprocess.run(
        ["pkg-config", "--cflags", "--libs", "sdformat12"], capture_output=True, text=True
    )
    if found.returncode:
        tools.missing("libsdformat-dev is not installed")
    flags = ["-std=c++17", "-w", *found.stdout.split()]
    command = [tools.tool("g++"), PROGRAM, *flags]
    return tools.compiled(command, tmp_path_factory.mktemp("sdf") / "reader")


def written(reader: Path, path: Path, *words: str) -> str:
    """What libsdformat prints of a file, of which it must not complain."""
    done = subprocess.run([reader, path, *words], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def as_read(reader: Path, path: Path) -> Read:
    """What libsdformat reads in a file."""
    lines = [line.split() for line in written(reader, path).splitlines()]
    numbers: dict[str, dict[str, Array]] = {"link": {}, "joint": {}}
    for kind, name, *words in lines:
        numbers[kind][name] = np.array(words, float)
    values = np.array(list(numbers["link"].values()))
    masses, coms = values[:, 0], values[:, 1:4]
    mass, com = masses.sum(), masses @ coms / masses.sum()
    inertia = values[:, 4:13].reshape(-1, 3, 3).sum(0)
    for m, arm in zip(masses, coms - com, strict=True):
        inertia = inertia + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Read(mass, com, inertia, numbers["link"], numbers["joint"])


def assert_is_as_read(robot: Robot, read: Read) -> None:
    """Masses, joints and rotors, with all joints at zero."""
    whole = posture.whole_properties(robot)
    frames = posture.frames_on(robot, posture.AT_ORIGIN, np.zeros(len(robot.moving)))
    assert read.mass == pytest.approx(whole.mass, rel=1e-12)
    assert np.allclose(read.com, whole.com, rtol=0.0, atol=1e-12)
    inertia = inertia_matrix(whole.inertia)
    assert np.abs(read.inertia - inertia).max() < 1e-11 * np.abs(inertia).max()
    for i in robot.moving:
        link, frame = robot.links[i - 1], frames.links[i - 1]
        low, high, damping, *place = read.joints[str(link.coordinate)]
        limits = link.limits
        assert (limits.low, limits.high) == tuple(None if abs(b) > 1e15 else b for b in (low, high))
        assert damping == link.passive.damping
        assert np.allclose(place[:3], frame.origin, rtol=0.0, atol=1e-12)
        assert np.allclose(place[3:], frame.axes @ np.array(link.axis), rtol=0.0, atol=1e-12)
    for rotor, seat, thrust in zip(
        mounted_rotors(robot), frames.motors, frames.thrusts, strict=True
    ):
        own = read.links[str(rotor.name)]
        assert np.allclose(own[-6:-3], seat, rtol=0.0, atol=1e-12)
        assert np.allclose(own[-3:], thrust, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("name", ["hexarotor_3link", "hydrus", "dual_arm", "quadrotor_arm_2link"])
def test_shipped_robots_come_back(name: str, reader: Path, tmp_path: Path) -> None:
    robot, path = with_quaternion(name), tmp_path / "robot.sdf"
    text, _ = export_robot(robot, "sdf")
    path.write_text(text)
    back, report = import_robot(path, ImportOptions("quaternion", snap=False))
    spinning = [line.subject for line in report if line.detail == "at 0; lets a rotor spin"]
    assert len(spinning) == len(back.thrusters) == robot.rotors
    ours, theirs = Oracle(robot, rigid_base=True), free_flyer(back)
    size = 6 + len(back.links)
    q = np.random.default_rng(0).uniform(-1.0, 1.0, size + 1)
    q[3:7] /= np.linalg.norm(q[3:7])
    found = theirs.dynamics(q, np.zeros(size), np.zeros(robot.rotors + len(back.links)))
    matrix = ours.mass_matrix(q)
    armature = [0.0] * 6 + [robot.links[i - 1].passive.armature for i in robot.moving]
    matrix = matrix - np.diag(armature)
    assert np.abs(found.mass_matrix - matrix).max() < 1e-12 * np.abs(matrix).max()
    assert np.allclose(found.inputs, ours.input_matrix(q), rtol=0.0, atol=1e-12)
    assert_is_as_read(back, as_read(reader, path))


def test_actuators_are_written_as_motors_and_controllers_of_gazebo(
    reader: Path, tmp_path: Path
) -> None:
    robot, path = actuated(), tmp_path / "robot.sdf"
    text, lines = export_robot(robot, "sdf")
    path.write_text(text)
    assert as_read(reader, path).mass == pytest.approx(robot.total_mass)
    own = "rate of its servo and delay of its servo and backlash of its servo and static friction"
    assert f"left out: joint upper: {own}" in lines
    assert "left out: inflow, ground effect of the air (rotors front_left)" in lines
    square = (
        "changed: thrust depends on the square of the speed alone (rotors front_left, rear_left)"
    )
    assert square in lines
    assert "assumed: 1000 rad/s at the greatest thrust (rotors front_right)" in lines
    options = ImportOptions("quaternion", command="speed", friction=True)
    back, report = import_robot(path, options)
    front, rear, right, plain = (rotor.drive for rotor in back.thrusters)
    assert front is not None
    assert (front.up, front.down, front.limits) == (0.03, 0.05, (0.0, 900.0))
    assert front.thrust(900.0) == pytest.approx(9.0)
    assert back.thrusters[0].hub_drag == 1e-4
    assert rear is not None
    assert rear.thrust(900.0) == pytest.approx(robot.drives[1].thrust(900.0))
    assert right is not None
    assert right.curve == pytest.approx((0.0, 0.0, 1e-5))
    assert right.limits == (0.0, 950.0)
    assert plain is not None
    assert plain.thrust(1000.0) == pytest.approx(9.0)
    rubbing = [link.friction for link in back.links]
    assert rubbing == [Friction(0.02, 0.02), None, Friction(0.005, 0.005)]
    servo = ["<p_gain>30.0<", "<d_gain>0.4<", "<i_gain>0.0<", "<cmd_max>4.0<", "<cmd_min>-4.0<"]
    assert all(gain in text for gain in servo)
    assert text.count("gz-sim-apply-joint-force-system") == 1
    by_rate, _ = export_robot(by_rates(), "sdf")
    assert by_rate.count('name="gz::sim::systems::JointController"') == 2
    assert by_rate.count("<use_force_commands>true<") == 2
    assert "<p_gain>80.0<" in by_rate
    assert Finding("left out", "plugins other than motors", "4") in report


FEATURES = (Path(__file__).parent / "sources" / "features.sdf").read_text()
AXIS = "<xyz>0 1 1</xyz>"
SEEN = {
    "joint": FEATURES,
    "frame": FEATURES.replace(AXIS, AXIS.replace("<xyz", '<xyz expressed_in="hook"')),
    "model": FEATURES.replace(AXIS, AXIS.replace("<xyz", '<xyz expressed_in="__model__"')),
}


@pytest.mark.parametrize("seen", SEEN)
def test_what_is_placed_by_frames_is_where_libsdformat_has_it(
    seen: str, reader: Path, tmp_path: Path
) -> None:
    path = tmp_path / "robot.sdf"
    text = SEEN[seen]
    path.write_text(text)
    robot, report = import_robot(path, ImportOptions("quaternion", snap=False))
    (link,) = robot.links
    assert (link.name, link.coordinate, link.passive.stiffness) == ("boom", "lift", 2.0)
    assert (robot.name, robot.gravity) == ("machine", 3.7)
    on = {frame.name: frame.on for frame in robot.frames}
    assert (on["shelf"], on["bracket"], on["hook"]) == (0, 1, 0)
    # The one whose joint its plugin does not name is locked all the same.
    assert [line.subject for line in report if line.kind == "locked"] == [
        *("left_joint", "right_joint")
    ]
    assert [(rotor.name, rotor.drag) for rotor in robot.thrusters] == [
        *(("left", 0.02), ("right", -0.02))
    ]
    told = {line.subject: line.detail for line in report if line.kind == "left out"}
    assert told == {
        **{"model://sun": "another model", "lift": "dry friction 0.2", "collision shapes": "1"},
        "rolling moments of rotors": "2",
    }
    # With the include libsdformat looks for the sun.
    path.write_text(text.replace("<include><uri>model://sun</uri></include>", ""))
    assert_is_as_read(robot, as_read(reader, path))


def test_frames_on_the_world_are_told(tmp_path: Path) -> None:
    path = tmp_path / "robot.sdf"
    path.write_text(FEATURES.replace('"hook">', '"dock" attached_to="world"/><frame name="hook">'))
    robot, report = import_robot(path, ImportOptions("quaternion", snap=False))
    assert "dock" not in {frame.name for frame in robot.frames}
    words = "on the world: a robot has frames of its own"
    assert Finding("left out", "dock", words) in report


def test_axes_of_old_files_are_those_of_the_model(tmp_path: Path) -> None:
    axes = []
    old = f"{AXIS}<use_parent_model_frame>1</use_parent_model_frame>"
    for text in (
        FEATURES.replace("1.9", "1.4"),
        FEATURES.replace("1.9", "1.6").replace(AXIS, old),
        SEEN["model"],
    ):
        path = tmp_path / "robot.sdf"
        path.write_text(text)
        axes.append(import_robot(path, ImportOptions("quaternion", snap=False))[0].links[0].axis)
    assert axes[0] == axes[1] == axes[2]


def test_a_model_may_be_merged_of_links_in_one_file_and_motors_in_another(tmp_path: Path) -> None:
    path = tmp_path / "whole.sdf"
    path.write_text(FEATURES)
    expected, _ = import_robot(path, ImportOptions("quaternion"))
    body, plugin, rest = FEATURES.partition('<plugin name="a"')
    begin = '<model name="machine">'
    # 1.10 is later than 1.9.
    parts = {
        "base": f'<sdf version="1.10">{body[body.index(begin) :]}</model></sdf>',
        "machine": '<sdf version="1.10"><world name="w"><gravity>0 0 -3.7</gravity>'
        '<model name="machine"><include merge="true"><uri>model://base</uri></include>'
        f"{plugin}{rest}",
    }
    machine = laid(tmp_path, parts)["machine"]
    assert import_robot(machine, ImportOptions("quaternion"))[0] == expected
    laid(tmp_path, {"base": parts["base"].replace("<mass>1.5<", "<mass>-1<")})
    with pytest.raises(GibbsCodegenError, match=r"not -1 \(.*base/model.sdf:\d+\)"):
        import_robot(machine, ImportOptions("quaternion"))


def laid(folder: Path, texts: dict[str, str]) -> dict[str, Path]:
    """Files of models, each in a folder of its name as Gazebo has them."""
    for name, text in texts.items():
        (folder / name).mkdir(parents=True, exist_ok=True)
        (folder / name / "model.config").write_text(
            '<model><sdf version="1.3">old.sdf</sdf><sdf version="1.9">model.sdf</sdf></model>'
        )
        (folder / name / "model.sdf").write_text(text)
    return {name: folder / name / "model.sdf" for name in texts}


def link(name: str, mass: float, inside: str = "") -> str:
    """A link whose centre of mass is off its origin."""
    moments = "<ixx>0.02</ixx><iyy>0.03</iyy><izz>0.04</izz><ixy>0.001</ixy>"
    own = f"<pose>0.02 0.01 0.03 0.1 0 0</pose><mass>{mass}</mass><inertia>{moments}</inertia>"
    return f'<link name="{name}">{inside}<inertial>{own}</inertial></link>'


# An arm with a propeller and a motor, whose base is to be put somewhere by any of its frames.
ARM = f"""<sdf version="1.9"><model name="arm" canonical_link="upper">
  {link("mount", 0.1)}{link("upper", 0.2, "<pose>0.1 0 0.2 0 0.3 0</pose>")}
  {link("prop", 0.01, '<pose relative_to="grip">0 0 0.05 0 0 0</pose>')}
  <frame name="grip" attached_to="upper"><pose>0.3 0 0 0.2 0 0</pose></frame>
  <frame name="own"><pose>0 0 0.1 0 0 0.5</pose></frame>
  <frame name="level"><pose>0.1 0 0.1 0 0 0</pose></frame>
  <joint name="elbow" type="revolute"><pose>0 0.1 0 0 0 0</pose><parent>mount</parent>
    <child>upper</child><axis><xyz expressed_in="__model__">0 0.6 0.8</xyz>
    <limit><lower>-1</lower><upper>1</upper></limit></axis></joint>
  <joint name="spin" type="revolute"><parent>upper</parent><child>prop</child><axis><xyz>0 0 1</xyz>
    <limit><lower>-1e16</lower><upper>1e16</upper></limit></axis></joint>
  <plugin filename="gz-sim-multicopter-motor-model-system" name="m"><jointName>spin</jointName>
    <linkName>prop</linkName><turningDirection>cw</turningDirection></plugin>
</model></sdf>"""
NESTED = ARM[ARM.index("<model") : ARM.index("</sdf>")]
FIXED = '<joint name="j" type="fixed"><parent>{}</parent><child>{}</child></joint>'
INCLUDE = "<include{}><uri>{}</uri>{}</include>"
AT = '<pose relative_to="{}">0.3 -0.1 0.2 0.2 0.4 0.6</pose>'
TOGETHER = {
    "nested": NESTED.replace('link="upper">', f'link="upper">{AT.format("shelf")}')
    + FIXED.format("body", "arm::mount"),
    "nested, placed by a frame": NESTED.replace(
        'link="upper">', f'link="upper" placement_frame="grip">{AT.format("body")}'
    )
    + FIXED.format("shelf", "arm::mount"),
    "included": INCLUDE.format("", "model://arm", f"<name>left</name>{AT.format('shelf')}")
    + FIXED.format("left::grip", "body").replace("<parent>left::grip", "<parent>left::mount"),
    "included, placed by a frame": INCLUDE.format(
        "", "model://arm", f"<placement_frame>own</placement_frame>{AT.format('body')}"
    )
    + FIXED.format("body", "arm::mount")
    + '<frame name="tip" attached_to="arm::grip"><pose>0 0 0.1 0 0 0</pose></frame>',
    "merged": INCLUDE.format(' merge="true"', "model://arm", AT.format("shelf"))
    + FIXED.format("body", "mount"),
    "merged, placed by a frame": INCLUDE.format(  # libsdformat rounds what it computes here.
        ' merge="true"',
        "model://arm",
        "<placement_frame>level</placement_frame>"
        '<pose relative_to="body">0.3 -0.1 0.2 0 0 0</pose>',
    )
    + FIXED.format("shelf", "mount"),
    "through another": INCLUDE.format("", "model://between", AT.format("body"))
    + FIXED.format("body", "between::arm::mount"),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["nested, placed by a frame", "merged", "through another"])
def test_models_are_put_together_as_libsdformat_does(
    kind: str, reader: Path, tmp_path: Path
) -> None:
    """The file itself, and the one that libsdformat writes of it, in which nothing is included."""
    shelf = '<frame name="shelf" attached_to="body"><pose>0 0.1 0.2 0 0 0.7</pose></frame>'
    texts = {"arm": ARM, "machine": f"{link('body', 1.5)}{shelf}{TOGETHER[kind]}"}
    texts["between"] = INCLUDE.format("", "model://arm", AT.format("__model__"))
    for name in ("machine", "between"):
        texts[name] = f'<sdf version="1.9"><model name="{name}">{texts[name]}</model></sdf>'
    path = laid(tmp_path, texts)["machine"]
    options = ImportOptions("quaternion", snap=False, base="body")
    robot, _ = import_robot(path, options)
    (rotor,) = robot.thrusters
    assert (rotor.drag, rotor.limits) == (0.016, (0.0, 8.54858e-06 * 838.0**2))
    assert_is_as_read(robot, as_read(reader, path))
    whole = tmp_path / "whole.sdf"
    whole.write_text(written(reader, path, "-p"))
    assert_is_as_read(import_robot(whole, options)[0], as_read(reader, whole))


@pytest.mark.parametrize(
    ("uri", "place", "variable"),
    [
        *(("model://arm", "models/arm", ""), ("../arm", "models/arm", "")),
        *(("arm/model.sdf", "models/machine/arm", ""), ("model://arm", "arm", "")),
        *((("model://arm", "else/arm", name)) for name in ("GZ_SIM_RESOURCE_PATH", "SDF_PATH")),
        *(("model://arm", "else/arm", "GAZEBO_MODEL_PATH"), ("FOLDER/else/arm", "else/arm", "")),
        *(("model://arm", "working/arm", None), ("model://arm", "", None)),
        *(("https://fuel.gazebosim.org/1.0/a/models/arm", "models/arm", None),),
    ],
)
def test_models_are_looked_for_beside_the_file_and_where_the_environment_says(
    uri: str, place: str, variable: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """None: it is not there, for the working folder says nothing of models."""
    for name in ("GZ_SIM_RESOURCE_PATH", "SDF_PATH", "GAZEBO_MODEL_PATH"):
        value = f"{tmp_path / 'no'}:{tmp_path / 'else'}" if name == variable else ""
        monkeypatch.setenv(name, value)
    text = INCLUDE.format("", uri.replace("FOLDER", str(tmp_path)), "")
    machine = f'<sdf version="1.9"><world name="w">{text}</world></sdf>'
    path = laid(tmp_path, {"models/machine": machine, **({place: ARM} if place else {})})[
        "models/machine"
    ]
    (tmp_path / "working").mkdir(exist_ok=True)
    monkeypatch.chdir(tmp_path / "working")
    if variable is None:
        with pytest.raises(GibbsCodegenError, match=r"was not found|gz fuel download"):
            import_robot(path, ImportOptions("quaternion"))
    else:
        assert import_robot(path, ImportOptions("quaternion"))[0].rotors == 1


REFUSED = [
    ("<mass>1.5<", "<mass>-1<", "<mass> must be at least 0"),
    ("<mass>1.5<", "<mass>1 kg<", "must be a finite number"),
    ('<link name="hub">', '<link name="boom">', "there is another link of that name"),
    ('relative_to="shelf"', 'relative_to="shell"', "no link, joint or frame shell"),
    ('attached_to="boom"><pose>0.05', 'attached_to="bom"><pose>0.05', "bom; did you mean boom?"),
    ('attached_to="hub">', 'attached_to="hup">', "no link, joint or frame hup; did you mean hub?"),
    ('"hook">', '"hook" attached_to="nolink"/><frame name="other">', "joint or frame nolink"),
    ('relative_to="boom"', 'relative_to="hook"', "relative to itself through others"),
    ("<lower>-1<", "<lower>-1e20 m<", "must be a finite number"),
    ("1 2 3 0 0 0.5</pose>", "1 2 3 0 0 0.5</pose><include/>", "<include>: has no <uri>"),
    (
        '"hook">',
        '"hook" attached_to="ring"/><frame name="ring" attached_to="hook">',
        "is attached to itself through others",
    ),
    (
        'type="revolute">\n        <pose>',
        'type="screw">\n        <pose>',
        "must be one of revolute",
    ),
    ("<lower>-1<", "<lower>2<", "<lower> 2 is above <upper> 1"),
    ("<static>true</static>", "", "holds 2 models that move (floor, machine); keep one"),
    (">0 1 1<", ">0 0 0<", "its axis has no length"),
    (">0 1 1<", ">0 1<", "must have 3 numbers, not 2"),
    ("<child>boom<", "<child>bom<", "no link, joint or frame bom; did you mean boom?"),
    ("<inertial><mass>0.2", '<inertial auto="true"><mass>0.2', "takes its inertia from shapes"),
]


@pytest.mark.parametrize("text", ["5e80", "nan", "-0.2", "sticky"])
def test_friction_that_is_not_taken_is_refused_for_nothing(text: str, tmp_path: Path) -> None:
    urdf = '<robot name="r"><link name="a"/><link name="b"/><joint name="lift" type="revolute">'
    urdf += '<parent link="a"/><child link="b"/><axis xyz="0 0 1"/><dynamics friction="0.2"/>'
    sources = {"robot.sdf": FEATURES, "robot.urdf": f"{urdf}</joint></robot>"}
    for name, source in sources.items():
        (tmp_path / name).write_text(
            source.replace("<friction>0.2<", f"<friction>{text}<").replace('"0.2"', f'"{text}"')
        )
        _, report = import_robot(tmp_path / name, ImportOptions("quaternion"))
        assert "dry friction" in next(line.detail for line in report if line.subject == "lift")
        with pytest.raises(GibbsCodegenError, match="friction"):
            import_robot(tmp_path / name, ImportOptions("quaternion", friction=True))


@pytest.mark.parametrize(("right", "wrong", "message"), REFUSED)
def test_what_is_wrong_in_a_file_is_told(
    right: str, wrong: str, message: str, tmp_path: Path
) -> None:
    assert right in FEATURES
    path = tmp_path / "robot.sdf"
    path.write_text(FEATURES.replace(right, wrong, 1))
    with pytest.raises(GibbsCodegenError) as caught:
        import_robot(path, ImportOptions("quaternion"))
    assert message in str(caught.value)


def test_a_link_without_inertia_has_what_sdf_says(reader: Path, tmp_path: Path) -> None:
    path = tmp_path / "robot.sdf"
    path.write_text('<sdf version="1.9"><model name="m"><link name="a"/></model></sdf>')
    robot, report = import_robot(path, ImportOptions("quaternion"))
    assert_is_as_read(robot, as_read(reader, path))
    assert robot.total_mass == 1.0
    assert any(line.subject == "a" and "so SDF's defaults" in line.detail for line in report)


def test_inertias_that_gazebo_refuses_are_told() -> None:
    text = "[base]\nmass = 1.0\ninertia = [1, 1, 9, 0, 0, 0]\n"
    robot = parse_robot(f'name = "r"\nallow_impossible_inertia = true\n{text}')
    with pytest.raises(UsageError, match=r"inertia of link base .* export URDF"):
        export_robot(robot, "sdf")


STANDING = """<sdf version="1.9"><model name="m" {placed}><pose>1 2 3 0 0 {turn}</pose>{static}
  <link name="foot"><pose>0 0 0.5 0 0 0</pose></link>
  <link name="arm"><pose>0 0 1 0 0 0</pose></link>
  <joint name="swing" type="revolute"><parent>foot</parent><child>arm</child>
    <axis><xyz>1 0 0</xyz></axis></joint>{joint}</model></sdf>"""
TO_WORLD = '<joint name="bolt" type="fixed"><parent>world</parent><child>foot</child></joint>'


@pytest.mark.parametrize(
    ("static", "joint", "placed", "options", "motion"),
    [
        ("", "", "", {}, "free"),
        ("<static>true</static>", "", "", {}, "fixed"),
        ("", TO_WORLD, "", {}, "fixed"),
        ("", TO_WORLD, 'placement_frame="foot"', {}, "fixed"),
        ("", "", "", {"motion": "upright"}, "upright"),
        ("<static>1</static>", TO_WORLD, "", {"motion": "free"}, "free"),
    ],
)
def test_models_that_the_world_holds_stand_where_they_are(
    static: str, joint: str, placed: str, options: dict[str, Any], motion: str, tmp_path: Path
) -> None:
    text = STANDING.format(static=static, joint=joint, placed=placed, turn=np.pi / 6)
    (tmp_path / "m.sdf").write_text(text)
    robot, _ = import_robot(tmp_path / "m.sdf", ImportOptions("xyz", **options))
    assert robot.base.motion == motion
    if motion != "free":
        height = 3.0 if placed else 3.5
        assert robot.base.pose == Pose((1.0, 2.0, height), (LEVEL[0], LEVEL[1], Fraction(30)))


@pytest.mark.slow  # It compiles a program with libsdformat.
def test_bases_that_do_not_fly_are_read_by_libsdformat(reader: Path, tmp_path: Path) -> None:
    robot, _ = read_robot("quadrotor_arm_2link")
    base = replace(robot.base, attitude="xyz", motion=("x", "z", "pitch"))
    text, _ = export_robot(replace(robot, base=base), "sdf")
    (tmp_path / "planar.sdf").write_text(text)
    read = as_read(reader, tmp_path / "planar.sdf")
    assert {"x", "z", "pitch"} <= {*read.joints}
    assert read.mass == pytest.approx(robot.total_mass)
