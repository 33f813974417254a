"""The command line with a watch on it: `python audited.py [--plant WHAT] ARGUMENTS…`.

Ends with exit code 99 at the first attempt to run text as code, whoever is asked to run it, unless
the text is a file that is being imported or a template of the package. With `--plant` the package
itself makes such an attempt when the first robot file is read, which shows that the watch sees it.
"""

from __future__ import annotations

import os
import sys
import typing
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "gibbs_codegen"
TEMPLATES = ROOT / "templates"
SEEN = 99

# Programs that the package runs: the C compiler that was found, and what writes films.
PROGRAMS = ("cc", "gcc", "clang", "ffmpeg")

# What writes functions for itself: SymPy of a number of generators, fontTools of its own tables.
LIBRARIES = (
    os.path.join("sympy", "polys", "monomials.py"),
    os.path.join("fontTools", "ttLib", "tables", "otBase.py"),
)

# What makes dataclasses of the classes of a module.
DECORATORS = ("table", "file_table")

WATCHED = (
    "exec",
    "compile",
    "subprocess.Popen",
    "os.system",
    "os.exec",
    "os.spawn",
    "os.posix_spawn",
    "os.startfile",
    "pickle.find_class",
    "pty.spawn",
    "code.__new__",
    "function.__new__",
    "socket.connect",
    "urllib.Request",
)

PLANTS = {
    "nothing": "pass",
    "eval": "eval('1 + 1')",
    "exec": "exec('x = 1')",
    "compile": "compile('1', 'text', 'eval')",
    "compiled": "exec(next(c for c in planted.__code__.co_consts if hasattr(c, 'co_code')))",
    "sympify": "import sympy; sympy.sympify('1 + 1')",
    "parse_expr": "from sympy.parsing.sympy_parser import parse_expr; parse_expr('x + 1')",
    "S": "import sympy; sympy.S('x + 1')",
    "Matrix": "import sympy; sympy.Matrix(['x + 1'])",
    "lambdify": "import sympy; sympy.lambdify([], sympy.Integer(1))",
    "pickle": "import pickle; pickle.loads(b'cposix\\nsystem\\n.')",
    "os.system": "import os; os.system('true')",
    "shell": "import subprocess; subprocess.run('true', shell=True)",
    "program": "import subprocess; subprocess.run(['/bin/sh', '-c', 'true'])",
    "template": "import jinja2; jinja2.Template('{{ 7 * 7 }}').render()",
    "namespace": "from collections import namedtuple; namedtuple('N', 'a')",
}


def violation(event: str, arguments: tuple[Any, ...], frame: FrameType | None) -> str | None:
    """What is wrong about an audit event that our code has led to, if something is."""
    source = ""
    # MuJoCo's bindings look up this built-in function so before they take a callback.
    if event == "compile" and arguments[0] == b"callable":
        return None
    if event == "exec" and arguments[0].co_names == ("callable",):
        return None
    if event == "subprocess.Popen" and Path(arguments[1][0]).name in PROGRAMS:
        return None
    if event == "exec":
        source = arguments[0].co_filename
    elif event == "compile" and arguments[1] is not None:
        source = os.fsdecode(arguments[1])
    caller = frame.f_code.co_filename if frame is not None else ""
    # It gives a function of a module, which was imported, the elementary functions of a library.
    if event == "function.__new__" and Path(caller) == PACKAGE / "runtime" / "kernels.py":
        return None
    if caller.endswith(LIBRARIES):
        return None
    # What it runs, it has compiled just before.
    if caller == typing.__file__ and (event == "exec" or is_annotation(arguments[0])):
        return None
    # Between us and the text: is it a file that is being imported, or a template of ours?
    while frame is not None:
        name = frame.f_code.co_filename
        if name.startswith("<frozen importlib"):
            return None
        if "jinja2" in name and Path(source).parent in (TEMPLATES, PACKAGE / "templates"):
            return None
        if Path(name).is_relative_to(PACKAGE):
            # Dataclasses are made of text where a module defines them, long before there is input.
            if frame.f_code.co_name == "<module>":
                return None
            if frame.f_code.co_name in DECORATORS and Path(name) == PACKAGE / "files" / "table.py":
                frame = frame.f_back
                continue
            by = f"{caller}, led to by {name}:{frame.f_lineno}"
            return f"{event} {source} {arguments!r:.200} by {by}"
        frame = frame.f_back
    return None


def is_annotation(text: object) -> bool:
    """Whether a text says the type of a key of one of the package's tables, in its source."""
    table = getattr(sys.modules.get("gibbs_codegen.files.table"), "Table", None)
    kinds: list[Any] = [table] if table else []
    for kind in kinds:
        kinds += kind.__subclasses__()
    known = [words for kind in kinds for words in kind.__annotations__.values()]
    return isinstance(text, bytes) and text.decode() in known


def watch(event: str, arguments: tuple[Any, ...]) -> None:
    """End the process, whatever would catch an exception."""
    if event not in WATCHED:  # To ask for a frame is an event, too.
        return
    if wrong := violation(event, arguments, sys._getframe(1)):
        os.write(2, f"AUDIT: {wrong}\n".encode("ascii", "backslashreplace"))
        os._exit(SEEN)


def plant(text: str) -> None:
    """Let the package run `text` when a robot's text is read."""
    from gibbs_codegen.robot import file

    lines = ["def planted(text, source):", *(f"    {line}" for line in text.split("; "))]
    lines += ["    class Unused: pass", "    return parse_robot(text, source)"]
    made: dict[str, Any] = {"parse_robot": file.parse_robot}
    code: CodeType = compile("\n".join(lines), str(PACKAGE / "planted.py"), "exec")
    exec(code, made)  # noqa: S102
    setattr(file, "parse_robot", made["planted"])  # noqa: B010 - mypy refuses the assignment.


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    if sys.argv[1] == "--plant":
        plant(PLANTS[sys.argv[2]])
        del sys.argv[1:3]
    from gibbs_codegen.cli.app import main

    sys.addaudithook(watch)
    sys.exit(main())
