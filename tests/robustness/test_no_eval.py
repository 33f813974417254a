"""No way from text to `eval`: read off the source, and watched while all commands run."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT
from support.audited import PACKAGE, SEEN, TEMPLATES
from support.tools import HANGING

SOURCES = sorted(PACKAGE.rglob("*.py"))

# What makes code of text, or runs another program by one, wherever it comes from.
FORBIDDEN = {
    *("eval", "exec", "compile", "__import__", "execfile", "input", "breakpoint"),
    *("sympify", "parse_expr", "_sympify", "lambdify", "lambdastr", "autowrap", "ufuncify"),
    *("pickle", "cPickle", "dill", "shelve", "marshal", "cloudpickle", "joblib"),
    *("system", "popen", "getoutput", "getstatusoutput", "spawnl", "spawnv", "execv", "execl"),
    *("from_string", "Template", "literal_eval", "run_path", "runpy", "code", "codeop"),
}

HARMLESS = ("re.compile", "platform.system", "xacrodoc.XacroDoc.from_string")

# A sweep sends the functions of its caller to its own workers, and takes back nothing but arrays;
# scenarios are only written, to compare them. None of it is read from a file.
SENT_TO_WORKERS = {
    "flight/many.py": {"pickle"},
    "flight/sweeps/fingerprint.py": {"cloudpickle"},
    "flight/sweeps/measures.py": {"cloudpickle"},
    "flight/sweeps/chunks.py": {"pickle"},
    "flight/sweeps/execution.py": {"pickle"},
}

# YAML can call what it names, unless it is read so.
SAFE_YAML = ("yaml.safe_load", "yaml.YAMLError", "yaml.MarkedYAMLError")


def uses(text: str) -> set[str]:
    """Forbidden names that a source calls or imports, S(…) of SymPy and shell=True among them."""
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = [alias.name for alias in node.names]
            found |= {"yaml"} & {getattr(node, "module", "")}
            modules = [node.module or ""] if isinstance(node, ast.ImportFrom) else names
            found |= FORBIDDEN & {part for name in (*names, *modules) for part in name.split(".")}
        elif isinstance(node, ast.Call):
            name = getattr(node.func, "id", getattr(node.func, "attr", ""))
            if name in FORBIDDEN and ast.unparse(node.func) not in HARMLESS:
                found.add(name)
            if name == "S" and ast.unparse(node.func) in ("sp.S", "sympy.S", "S"):
                found.add("S")
            found |= {
                f"{k.arg}="
                for k in node.keywords
                if k.arg in ("shell", "allow_pickle") and ast.unparse(k.value) != "False"
            }
        elif isinstance(node, ast.Attribute) and getattr(node.value, "id", "") == "yaml":
            found |= {f"yaml.{node.attr}"} - {*SAFE_YAML}
    return found


@pytest.mark.slow
def test_no_source_makes_code_of_text() -> None:
    found = {
        path.relative_to(PACKAGE).as_posix(): uses(path.read_text(encoding="utf-8"))
        for path in SOURCES
    }
    assert {path: names for path, names in found.items() if names} == SENT_TO_WORKERS


def test_sources_are_looked_at_closely() -> None:
    for text in (
        "eval('1')",
        "import sympy as sp\nsp.S('x')",
        "sp.sympify(x)",
        "from sympy import parse_expr",
        "import pickle as p",
        "from marshal import loads",
        "os.system(x)",
        "subprocess.run(x, shell=True)",
        "np.load(x, allow_pickle=True)",
        "environment.from_string(x)",
        "yaml.load(x, Loader=yaml.Loader)",
        "from yaml import unsafe_load",
        "compile(x, '', 'exec')",
    ):
        assert uses(text), text
    assert len(SOURCES) > 80


def test_templates_include_nothing_and_import_nothing() -> None:
    for path in TEMPLATES.glob("*.jinja"):
        text = path.read_text(encoding="utf-8")
        assert not any(
            word in text for word in ("{% include", "{% import", "{% extends", "__class")
        )


def watched(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """A command under the audit hook."""
    command = [sys.executable, str(ROOT / "tests" / "support" / "audited.py"), *arguments]
    return subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, timeout=HANGING, env=dict(os.environ)
    )


GENERATE = ["generate", "mine.toml"]
SIMULATE = ["simulate", "mine", "--scenario", "hover", "--set", "duration=0.05"]
COMMANDS = [
    GENERATE,
    ["new", "__import__('os').system('true').toml"],
    [*SIMULATE, "--no-figures", "--backend", "numpy"],
    ["verify", "mine", "--states", "1", "--backend", "numpy"],
]
MORE_COMMANDS = [
    [*GENERATE, "--check"],
    [*GENERATE, "--all-parameters", "--target", "numpy", "--target", "c"],
    ["info", "mine.toml"],
    ["info", "mine.toml", "--json", "--operations"],
    ["show", "mine.toml", "--chain", "1", "--format", "latex"],
    [*SIMULATE, "--backend", "c", "--animate", "gif"],
    ["verify", "mine.toml", "--states", "1"],
]
ROBOT = """# __import__('os').system('touch canary')
name = "mine"
[base]
rotors = 6
arm = { length = 1, mass_per_length = 1 }
"""


@pytest.mark.slow
def test_no_command_makes_code_of_text(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(ROBOT)
    for command in COMMANDS:
        done = watched(*command, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    assert not (tmp_path / "canary").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    "planted",
    ["sympify"],
)
def test_the_watch_sees(planted: str, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(ROBOT)
    done = watched("--plant", planted, "info", "mine.toml", "--operations", cwd=tmp_path)
    assert done.returncode == (0 if planted == "nothing" else SEEN), done.stderr
    assert ("AUDIT:" in done.stderr) == (planted != "nothing")
