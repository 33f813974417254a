"""Statements in C: their text, their comments, and lines that are never too long."""

from __future__ import annotations

import pytest

from gibbs_codegen.program.nodes import Name, Number, Product, Statement, Sum
from gibbs_codegen.targets.c.statements import (
    CStatements,
    array_size,
    call,
    call_helper,
    from_block,
    from_entry,
    helper,
    load,
    loop,
    place_in_loop,
    read_arrays,
    side_by_side,
    spill,
    unused,
    vector_loop,
    written_arrays,
)
from gibbs_codegen.targets.printers import CPrinter

PRINTER = CStatements(CPrinter())
TWICE = Product((Number(2.0), Name("x")))


def test_statements_are_c() -> None:
    assert PRINTER.assign("t1", TWICE) == ["const real t1 = R(2.0) * x;"]
    assert PRINTER.store("residual", 3, Name("t1")) == ["residual[3 * stride] = t1;"]
    assert load("x", "q", 4) == "const real x = q[4 * stride];"
    assert load("t1", "scratch", 2, "-") == "const real t1 = -scratch[2 * stride];"
    assert spill("scratch", place_in_loop(2), "t1", "-") == "scratch[(2 + i) * stride] = -t1;"
    assert place_in_loop(2, 1) == "(2 + 1 * i)"
    assert unused("v") == "(void)v;"
    assert call("f", ["a", "b + 1"]) == ["f(a, b + 1);"]


def test_functions_are_called_for_one_state_or_for_every_lane() -> None:
    assert call_helper("f", ["q", "x"], lanes=False) == ["f(constants, q, x, 1);"]
    lines = ["f(OF_LANE(constants, lane), q + lane, x + lane, LANES);"]
    assert call_helper("f", ["q", "x"], lanes=True) == vector_loop("lane", "LANES", lines)
    assert [array_size(3, lanes) for lanes in (False, True)] == ["3", "3 * LANES"]
    assert from_entry("angle", 4) == "angle + 4"
    assert from_block("q", 9, "whole") == "q + whole * (9 * LANES)"


def test_a_helper_has_constants_arrays_and_stride() -> None:
    body = ["x[0 * stride] = a;", "", "b;"]
    assert helper("f", [*read_arrays(["q"]), *written_arrays(["x"])], body) == [
        "static INLINE void f(const Constants *RESTRICT constants, const real *RESTRICT q, "
        "real *RESTRICT x,",
        "    const int stride)",
        "{",
        "    x[0 * stride] = a;",
        "",
        "    b;",
        "}",
    ]
    assert helper("f", [], ["a;"])[-4:] == ["{", "    (void)stride;", "    a;", "}"]
    assert read_arrays(["q"], "toy_real", "") == ["const toy_real *q"]


def test_short_statements_of_a_kind_stand_side_by_side() -> None:
    """Numbers that are copied fill lines; of those that are computed a line has two."""
    loads = [load(f"x{i}", "q", i) for i in range(6)]
    copied = side_by_side(loads)
    assert " ".join(copied).replace("; const real", ",") == (
        "const real " + ", ".join(f"x{i} = q[{i} * stride]" for i in range(6)) + ";"
    )
    assert [line.count("=") for line in copied] == [4, 2]
    sums = [f"const real t{i} = x{i} + x0;" for i in range(3)]
    stores = ["a[0 * stride] = t0;", "a[1 * stride] = -t1;"]
    assert side_by_side([*loads[:1], *sums, *stores, "", "/* words */", *sums[:1]]) == [
        "const real x0 = q[0 * stride];",
        "const real t0 = x0 + x0, t1 = x1 + x0;",
        "const real t2 = x2 + x0;",
        "a[0 * stride] = t0; a[1 * stride] = -t1;",
        "",
        "/* words */",
        "const real t0 = x0 + x0;",
    ]
    broken = ["const real t3 = x0 +", "    x1;", "a[2 * stride] = t3 *", "    x1;"]
    assert side_by_side([*sums[:1], *broken, *stores[:1]]) == [*sums[:1], *broken, *stores[:1]]


def test_loops_hold_their_body() -> None:
    lines = loop("i", 3, ["x[i] = y;"])
    assert lines == ["for (int i = 0; i < 3; ++i) {", "    x[i] = y;", "}"]
    assert vector_loop("i", 3, ["x[i] = y;"]) == ["VECTORISE", *lines]
    assert PRINTER.clear("x", "3 * LANES")[1] == "    x[i] = R(0.0);"


def test_a_group_begins_with_its_comment() -> None:
    rows = [Statement("a", TWICE, "p"), Statement("b", TWICE, "p"), Statement("c", TWICE, "q")]
    lines = [line for line in PRINTER.assign_all(rows) if not line.startswith("const")]
    assert lines == ["", "/* p */", "", "/* q */"]


@pytest.mark.parametrize("length", range(1, 40))
def test_a_call_fits_where_it_is_indented_most(length: int) -> None:
    """Within 100 columns, indented four times, which is as deep as calls stand."""
    arguments = ["n" * length, *(f"name_{i}" for i in range(8))]
    lines = call("f", arguments)
    assert max(map(len, lines)) <= 84
    assert " ".join(map(str.strip, lines)) == f"f({', '.join(arguments)});"


@pytest.mark.parametrize("length", range(1, 60))
def test_no_line_is_longer_than_100_columns(length: int) -> None:
    """Within a function, whose body is indented once, and in a loop there, indented twice."""
    total = Sum((*((1, Name(f"name_{i}")) for i in range(8)), (1, Name("n" * length))))
    for printer, room in ((PRINTER, 96), (PRINTER.inside, 92)):
        lines = printer.assign("t1", total)
        assert max(map(len, lines)) <= room
        assert " ".join(map(str.strip, lines)) == PRINTER.assign("t1", Name("?"))[0].replace(
            "?", " + ".join([f"name_{i}" for i in range(8)] + ["n" * length])
        )
        assert len(lines) == 1 or len(" ".join(map(str.strip, lines))) > room
