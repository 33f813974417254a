"""The files of `gibbs_codegen.emitted` as text: source that a module contains whole."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

_FOLDER = Path(__file__).parent.parent / "emitted"
_IMPORT = re.compile(r"^(?:import|from) .*$", re.MULTILINE)
_INCLUDE = re.compile(r'^#include "(\w+\.\w)"\n', re.MULTILINE)


@dataclass(frozen=True)
class PythonSource:
    """A Python file without its docstring: its imports, and what follows them."""

    imports: str
    body: str


def python_source(name: str) -> PythonSource:
    """A Python file of the folder.

    Args:
        name: Of the file.

    Returns:
        Its parts.
    """
    # Parsing it would compile text, which no command does.
    text = _text(name).partition('"""\n\n')[2]
    end = max(match.end() for match in _IMPORT.finditer(text))
    return PythonSource(text[:end], text[end:].strip())


def c_source(name: str) -> str:
    """A C file of the folder, with the files of the folder that it includes in their places.

    Args:
        name: Of the file.

    Returns:
        Its text.
    """
    return _INCLUDE.sub(lambda match: c_source(match[1]), _text(name))


def matlab_source(name: str) -> list[str]:
    """A file of the folder's functions in MATLAB.

    Args:
        name: Of the function.

    Returns:
        Its lines.
    """
    return _text(f"matlab/{name}.m").splitlines()


def _text(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")
