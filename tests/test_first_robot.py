"""The page that leads from nothing to a robot of one's own that flies does what it says."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from support.command import run
from support.pages import PAGES, blocks, run_python

from gibbs_codegen import read_flight

pytestmark = pytest.mark.usefixtures("derived_once")

PAGE = "docs/start/first-robot.md"


def without_time(text: str) -> str:
    return re.sub(r"in \d+\.\d s", "", text)


@pytest.mark.slow
def test_a_robot_of_ones_own_flies(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    names = re.findall(r"^Save this as `([\w.]+)`", PAGES[PAGE], re.MULTILINE)
    for name, text in zip(names, blocks(PAGE, "toml"), strict=True):
        (tmp_path / name).write_text(text, encoding="utf-8")
    printed = ""
    for block in blocks(PAGE, "sh"):
        command = block.removeprefix("gibbs-codegen ").split()
        done = run(*command, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        printed += done.stdout
    (shown,) = blocks(PAGE, "text")
    assert without_time(shown) in without_time(printed)
    assert "force along x\n  force along y\n" in printed
    flight = read_flight(tmp_path / "flight" / "flight.npz")
    thrusts = flight.applied[flight.time > 0.2, :4]
    assert (np.floor(thrusts.min()), np.ceil(thrusts.max())) == (3, 6)
    assert (tmp_path / "flight" / "snapshots.png").is_file()
    run_python("docs/start/first-robot.md")
