"""Compiling the peers, and saying what is missing where that fails."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path

SOURCES = Path(__file__).parent
FLAGS = ("-O3", "-march=native", "-DNDEBUG", "-fPIC", "-shared", "-fvisibility=hidden")


class BuildError(RuntimeError):
    """A peer that cannot be built here, and what would mend it."""


def package_folder(name: str, distribution: str) -> Path:
    """Folder of an installed Python package, which is not imported."""
    found = find_spec(name)
    if found is None or not found.submodule_search_locations:
        raise BuildError(f"the Python package {name} is missing: pip install {distribution}")
    return Path(found.submodule_search_locations[0])


def required(path: Path, what: str) -> Path:
    """The path, or an error that says `what` is missing."""
    if not path.exists():
        raise BuildError(f"{path} is missing: {what}")
    return path


def compiled(source: str, library: Path, arguments: Iterable[str | Path] = ()) -> Path:
    """Compile a source file of this folder into a library; one already there is taken as it is."""
    if library.exists():
        return library
    compiler = "gcc" if source.endswith(".c") else "g++"
    if shutil.which(compiler) is None:
        raise BuildError(f"{compiler} is not on the path: install gcc and g++")
    draft = library.with_suffix(".draft")
    command = [compiler, *FLAGS, str(SOURCES / source), "-o", str(draft), *map(str, arguments)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    if ran.returncode:
        errors = [line for line in ran.stderr.splitlines() if "error" in line] or [ran.stderr]
        raise BuildError("\n".join([" ".join(command), *errors[:5]]))
    return draft.rename(library)


def function(library: ctypes.CDLL, name: str, pointers: int = 5) -> ctypes._CFuncPtr:
    """A function of a library that takes pointers and returns nothing."""
    found = library[name]
    found.argtypes, found.restype = [ctypes.c_void_p] * pointers, None
    return found


def own_copy(library: Path, copy: Path) -> ctypes.CDLL:
    """A copy of the library, loaded by itself: the model it holds is then its own."""
    if not copy.exists():
        shutil.copy(library, copy)
    return ctypes.CDLL(str(copy))
