"""Statements in C: their text, their comments, and lines that are never too long."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gibbs_codegen.program.nodes import Name, Number, Product, Statement, Sum
from gibbs_codegen.targets.c.statements import (
    CStatements,
    array_size,
    call,
    from_block,
    from_entry,
    loop,
    place,
    place_in_loop,
    read_arrays,
    side_by_side,
    unused,
    vector_loop,
    written_arrays,
)
from gibbs_codegen.targets.printers import CPrinter

PRINTER = CStatements(CPrinter())
OF_SEVERAL = CStatements(CPrinter(), of_several=True)
TWICE = Product((Number(2.0), Name("x")))


def test_statements_are_c() -> None:
    assert PRINTER.assign("t1", TWICE) == ["const real t1 = R(2.0) * x;"]
    assert PRINTER.store("residual", 3, Name("t1")) == ["residual[3] = t1;"]
    assert PRINTER.load("x", "q", 4) == "const real x = q[4];"
    assert PRINTER.load("t1", "scratch", 2, "-") == "const real t1 = -scratch[2];"
    assert PRINTER.spill("scratch", place_in_loop(2), "t1", "-") == "scratch[2 + i] = -t1;"
    assert PRINTER.load_constant("k3") == "const real k3 = constants->k3;"
    assert place_in_loop(2, 1) == "2 + 1 * i"
    assert unused("v") == "(void)v;"
    assert call("f", ["a", "b + 1"]) == ["f(a, b + 1);"]


def test_entries_of_several_states_are_a_stride_apart() -> None:
    assert OF_SEVERAL.store("residual", 3, Name("t1")) == ["residual[3 * stride] = t1;"]
    assert OF_SEVERAL.inside.load("x", "q", 4) == "const real x = q[4 * stride];"
    assert OF_SEVERAL.spill("scratch", place_in_loop(2), "t1") == "scratch[(2 + i) * stride] = t1;"
    assert OF_SEVERAL.load_constant("k3") == "const real k3 = CONSTANT(k3);"


@pytest.mark.parametrize("shape", [(), (7,), (3, 5), (2, 3, 4)])
def test_places_tell_row_and_column(shape: tuple[int, ...]) -> None:
    """What C makes of the text is the number of the entry in the order of NumPy."""
    for number, index in enumerate(np.ndindex(shape)):
        factors = [[*map(int, term.split(" * "))] for term in place(shape, number).split(" + ")]
        assert sum(map(math.prod, factors)) == number
        assert tuple(first for first, *_ in factors) == (index or (0,))


def test_functions_are_called_for_one_state_or_for_every_lane() -> None:
    assert PRINTER.call_helper("f", ["q", "x"]) == ["f(constants, q, x);"]
    lines = ["f(OF_LANE(constants, lane), q + lane, x + lane, LANES);"]
    assert OF_SEVERAL.call_helper("f", ["q", "x"]) == vector_loop("lane", "LANES", lines)
    assert [array_size(3, lanes) for lanes in (False, True)] == ["3", "3 * LANES"]
    assert from_entry("angle", 4) == "angle + 4"
    assert from_block("q", 9, "whole") == "q + whole * (9 * LANES)"


def test_a_helper_has_constants_arrays_and_stride() -> None:
    body = ["x[0 * stride] = a;", "", "b;"]
    assert OF_SEVERAL.helper("f", [*read_arrays(["q"]), *written_arrays(["x"])], body) == [
        "static INLINE void f(const Constants *RESTRICT constants, const real *RESTRICT q, "
        "real *RESTRICT x,",
        "    const int stride)",
        "{",
        "    x[0 * stride] = a;",
        "",
        "    b;",
        "}",
    ]
    assert OF_SEVERAL.helper("f", [], ["a;"])[-4:] == ["{", "    (void)stride;", "    a;", "}"]
    alone = PRINTER.helper("f", [*read_arrays(["q"])], ["a;"])
    assert "stride" not in " ".join(alone)
    assert alone[-3:] == ["{", "    a;", "}"]
    assert read_arrays(["q"], "toy_real", "") == ["const toy_real *q"]


def test_short_statements_of_a_kind_stand_side_by_side() -> None:
    """Numbers that are copied fill lines; of those that are computed a line has two."""
    loads = [OF_SEVERAL.load(f"x{i}", "q", i) for i in range(6)]
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
