"""What the graph makes of a tape: the same values, exact numbers, and the tape's words."""

from __future__ import annotations

from fractions import Fraction

import pytest
import sympy as sp

from gibbs_codegen.graph.from_tape import ImportedTape
from gibbs_codegen.graph.graph import NodeKind
from gibbs_codegen.symbolic.tape import Stage, Tape
from gibbs_codegen.symbolic.vectors import cos_sin_deg


def test_statements_become_nodes_in_the_order_of_the_tape() -> None:
    tape = Tape()
    k = tape.symbol("k", Stage.PARAMETER)
    x = tape.symbol("x", Stage.CONFIGURATION)
    imported = ImportedTape(tape)
    graph = imported.graph
    sine = tape.let(sp.sin(x))
    entry = tape.let(sp.Rational(1, 3) * k * tape.let(sine * sine) - tape.let(1 / x))
    ref = imported.ref(entry)
    assert graph.kinds[ref >> 1] is NodeKind.SUM
    assert [graph.constant[imported.ref(e) >> 1] for e in (k, x, sine)] == [True, False, False]
    assert imported.ref(k) < imported.ref(x) < imported.ref(sine) < ref
    assert imported.ref(-entry) == ref ^ 1
    later = tape.let(entry + x)
    assert imported.ref(later) > ref


@pytest.mark.parametrize("number", [sp.Rational(1, 3), -sp.sqrt(3) / 2, sp.Integer(4), sp.pi / 7])
def test_numbers_are_exact_or_have_forty_digits(number: sp.Expr) -> None:
    tape = Tape()
    x = tape.symbol("x", Stage.CONFIGURATION)
    imported = ImportedTape(tape)
    graph = imported.graph
    root = sp.sqrt(2)
    exact = not number.has(sp.pi)
    value = graph.value(imported.ref(number))
    assert value == number if exact else abs(value - number).evalf(50) < 1e-39
    twice = imported.ref(number * root * x)
    factor, _ = graph.operands[twice >> 1]
    label = graph.labels[factor >> 1]
    assert label == abs(number * root) if exact else abs(label - number * root).evalf(50) < 1e-39


def test_numbers_that_are_equal_are_one_node() -> None:
    imported = ImportedTape(Tape())
    graph, ref = imported.graph, imported.ref
    cosine, root = sp.sqrt(3) / 2, sp.sqrt(2)
    square = graph.product(ref(cosine), ref(cosine))
    assert square == ref(sp.Rational(3, 4))
    assert graph.sum([graph.one, graph.minus(square)]) == ref(sp.Rational(1, 4))
    length = graph.symbol("length", constant=True)
    third = graph.product(square, length)
    assert graph.sum([length, graph.minus(third)]) == graph.product(ref(sp.Rational(1, 4)), length)
    # 1/(√6 + √2) is (√6 − √2)/4.
    total = graph.product(ref(root), graph.sum([graph.one, ref(sp.sqrt(3))]))
    assert graph.reciprocal(total) == ref((sp.sqrt(6) - root) / 4)
    # sin² 20° + cos² 20°, of forty digits each.
    cos, sin = (ref(entry) for entry in cos_sin_deg(Fraction(20)))
    squares = [graph.product(cos, cos), graph.product(sin, sin)]
    assert graph.sum(squares) == graph.one
    assert graph.sum([graph.one, *map(graph.minus, squares)]) == graph.zero
    assert graph.sum([graph.one, graph.minus(squares[0])]) == squares[1]


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
    assert imported.words_of(cube >> 1) == "cubes"
    assert imported.words_of(other >> 1) == imported.words_of(ref >> 1) == ""
