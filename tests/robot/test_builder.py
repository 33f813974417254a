"""Robot files made in Python read back as what was given, and are refused by key."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from support.actuated import TEXT as ACTUATED
from support.constrained import TEXT as CONSTRAINED

from gibbs_codegen import OutputError, RobotFile, RobotFileError, parse_robot
from gibbs_codegen.robot.file import shipped_robots

FILES = [ROOT / "gibbs_codegen" / "robots" / f"{name}.toml" for name in shipped_robots()]
FILES.append(ROOT / "tests" / "robots" / "everything.toml")
TEXTS = [*(path.read_text(encoding="utf-8") for path in FILES), ACTUATED, CONSTRAINED]
_TABLES = ("rotor", "link", "frame", "constraint")


@pytest.mark.parametrize("text", TEXTS, ids=lambda text: tomllib.loads(text)["name"])
def test_every_file_can_be_made_key_by_key(text: str) -> None:
    document = tomllib.loads(text)
    tables = {kind: document.pop(kind, []) for kind in _TABLES}
    single = {kind: document.pop(kind) for kind in ("battery", "base") if kind in document}
    file = RobotFile(**document)
    for kind, keys in single.items():
        file = getattr(file, kind)(**keys)
    for kind, entries in tables.items():
        for entry in entries:
            file = getattr(file, kind)(**entry)
    assert file.robot() == parse_robot(file.text()) == parse_robot(text)


HULL = RobotFile("uav").base(mass=np.float64(2), inertia=np.array([1, 1, 1, 0, 0, 0]))


def test_files_are_not_changed_by_their_methods(tmp_path: Path) -> None:
    with_arm = HULL.link(
        mass=1, inertia=(1, 1, 1, 0, 0, 0), limits=(-np.inf, 1), coordinate=None, name="arm"
    )
    heavy = with_arm.base(mass=3)
    assert (HULL.robot().total_mass, with_arm.robot().total_mass) == (2, 3)
    assert heavy.robot().total_mass == 4
    path = heavy.write(tmp_path / "designs" / "uav.toml")
    assert path == HULL.write(path)
    assert path.read_text() == HULL.text()
    with pytest.raises(OutputError, match="cannot be written"):
        HULL.write(path / "uav.toml")


def test_every_fault_names_its_key() -> None:
    with pytest.raises(RobotFileError) as refused:
        HULL.rotor(raduis=1).link(mass="x", name="a").link(colour=object(), parent="b").text()
    for words in (
        "uav: rotor 1: raduis: unknown key; did you mean radius?",
        "uav: link 1: mass: must be a number, not a string",
        "uav: link 2: colour: unknown key",
        'uav: link 2: parent: must be "base" or the name of a link given earlier',
    ):
        assert words in str(refused.value)
    with_feet = HULL.link(mass=1, inertia=(1, 1, 1, 0, 0, 0), name="leg")
    for k in (1, 2):
        with_feet = with_feet.frame(name=f"foot_{k}", on="leg")
    for name, frame in (("pin", "fot_2"), ("stand", "x")):
        with_feet = with_feet.constraint(name=name, type="point", frame=frame)
    with_feet = with_feet.link(
        name="sole", parent="leg", joint="fixed", mass=1, inertia=(1, 1, 1, 0, 0, 0)
    ).frame(name="toe", on="sole")
    for name, frame in (("free", "base"), ("welded", "foot_2"), ("one", "foot_1")):
        with_feet = with_feet.constraint(
            name=name, type="point", frame=frame, to="toe" if name != "one" else "foot_2"
        )
    with pytest.raises(RobotFileError) as refused:
        with_feet.text()
    for words in (
        "constraint 1: frame: must be the name of a frame, not 'fot_2'; did you mean 'foot_2'?",
        "constraint 2: frame: must be the name of a frame, not 'x'; 'toe' is one",
        "constraint 4: to: both frames are on the same body; choose frames on two bodies",
        "constraint 5: to: both frames are on the same body; choose frames on two bodies",
    ):
        assert words in str(refused.value)
    assert "constraint 3" not in str(refused.value)
    with pytest.raises(RobotFileError, match="base: missing"):
        RobotFile("uav", gravity=1.6).text()
