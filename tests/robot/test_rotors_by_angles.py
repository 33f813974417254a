"""Rotors that radius, azimuth, tilt and cant place, against rotations of SciPy's."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gibbs_codegen.errors import RobotFileError, UsageError
from gibbs_codegen.exchange.importing import ImportOptions, import_robot
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.robot.parts.rotor import Rotor
from gibbs_codegen.robot.text import placed_robot_text

BASE = 'name = "uav"\n[base]\nmass = 1\ninertia = [1, 1, 1, 0, 0, 0]\n'


def rotor(keys: str) -> Rotor:
    return parse_robot(f"{BASE}[[rotor]]\n{keys}").thrusters[0]


def test_angles_turn_as_the_page_says() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        azimuth, tilt, cant = rng.uniform(-180, 180, 3)
        radius, height = rng.uniform(0, 1, 2)
        found = rotor(
            f"radius = {radius}\nazimuth_deg = {azimuth}\nheight = {height}\n"
            f"tilt_deg = {tilt}\ncant_deg = {cant}"
        )
        turn = Rotation.from_euler("ZXY", [azimuth, cant, tilt], degrees=True)
        flat = Rotation.from_euler("Z", azimuth, degrees=True)
        np.testing.assert_allclose(found.direction, turn.apply([0, 0, 1]), atol=1e-15)
        np.testing.assert_allclose(found.position, flat.apply([radius, 0, height]), atol=1e-15)


def test_common_angles_leave_no_rounding() -> None:
    """What is zero is folded away in generated code, and equal numbers share a constant."""
    found = rotor("radius = 0.3\nazimuth_deg = 90\ntilt_deg = 30")
    assert found.position == (0.0, 0.3, 0.0)
    assert found.direction == (0.0, 0.5, math.cos(math.pi / 6))
    for azimuth in (45, 135, 225, 315):
        x, y, _ = rotor(f"radius = 0.3\nazimuth_deg = {azimuth}").position
        assert abs(x) == abs(y)
    assert rotor("azimuth_deg = 60\nheight = 0.1") == Rotor(position=(0.0, 0.0, 0.1))


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("position = [1, 0, 0]\nazimuth_deg = 3", "azimuth_deg: excludes position"),
        ("azimuth_deg = 3\ndirection = 'x'\ncant_deg = 3", "cant_deg: excludes direction"),
        ("radius = 1", "radius: needs azimuth_deg"),
        ("position = [1, 0, 0]\ntilt_deg = 5", "tilt_deg: needs azimuth_deg"),
    ],
)
def test_one_form_of_a_placement_is_given_whole(keys: str, words: str) -> None:
    with pytest.raises(RobotFileError, match=words):
        rotor(keys)


def test_files_of_rotors_for_imports_have_them_too(tmp_path: Path) -> None:
    (tmp_path / "rotors.toml").write_text(
        "[[rotor]]\nradius = 0.3\nazimuth_deg = 90\ncant_deg = 90"
    )
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    body = f'<link name="body"><inertial><mass value="1"/>{inertia}</inertial></link>'
    (tmp_path / "uav.urdf").write_text(f'<robot name="uav">{body}</robot>')
    options = ImportOptions("quaternion", tmp_path / "rotors.toml")
    (found,) = import_robot(tmp_path / "uav.urdf", options)[0].thrusters
    assert (found.position, found.direction) == ((0.0, 0.3, 0.0), (1.0, 0.0, 0.0))


def test_the_file_to_start_from_has_rotors_in_a_circle() -> None:
    """The four corners, in their order, are those of a square of 2 · 191 mm."""
    robot = parse_robot(placed_robot_text("uav"))
    corners = 0.191 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    np.testing.assert_allclose([r.position[:2] for r in robot.thrusters], corners, atol=1e-4)
    assert [(r.name, math.copysign(1, r.drag)) for r in robot.thrusters] == [
        *(("front_left", 1), ("rear_left", -1), ("rear_right", 1), ("front_right", -1))
    ]
    seven = parse_robot(placed_robot_text("uav", 7)).thrusters
    np.testing.assert_allclose(sum(np.array(r.position[:2]) for r in seven), 0.0, atol=1e-15)
    with pytest.raises(UsageError, match="from 4 to 256 with --placed, not 3"):
        placed_robot_text("uav", 3)
