"""The layout tells where attitude, joints and position stand, and what each entry is."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gibbs_codegen.errors import UsageError
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.layout import Layout, coordinate_places, layout_of, velocity_places
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.link import JointKind, JointLimits
from gibbs_codegen.robot.posture import default_posture

ROBOTS = ["hexarotor", "quadrotor_2link", "octorotor_7link"]


def robot_with_slider(name: str) -> Robot:
    """The robot that ships under `name`, its last joint, if it has one, made prismatic."""
    robot, _ = read_robot(name)
    links = robot.links
    if links:
        links = (*links[:-1], replace(links[-1], joint="prismatic"))
    return replace(robot, links=links)


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize(
    "limits", [(0.0, None), (None, 0.0), (0.0, 0.5), (-0.3, 0.3), (2.5, None), (None, -2.5)]
)
def test_a_robot_starts_strictly_within_its_limits(
    kind: JointKind, limits: tuple[float | None, float | None]
) -> None:
    robot, _ = read_robot("quadrotor_2link")
    links = [replace(link, joint=kind, limits=JointLimits(*limits)) for link in robot.links]
    robot = replace(robot, links=tuple(links))
    posture = default_posture(robot)[list(layout_of(robot).q.joint_places)]
    low, high = limits
    assert low is None or all(posture > low)
    assert high is None or all(posture < high)


@pytest.fixture(params=["xyz", "zyx", "quaternion"])
def attitude(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(params=ROBOTS)
def robot(request: pytest.FixtureRequest, attitude: str) -> Robot:
    robot = robot_with_slider(request.param)
    return replace(robot, base=replace(robot.base, attitude=attitude))


def test_layout_agrees_with_the_coordinates(robot: Robot) -> None:
    layout = layout_of(robot)
    for entries, listed in (
        (layout.q, Description(robot).coordinates),
        (layout.v, Description(robot).velocities),
    ):
        assert entries.names == tuple(c.name for c in listed)
        assert entries.units == tuple(c.unit for c in listed)
        assert entries.size == len(listed)
        joints = tuple(entries.names[k] for k in entries.joint_places)
        assert joints == entries.names[entries.joints]
    assert layout.effort_units == tuple(c.unit for c in Description(robot).inputs[robot.rotors :])
    assert layout.q.names[layout.q.position] == ("x", "y", "z")
    assert layout.q.names[layout.q.joints] == layout.v.names[layout.v.joints]


def test_layout_of_angles() -> None:
    layout = layout_of(robot_with_slider("quadrotor_2link"))
    assert layout.q.names[layout.q.attitude] == ("theta_m1", "theta_0", "theta_1")
    assert layout.q.names[layout.middle_angle] == "theta_0"
    assert layout.v.names == layout.q.names
    assert layout.q.units == (*["rad"] * 4, *["m"] * 4)
    assert layout.v.units == (*["rad/s"] * 4, *["m/s"] * 4)
    assert layout.neutral == [0.0] * 8


def test_layout_of_a_quaternion() -> None:
    robot = robot_with_slider("quadrotor_2link")
    layout = layout_of(replace(robot, base=replace(robot.base, attitude="quaternion")))
    assert layout.q.names == ("x", "y", "z", "qx", "qy", "qz", "qw", "theta_5", "d_6")
    assert layout.q.units == (*["m"] * 3, *["1"] * 4, "rad", "m")
    assert layout.v.names == ("vx", "vy", "vz", "wx", "wy", "wz", "theta_5", "d_6")
    assert layout.v.units == (*["m/s"] * 3, *["rad/s"] * 4, "m/s")
    assert layout.neutral == [0.0] * 6 + [1.0] + [0.0] * 2


def test_hybrid_places(robot: Robot) -> None:
    layout, hybrid = layout_of(robot), [c.name for c in Description(robot).hybrid_coordinates]
    assert tuple(hybrid[k] for k in layout.free) == layout.v.names
    assert hybrid[layout.constrained] == [f"theta_{k}" for k in range(2, robot.rotors + 1)]
    joints = hybrid[layout.constrained.stop :][: len(robot.links)]
    assert tuple(joints) == layout.v.names[layout.v.joints]


def test_layout_of_what_a_module_lists_is_that_of_the_robot(robot: Robot, attitude: str) -> None:
    layout = layout_of(robot)
    listed = Layout.listed(attitude, layout.q.names, layout.q.units, robot.rotors - 1)
    assert listed == layout


@pytest.mark.parametrize("joints", [0, 1, 4])
@pytest.mark.parametrize("places", [coordinate_places, velocity_places])
def test_joined_is_the_inverse_of_split(places, joints: int, attitude: str) -> None:
    found = places(attitude, joints)
    values = list(range(found.size))
    base, moved = found.split(values)
    assert len(base) == (7 if (attitude, places) == ("quaternion", coordinate_places) else 6)
    assert len(moved) == joints
    assert found.joined(base, moved) == values


@pytest.mark.parametrize(
    ("attitude", "names"),
    [
        ("xyz", ("theta_m1", "theta_0")),
        ("xyz", ("theta_m1", "theta_0", "theta_1", "x", "y")),
        ("xyz", ("x", "y", "z", "theta_7", "theta_m1", "theta_0", "theta_1")),
        ("xyz", ("x", "y", "z", "qx", "qy", "qz", "qw")),
        ("quaternion", ("qx", "qy", "qz", "qw", "x", "y", "z")),
        ("quaternion", ("theta_m1", "theta_0", "theta_1", "theta_7", "x", "y", "z")),
    ],
)
def test_other_names_are_refused(attitude: str, names: tuple[str, ...]) -> None:
    with pytest.raises(UsageError, match="with the joints' at place"):
        Layout.listed(attitude, names, ["rad"] * len(names), 3)
