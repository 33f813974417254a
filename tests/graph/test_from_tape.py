"""What the graph makes of a tape: the same values, numbers rounded once, and the tape's words."""

from __future__ import annotations

import pytest
import sympy as sp

from gibbs_codegen.graph.from_tape import ImportedTape
from gibbs_codegen.graph.graph import Kind
from gibbs_codegen.symbolic.tape import Stage, Tape


def test_statements_become_nodes_in_the_order_of_the_tape() -> None:
    tape = Tape()
    k = tape.symbol("k", Stage.PARAMETER)
    x = tape.symbol("x", Stage.CONFIGURATION)
    imported = ImportedTape(tape)
    graph = imported.graph
    sine = tape.let(sp.sin(x))
    entry = tape.let(sp.Rational(1, 3) * k * tape.let(sine * sine) - tape.let(1 / x))
    ref = imported.ref(entry)
    assert graph.kinds[ref >> 1] is Kind.SUM
    assert [graph.constant[imported.ref(e) >> 1] for e in (k, x, sine)] == [True, False, False]
    assert imported.ref(k) < imported.ref(x) < imported.ref(sine) < ref
    assert imported.ref(-entry) == ref ^ 1
    later = tape.let(entry + x)
    assert imported.ref(later) > ref


@pytest.mark.parametrize("number", [sp.Rational(1, 3), -sp.sqrt(3) / 2, sp.Integer(4), sp.pi / 7])
def test_numbers_are_rounded_once(number: sp.Expr) -> None:
    tape = Tape()
    x = tape.symbol("x", Stage.CONFIGURATION)
    imported = ImportedTape(tape)
    graph = imported.graph
    assert graph.value(imported.ref(number)) == float(sp.N(number, 30))
    twice = imported.ref(number * sp.sqrt(2) * x)
    factor, _ = graph.operands[twice >> 1]
    assert graph.labels[factor >> 1] == abs(float(sp.N(number * sp.sqrt(2), 30)))


def test_powers_are_whole_powers_of_a_value_or_of_its_root() -> None:
    tape = Tape()
    x = tape.symbol("x", Stage.CONFIGURATION)
    imported = ImportedTape(tape)
    graph, ref = imported.graph, imported.ref(x)
    root = graph.call("sqrt", ref)
    assert imported.ref(sp.sqrt(x)) == root
    assert imported.ref(1 / sp.sqrt(x)) == graph.reciprocal(root)
    assert imported.ref(x ** sp.Rational(3, 2)) == graph.products([root] * 3)
    assert imported.ref(x**-2) == graph.reciprocal(graph.product(ref, ref))
    for power in (sp.cbrt(x), x**x):
        with pytest.raises(TypeError, match="twice its exponent must be whole"):
            imported.ref(power)


def test_words_are_those_of_the_tape_or_of_the_block_in_which_a_node_was_made() -> None:
    tape = Tape()
    x = tape.symbol("x", Stage.CONFIGURATION)
    imported = ImportedTape(tape)
    with tape.group("squares"):
        square = tape.let(x * x)
    ref = imported.ref(square)
    assert imported.words(tape.groups) == {ref >> 1: "squares"}
    with imported.group("cubes"):
        cube = imported.graph.product(ref, imported.ref(x))
    other = imported.graph.product(cube, cube)
    assert imported.said(cube >> 1) == "cubes"
    assert imported.said(other >> 1) == imported.said(ref >> 1) == ""
