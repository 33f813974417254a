"""The same robot file always gives the same bytes, wherever and however it is generated.

`.ci/matrix` does the same over versions of Python and of what the generator stands on.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from conftest import ROOT
from support.tools import missing, tool

DIGESTS = str(ROOT / "tests" / "support" / "digests.py")


@dataclass(frozen=True)
class Surroundings:
    """Where a process runs: variables, flags of the interpreter, one core or all of them."""

    seed: str
    variables: dict[str, str] = field(default_factory=dict)
    flags: tuple[str, ...] = ()
    cores: int = 0

    def digests(self, emitting: Sequence[str], folder: Path) -> list[str]:
        """What the commands emit when they run, last one first, in `folder` with these."""
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONHASHSEED": self.seed}
        pinned = [tool("taskset"), "--cpu-list", "0"] if self.cores == 1 else []
        done = subprocess.run(
            [*pinned, sys.executable, *self.flags, DIGESTS, *emitting],
            cwd=folder,
            env=environment | self.variables,
            capture_output=True,
            text=True,
            encoding="utf-8",
        )
        assert done.returncode == 0, done.stderr
        return sorted(done.stdout.splitlines())


@pytest.fixture
def locales(tmp_path: Path) -> Path:
    """Folder of locales whose case rules, decimal comma and encoding differ from Python's own."""
    folder = tmp_path / "locales"
    folder.mkdir()
    for name, encoding in (("tr_TR", "UTF-8"), ("tr_TR", "ISO-8859-9"), ("de_DE", "UTF-8")):
        made = folder / f"{name}.{encoding}"
        command = [tool("localedef"), "-i", name, "-f", encoding, str(made)]
        if subprocess.run(command, capture_output=True).returncode > 1:
            missing(f"localedef makes no {name} (Debian: package locales)")
    return folder


@pytest.mark.slow
def test_bytes_do_not_depend_on_seed_encoding_time_zone_place_or_flags(tmp_path: Path) -> None:
    emitting = ["generate quadrotor_2link", "generate hexarotor"]
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    plain = Surroundings("0").digests(emitting, ROOT)
    assert len({line.split()[0] for line in plain}) == 2
    far = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "TZ": "Asia/Kolkata"}
    other = Surroundings("random", far, flags=("-OO",), cores=1)
    assert other.digests(emitting[::-1], elsewhere) == plain
