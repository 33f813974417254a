"""Imports go one way, as the map in `pipeline` draws it."""

from __future__ import annotations

import ast

import pytest
from conftest import ROOT

PACKAGE = ROOT / "gibbs_codegen"

# Each room, from left to right; a module may import from its own room and from those before it.
ROOMS = [
    {"errors", "version"},
    {"robot", "names", "rigid_body", "toml_lines", "toml_reader", "templating"},
    {"robot_file", "family", "coordinates", "robot_text"},
    {"chains", "arrangement"},
    {"structural", "tape"},
    {"vectors", "gibbs", "ldlt"},
    {"inertia", "kinematics"},
    {"serial", "root", "parameters", "articulated_inertia"},
    {"machine", "equations", "articulated"},
    {"forces"},
    {"program", "interface"},
    {"trigonometry", "pieces"},
    {"runs", "slots"},
    {"rolling"},
    {"stack", "determinacy"},
    {"combine", "forward", "geometry", "closed_form"},
    {"lower"},
    {"model"},
    {"printers", "describe"},
    {"c_function"},
    {"numpy_target", "c_target"},
    {"emit"},
    {"write", "report"},
    {"cache", "compiler"},
    {"c_library"},
    {"c_backend"},
    {"load"},
    {"pipeline"},
    {"cli"},
    {"__main__", "__init__"},
]
PLACE = {name: place for place, room in enumerate(ROOMS) for name in room}
MODULES = sorted(path.stem for path in PACKAGE.glob("*.py"))


def imports(name: str) -> set[str]:
    """Every module that a module imports anywhere in it."""
    found = set()
    for node in ast.walk(ast.parse((PACKAGE / f"{name}.py").read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module == "gibbs_codegen":
            found |= {f"gibbs_codegen.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
    return found


def test_every_module_has_its_place() -> None:
    assert set(MODULES) == set(PLACE)


@pytest.mark.parametrize("name", MODULES)
def test_imports_go_one_way(name: str) -> None:
    ours = {
        i.removeprefix("gibbs_codegen.") for i in imports(name) if i.startswith("gibbs_codegen.")
    }
    assert all(PLACE[other] <= PLACE[name] for other in ours), ours


@pytest.mark.parametrize("name", MODULES)
def test_sympy_stays_in_the_derivation(name: str) -> None:
    derivation = {n for n in PLACE if PLACE["structural"] <= PLACE[n] <= PLACE["model"]} - {
        "program",
        "determinacy",
    }
    if name not in derivation:
        assert "sympy" not in imports(name)


@pytest.mark.parametrize("name", MODULES)
def test_jinja_stays_in_one_place(name: str) -> None:
    assert ("jinja2" in imports(name)) == (name == "templating")


@pytest.mark.parametrize("name", MODULES)
def test_only_the_command_line_prints_or_exits(name: str) -> None:
    text = (PACKAGE / f"{name}.py").read_text(encoding="utf-8")
    if name not in ("cli", "__main__"):
        assert "print(" not in text.replace("console.print(", "")
        assert "sys.exit" not in text
