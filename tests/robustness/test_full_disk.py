"""A disk that fills up: a message, exit code 1, and nothing half-written."""

from __future__ import annotations

from pathlib import Path

import pytest
from conftest import ROOT
from support.small_disk import on_small_disk
from support.tools import tool

MODULE = ROOT / "generated" / "hexarotor_3link"
GENERATE = '"$PYTHON" -m gibbs_codegen generate hexarotor --target numpy --out disk/generated'


# The module takes some 60 KiB.
@pytest.mark.slow
def test_no_module_rather_than_half_of_one(tmp_path: Path) -> None:
    done = on_small_disk(tmp_path, 4, GENERATE)
    assert done.code == 1
    assert "disk/generated/hexarotor: cannot be written: No space left on device" in done.error
    assert "Traceback" not in done.error
    assert done.left == []


@pytest.mark.slow
def test_the_module_that_was_there_stays(tmp_path: Path) -> None:
    script = f"""
        {GENERATE} && cp -r disk/generated kept && ! cp /dev/zero disk/filler 2> said &&
        ! {GENERATE} --all-parameters && diff -r kept disk/generated &&
        rm disk/filler && {GENERATE} --all-parameters && ! diff -r kept disk/generated > said"""
    done = on_small_disk(tmp_path, 400, script)
    assert done.code == 0, done.error
    assert "cannot be written: No space left on device; nothing was changed" in done.error
    folder = "./generated/hexarotor"
    files = [
        f"{folder}/{name}" for name in ("MANIFEST", "__init__.py", "numpy_module.py", "robot.toml")
    ]
    assert done.left == ["./generated", folder, *files]


LOAD = f"""
import os, sys
import numpy as np
from gibbs_codegen import load
small = load({str(MODULE)!r}, backend="c")
print(small.__file__.endswith(".py"), small.mass_matrix(np.zeros(9)).shape)
left = [name for name in os.listdir("disk/cache") if not name.endswith(".lock")]
print(left, flush=True)
assert os.system("mount -o remount,size=50m disk") == 0
large = load({str(MODULE)!r}, backend="c")
print(large.__file__.endswith(".so"), np.allclose(*(
    m.mass_matrix(np.ones(9)) for m in (small, large))))
"""


@pytest.mark.slow
def test_numpy_serves_until_there_is_room(tmp_path: Path) -> None:
    """There is no room for the source, or for the library."""
    tool("cc")
    cache = str(tmp_path / "disk" / "cache")
    script = f"cat > load.py << 'END'\n{LOAD}\nEND\n\"$PYTHON\" load.py"
    done = on_small_disk(tmp_path, 100, script, GIBBS_CODEGEN_CACHE=cache, CC="cc -O0")
    assert done.code == 0, done.error
    assert done.out.splitlines() == ["True (9, 9)", "[]", "True True"]
    # A slow machine also says that it compiles.
    said = [line for line in done.error.splitlines() if "compiling" not in line]
    assert len(said) == 1
    assert said[0].startswith("hexarotor_3link: runs in NumPy instead of C: ")
    assert "No space left on device" in said[0]


@pytest.mark.slow
def test_a_sweep_says_what_a_full_disk_says(tmp_path: Path) -> None:
    script = """cat > fill.py << 'END'
from gibbs_codegen.flight.sweeps.chunks import ResultFile
from pathlib import Path
digests = [str(number) for number in range(5000)]
try:
    ResultFile(Path("disk"), ()).add(digests, [([0.0, 0.0], *["a" * 9] * 3)] * 5000)
except Exception as error:
    print(error)
END
"$PYTHON" fill.py"""
    done = on_small_disk(tmp_path, 100, script)
    assert done.out == (
        "disk: cannot be written: No space left on device; finished flights are kept; repeat the "
        "call to continue\n"
    )
