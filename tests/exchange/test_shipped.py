"""Robots that ship and were imported: they are what `import` makes of their sources."""

from __future__ import annotations

from dataclasses import astuple
from importlib import resources
from pathlib import Path
from typing import Any

import pytest

from gibbs_codegen.cli.app import main
from gibbs_codegen.robot.file import read_robot

SOURCES = Path(__file__).parent / "sources"
ROBOTS = resources.files("gibbs_codegen") / "robots"
NAMES = ("hextilt_flying_arm_5", "hydrus")


def same_but_for_rounding(one: Any, other: Any) -> bool:
    """Whether values, or tuples of them, are equal; floats to 1e-12 of them.

    Processors multiply matrices with other roundings.
    """
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(same_but_for_rounding, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return one == pytest.approx(other, rel=1e-12, abs=1e-15)
    return bool(one == other)


@pytest.mark.parametrize("name", ["hydrus"])
def test_they_are_what_import_makes_of_their_sources(name: str, tmp_path: Path) -> None:
    rotors, out = SOURCES / f"{name}_rotors.toml", tmp_path / "out.toml"
    more = ["--rotors", str(rotors)] if rotors.exists() else []
    assert main(["import", str(SOURCES / f"{name}.urdf"), *more, "--out", str(out)]) == 0
    robot, text = read_robot(name)
    assert same_but_for_rounding(astuple(robot), astuple(read_robot(str(out))[0]))
    assert "LICENSES.txt" in text.partition("#\n")[0]


@pytest.mark.parametrize("name", NAMES)
def test_their_licences_travel_with_them(name: str) -> None:
    assert f"\n{name}\n" in (ROBOTS / "LICENSES.txt").read_text(encoding="utf-8")
    assert f"\n{name}\n" in (SOURCES / "LICENSES.txt").read_text(encoding="utf-8")
