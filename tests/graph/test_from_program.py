"""Array programs on the graph against the same programs evaluated with NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from gibbs_codegen.arrays import Node, Program, evaluate, variable
from gibbs_codegen.arrays.nodes import (
    absolute,
    choose,
    clip,
    copysign,
    join,
    reshaped,
    square_root,
    total,
)
from gibbs_codegen.graph.from_program import program_refs
from gibbs_codegen.graph.from_tape import ImportedTape
from gibbs_codegen.program.lower import Slice, lower
from gibbs_codegen.symbolic.tape import Stage, Tape

SIZES = {"q": 3, "v": 3}


def values(outcome: Node, states: list[dict[str, np.ndarray]]) -> list[list[float]]:
    """The entries of a node of q and v, of each state, as the graph of its program has them."""
    inputs = tuple(variable(name, size) for name, size in SIZES.items())
    tape = Tape()
    symbols = {
        name: [tape.symbol(f"{name}_{k}", Stage.MOTION) for k in range(size)]
        for name, size in SIZES.items()
    }
    imported = ImportedTape(tape)
    refs = {name: [imported.ref(x) for x in entries] for name, entries in symbols.items()}
    entries = program_refs(imported, Program("outcome", inputs, {"outcome": outcome}), refs)
    names = {name: tuple(x.name for x in entries) for name, entries in symbols.items()}
    piece = Slice("outcome", tuple(SIZES), (((len(entries),), tuple(entries)),))
    program = lower(imported, names, (), [piece])
    return [program.evaluate("outcome", {}, state)[0] for state in states]


def outcome() -> Node:
    """Every operation that the graph has, on q and v."""
    q, v = (variable(name, size) for name, size in SIZES.items())
    pieces = [
        clip(q, -0.5, v),
        choose(q, v, q * v, q - 2.0),
        copysign(1.5, q) / v,
        absolute(v)[1:],
        reshaped(square_root(absolute(q)), (3, 1))[2],
        total(q - v),
    ]
    return join(*pieces)


def test_every_operation_is_that_of_numpy() -> None:
    """With what is chosen on either side."""
    rng = np.random.default_rng(1)
    states = [{name: rng.normal(size=size) for name, size in SIZES.items()} for _ in range(20)]
    inputs = tuple(variable(name, size) for name, size in SIZES.items())
    program = Program("outcome", inputs, {"outcome": outcome()})
    for state, entries in zip(states, values(outcome(), states), strict=True):
        expected = evaluate(program, state, {})["outcome"]
        np.testing.assert_allclose(entries, expected, rtol=1e-14, atol=1e-15)


def test_a_product_of_matrices_is_refused() -> None:
    q, v = (variable(name, size) for name, size in SIZES.items())
    with pytest.raises(ValueError, match="the graph has no"):
        values(reshaped(q @ v, (1,)), [])
