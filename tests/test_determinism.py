"""The same robot file always gives the same bytes."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

from conftest import ROOT


def digest(tmp_path: Path, **environment: str) -> str:
    """Digest of a module generated in a process of its own."""
    out = tmp_path / "-".join(environment.values()).replace("/", "_")
    subprocess.run(
        [sys.executable, "-m", "gibbs_codegen", "generate", "octorotor_7link", "--out", str(out)],
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        check=True,
        capture_output=True,
    )
    digest = hashlib.sha256()
    for path in sorted((out / "octorotor_7link").glob("*.*")):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()


def test_bytes_do_not_depend_on_hash_seed_encoding_or_time_zone(tmp_path: Path) -> None:
    digests = {digest(tmp_path, PYTHONHASHSEED=seed) for seed in ("0", "1", "42", "12345")}
    digests.add(digest(tmp_path, LC_ALL="C", PYTHONUTF8="0", TZ="Asia/Kolkata", PYTHONHASHSEED="7"))
    assert len(digests) == 1
