"""Parts of the reference that the site makes from the package."""

from __future__ import annotations

import importlib.util
import re
from types import ModuleType

import pytest
from conftest import ROOT
from support.pages import PAGES
from ways_to_fly import REASONS, ways_to_fly

from gibbs_codegen.cli.app import argument_parser
from gibbs_codegen.files.shipped import shipped_names
from gibbs_codegen.files.table import json_schema
from gibbs_codegen.flight.scenario.file import ScenarioTable
from gibbs_codegen.interface import FUNCTIONS
from gibbs_codegen.robot.tables import RobotTable

HEADER = ROOT / "generated" / "hexarotor_3link" / "hexarotor_3link.h"


@pytest.fixture(scope="module")
def generated() -> ModuleType:
    spec = importlib.util.spec_from_file_location("generated", ROOT / "docs/_ext/generated.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_c_functions_are_declared_as_in_a_header(generated: ModuleType) -> None:
    header = HEADER.read_text(encoding="utf-8")
    for row in FUNCTIONS.values():
        if not (row.on_request or row.group == "actuators"):
            (declared,) = re.findall(rf"hexarotor_3link_{row.name}\((.*?)\);", header, re.DOTALL)
            shown = generated.prototype(row).partition("(")[2]
            assert re.findall(r"(\w+)(?:,|$)", declared) == re.findall(r"(\w+)(?:\[|,)", shown)


def test_every_option_of_every_command_is_told(generated: ModuleType) -> None:
    told = generated.commands()
    (chosen,) = (a for a in argument_parser()._actions if isinstance(a.choices, dict))
    for name, parser in chosen.choices.items():
        section = told.partition(f"## {name}\n")[2].partition("\n## ")[0]
        options = {option for action in parser._actions for option in action.option_strings}
        for option in options - {"-h", "--help"}:
            assert re.search(rf"\n`(--\S+, )?{option}[`, ]", section), (name, option)


def test_every_robot_that_ships_is_in_the_gallery_with_a_picture_and_a_command() -> None:
    for name in shipped_names("robots"):
        section = PAGES["docs/gallery.md"].partition(f"\n## {name}\n")[2].partition("\n## ")[0]
        assert f"](_static/gallery/{name}.png)" in section
        assert re.search(rf"^gibbs-codegen (simulate|show) {name} ", section, re.MULTILINE)
    drawn = (path.stem for path in (ROOT / "docs/_static/gallery").iterdir())
    assert sorted(drawn) == list(shipped_names("robots"))


def test_keys_are_told_with_their_bounds_and_defaults(generated: ModuleType) -> None:
    told = generated.robot_keys()
    assert "| `name` | string, required | " in told
    assert "| `gravity` | number ≥ 0; default `9.81` | " in told
    assert "| `com` | 3 numbers; default `[0, 0, 0]` | " in told
    assert "| `arm` | [arm](#arm) or list of [arm](#arm) | " in told
    for page, table in ((told, RobotTable), (generated.scenario_keys(), ScenarioTable)):
        schema = json_schema(table)
        for described in (schema, *schema["$defs"].values()):
            assert all(f"| `{key}` |" in page for key in described["properties"])


def test_every_part_acts_in_every_way_to_fly_or_there_is_a_reason() -> None:
    """A reason for what acts, and none for what does not, ends the table of the programs."""
    told = ways_to_fly()
    (wind,) = (line for line in told.splitlines() if line.startswith("| wind"))
    assert wind == "| wind, with drag | yes | yes | yes | yes | yes |"
    with pytest.MonkeyPatch.context() as patch:
        patch.delitem(REASONS, ("predictive control", "constraints"))
        with pytest.raises(
            ValueError, match="constraints in predictive control: there is no reason"
        ):
            ways_to_fly()
        patch.setitem(REASONS, ("predictive control", "constraints"), "")
        patch.setitem(REASONS, ("FMU", "pushes"), "none")
        with pytest.raises(ValueError, match="pushes in FMU: none"):
            ways_to_fly()
