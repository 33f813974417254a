"""Gathering a function's sines and cosines, on functions built by hand and drawn at random."""

from __future__ import annotations

from hypothesis import given
from support.functions import (
    T1,
    T2,
    T3,
    P,
    Values,
    X,
    Y,
    cosine,
    evaluated,
    evaluated_in_parts,
    function,
    functions,
    sine,
    sum_of,
    values,
)

from gibbs_codegen.program.nodes import (
    Function,
    Name,
    Output,
    Product,
    Reciprocal,
    Statement,
    names_in,
)
from gibbs_codegen.program.trigonometry import GatheredFunction, gather_angles


def test_angles_come_in_the_order_of_their_first_call() -> None:
    parts = gather_angles(function({"t1": sum_of(cosine(Y), sine(X))}, T1, cosine(X)))
    assert parts.angles == (Y, X)
    assert parts.statements == (Statement("t1", sum_of(Name("c1"), Name("s2"))),)
    assert parts.outputs[0].entries == (T1, Name("c2"))


def test_sine_and_cosine_of_an_angle_share_its_place() -> None:
    parts = gather_angles(function({}, Product((sine(X), cosine(X))), sine(X)))
    assert parts.angles == (X,)
    assert parts.outputs[0].entries == (Product((Name("s1"), Name("c1"))), Name("s1"))


def test_what_only_angles_need_is_left_out_of_the_rest() -> None:
    parts = gather_angles(function({"t1": sum_of(X, Y), "t2": Product((P, X))}, sine(T1), T2))
    assert parts.angle_statements == (Statement("t1", sum_of(X, Y)),)
    assert parts.statements == (Statement("t2", Product((P, X))),)


def test_what_both_need_is_computed_in_both() -> None:
    both = Statement("t1", sum_of(X, Y))
    parts = gather_angles(function({"t1": both.value}, Product((T1, sine(T1)))))
    assert parts.angle_statements == parts.statements == (both,)


def test_a_name_for_a_sine_gives_way_to_the_sine() -> None:
    """Also where that name has another name, and where it is an entry by itself."""
    parts = gather_angles(function({"t1": sine(X), "t2": T1, "t3": sum_of(T2, P)}, T1, T2, T3))
    assert parts.statements == (Statement("t3", sum_of(Name("s1"), P)),)
    assert parts.outputs[0].entries == (Name("s1"), Name("s1"), T3)


def test_a_statement_that_nothing_needs_is_dropped() -> None:
    parts = gather_angles(function({"t1": sum_of(X, Y), "t2": sum_of(T1, sine(X))}, cosine(X)))
    assert parts.angle_statements == parts.statements == ()


def test_without_sines_the_function_stays_as_it_is() -> None:
    plain = function({"t1": sum_of(X, Y)}, T1, Reciprocal(P))
    parts = gather_angles(plain)
    assert parts == GatheredFunction((), (), plain.statements, plain.outputs)


def test_shapes_stay() -> None:
    outputs = (Output((2, 1), (sine(X), X)), Output((), (Y,)))
    parts = gather_angles(Function("f", ("q",), (), (), outputs))
    assert [output.shape for output in parts.outputs] == [(2, 1), ()]


@given(function=functions(), at=values())
def test_gathered_functions_evaluate_alike(function: Function, at: Values) -> None:
    """To the last bit: the operations are the same ones. As text, since NaN is not itself."""
    assert str(evaluated_in_parts(gather_angles(function), at)) == str(evaluated(function, at))


@given(function=functions())
def test_no_call_is_left(function: Function) -> None:
    parts = gather_angles(function)
    nodes = [s.value for s in (*parts.angle_statements, *parts.statements)]
    nodes += [*parts.angles, *(entry for output in parts.outputs for entry in output.entries)]
    assert not any(node.calls for node in nodes)


@given(function=functions())
def test_angles_are_unique_and_all_are_used(function: Function) -> None:
    parts = gather_angles(function)
    assert len(set(parts.angles)) == len(parts.angles)
    assert set(parts.angles) == {c.argument for n in function.nodes() for c in n.calls}


@given(function=functions())
def test_statements_keep_their_order_and_nothing_idle_stays(function: Function) -> None:
    parts = gather_angles(function)
    order = [statement.name for statement in function.statements]
    entries = [entry for output in parts.outputs for entry in output.entries]
    for rows, roots in ((parts.angle_statements, parts.angles), (parts.statements, entries)):
        places = [order.index(statement.name) for statement in rows]
        assert places == sorted(set(places))
        read = {n for node in (*roots, *(s.value for s in rows)) for n in names_in(node)}
        assert read >= {statement.name for statement in rows}
