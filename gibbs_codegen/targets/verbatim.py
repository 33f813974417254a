"""The files of `gibbs_codegen.emitted` as text: source that a module contains whole."""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass
from pathlib import Path

_FOLDER = Path(__file__).parent.parent / "emitted"
_INCLUDE = re.compile(r'^#include "(\w+\.\w)"\n', re.MULTILINE)


@dataclass(frozen=True)
class PythonSource:
    """A Python file without its docstring: its imports, and what follows them."""

    imports: str
    body: str


def python_source(name: str) -> PythonSource:
    """A Python file of the folder.

    Args:
        name: of the file

    Returns:
        Its parts.
    """
    text = _text(name)
    imports = [n for n in ast.parse(text).body if isinstance(n, ast.Import | ast.ImportFrom)]
    first, last = imports[0].lineno - 1, imports[-1].end_lineno
    lines = text.splitlines()
    return PythonSource("\n".join(lines[first:last]), "\n".join(lines[last:]).strip())


def c_source(name: str) -> str:
    """A C file of the folder, with the files of the folder that it includes in their places.

    Args:
        name: of the file

    Returns:
        Its text.
    """
    return _INCLUDE.sub(lambda match: c_source(match[1]), _text(name))


def _text(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")
