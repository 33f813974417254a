"""Source that modules contain whole: every line of it stands in what is emitted."""

from __future__ import annotations

import pytest
from conftest import ROOT

from gibbs_codegen.targets.verbatim import c_source, python_source

EMITTED = ROOT / "gibbs_codegen" / "emitted"
ROBOT = ROOT / "generated" / "hexarotor_3link"


def test_a_python_file_is_its_docstring_its_imports_and_the_rest() -> None:
    source = python_source("evaluation.py")
    text = (EMITTED / "evaluation.py").read_text(encoding="utf-8")
    docstring = text.partition('"""\n\n')[0] + '"""\n\n'
    assert source.imports.startswith("from __future__ import annotations\n\nimport contextlib\n")
    assert text == f"{docstring}{source.imports}\n\n{source.body}\n"
    module = (ROBOT / "numpy_module.py").read_text(encoding="utf-8")
    assert f"\n{source.imports}\n\nNAME = " in module
    assert f"\n{source.body}\n\n\n_evaluate = " in module


def test_a_c_file_has_those_that_it_includes_in_their_places() -> None:
    kernel = (EMITTED / "sine_cosine_kernel.c").read_text(encoding="utf-8")
    support = c_source("support.c")
    assert support.count(kernel) == 2
    assert '#include "' not in support
    assert "#include <math.h>\n" in support


@pytest.mark.parametrize(
    ("name", "file"), [("support.c", ""), ("column_major.c", "_casadi")], ids=["module", "CasADi"]
)
def test_every_line_stands_in_the_module(name: str, file: str) -> None:
    module = (ROBOT / f"hexarotor_3link{file}.c").read_text(encoding="utf-8")
    assert f"\n{c_source(name)}" in module
