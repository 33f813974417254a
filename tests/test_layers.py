"""Imports go one way, as the map in `pipeline` draws it."""

from __future__ import annotations

import ast
import functools
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

PACKAGE = ROOT / "gibbs_codegen"

# Each room, from left to right; a module may import from its own room and from those before it.
ROOMS = [
    {"errors", "version"},
    {"output_folder", "folder_lock"},
    {"toml_depth", "toml_lines", "toml_reader", "toml_document"},
    {"robot", "names", "magnitude", "rigid_body", "templating"},
    {"robot_file", "family", "coordinates", "robot_text"},
    {"chains", "arrangement", "balance", "frames", "undetermined"},
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
    {"notation", "normal_form", "definitions"},
    {"chain_names", "shown_equation", "typeset"},
    {"readable", "forms"},
    {"recursion"},
    {"combine", "forward", "geometry", "closed_form"},
    {"filling"},
    {"show"},
    {"layout"},
    {"lower"},
    {"model"},
    {"printers", "describe"},
    {"c_function"},
    {"numpy_target", "c_target"},
    {"emit"},
    {"manifest", "write", "report"},
    {"arguments", "cache", "compiler"},
    {"c_library"},
    {"c_backend"},
    {"load"},
    {"verification.__init__", "verification.tree"},
    {"verification.formulation", "verification.differences", "verification.parameters"},
    {"verification.newton_euler", "verification.lagrange"},
    {"verification.pinocchio_tree", "verification.mujoco_tree", "verification.own_units"},
    {"verification.states", "verification.comparison"},
    {"verification.variation"},
    {"verification.equations", "verification.evaluation", "verification.contents"},
    {"verification.invariants"},
    {"verification.verify"},
    {"verification.table", "verification.c_program"},
    {"verification.modules"},
    {"simulator.paths", "simulator.attitude", "simulator.flight"},
    {"simulator.orientation", "simulator.vehicle", "simulator.path_file"},
    {"simulator.figure_style"},
    {"simulator.machine_drawing"},
    {"simulator.snapshots"},
    {"simulator.figures", "simulator.animation", "simulator.allocation"},
    {"simulator.inverse_dynamics", "simulator.inverse_kinematics"},
    {"simulator.reference", "simulator.hanging"},
    {"simulator.control"},
    {"simulator.closed_loop"},
    {"simulator.compiled_loop", "simulator.envelope"},
    {"simulator.integrate"},
    {"simulator.scenario"},
    {"simulator.scenario_file"},
    {"simulator.simulation", "simulator.results", "simulator.__init__"},
    {"coupling_figures", "machine_figures"},
    {"chains_figures"},
    {"pipeline"},
    {"robot_source"},
    {"cli"},
    {"__main__", "__init__"},
]
PLACE = {name: place for place, room in enumerate(ROOMS) for name in room}
FOLDERS = (PACKAGE, PACKAGE / "simulator", PACKAGE / "verification")
MODULES = sorted(
    ".".join(path.relative_to(PACKAGE).with_suffix("").parts)
    for folder in FOLDERS
    for path in folder.glob("*.py")
)
SIMULATOR = [name for name in MODULES if name.startswith("simulator.")]


VERIFICATION = [name for name in MODULES if name.startswith("verification.")]


@functools.cache
def text_of(name: str) -> str:
    return (PACKAGE / f"{name.replace('.', '/')}.py").read_text(encoding="utf-8")


@functools.cache
def imports(name: str) -> set[str]:
    """Every module that a module imports anywhere in it."""
    found = set()
    for node in ast.walk(ast.parse(text_of(name))):
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
    text = text_of(name)
    if name not in ("cli", "__main__"):
        assert "print(" not in text.replace("console.print(", "")
        assert "sys.exit" not in text


@pytest.mark.parametrize("name", SIMULATOR)
def test_the_simulator_knows_nothing_left_of_generated_modules(name: str) -> None:
    toml = {"toml_depth", "toml_reader", "toml_document"}
    shared = {"errors", "output_folder", *toml, "c_library", "cache", "compiler", "load"}
    ours = {
        i.removeprefix("gibbs_codegen.") for i in imports(name) if i.startswith("gibbs_codegen.")
    }
    assert {i for i in ours if not i.startswith("simulator.")} <= shared


@pytest.mark.parametrize("name", VERIFICATION)
def test_verification_shares_no_code_with_the_derivation(name: str) -> None:
    """The robot's data, the names of its coordinates, and what loads a module; nothing else."""
    shared = {"errors", "robot", "robot_file", "coordinates", "interface"}
    loading = {"load", "c_backend", "c_library", "cache", "compiler"}
    ours = {
        i.removeprefix("gibbs_codegen.") for i in imports(name) if i.startswith("gibbs_codegen.")
    }
    allowed = shared | (loading if name == "verification.modules" else set())
    assert {i for i in ours if not i.startswith("verification.")} <= allowed


def test_flying_imports_no_sympy(tmp_path: Path) -> None:
    run = (
        "import sys; from gibbs_codegen import load, read_scenario, simulate, write_results; "
        "scenario = read_scenario('paper', {'duration': 0.1}); "
        "robots = [load('generated/hexarotor_3link', b) for b in ('numpy', 'c')]; "
        "flights = [simulate(robot, scenario) for robot in robots]; "
        f"write_results(flights[1], {str(tmp_path)!r}); "
        "assert 'sympy' not in sys.modules and 'jinja2' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", run], check=True, cwd=ROOT)
