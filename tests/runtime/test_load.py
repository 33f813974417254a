"""Loading generated modules by path and by name."""

from __future__ import annotations

import importlib.util
import pydoc
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from support.command import ENVIRONMENT
from support.tools import missing, tool

from gibbs_codegen import load, verify
from gibbs_codegen.cli.robot_argument import find_robot
from gibbs_codegen.errors import UsageError
from gibbs_codegen.pipeline import generate
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.runtime.load import find_module


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("load")
    generate("hexarotor", root / "generated", verify=False)
    return root


def test_by_path_and_by_name(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    before = list(sys.path)
    by_name, by_path = load("hexarotor"), load(folder / "generated" / "hexarotor")
    assert by_name.NAME == by_path.NAME == "hexarotor"
    assert by_name.mass_matrix([0.0] * 6).shape == (6, 6)
    assert sys.path == before


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_help_begins_with_the_robot_and_what_it_takes(folder: Path, backend: str) -> None:
    if backend == "c":
        tool("cc")
    module = load(folder / "generated" / "hexarotor", backend)
    shown = pydoc.plain(pydoc.render_doc(module))
    assert "NAME\n    hexarotor - Dynamics M a = R + B u of hexarotor." in shown
    assert "theta_m1  [rad]  first attitude angle" in shown
    assert shown.index("Inputs u, in order:") < shown.index("forward_dynamics")
    assert repr(module).startswith("<module 'hexarotor' from")


@pytest.mark.slow
def test_a_module_that_changed_is_loaded_anew(folder: Path) -> None:
    path = folder / "generated" / "hexarotor"
    assert load(path).PARAMETERS["gravity"] == 9.81
    heavier = folder / "heavier.toml"
    heavier.write_text(read_robot("hexarotor")[1].replace("9.81", "24.79"))
    assert generate(heavier, str(folder / "generated"), verify=False) == path
    assert load(path).PARAMETERS["gravity"] == 24.79


def test_a_module_of_an_older_version_is_refused(folder: Path, tmp_path: Path) -> None:
    old = tmp_path / "hexarotor"
    shutil.copytree(folder / "generated" / "hexarotor", old)
    text = (old / "__init__.py").read_text(encoding="utf-8")
    (old / "__init__.py").write_text(text.replace("HYBRID_COORDINATES", "prepare"), "utf-8")
    with pytest.raises(UsageError, match="no HYBRID_COORDINATES, so it was made by an old"):
        load(old)


def test_half_a_module_is_none(tmp_path: Path) -> None:
    (tmp_path / "numpy_module.py").write_text("")
    with pytest.raises(UsageError, match="no generated module"):
        load(tmp_path)


def test_what_is_not_there_is_refused_with_the_command_that_makes_it() -> None:
    with pytest.raises(UsageError, match="gibbs-codegen generate nowhere"):
        load("nowhere")
    with pytest.raises(UsageError, match="known: numpy, c, casadi, jax, torch"):
        load("nowhere", backend="fortran")


@pytest.mark.parametrize("backend", ["casadi", "jax", "torch"])
def test_a_library_that_is_missing_is_named_with_its_extra(
    backend: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, f"gibbs_codegen.runtime.{backend}_backend", raising=False)
    for name in [n for n in sys.modules if n.partition(".")[0] == backend]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [_Without(backend), *sys.meta_path])
    said = rf"{backend} is not installed; .* gibbs_codegen with its extra {backend}"
    with pytest.raises(UsageError, match=said):
        load(folder / "generated" / "hexarotor", backend=backend)


class _Without:
    """Finds that a package is not installed."""

    def __init__(self, package: str) -> None:
        self.package = package

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:
        if name == self.package:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


@pytest.mark.slow
def test_no_other_library_is_imported_until_its_back_end_is_loaded(folder: Path) -> None:
    code = (
        "import sys, gibbs_codegen, gibbs_codegen.cli.app\n"
        "for name in gibbs_codegen.__all__:\n    getattr(gibbs_codegen, name)\n"
        "gibbs_codegen.load('hexarotor')\n"
        "assert not {'casadi', 'jax', 'torch'} & set(sys.modules)\n"
        "gibbs_codegen.load('hexarotor', backend='casadi')\n"
        "assert 'jax' not in sys.modules"
    )
    if importlib.util.find_spec("casadi") is None:
        missing("casadi is not installed")
    done = subprocess.run(
        [sys.executable, "-c", code], env=ENVIRONMENT, cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_a_module_that_is_only_c_is_refused_with_what_it_lacks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = generate("hexarotor", tmp_path / "generated", targets=("c",), verify=False)
    monkeypatch.chdir(tmp_path)
    for name in ("hexarotor", folder):
        with pytest.raises(
            UsageError, match=r"hexarotor: lacks __init__.py, numpy_.* --target c --target numpy$"
        ):
            load(name, backend="numpy")


@pytest.mark.slow
def test_a_robot_that_ships_is_generated_once_into_the_cache(
    tmp_path: Path, small: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The module is the one that the command makes; one in generated/, or what is left, wins."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GIBBS_CODEGEN_CACHE", str(tmp_path / "cache"))
    commands = []

    def generated(command: list[str], **_: object) -> subprocess.CompletedProcess[bytes]:
        commands.append(command[1:-1])
        shutil.copytree(small, Path(command[-1]) / small.name)
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(subprocess, "run", generated)
    assert load(small.name).NAME == load(small.name, "c").NAME == small.name
    assert verify(small.name, states=1, backends=["numpy"]).passed
    assert commands == [["-m", "gibbs_codegen", "generate", small.name, "--out"]]
    assert [line.split("; ")[1] for line in caplog.messages] == ["generating one into the cache"]
    kept = find_module(Path(small.name))
    (kept / "numpy_module.py").write_text("")
    assert find_module(Path(small.name)) == kept
    assert (kept / "numpy_module.py").stat().st_size
    (tmp_path / "generated" / small.name).mkdir(parents=True)
    with pytest.raises(UsageError, match=f"no generated module there.*generate {small.name}$"):
        load(small.name)
    shutil.copytree(small, tmp_path / "generated" / small.name, dirs_exist_ok=True)
    assert find_module(Path(small.name)).parent == tmp_path / "generated"


def test_a_robot_that_cannot_be_cached_is_refused_with_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    monkeypatch.setenv("GIBBS_CODEGEN_CACHE", str(tmp_path / "file"))
    with pytest.raises(
        UsageError, match=r"into the cache: .*exists; .*: gibbs-codegen generate qu"
    ):
        load("quadrotor")


def test_what_was_meant_is_suggested(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "inspector.toml").touch()
    with pytest.raises(
        UsageError, match="this is a robot file, not a module; run gibbs-codegen generate"
    ):
        load("inspector.toml")
    folder = tmp_path / "generated" / "inspector"
    folder.mkdir(parents=True)
    (folder / "robot.toml").touch()
    for meant, word in (("inspector", "inspectr"), ("hexarotor_3link", "hexarotr_3link")):
        with pytest.raises(UsageError, match=rf"generated module there.*; did you mean {meant}\?$"):
            load(word)
    for meant, word in (("inspector", "inspctor"), ("inspector.toml", "inspctor.toml")):
        with pytest.raises(UsageError, match=rf"; did you mean {meant}\?$"):
            find_robot(word)


def test_a_name_means_its_module_and_another_file_beside_is_told_of_once(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Those that derive, those that fly, and pages read the same robot."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(small, tmp_path / "generated" / small.name)
    text = (small / "robot.toml").read_text("utf-8")
    beside = tmp_path / f"{small.name}.toml"
    beside.write_text(text, "utf-8")
    assert find_robot(small.name)[1] == text
    assert caplog.messages == []
    edited = text + "\n# Edited.\n"
    beside.write_text(edited, "utf-8")
    assert small.name == load(small.name).NAME
    assert find_robot(small.name)[1] == text
    told = f"{small.name}.toml differs from the file that {Path('generated') / small.name} was made"
    assert [line.partition(" of: ")[0] for line in caplog.messages] == [told]
    assert find_robot(beside.name)[1] == edited
