"""What the README and the pages in `docs/` show is what happens."""

from __future__ import annotations

import doctest
import json
import re
import shlex
import tomllib
from os.path import relpath
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
from conftest import ROOT
from support.command import run as run_command
from support.pages import PAGES, blocks, files_of, run_python, write_files
from support.tools import compiler_to_run, run, tool

import gibbs_codegen
from gibbs_codegen import generate, trim
from gibbs_codegen.cli.app import options_of
from gibbs_codegen.flight.scenario.file import parse_scenario
from gibbs_codegen.interface import FUNCTIONS
from gibbs_codegen.interface.table import DERIVATIVE_GROUPS
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.runtime.load import load

pytestmark = pytest.mark.usefixtures("derived_once")

# Pages that need a package more, each with a test file that runs it and asserts what comes out.
RUN_ELSEWHERE = {
    "docs/howto/casadi.md": "tests/runtime/test_casadi_backend.py",
    "docs/howto/crocoddyl.md": "tests/test_crocoddyl.py",
    "docs/howto/fly.md": "tests/flight/viewer/test_fly.py",
    "docs/howto/own-law.md": "tests/runtime/test_own_law.py",
    "docs/howto/own-nmpc.md": "tests/runtime/test_casadi_backend.py",
    "docs/howto/jax.md": "tests/runtime/test_jax_backend.py",
    "docs/howto/predictive-c.md": "tests/test_project_pages.py",
    "docs/howto/torch.md": "tests/runtime/test_torch_backend.py",
    "docs/howto/train.md": "tests/flight/rollouts/test_torch_env.py",
    "docs/start/autopilot.md": "tests/flight/autopilots/test_betaflight.py",
    "docs/start/first-robot.md": "tests/test_first_robot.py",
}
# Pages of whole projects, which tests/test_project_pages.py builds and runs.
PROJECTS = ("docs/howto/cmake.md", "docs/howto/eigen.md", "docs/howto/predictive-c.md")
# Entries of Python's functions, each with an example; those of these need a package, or a window.
API_PAGES = sorted(page for page in PAGES if page.startswith("docs/reference/python-"))
WITHOUT_EXAMPLE = {"acados_model", "differentiable", "fly_html", "view"}
MODULE_PAGE = "docs/reference/generated-module.md"
COMMAND = re.compile(r"gibbs-codegen ([^#&>\n]*)")


def pages_with(language: str) -> list[str]:
    """Pages that have blocks of a language."""
    return [page for page in PAGES if blocks(page, language)]


@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    [p for p in pages_with("python") if p not in RUN_ELSEWHERE and "/lessons/" not in p],
)
def test_python_runs(page: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The blocks of a page one after the other, in an empty folder; prompts give what is shown.

    What `generate` checks first is checked where it is tested.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("gibbs_codegen.pipeline.refuse_wrong", lambda *_: None)
    if page == "docs/howto/rollouts.md":
        monkeypatch.setenv("CC", compiler_to_run())
    write_files(page, tmp_path)
    run_python(page)


@pytest.mark.slow
def test_c_program(tmp_path: Path) -> None:
    """The C lines compile as the body of a program, and it computes something."""
    pages = ["actuators", "c-and-firmware", "rollouts"]
    pages = [*(f"howto/{page}" for page in pages), "reference/derivatives"]
    elsewhere = (*PROJECTS, "docs/lessons/firmware.md", "docs/reference/equations.md")
    assert [p for p in pages_with("c") if p not in elsewhere] == [f"docs/{p}.md" for p in pages]
    one, wrench, quaternion, other, batch = blocks("docs/howto/c-and-firmware.md", "c")
    generate("quadrotor", tmp_path, verify=False)
    header, _, turning = quaternion.partition("\n\n")
    *include, body = re.split(r"(?<=\*/)\n\n", one)
    lines = [*include, header, "#include <string.h>", "int main(void)", "{", body, wrench, other]
    lines += ["{", turning, "if (!(moved[QUADROTOR_Q_QZ] > 0.002)) return 1;", "}", "{", batch]
    lines += [
        "mass_matrix[0] = M[999 * 81];",
        "}",
        "return !(mass_matrix[80] > 0.0 && mass_matrix[0] > 0.0 && a[HEXAROTOR_3LINK_V_Z] < -9.9);",
        "}",
    ]
    (tmp_path / "program.c").write_text("\n".join(lines), encoding="utf-8")
    folder = ROOT / "generated" / "hexarotor_3link"
    other_folder = tmp_path / "quadrotor"
    sources = [folder / f"hexarotor_3link{ending}.c" for ending in ("", "_batch")]
    sources += [tmp_path / "program.c", other_folder / "quadrotor.c"]
    program = tmp_path / "program"
    run([tool("cc"), "-O0", f"-I{folder}", f"-I{other_folder}", *sources, "-o", program, "-lm"])
    run([program])


@pytest.mark.slow
def test_c_program_that_sends_commands(tmp_path: Path) -> None:
    """Without gains the law gives what hovers, and the commands are those of NumPy."""
    page = "docs/howto/actuators.md"
    write_files(page, tmp_path)
    folder = generate(tmp_path / "courier.toml", tmp_path, laws=["geometric"], verify=False)
    (text,) = blocks(page, "c")
    lines = [
        "#include <stdio.h>",
        "int main(void)",
        "{",
        "courier_rotors rotors;",
        "courier_gains gains = {{0}, {0}, {0}, {0}};",
        "courier_state state = {{0, 0, 0, 0, 0, 0, 1, 0.5, 0.7}, {0}};",
        "courier_reference reference = {0};",
        "courier_real command[COURIER_COMMANDS];",
        "for (int i = 0; i < COURIER_COORDINATES; ++i) reference.q[i] = state.q[i];",
        "for (int i = 0; i < COURIER_INPUTS; ++i) { gains.least[i] = -20; gains.most[i] = 20; }",
        "courier_init_rotors(&courier_default_constants, &rotors);",
        "control(&rotors, &gains, &state, &reference, command);",
        'for (int i = 0; i < COURIER_COMMANDS; ++i) printf("%.17g\\n", command[i]);',
        "return 0;",
        "}",
    ]
    (tmp_path / "program.c").write_text("\n".join([text, *lines]), encoding="utf-8")
    sources = [tmp_path / "program.c", *(folder / f"courier{ending}.c" for ending in ("", "_laws"))]
    program = tmp_path / "program"
    run([tool("cc"), "-O0", f"-I{folder}", *sources, "-o", program, "-lm"])
    found = np.array([float(line) for line in run([program]).split()])
    drone = load(folder)
    hover = trim(drone, {"upper_arm": 0.5, "forearm": 0.7})
    expected = drone.command_of(hover.q, hover.v, hover.u)
    assert np.allclose(found, expected, rtol=1e-9)


@pytest.mark.slow
def test_c_program_with_derivatives(tmp_path: Path) -> None:
    """Gravity turns with the base: the acceleration along x by the angle about y is g."""
    generate("quadrotor", tmp_path, derivatives="forward_dynamics_derivatives", verify=False)
    (text,) = blocks("docs/reference/derivatives.md", "c")
    header, _, body = text.partition("\n\n")
    state = ["double q[7] = {0, 0, 0, 0, 0, 0, 1}, v[6] = {0}, u[4] = {0};"]
    checked = "return !(jacobian[QUADROTOR_V_VX][QUADROTOR_V_WY] == 9.81);"
    lines = [header, "int main(void)", "{", *state, "double jacobian[6][6] = {{0}};", body, checked]
    (tmp_path / "program.c").write_text("\n".join([*lines, "}"]), encoding="utf-8")
    sources = [tmp_path / "program.c", tmp_path / "quadrotor" / "quadrotor.c"]
    program = tmp_path / "program"
    run([tool("cc"), "-O0", f"-I{tmp_path / 'quadrotor'}", *sources, "-o", program, "-lm"])
    run([program])


def test_files_in_toml_are_accepted() -> None:
    files = [f"reference/{page}" for page in ("equations", "robot-file", "scenario-file")]
    touching = ["howto/force-control", "howto/walls"]
    loads = ["howto/observers"]
    filtered = ["howto/estimate"]
    named = ("actuators", "constraints", "import", "other-machines", "sensors")
    howto = [f"howto/{page}" for page in named]
    pages = [
        *sorted([*howto, *touching, *loads, *filtered]),
        *(f"lessons/{page}" for page in ("px4", "teaching", "urdf")),
        *files,
        "start/autopilot",
        "start/first-robot",
    ]
    assert pages_with("toml") == ["README.md", *(f"docs/{page}.md" for page in pages)]
    paper, whole, *more = blocks("docs/reference/robot-file.md", "toml")
    more = [whole + text if text.startswith("# added to") else text for text in more]
    robots = map(parse_robot, [paper, whole, *more])
    rods, placed, fixed, driven, held, sprung, geared, motored = robots
    assert (rods.base.rotors, len(rods.links)) == (6, 1)
    assert (len(placed.thrusters), placed.parents, len(placed.frames)) == (4, (0, 1), 1)
    assert fixed.base.motion == "fixed"
    assert [drive.command for drive in driven.drives] == ["speed"]
    assert [each.kind for each in held.constraints] == ["frame", "distance", "plane", "loop"]
    assert [each.name for each in sprung.springs] == ["balance"]
    assert (geared.moving, geared.gearing[4].ratio) == ((1, 2, 3), -1.0)
    assert motored.links[2].motor.gear_ratio == -100.0
    scenario, *others = map(parse_scenario, blocks("docs/reference/scenario-file.md", "toml"))
    assert scenario.arm.tip is not None
    assert [other.name for other in others] == ["via", "quick"]
    for page in filtered:
        for text in blocks(f"docs/{page}.md", "toml"):
            assert parse_scenario(text).control.estimate
    for page in touching:
        for text in blocks(f"docs/{page}.md", "toml"):
            assert parse_scenario(text).walls
    for page in loads:
        for text in blocks(f"docs/{page}.md", "toml"):
            assert parse_scenario(text).payloads


@pytest.mark.parametrize("page", [*pages_with("sh"), *pages_with("console")])
def test_commands_have_options_that_exist(page: str) -> None:
    for block in [*blocks(page, "sh"), *blocks(page, "console")]:
        for command in COMMAND.findall(block.replace("\\\n", " ")):
            options_of(shlex.split(command))


@pytest.mark.parametrize("page", pages_with("sh"))
def test_commands_are_what_a_shell_reads(page: str) -> None:
    run([tool("bash"), "-n", "-c", "\n".join(blocks(page, "sh"))])


@pytest.mark.parametrize(
    "page",
    [
        pytest.param("docs/howto/actuators.md", marks=pytest.mark.slow),
        "docs/howto/latex.md",
        pytest.param("docs/howto/verification.md", marks=pytest.mark.slow),
    ],
)
def test_commands_print_what_is_shown(page: str, tmp_path: Path) -> None:
    """Line by line, but for what is left out (…), and for times and errors, which vary."""
    copytree(ROOT / "generated", tmp_path / "generated")
    write_files(page, tmp_path)
    for block in blocks(page, "console"):
        command, *shown = block.removeprefix("$ gibbs-codegen ").splitlines()
        done = run_command(*command.split(), cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        printed = [without_measurements(line) for line in done.stdout.splitlines()]
        for line in shown:
            end = without_measurements(line).removeprefix("…")
            found = [text for text in printed if text.endswith(end)]
            assert line.startswith("…") or end in found, line
            assert found, line


def without_measurements(line: str) -> str:
    """A line of output without times and without errors, which are numbers like 1.6e-16 or 0."""
    return re.sub(r"in \d+\.\d s|, \d+ s$|( +(\d\.\de-\d\d|0)\b)+", "", line.rstrip())


def test_every_emitted_function_is_listed() -> None:
    robot = load(ROOT / "generated" / "hexarotor_3link")
    names = [name for name in dir(robot) if name.islower() and callable(getattr(robot, name))]
    assert len(names) > 16
    for name in names:
        assert re.search(rf"[`.]{name}\(", PAGES[MODULE_PAGE]), name
    for row in FUNCTIONS.values():
        derivative = row.group in DERIVATIVE_GROUPS
        page = "docs/reference/derivatives.md" if derivative else MODULE_PAGE
        assert f"`{row.name}(" in PAGES[page], row.name


@pytest.mark.slow
@pytest.mark.parametrize("page", API_PAGES)
def test_examples_of_functions_give_what_is_shown(
    page: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    text = "\n".join(blocks(page, "{eval-rst}"))
    examples = doctest.DocTestParser().get_doctest(text, {}, page, page, 0)
    assert examples.examples
    assert doctest.DocTestRunner().run(examples).failed == 0


def test_every_name_that_is_imported_has_an_entry_with_an_example() -> None:
    text = "\n".join(PAGES[page] for page in API_PAGES)
    described = re.findall(r"^\.\. auto(\w+):: (\w+)$", text, re.MULTILINE)
    errors = re.findall(r"^\.\. autoexception:: (\w+)$", PAGES["docs/reference/errors.md"], re.M)
    names = [name for _, name in described]
    assert sorted([*names, *errors, "__version__"]) == sorted(gibbs_codegen.__all__)
    for kind, name in described:
        entry, _, _ = text.partition(f":: {name}\n")[2].partition("\n.. auto")
        assert ">>>" in entry or kind == "exception" or name in WITHOUT_EXAMPLE, name


def test_pages_that_are_run_elsewhere_have_their_tests() -> None:
    for page, tests in RUN_ELSEWHERE.items():
        assert f'run_python("{page}"' in (ROOT / tests).read_text(encoding="utf-8")


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page: str) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", PAGES[page]):
        if target.startswith("https://"):
            continue
        path, _, anchor = target.partition("#")
        to = (ROOT / page).parent / path if path else ROOT / page
        assert to.exists(), target
        if anchor:
            text = to.read_text(encoding="utf-8")
            if to.suffix == ".ipynb":
                text = "\n\n".join("".join(cell["source"]) for cell in json.loads(text)["cells"])
            headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
            assert anchor in {re.sub(r"[^\w -]", "", h).lower().replace(" ", "-") for h in headings}


@pytest.mark.parametrize("page", PAGES)
def test_files_that_are_named_exist(page: str) -> None:
    for path in re.findall(r"\b((?:tests|gibbs_codegen|templates|\.ci)/[\w./]*\w/?)", PAGES[page]):
        assert (ROOT / path).exists() or path in files_of(page), path


@pytest.mark.parametrize("page", sorted({p for p in PAGES if "docs/" in p} - {"docs/index.md"}))
def test_every_page_is_listed_in_the_index_of_its_room(page: str) -> None:
    index = page.rpartition("/")[0] + "/index.md"
    above = index if index in PAGES and index != page else "docs/index.md"
    assert f"({relpath(page, Path(above).parent)})" in PAGES[above]


def test_the_readme_is_short() -> None:
    assert len(PAGES["README.md"].splitlines()) <= 150


def test_the_readme_has_the_address_of_the_site_or_says_that_there_is_none() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    words = project.get("urls", {}).get("Documentation", "It has no public address yet")
    assert words in " ".join(PAGES["README.md"].split())
