"""The modules in `generated/` are what the generator writes, and their numbers are right."""

from __future__ import annotations

import pytest
from conftest import ROOT
from support.comparison import compare

from gibbs_codegen.pipeline import check_robot
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.runtime.load import load

COMMITTED = ["hexarotor_3link", "quadrotor_2link"]


@pytest.mark.parametrize("name", COMMITTED)
def test_committed_module_is_up_to_date(name: str) -> None:
    robot, text = read_robot(name)
    differing = check_robot(robot, text, ROOT / "generated")[1]
    assert differing == [], f"if this is meant, read the diff of: gibbs-codegen generate {name}"
    compare(robot, load(ROOT / "generated" / name), count=20)
