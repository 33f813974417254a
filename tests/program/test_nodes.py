"""The program by itself, built by hand: evaluation, counting and lowering."""

from __future__ import annotations

import math

import sympy as sp

from gibbs_codegen.program.lower import Slice, lower
from gibbs_codegen.program.nodes import (
    Call,
    Name,
    Node,
    Number,
    Operations,
    Product,
    Reciprocal,
    ScalarProgram,
    Sum,
    count_operations,
    names_in,
)
from gibbs_codegen.symbolic.tape import Stage, Tape

X, Y = Name("x"), Name("y")


def small_program() -> ScalarProgram:
    """f(q) = p(sin x)² + 1/y and the constant 2p, over a parameter p."""
    tape = Tape()
    p = tape.symbol("p", Stage.PARAMETER)
    x, y = (tape.symbol(name, Stage.CONFIGURATION) for name in "xy")
    sine = tape.let(sp.sin(x))
    entries = (tape.let(p * sine * sine + tape.let(1 / y)), tape.let(2 * p))
    return lower(tape, {"q": ("x", "y")}, ("p",), [Slice("f", ("q",), (((2,), entries),))])


def test_lowered_program_evaluates() -> None:
    (values,) = small_program().evaluate("f", {"p": 3.0}, {"q": [0.7, 4.0]})
    assert values == [3.0 * (math.sin(0.7) * math.sin(0.7)) + 0.25, 6.0]


def lowered(value: str, *names: str) -> Node:
    """What a value over coordinates of these names, defined in this order, becomes."""
    tape = Tape()
    symbols = {name: tape.symbol(name, Stage.CONFIGURATION) for name in names}
    entry = tape.let(sp.sympify(value, symbols))
    program = lower(tape, {"q": names}, (), [Slice("f", ("q",), (((1,), (entry,)),))])
    return program.functions[0].statements[-1].value


def test_terms_are_written_positive_first_and_oldest_first() -> None:
    """What is no name comes before the names; SymPy would put names by the alphabet."""
    terms = ((1, Number(2.0)), (1, Name("y")), (1, Name("x")), (-1, Name("w")), (-1, Name("a")))
    assert lowered("x + y + 2 - a - w", "w", "y", "x", "a") == Sum(terms)


def test_a_product_begins_with_its_number_and_has_its_oldest_name_next() -> None:
    assert lowered("2*x*y", "y", "x") == Product((Number(2.0), Name("y"), Name("x")))
    root = Number(2.0 * math.sqrt(3.0))
    assert lowered("2*sqrt(3)*x*y", "y", "x") == Product((root, Name("y"), Name("x")))


def test_parameters_cost_nothing_in_the_function() -> None:
    program = small_program()
    assert program.constants == ("p", "k1")
    assert [s.name for s in program.prepare] == ["k1"]
    counts = count_operations(program.function("f").nodes())
    assert counts == Operations(additions=1, multiplications=2, divisions=1, sine_cosine_pairs=1)


def test_counting_by_kind() -> None:
    node = Sum(((1, Product((X, Y, Number(2.0)))), (-1, Reciprocal(X)), (1, Call("sin", Y))))
    assert count_operations([node, Call("cos", Y)]) == Operations(1, 1, 2, 1, 0, 1)
    assert count_operations([Sum(((-1, X), (-1, Y)))]).subtractions == 2
    calls = [Call(function, X) for function in ("sqrt", "atan", "sign")]
    assert count_operations(calls) == Operations(subtractions=1, square_roots=1, arctangents=1)
    assert count_operations([X, Number(1.0)]).total == 0
    # Powers of two, so that no two kinds can stand for each other; pairs are apart.
    assert Operations(1, 2, 4, 8, 16, 32).total == 31


def test_names_are_listed_as_often_as_they_stand() -> None:
    assert names_in(Sum(((1, Product((X, X))), (-1, Call("cos", Y))))) == ("x", "x", "y")


def test_folding_keeps_the_count_and_lines_short() -> None:
    """A chain of single uses is written in place; a value used twice keeps its name."""
    tape = Tape()
    symbols = [tape.symbol(f"x{i}", Stage.CONFIGURATION) for i in range(20)]
    total = symbols[0]
    for symbol in symbols[1:]:
        total = tape.let(total + symbol)
    twice = tape.let(total * total)
    names = tuple(s.name for s in symbols)
    program = lower(tape, {"q": names}, (), [Slice("f", ("q",), (((1,), (twice,)),))])
    function = program.function("f")
    assert count_operations(function.nodes()).total == 20
    assert max(len(names_in(s.value)) for s in function.statements) == 7
    assert len(function.statements) < 8
    (values,) = program.evaluate("f", {}, {"q": [1.0] * 20})
    assert values == [400.0]
