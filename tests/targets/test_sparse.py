"""Derivatives in C: all that there are compile, agree with NumPy, and have forms without zeros."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support import on_request
from support.compiled import Emitted, Library, build, compile_only, emit
from support.tools import run, tool

from gibbs_codegen.interface import FUNCTIONS, Signature, derivatives_among
from gibbs_codegen.robot.family import paper_family


@pytest.fixture(scope="module")
def emitted(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Emitted]:
    """A robot with every function that is generated on request."""
    robot = paper_family(2, 1)
    robot = replace(robot, base=replace(robot.base, attitude="quaternion"))
    with pytest.MonkeyPatch.context() as patch:
        on_request.add(patch)
        yield emit(robot, tmp_path_factory.mktemp("sparse") / "module", derivatives="all")


@pytest.mark.slow
def test_clang_finds_nothing_amiss_in_the_comments_of_headers(emitted: Emitted) -> None:
    """Its versions before 19 do not know that what stands beside @par is a title."""
    header = emitted.file(".h")
    run([tool("clang"), "-std=c99", "-Wdocumentation", "-Werror", "-fsyntax-only", header])
    titled = re.findall(r"@par (.*)\n \* (.*)", emitted.text(".h"))
    assert {*titled} <= {("Source", f"{row.source}.") for row in FUNCTIONS.values()}
    assert titled


def on_demand(emitted: Emitted) -> list[Signature]:
    """Signatures of the functions on request; the matrices of composed ones are dense."""
    rows = {name for name in derivatives_among(FUNCTIONS) if not FUNCTIONS[name].composed}
    return [signature for signature in emitted.signatures() if signature.name in rows]


def matrices(signature: Signature) -> list[str]:
    """Names of the outputs that are matrices; "" for the others."""
    outputs = FUNCTIONS[signature.name].outputs
    pairs = zip(outputs, signature.shapes, strict=True)
    return [output.name if len(shape) > 1 else "" for output, shape in pairs]


@pytest.mark.slow
def test_they_are_described(emitted: Emitted) -> None:
    header, said = emitted.text(".h"), " ".join(emitted.text(".h").replace("\n *", " ").split())
    for signature in on_demand(emitted):
        row = FUNCTIONS[signature.name]
        assert f"\n * @brief {row.summary}\n" in header
        # Lines are broken after hyphens.
        assert row.details.replace("- ", "-") in said.replace("- ", "-")
        assert row.summary in str(getattr(emitted.module, row.name).__doc__)


@pytest.fixture(scope="module")
def library(emitted: Emitted, tmp_path_factory: pytest.TempPathFactory) -> Library:
    """The library, which compiles silently."""
    return Library(emitted, tmp_path_factory.mktemp("library") / "double.so", "gcc", ["-O0"])


@pytest.mark.slow
def test_they_compile_silently(emitted: Emitted, tmp_path: Path) -> None:
    """By another compiler, in single precision."""
    compile_only("clang", ["-O0", emitted.single], emitted.sources, tmp_path)


@pytest.mark.slow
def test_forms_without_zeros_have_the_entries_of_the_patterns(
    emitted: Emitted, library: Library
) -> None:
    rng = np.random.default_rng(2)
    compared = set()
    for signature in on_demand(emitted):
        found = matrices(signature)
        if not any(found):
            assert f"{signature.name}_sparse" not in emitted.text(".h")
            continue
        rows = [rng.uniform(-1, 1, (3, *shape)) for shape in signature.argument_shapes]
        whole = library.one(signature, rows)
        patterns = [emitted.module.PATTERNS.get(name) for name in found]
        shapes = [
            (len(pattern[0]),) if name else shape
            for name, pattern, shape in zip(found, patterns, signature.shapes, strict=True)
        ]
        sparse = replace(signature, name=f"{signature.name}_sparse", shapes=tuple(shapes))
        for name, pattern, dense, entries in zip(
            found, patterns, whole, library.one(sparse, rows), strict=True
        ):
            if name:
                compared.add(name)
                dense = dense.reshape(3, -1, dense.shape[-1])
                assert np.count_nonzero(dense) == np.count_nonzero(dense[(..., *pattern)])
                dense = dense[(..., *pattern)]
            np.testing.assert_array_equal(entries, dense)
    assert compared == {*emitted.module.PATTERNS}


@pytest.mark.slow
def test_patterns_in_c_are_those_of_python(emitted: Emitted, library: Library) -> None:
    header = emitted.text(".h")
    assert emitted.module.PATTERNS["moved_dq"] == ((), ())
    for name, pattern in emitted.module.PATTERNS.items():
        length = len(pattern[0])
        macro = f"{emitted.name}_{name}_nonzeros".upper()
        assert re.search(rf"#define {macro} {length}\n", header)
        for kind, places in zip(("rows", "columns"), pattern, strict=True):
            symbol = f"{emitted.name}_{name}_{kind}"
            assert re.search(rf"extern const int\n    {symbol}\[{max(length, 1)}\];", header)
            found = library.data(f"{name}_{kind}", length, ctypes.c_int)
            assert tuple(found) == places


@pytest.mark.slow
def test_functions_equal_numpy(emitted: Emitted, library: Library) -> None:
    rng = np.random.default_rng(3)
    for signature in on_demand(emitted):
        rows = [rng.uniform(-1, 1, (9, *shape)) for shape in signature.argument_shapes]
        if not rows:
            continue
        expected = getattr(emitted.module, signature.name)(*rows)
        expected = expected if isinstance(expected, tuple) else (expected,)
        for form in (library.one(signature, rows), library.batch(signature, rows, np.nan)):
            for ours, theirs in zip(form, expected, strict=True):
                size = np.abs(theirs).max(initial=1.0)
                np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-10 * size)


@pytest.mark.slow
def test_a_program_may_use_them(emitted: Emitted, tmp_path: Path) -> None:
    size = len(emitted.module.VELOCITIES)
    prefix = emitted.name
    text = f"""
#include "{prefix}.h"
#include <stdio.h>
int main(void)
{{
    double q[{prefix.upper()}_COORDINATES] = {{0}}, v[{size}] = {{0}}, h = 0.5, moved[{size}];
    double by_v[{prefix.upper()}_MOVED_DV_NONZEROS], by_q[1], blocks[2];
    {prefix}_stretched_sparse(
        &{prefix}_default_constants, q, v, &h, moved, by_v, by_q, blocks);
    for (int i = 0; i < {prefix.upper()}_MOVED_DV_NONZEROS; ++i) {{
        printf("%d %d %g\\n", {prefix}_moved_dv_rows[i], {prefix}_moved_dv_columns[i], by_v[i]);
    }}
    return 0;
}}
"""
    (tmp_path / "program.c").write_text(text)
    sources = [str(tmp_path / "program.c"), *emitted.sources]
    program = build("gcc", [f"-I{emitted.folder}"], sources, tmp_path / "program")
    lines = run([program]).splitlines()
    assert lines[0] == "0 0 0.5"
    assert f"{size - 1} 1 1" in lines
    assert len(lines) == size + 2
