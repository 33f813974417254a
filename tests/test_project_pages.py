"""The projects that pages show are made from nothing, built and run, command by command."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from shutil import copytree

import pytest
from conftest import ROOT
from support.pages import PAGES, blocks, run_python, write_files
from support.tools import run, tool

from gibbs_codegen import generate

CMAKE = "docs/howto/cmake.md"
EIGEN = "docs/howto/eigen.md"
LOOP = "docs/howto/c-and-firmware.md"
PREDICTIVE = "docs/howto/predictive-c.md"
MODULE = "hexarotor_3link"


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
    flags = dict.fromkeys(("CFLAGS", "CXXFLAGS"), "-O0 -Wall -Wextra -Werror")
    return run(["sh", "-ec", script], CMAKE_BUILD_TYPE="Plain", **flags)


def with_quaternion(folder: Path, *files: str) -> None:
    """Turn a page's project into one of a robot with a quaternion, as the page says to do it."""
    text = (ROOT / "gibbs_codegen" / "robots" / "hexarotor.toml").read_text(encoding="utf-8")
    text = text.replace('"hexarotor"', '"turning"').replace('"xyz"', '"quaternion"')
    (folder / "turning.toml").write_text(text, encoding="utf-8")
    generate(folder / "turning.toml", folder / "generated", laws=["computed_torque"], verify=False)
    for file in files:
        text = (folder / file).read_text(encoding="utf-8")
        text = re.sub(r"wanted\[HEX.*", "wanted[TURNING_Q_QW] = 1;", text)
        text = text.replace(MODULE, "turning").replace(MODULE.upper(), "TURNING")
        (folder / file).write_text(text, encoding="utf-8")


def errors(said: str) -> list[float]:
    """The errors that a program prints, each at the end of a line."""
    return [float(line.split()[-1]) for line in said.splitlines() if "error" in line]


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
def test_the_control_loop_in_c_holds_the_robot(tmp_path: Path) -> None:
    assert write_files(LOOP, tmp_path) == ["control.c"]
    generate(MODULE, tmp_path / "generated", laws=["computed_torque"], verify=False)
    commands = blocks(LOOP, "sh")[-1]
    flags = "-std=c99 -O0 -Wall -Wextra -Wdouble-promotion -Werror"
    commands = commands.replace("-O2", flags)
    start, end = (line.split()[-1] for line in printed(commands, tmp_path).splitlines())
    assert f"an error of {start} at the start and of `{end}` after 5 s" in PAGES[LOOP]
    single = commands.replace("cc ", f"cc -D{MODULE.upper()}_FLOAT ")
    assert errors(printed(single, tmp_path))[1] == pytest.approx(2e-5, rel=0.5)
    with_quaternion(tmp_path, "control.c")
    start, end = errors(printed(commands.replace(MODULE, "turning"), tmp_path))
    assert start > 0.4
    assert end < 1e-5


@pytest.mark.slow
def test_the_predictive_controller_in_c_flies(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert write_files(PREDICTIVE, tmp_path) == ["write.py", "main.c", "CMakeLists.txt"]
    monkeypatch.chdir(tmp_path)
    run_python("docs/howto/predictive-c.md")
    _, *commands = blocks(PREDICTIVE, "sh")[0].splitlines(keepends=True)
    plans, _ = printed("".join(commands), tmp_path).splitlines()[-2:]
    assert plans == "400 of 400 plans found, tip within 0.02 mm"
    assert "400 plans were found and that the tip, once" in PAGES[PREDICTIVE]


@pytest.mark.slow
def test_the_controller_in_cpp_flies(tmp_path: Path) -> None:
    assert project(EIGEN, tmp_path) == ["robot.hpp", "main.cpp", "CMakeLists.txt"]
    said = printed(blocks(EIGEN, "sh")[1], tmp_path).splitlines()[-1]
    assert said.startswith("after 5 s")
    assert f"`{said}`" in PAGES[EIGEN]
