"""The page of a robot, for robots of every kind."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

import gibbs_codegen
from gibbs_codegen.flight.viewer import page as viewer_page
from gibbs_codegen.flight.viewer.machine import DrawnMachine

pytestmark = pytest.mark.usefixtures("derived_once")

Shipped = Callable[[str], ModuleType]

# A base without rotors, and a joint that slides.
SLIDER = """\
name = "slider"
gravity = 9.81
[base]
attitude = "quaternion"
mass = 2
inertia = [0.02, 0.02, 0.03, 0, 0, 0]
[[link]]
name = "slide"
joint = "prismatic"
axis = "z"
xyz = [0, 0, -0.1]
mass = 1
inertia = [0.01, 0.01, 0.01, 0, 0, 0]
limits = [0, 0.25]
"""


@pytest.mark.slow
def test_a_robot_without_rotors_that_slides_is_shown(tmp_path: Path) -> None:
    (tmp_path / "slider.toml").write_text(SLIDER)
    file, out = str(tmp_path / "slider.toml"), str(tmp_path / "made")
    module = gibbs_codegen.load(gibbs_codegen.generate(file, out, verify=False))
    machine = DrawnMachine(module)
    labels, ends = machine.controls(1.0)
    assert labels[3] == "slide, m"
    assert ends[:, 3].tolist() == [0.0, 0.25]
    page = gibbs_codegen.view_html(module)
    assert len(page.text) < 2_000_000
    assert "thrust" not in page.text.rpartition('id="key"')[2]
    assert "force at a joint" in page.text


@pytest.mark.slow
def test_a_page_has_fewer_frames_rather_than_more_room(
    shipped: Shipped, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = gibbs_codegen.view_html(shipped("quadrotor")).size
    monkeypatch.setattr(viewer_page, "_ROOM", whole - 1000)
    assert gibbs_codegen.view_html(shipped("quadrotor")).size <= whole - 1000
