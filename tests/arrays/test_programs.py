"""Array programs: nodes are made once, programs within others computed once, and refusals."""

from __future__ import annotations

import copy
import gc
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.made_up import MadeUp

from gibbs_codegen.arrays import (
    Functions,
    Node,
    Program,
    constant,
    evaluate,
    external,
    gradient,
    jacobian,
    join,
    nodes,
    sine,
    solve,
    total,
    variable,
)
from gibbs_codegen.arrays.c_text import CProgram
from gibbs_codegen.arrays.contents import check_distinct
from gibbs_codegen.arrays.labels import labelled, named
from gibbs_codegen.errors import MissingFunctionError, UsageError
from gibbs_codegen.runtime.load import load

Array = np.ndarray


def test_a_program_within_a_program_is_evaluated_once_and_derived_once() -> None:
    calls = []

    def counted(x: Array) -> Array:
        calls.append(x)
        return x + 1.0

    x = variable("x", 2)
    inner = Program("inner", (x,), {"a": external("counted", (2,), x), "b": 2.0 * x})
    a, b = inner(x)
    once_more, _ = inner(x)
    assert once_more is a
    program = Program("outer", (x,), {"sum": a + b, "product": a * b})
    found = evaluate(program, {"x": np.array([1.0, 2.0])}, {}, externals={"counted": counted})
    np.testing.assert_array_equal(found["product"], [4.0, 12.0])
    assert len(calls) == 1
    smooth = Program("smooth", (x,), {"s": sine(x)})
    twice = Program("twice", (x,), {"y": smooth(smooth(x)[0])[0]})
    inside = {
        y.operation.program
        for y in jacobian(twice, ("x",)).nodes
        if isinstance(y.operation, nodes.Invocation)
    }
    assert inside == {smooth, jacobian(smooth, ("x",))}
    with pytest.raises(UsageError, match="has no derivative"):
        jacobian(program, ("x",))


@pytest.mark.slow
def test_nodes_are_made_once_and_forgotten() -> None:
    x = variable("x", 3)
    assert 2.0 * sine(x) is 2.0 * sine(x)
    assert variable("x", 3) is x
    assert variable("x", 3, uniform=True) is not x
    assert (x + 0.0) is x
    assert (1.0 * x) is x
    assert nodes.is_all(0.0 * x, 0.0)
    assert constant(np.eye(3)) @ x is x
    assert join(x[:1], x)[1:] is x
    assert nodes.reshaped(nodes.reshaped(x, (3, 1)), (3,)) is x
    assert x[2:1].shape == (0,)
    assert x[np.int64(1)] is x[1]
    assert total(x, -1) is total(x, 0)
    assert total(x, 0, -1) is total(x, 0)
    gc.collect()
    before = len(nodes._NODES)
    for k in range(100):
        sine(x * float(k + 2))
    gc.collect()
    assert len(nodes._NODES) <= before + 1


def test_copies_of_programs_have_their_nodes() -> None:
    x = variable("x", 2)
    program = Program("squares", (x,), {"y": x * x})
    copied = copy.deepcopy(program)  # By the same words as pickle.
    assert copied.inputs == (x,)
    assert jacobian(copied, "x").outputs == jacobian(program, "x").outputs


def test_text_has_the_names_of_its_own_program() -> None:
    """Programs share nodes, and what one calls them is nothing to another, whichever is older."""
    x = variable("x", 9)

    @labelled
    def made(name: str) -> Program:
        doubled = 2.0 * x
        if name:
            named(doubled, name, f"It is called {name}.")
        return Program("twice", (x,), {"y": doubled @ doubled, "z": doubled + 1.0})

    programs = {name: made(name) for name in ("first", "", "second")}
    for name, program in programs.items():
        for derived in (program, jacobian(program, "x"), gradient(program, "x")):
            text = "\n".join(CProgram(derived).function())
            assert {one for one in programs if one and one in text} == ({name} - {""})
            assert not name or (f"{name}[" in text and f"/* It is called {name}. */" in text)
    assert programs["first"].labels != programs["second"].labels


def test_threads_make_a_node_once(monkeypatch: pytest.MonkeyPatch) -> None:
    made = nodes.Node

    def slow(*values: Any) -> Node:
        time.sleep(0.05)
        return made(*values)

    monkeypatch.setattr(nodes, "Node", slow)
    with ThreadPoolExecutor(2) as threads:
        one, other = threads.map(variable, ["of_threads"] * 2)
    assert one is other


def wrong() -> Iterator[tuple[Callable[[Functions, Node, Node], object], str]]:
    """What is refused, and a part of the words."""
    yield lambda r, q, v: q + v, "coordinates are no vectors"
    yield lambda r, q, v: v + constant(np.ones(2)), "do not go together"
    yield lambda r, q, v: v @ constant(np.eye(2)), "does not go with"
    yield lambda r, q, v: solve(constant(np.eye(2)), v), "does not go with"
    yield lambda r, q, v: r.integrate(v, v), "integrate: q is coordinates of shape"
    yield lambda r, q, v: r.difference(q), "difference takes q0, q1"
    yield lambda r, q, v: nodes.coordinates_of(v[:2], r.space), "entries"
    yield lambda r, q, v: join(v, constant(np.eye(2))), "do not go together"
    yield lambda r, q, v: nodes.reshaped(v, (2,)), "has not the entries"
    yield lambda r, q, v: v[::2], "side by side"
    yield lambda r, q, v: [*total(v)], "a number has no parts"
    yield lambda r, q, v: solve(v, total(v)), "does not go with"
    yield lambda r, q, v: total(v, 0, 5), "has not the axes 0, 5"
    yield lambda r, q, v: Program("p", (q,), {"v": v}), "p: no inputs, but needed: v"
    yield lambda r, q, v: Program("p", (v, variable("v")), {"v": v}), "two inputs have one name"
    yield lambda r, q, v: Program("p", (v, 2.0 * v), {"v": v}), "an input that is no variable"
    yield lambda r, q, v: jacobian(Program("p", (v,), {"v": v}), ["gain"]), "p has no inputs gain"
    yield lambda r, q, v: gradient(Program("p", (v,), {"v": v}), "gain"), "p has no inputs gain"
    for derived in (jacobian, gradient):
        yield (
            lambda r, q, v, derived=derived: derived(
                Program("p", (v,), {"y": external("f", (2,), v, 2.0 * v)}), "v"
            ),
            "has no derivative",
        )
    yield lambda r, q, v: Program("p", (v,), {"v": v})(v[:1]), "does not go with its input"
    twice = [Program("f", (), {"y": constant(value)}) for value in (1.0, 2.0)]
    yield lambda r, q, v: check_distinct(twice), "two programs are called f; rename one"
    shared = variable("v", 1, uniform=True)
    yield lambda r, q, v: Program("p", (shared,), {"v": shared})(v[:1]), "does not go with"
    yield (
        lambda r, q, v: jacobian(Program("p", (q,), {"y": r.mass_matrix(q)}), ("q",)),
        "derivatives of mass_matrix by q",
    )
    yield lambda r, q, v: evaluate(Program("p", (v,), {"v": v}), {}, {}), "no value for v"
    yield (
        lambda r, q, v: evaluate(Program("p", (), {"y": external("f", (2,))}), {}, {}),
        "no external function is given for 'f'",
    )
    yield (
        lambda r, q, v: evaluate(
            Program("p", (q,), {"y": r.mass_matrix(q)}), {"q": np.ones(q.size)}, {}
        ),
        "no module is given for 'robot'",
    )
    yield (
        lambda r, q, v: evaluate(Program("p", (v,), {"v": v}), {"v": np.ones(2)}, {}),
        "its last axes must be",
    )


@pytest.mark.parametrize("case", range(len([*wrong()])))
def test_what_does_not_fit_is_refused(case: int) -> None:
    robot = Functions(MadeUp("quaternion"))
    build, words = [*wrong()][case]
    with pytest.raises(UsageError, match=words):
        build(robot, *robot.state())


def test_a_function_that_the_module_lacks_is_named_with_its_option(small: Path) -> None:
    robot = Functions(load(small))
    with pytest.raises(MissingFunctionError, match="--functions=default,gibbs"):
        robot.gibbs(*robot.state(), robot.velocities("a"))
    with pytest.raises(AttributeError, match="forward_dynamic"):
        _ = robot.forward_dynamic
