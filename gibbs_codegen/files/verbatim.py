"""The files of `gibbs_codegen.emitted` as text: source that a module contains whole."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

_FOLDER = Path(__file__).parent.parent / "emitted"
_IMPORT = re.compile(r"^(?:import|from) .*$", re.MULTILINE)
# In a module, names that files of the folder import from each other stand above them.
_PACKAGE = "from gibbs_codegen.emitted."
_INCLUDE = re.compile(r'^#include "([\w/]+\.\w)"\n', re.MULTILINE)


@dataclass(frozen=True)
class PythonSource:
    """Python files without their docstrings: their imports, and what follows them."""

    imports: str
    body: str


def python_source(*names: str) -> PythonSource:
    """Python files of the folder as one, each after those that it imports from."""
    lines: list[str] = []
    bodies = []
    for name in names:
        # Parsing it would compile text, which no command does.
        text = _text(name).partition('"""\n\n')[2]
        imports_found = [*_IMPORT.finditer(text)]
        lines += [match[0] for match in imports_found if _PACKAGE not in match[0]]
        bodies.append(text[imports_found[-1].end() :].strip())
    # In the order that linters want, those from one module, some of them twice, in one line.
    imported_names: dict[str, set[str]] = {}
    for line in lines:
        start, _, imported = line.partition(" import ")
        imported_names.setdefault(start, set()).update(imported.split(", "))
    groups: dict[str, list[str]] = {"__future__": [], "": [], "numpy": []}
    for start in sorted(imported_names, key=lambda start: (start.startswith("from"), start)):
        package = start.split()[1].partition(".")[0]
        imported = ", ".join(sorted(imported_names[start]))
        groups.get(package, groups[""]).append(f"{start} import {imported}" if imported else start)
    imports = "\n\n".join("\n".join(group) for group in groups.values())
    return PythonSource(imports, "\n\n\n".join(bodies))


def c_source(name: str) -> str:
    """A C file of the folder, with the files of the folder that it includes in their places."""
    return _INCLUDE.sub(lambda match: c_source(match[1]), _text(name))


def matlab_source(name: str) -> list[str]:
    """Lines of a file of the folder's functions in MATLAB."""
    return _text(f"matlab/{name}.m").splitlines()


def _text(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")
