"""Source that modules contain whole: every line of it stands in what is emitted."""

from __future__ import annotations

from collections.abc import Callable

from conftest import ROOT
from support.compiled import SMALL, Emitted

from gibbs_codegen.files.verbatim import c_source, python_source
from gibbs_codegen.runtime.c_library import RUNTIME

EMITTED = ROOT / "gibbs_codegen" / "emitted"
ROBOT = ROOT / "generated" / "hexarotor_3link"


def test_python_files_are_their_docstrings_their_imports_and_the_rest() -> None:
    first, second = python_source("preparation.py"), python_source("evaluation.py")
    text = (EMITTED / "preparation.py").read_text(encoding="utf-8")
    docstring = text.partition('"""\n\n')[0] + '"""\n\n'
    assert text.startswith(f"{docstring}{first.imports}\n\n")
    assert text.endswith(f"{first.body}\n")
    both = python_source("preparation.py", "evaluation.py")
    assert both.body == f"{first.body}\n\n\n{second.body}"
    assert "gibbs_codegen" not in both.imports
    assert both.imports.startswith("from __future__ import annotations\n\nimport contextlib\n")
    lines = {*first.imports.splitlines(), *second.imports.splitlines()}
    assert {*both.imports.splitlines()} == lines
    module = (ROBOT / "numpy_module.py").read_text(encoding="utf-8")
    assert f"\n{both.imports}\n\nNAME = " in module
    assert f"\n{both.body}\n\n\n_evaluate = " in module


def test_a_c_file_has_those_that_it_includes_in_their_places() -> None:
    kernel = (EMITTED / "sine_cosine_kernel.c").read_text(encoding="utf-8")
    runtime = c_source("runtime.c")
    assert runtime.count(kernel) == 2
    assert '#include "' not in runtime
    assert "#include <math.h>\n" in runtime


def test_every_line_stands_in_the_module(emitted: Callable[[str], Emitted]) -> None:
    small = emitted(SMALL)
    assert (small.folder / RUNTIME).read_text(encoding="utf-8").endswith(c_source("runtime.c"))
    assert f'#include "{RUNTIME}"' in small.text(".c")
