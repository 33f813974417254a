"""The module in `generated/` is what the generator writes, and its numbers are right."""

from __future__ import annotations

import pytest
from conftest import ROOT
from support.comparison import compare

from gibbs_codegen.pipeline import check_robot
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.runtime.load import load

COMMITTED = "hexarotor_3link"


@pytest.mark.slow
def test_committed_module_is_up_to_date() -> None:
    robot, text = read_robot(COMMITTED)
    differing = check_robot(robot, text, ROOT / "generated")[1]
    assert differing == [], (
        f"if this is meant, read the diff of: gibbs-codegen generate {COMMITTED}"
    )
    compare(robot, load(ROOT / "generated" / COMMITTED), count=20)
