"""The layout tells where attitude, joints and position stand, and what each entry is."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gibbs_codegen.errors import UsageError
from gibbs_codegen.robot.coordinates import hybrid_coordinates, inputs, reduced_coordinates
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.layout import Layout, Places, joint_kind, layout_of
from gibbs_codegen.robot.model import Robot

ROBOTS = ["hexarotor", "quadrotor_2link", "octorotor_7link"]


def robot_with_slider(name: str) -> Robot:
    """The robot that ships under `name`, its last joint, if it has one, made prismatic."""
    robot, _ = read_robot(name)
    links = robot.links
    if links:
        links = (*links[:-1], replace(links[-1], joint="prismatic"))
    return replace(robot, links=links)


@pytest.mark.parametrize("name", ROBOTS)
def test_layout_agrees_with_the_coordinates(name: str) -> None:
    robot = robot_with_slider(name)
    layout, coordinates = layout_of(robot), reduced_coordinates(robot)
    assert layout.names == tuple(c.name for c in coordinates)
    assert layout.units == tuple(c.unit for c in coordinates)
    assert layout.effort_units == tuple(c.unit for c in inputs(robot)[robot.rotors :])
    assert layout.names[layout.attitude] == ("theta_m1", "theta_0", "theta_1")
    assert layout.names[layout.position] == ("x", "y", "z")
    assert layout.names[layout.middle_angle] == "theta_0"
    assert layout.size == len(coordinates)
    assert [layout.names[k] for k in layout.base] == ["theta_m1", "theta_0", "theta_1", *"xyz"]
    assert tuple(layout.names[k] for k in layout.joint_places) == layout.names[layout.joints]


@pytest.mark.parametrize("name", ROBOTS)
def test_hybrid_places(name: str) -> None:
    robot = robot_with_slider(name)
    layout, hybrid = layout_of(robot), [c.name for c in hybrid_coordinates(robot)]
    assert tuple(hybrid[k] for k in layout.free) == layout.names
    assert hybrid[layout.constrained] == [f"theta_{k}" for k in range(2, robot.rotors + 1)]


def test_layout_of_names_is_that_of_the_robot() -> None:
    robot = robot_with_slider("quadrotor_2link")
    assert Layout.of(layout_of(robot).names, robot.rotors - 1) == layout_of(robot)


@pytest.mark.parametrize("joints", [0, 1, 4])
def test_joined_is_the_inverse_of_split(joints: int) -> None:
    places = Places.of_joints(joints)
    values = list(range(6 + joints))
    base, moved = places.split(values)
    assert len(base) == 6
    assert len(moved) == joints
    assert places.joined(base, moved) == values


def test_kinds_of_joints() -> None:
    assert joint_kind("theta_7") == "revolute"
    assert joint_kind("d_8") == "prismatic"
    assert {joint_kind(name) for name in ("x", "theta_m1", "theta_", "tau_7", "d_12345")} == {None}


@pytest.mark.parametrize(
    "names",
    [
        ("theta_m1", "theta_0"),
        ("theta_m1", "theta_0", "theta_1", "x", "y"),
        ("x", "y", "z", "theta_7", "theta_m1", "theta_0", "theta_1"),
        ("theta_m1", "theta_0", "theta_1", "elbow", "x", "y", "z"),
    ],
)
def test_other_names_are_refused(names: tuple[str, ...]) -> None:
    with pytest.raises(UsageError, match="are not theta_m1, theta_0, theta_1, the joints"):
        Layout.of(names, 3)
