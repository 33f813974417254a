"""Robots that ship and were imported: they are what `import` makes of their sources."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import pytest

from gibbs_codegen.cli.app import main
from gibbs_codegen.robot.file import read_robot

SOURCES = Path(__file__).parent / "sources"
ROBOTS = resources.files("gibbs_codegen") / "robots"
NAMES = ("hextilt_flying_arm_5", "hydrus")


@pytest.mark.parametrize("name", NAMES)
def test_they_are_what_import_makes_of_their_sources(name: str, tmp_path: Path) -> None:
    rotors, out = SOURCES / f"{name}_rotors.toml", tmp_path / "out.toml"
    more = ["--rotors", str(rotors)] if rotors.exists() else []
    assert main(["import", str(SOURCES / f"{name}.urdf"), *more, "--out", str(out)]) == 0
    robot, text = read_robot(name)
    assert robot == read_robot(str(out))[0]
    assert "LICENSES.txt" in text.partition("#\n")[0]


@pytest.mark.parametrize("name", NAMES)
def test_their_licences_travel_with_them(name: str) -> None:
    assert f"\n{name}\n" in (ROBOTS / "LICENSES.txt").read_text(encoding="utf-8")
    assert f"\n{name}\n" in (SOURCES / "LICENSES.txt").read_text(encoding="utf-8")
