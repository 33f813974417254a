"""The projects that pages show are made from nothing, built and run, command by command."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from shutil import copytree

import pytest
from conftest import ROOT
from support.pages import PAGES, blocks, run_python, write_files
from support.tools import run, tool

CMAKE = "docs/howto/cmake.md"
EIGEN = "docs/howto/eigen.md"
PREDICTIVE = "docs/howto/predictive-c.md"
MODULE = "hexarotor_3link"
WITHOUT_WARNINGS = "-O0 -Wall -Wextra -Werror"


def project(page: str, folder: Path) -> list[str]:
    """The files of a page in a folder, with the module that is generated there."""
    copytree(ROOT / "generated" / MODULE, folder / "generated" / MODULE)
    return write_files(page, folder)


def printed(commands: str, folder: Path) -> str:
    """What the commands of a block print, but for those of this package."""
    whole = commands.replace("\\\n", "").splitlines()
    lines = [line for line in whole if not line.startswith("gibbs-codegen ")]
    for line in lines:
        if not line.startswith("./"):
            tool(line.split()[0])
    script = "\n".join([f"cd '{folder}'", *lines])
    flags = dict.fromkeys(("CFLAGS", "CXXFLAGS"), WITHOUT_WARNINGS)
    return run(["sh", "-ec", script], CMAKE_BUILD_TYPE="Plain", **flags)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A project of the page on CMake."""
    files = ["CMakeLists.txt", "main.c", "generated.cmake", "cortex-m4f.cmake"]
    assert project(CMAKE, tmp_path) == [*files, "startup.c", "link.ld"]
    return tmp_path


@pytest.mark.slow
def test_the_program_runs_on_a_pc(folder: Path) -> None:
    _, commands, _ = blocks(CMAKE, "sh")
    said = printed(commands, folder).splitlines()[-1]
    assert said == "upward acceleration: 0.190 m/s^2"
    assert PAGES[CMAKE].count(f"`{said}`") == 2


@pytest.mark.slow
def test_the_same_program_runs_on_an_emulated_cortex_m(folder: Path) -> None:
    _, _, commands = blocks(CMAKE, "sh")
    said = printed(commands, folder).splitlines()[-1]
    assert said == "upward acceleration: 0.190 m/s^2"


@pytest.mark.slow
def test_the_build_generates_the_module_anew_when_the_robot_file_changes(folder: Path) -> None:
    listed = (folder / "CMakeLists.txt").read_text(encoding="utf-8")
    start, end = listed.index("set(MODULE"), listed.index("target_link_libraries(robot")
    made = listed[:start] + (folder / "generated.cmake").read_text("utf-8") + listed[end:]
    (folder / "CMakeLists.txt").write_text(made, encoding="utf-8")
    robot = folder / f"{MODULE}.toml"
    text = (ROOT / "gibbs_codegen" / "robots" / robot.name).read_text(encoding="utf-8")
    commands = blocks(CMAKE, "sh")[1]
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", path)
        for gravity, acceleration in (("9.81", "0.190"), ("1.62", "8.380")):
            robot.write_text(text.replace("9.81", gravity), encoding="utf-8")
            said = printed(commands, folder).splitlines()[-1]
            assert said == f"upward acceleration: {acceleration} m/s^2"
        robot.write_text(text.replace(f'"{MODULE}"', '"other"'), encoding="utf-8")
        with pytest.raises(pytest.fail.Exception, match=f"must have the name {MODULE}"):
            printed(commands, folder)


@pytest.mark.slow
def test_the_predictive_controller_in_c_flies(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert write_files(PREDICTIVE, tmp_path) == ["write.py", "main.c"]
    monkeypatch.chdir(tmp_path)
    run_python("docs/howto/predictive-c.md")
    _, *commands = blocks(PREDICTIVE, "sh")[0].splitlines(keepends=True)
    unoptimised = "".join(commands).replace("-O3", WITHOUT_WARNINGS)
    plans, _ = printed(unoptimised, tmp_path).splitlines()[-2:]
    assert plans == "400 of 400 plans found, tip within 0.02 mm"
    assert "400 plans were found and that the tip, once" in PAGES[PREDICTIVE]


@pytest.mark.slow
def test_the_controller_in_cpp_flies(tmp_path: Path) -> None:
    assert project(EIGEN, tmp_path) == ["robot.hpp", "main.cpp"]
    commands = blocks(EIGEN, "sh")[1].replace("-O2", WITHOUT_WARNINGS)
    said = printed(commands, tmp_path).splitlines()[-1]
    assert said.startswith("after 5 s")
    assert f"`{said}`" in PAGES[EIGEN]
