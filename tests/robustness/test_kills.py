"""Processes that are killed outright leave nothing half-done, and whoever comes next can work."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT
from support.tools import HANGING

SEED = 17
MODULE = ROOT / "generated" / "hexarotor_3link"


def program(code: str, folder: Path) -> list[str]:
    """What a program prints, line by line; it finds the modules of the tests."""
    paths = os.pathsep.join([str(ROOT), str(ROOT / "tests")])
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
        timeout=HANGING,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


WRITING = """
import os, shutil
from pathlib import Path
from support.outright import killed_at_every_step
from gibbs_codegen.version import HEADER_START
from gibbs_codegen.files.module_writer import differing_files, write_module

head = f"# {HEADER_START}\\n"
old = {"__init__.py": head, "numpy_module.py": head + "x = 1\\n"}
new = {"__init__.py": head, "numpy_module.py": head + "x = 2\\n", "more.c": head}
out = Path("out")
for begin in (None, old):
    seen = set()
    for step in killed_at_every_step(lambda: write_module(out / "robot", new)):
        hidden = [p for p in out.glob(".*")] if out.exists() else []
        assert len(hidden) <= 1
        assert {p.name for p in out.glob("*") if p not in hidden} <= {"robot"}
        if not (out / "robot").exists():
            seen.add("none")
            # Between two renames what was there is in the hidden folder, whole.
            assert begin is None or differing_files(hidden[0] / "robot", old) == []
        elif differing_files(out / "robot", new) == []:
            seen.add("new")
        else:
            assert differing_files(out / "robot", old) == []
            seen.add("old")
        for path in hidden:
            os.utime(path, (0, 0))
        write_module(out / "robot", new)
        assert os.listdir(out) == ["robot"]
        assert differing_files(out / "robot", new) == []
        shutil.rmtree(out)
        if begin:
            write_module(out / "robot", begin)
    print(step, sorted(seen))
    shutil.rmtree(out)
    write_module(out / "robot", old)
"""


@pytest.mark.slow
def test_a_kill_at_any_step_of_writing_leaves_a_whole_module(tmp_path: Path) -> None:
    fresh, replaced = (line.split(maxsplit=1) for line in program(WRITING, tmp_path))
    assert min(int(fresh[0]), int(replaced[0])) > 10
    assert fresh[1] == "['new', 'none']"
    assert replaced[1] == "['new', 'none', 'old']"


CACHING = """
import hashlib, os, shutil
from pathlib import Path
from support.outright import killed_at_every_step
from gibbs_codegen.runtime.cache import cached_library

def make(output):
    output.write_bytes(b"library")

folder = Path(os.environ["GIBBS_CODEGEN_CACHE"])
for spoiled in (False, True):
    seen = set()
    for step in killed_at_every_step(lambda: cached_library("key", make)):
        for entry in (p for p in folder.glob("*") if p.is_dir() and p.name[0] != "."):
            content = (entry / "library.so").read_bytes()
            seen.add(content)
            digest = hashlib.sha256(content).hexdigest() == (entry / "sha256").read_text()
            assert digest == (content == b"library")
        path = cached_library("key", make)
        assert path.read_bytes() == b"library"
        shutil.rmtree(folder)
        if spoiled:
            cached_library("key", make).write_bytes(b"spoiled")
    print(step, sorted(seen))
    cached_library("key", make).write_bytes(b"spoiled")
"""


@pytest.mark.slow
def test_a_kill_at_any_step_of_filling_the_cache_leaves_a_whole_entry(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GIBBS_CODEGEN_CACHE", str(tmp_path / "cache"))
    fresh, replaced = (line.split(maxsplit=1) for line in program(CACHING, tmp_path))
    assert min(int(fresh[0]), int(replaced[0])) > 10
    assert fresh[1] == "[b'library']"
    assert replaced[1] == "[b'library', b'spoiled']"


GENERATING = """
import os, shutil
from pathlib import Path
from support.outright import killed_at_random
from gibbs_codegen import generate

def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}

def make(folder):
    return generate("hexarotor", folder, ["numpy"], verify=False)

right = files(make("right"))
out = Path("out")
killed = 0
for at_work in killed_at_random(lambda: make(out), COUNT, SEED):
    killed += at_work
    visible = [path for path in out.glob("*") if path.name[0] != "."]
    assert visible in ([], [out / "hexarotor"])
    for module in visible:
        assert files(module) == right
        shutil.rmtree(module)
print(killed)
for left in out.glob(".*"):
    assert left.name.startswith(".gibbs_codegen_")
    os.utime(left, (0, 0))
make(out)
assert os.listdir(out) == ["hexarotor"]
"""
KILLS = 50


LOADING = """
import hashlib, os, shutil
from pathlib import Path
import numpy as np
from support.outright import killed_at_random
from gibbs_codegen import generate, load

# The smallest there is, to spend the time on kills.
folder = generate("hexarotor", "modules", verify=False)
cache = Path(os.environ["GIBBS_CODEGEN_CACHE"])
killed = 0
for at_work in killed_at_random(lambda: load(folder, backend="c"), COUNT, SEED):
    killed += at_work
    for entry in (path for path in cache.glob("*") if path.is_dir() and path.name[0] != "."):
        digest = hashlib.sha256((entry / "library.so").read_bytes()).hexdigest()
        assert (entry / "sha256").read_text() == digest
        shutil.rmtree(entry)
print(killed)
module = load(folder, backend="c")
assert Path(module.__file__).is_relative_to(cache)
q = np.linspace(0.0, 1.0, 6)
assert np.allclose(module.mass_matrix(q), load(folder).mass_matrix(q), rtol=0, atol=1e-12)
"""


LOAD = f"from gibbs_codegen import load; load({str(MODULE)!r}, backend='c')"
GENERATING_AT_ONCE = """
import multiprocessing, os
from gibbs_codegen import generate

context = multiprocessing.get_context("fork")
start = context.Barrier(16)

def work(_):
    start.wait()
    return str(generate("hexarotor", "out", verify=False))

generate("hexarotor", "right", verify=False)
with context.Pool(16) as pool:
    assert set(pool.map(work, range(16), chunksize=1)) == {os.path.join("out", "hexarotor")}
assert os.listdir("out") == ["hexarotor"]
assert os.system("diff -r -x __pycache__ out right") == 0
"""
