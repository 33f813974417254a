"""What tests derive is kept between runs, for as long as nothing that it was made of changes."""

from __future__ import annotations

import hashlib
import importlib.metadata
import os
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path

from filelock import FileLock

_TESTS = Path(__file__).parents[1]
_PACKAGE = _TESTS.parent / "gibbs_codegen"
# Rooms that fly, draw, check or tell what a module holds, and have no part in making it.
_APART = {"cli", "exchange", "figures", "flight", "identification", "verification"}
_ROBOTS = (
    *("tests/support/compiled.py", "tests/support/random_robots.py"),
    *("tests/support/actuated.py", "tests/support/on_request.py"),
    "benchmarks/family.py",
)


def generator_digest() -> str:
    """A digest of what emitted bytes depend on: sources, templates, robots of tests, libraries."""
    sources = [p for p in _PACKAGE.rglob("*") if p.relative_to(_PACKAGE).parts[0] not in _APART]
    sources += [*(_TESTS.parent / "templates").iterdir(), *map(_TESTS.parent.joinpath, _ROBOTS)]
    digest = hashlib.sha256(sys.version.encode())
    for library in ("jinja2", "numpy", "pydantic", "sympy"):
        digest.update(f"{library} {importlib.metadata.version(library)}".encode())
    for path in sorted(sources):
        if path.is_file() and "__pycache__" not in path.parts and path.suffix != ".so":
            digest.update(f"{path.relative_to(_TESTS.parent)}\n".encode() + path.read_bytes())
    return digest.hexdigest()[:16]


KEPT_MODULES = "TESTS_KEEP_MODULES_IN"


def kept_folder(*of: object) -> Path:
    """The folder of what the generator makes of these, which their representations tell apart."""
    digest = hashlib.sha256(repr(of).encode()).hexdigest()[:24]
    return Path(os.environ[KEPT_MODULES]) / digest


def forget_unused(folder: Path, days: int = 14) -> None:
    """Remove the entries of a folder that have not been touched for some days."""
    for entry in folder.glob("*"):
        if time.time() - entry.stat().st_mtime > 86400 * days:
            entry.unlink() if entry.is_file() else shutil.rmtree(entry, ignore_errors=True)


def made_once(folder: Path, make: Callable[[], object]) -> Path:
    """A folder that the first process that wants it makes, while the others wait."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    whole = folder.with_name(f"{folder.name}.whole")
    with FileLock(f"{folder}.lock"):
        if not whole.exists():
            shutil.rmtree(folder, ignore_errors=True)  # A run that was ended has left a part.
            make()
            whole.touch()
    return folder
