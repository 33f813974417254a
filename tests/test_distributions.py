"""The sdist and the wheels of the last commit: what is in them, and the same bytes every time."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest
from conftest import ROOT
from support.tools import missing, run, tool

from gibbs_codegen.version import __version__

pytestmark = pytest.mark.slow

STEM = f"gibbs_codegen-{__version__}"
WHEEL = f"{STEM}-py3-none-any.whl"
SDIST = f"{STEM}.tar.gz"

# Where Python has no headers: the file that the type of a compiled function comes from.
CALLS = """
import sys, sysconfig
sysconfig.get_path = lambda _: "/nowhere"
import numpy, gibbs_codegen
function = gibbs_codegen.load(sys.argv[1], backend="c").mass_matrix
q = numpy.linspace(-1, 1, 9)
assert (function(q) == function.__wrapped__(q)).all()
print(sys.modules[type(function).__module__].__file__)
"""
# All of a wheel but the modules, which are those of the layers.
DATA = """
    py.typed
    emitted/acados.c emitted/adaptive.c emitted/allocation.c emitted/arctangent.c
    emitted/blocks.c emitted/constants.c
    emitted/curves.c emitted/device.c emitted/device_rows.c
    emitted/engine.c emitted/exactness.c emitted/fixed.c emitted/flight.c
    emitted/flow.c emitted/fmi_both.c emitted/fmi2.c
    emitted/fmi3.c emitted/fmu.c emitted/gather.c emitted/horizon.c
    emitted/lanes.c emitted/literals.c emitted/numbers.c emitted/platform.c
    emitted/predictive.c emitted/rollout.c
    emitted/ranges.c emitted/rows.c emitted/runtime.c
    emitted/smallest_thrusts.c
    emitted/sine_cosine.c emitted/sine_cosine_kernel.c emitted/sine_cosine_numbers.c
    emitted/sine_cosine_series.c
    emitted/matlab/changed_parameters.m emitted/matlab/check_constants.m
    emitted/matlab/product.m emitted/matlab/states.m
    runtime/native/arrays.h runtime/native/caller.c runtime/native/jax_call.c runtime/native/rows.c
    runtime/native/web/math.h runtime/native/web/string.h
    robots/__init__.py robots/cart_pole.toml robots/decarotor_3link.toml
    robots/delta_hexarotor.toml robots/dual_arm.toml robots/hexarotor.toml
    robots/hexarotor_3link.toml robots/hextilt_flying_arm_5.toml robots/hydrus.toml
    robots/LICENSES.txt robots/octorotor_7link.toml robots/panda.toml
    robots/planar_quadrotor_arm.toml robots/quadrotor.toml
    robots/quadrotor_2link.toml robots/quadrotor_arm_2link.toml robots/rover_arm.toml
    robots/ur5e.toml
    scenarios/circle.toml scenarios/delta.toml scenarios/drive.toml scenarios/flip.toml
    scenarios/hold.toml
    scenarios/hover.toml scenarios/inspection.toml scenarios/reach.toml
    scenarios/line.toml scenarios/paper.toml scenarios/push.toml
    templates/c_batch.c.jinja templates/c_each.c.jinja templates/c_header.h.jinja
    templates/c_places.h.jinja templates/cuda_header.cuh.jinja templates/cuda_source.cu.jinja
    templates/c_rollout.c.jinja templates/c_rollout.h.jinja templates/c_runtime.h.jinja
    templates/c_source.c.jinja templates/fmi2_model.xml.jinja templates/fmi3_build.xml.jinja
    templates/fmi3_model.xml.jinja templates/fly.html.jinja templates/fmu_source.c.jinja
    templates/matlab_constants.m.jinja
    templates/matlab_function.m.jinja templates/matlab_list.m.jinja
    templates/matlab_parameters.m.jinja templates/matlab_patterns.m.jinja
    templates/matlab_prepare.m.jinja templates/matlab_source.m.jinja
    templates/numpy_module.py.jinja
    templates/package_init.py.jinja templates/paper.html.jinja templates/paper.md.jinja
    templates/placed_robot.toml.jinja
    templates/robot.toml.jinja templates/web_module.mjs.jinja
"""
ABOUT = "METADATA RECORD WHEEL entry_points.txt top_level.txt licenses/LICENSE"
MADE_BY_SETUPTOOLS = """
    PKG-INFO setup.cfg gibbs_codegen.egg-info/PKG-INFO gibbs_codegen.egg-info/SOURCES.txt
    gibbs_codegen.egg-info/dependency_links.txt gibbs_codegen.egg-info/entry_points.txt
    gibbs_codegen.egg-info/requires.txt gibbs_codegen.egg-info/top_level.txt
"""


def python_with_pip() -> str:
    """An interpreter that has pip; an environment made as the README says has none."""
    for python in (sys.executable, shutil.which("python3") or sys.executable):
        if subprocess.run([python, "-m", "pip", "--version"], capture_output=True).returncode == 0:
            return python
    return str(missing("no python3 with pip"))


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the sdist and the wheels: CI's, or else built as a release builds them."""
    if folder := os.environ.get("GIBBS_CODEGEN_DISTRIBUTIONS"):
        return Path(folder)
    tool("git")
    if not (ROOT / ".git").exists():
        missing("not a checkout")
    out = tmp_path_factory.mktemp("dist")
    run([python_with_pip(), ROOT / ".ci" / "distributions.py", out])
    return out


def held(wheel: Path) -> set[str]:
    """Names of what is in a wheel."""
    with zipfile.ZipFile(wheel) as files:
        return set(files.namelist())


def test_a_wheel_holds_the_modules_and_their_data_and_nothing_else(built: Path) -> None:
    tracked = run(["git", "-C", ROOT, "ls-files", "gibbs_codegen/*.py"]).splitlines()
    modules = set(tracked)
    data = {f"gibbs_codegen/{name}" for name in DATA.split()}
    about = {f"{STEM}.dist-info/{name}" for name in ABOUT.split()}
    assert held(built / WHEEL) == modules | data | about


def test_the_wheel_with_the_extension_needs_no_headers(built: Path, tmp_path: Path) -> None:
    wheels = {path.name for path in built.glob("*.whl")} - {WHEEL}
    if not wheels:
        missing("a compiler and Python's headers, with which the extension is built")
    (name,) = wheels
    (extension,) = held(built / name) - held(built / WHEEL)
    assert extension.startswith("gibbs_codegen/runtime/_caller.")
    shutil.unpack_archive(built / name, tmp_path, "zip")
    program = [sys.executable, "-c", CALLS, str(ROOT / "generated" / "hexarotor_3link")]
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run(program, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == str(tmp_path / extension)


def test_an_sdist_holds_what_git_does_but_hidden_files(built: Path) -> None:
    tracked = run(["git", "-C", ROOT, "ls-tree", "-r", "--name-only", "HEAD"]).splitlines()
    shown = {name for name in tracked if not name.startswith(".")}
    with tarfile.open(built / SDIST) as sdist:
        members = sdist.getmembers()
    assert {(m.uid, m.gid, m.uname, m.gname) for m in members} == {(0, 0, "", "")}
    files = {member.name.removeprefix(f"{STEM}/") for member in members if member.isfile()}
    assert files == shown | set(MADE_BY_SETUPTOOLS.split())


def test_citation_and_changelog_name_this_version() -> None:
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {__version__}\n" in citation
    (date,) = re.findall(r"^date-released: (.+)$", citation, re.MULTILINE)
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"\n## [{__version__}] - {date}\n" in changes
