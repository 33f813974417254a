"""Straight-line functions, built by hand and drawn at random, and their values."""

from __future__ import annotations

import random
from collections.abc import Sequence

from hypothesis import strategies as st

from gibbs_codegen.program.nodes import (
    Call,
    Function,
    Name,
    Node,
    Number,
    Output,
    Product,
    Reciprocal,
    ScalarProgram,
    Statement,
    Sum,
    node_value,
)
from gibbs_codegen.program.trigonometry import GatheredFunction, cosine_name, sine_name

INPUTS = ("x", "y", "z")
CONSTANTS = ("p", "r")
X, Y, P = Name("x"), Name("y"), Name("p")
T1, T2, T3, T4 = (Name(f"t{i}") for i in range(1, 5))

Values = dict[str, float]


def sine(argument: Node) -> Call:
    return Call("sin", argument)


def cosine(argument: Node) -> Call:
    return Call("cos", argument)


def function(statements: dict[str, Node], *entries: Node) -> Function:
    """A function of q with one vector for output."""
    rows = tuple(Statement(name, value) for name, value in statements.items())
    return Function("f", ("q",), CONSTANTS, rows, (Output((len(entries),), entries),))


def sum_of(*terms: Node) -> Sum:
    return Sum(tuple((1, term) for term in terms))


def random_function(seed: int, size: int) -> Function:
    """A straight-line function of `size` statements and up to two outputs.

    As in the functions of a robot, no angle depends on a sine or cosine.
    """
    rng = random.Random(seed)  # noqa: S311 - no secret
    known: list[Node] = [Name(name) for name in (*INPUTS, *CONSTANTS)]
    angles = list(known)
    statements = []
    for i in range(size):
        name = Name(f"t{i}")
        if rng.random() < 0.3:
            value: Node = _random_sum(rng, angles)
            angles.append(name)
        else:
            value = _random_node(rng, known, angles)
        statements.append(Statement(name.name, value))
        known.append(name)
    outputs = []
    for _ in range(rng.randrange(3)):
        entries = [
            Number(0.0) if rng.random() < 0.2 else _random_node(rng, known, angles)
            for _ in range(rng.randrange(1, 9))
        ]
        outputs.append(Output((len(entries),), tuple(entries)))
    return Function("f", ("q",), CONSTANTS, tuple(statements), tuple(outputs))


def _random_node(rng: random.Random, known: list[Node], angles: list[Node]) -> Node:
    """A node of any kind; reciprocals are of what is never zero."""
    angle = rng.choice(angles) if rng.random() < 0.5 else _random_sum(rng, angles)
    leaves = [*rng.choices(known, k=3), Number(2.0), Call(rng.choice(["sin", "cos"]), angle)]
    factors = [*leaves, Reciprocal(Name(rng.choice((*INPUTS, *CONSTANTS))))]
    product = Product(tuple(rng.sample(factors, rng.randrange(2, 4))))
    return rng.choice([*factors, product, product, _random_sum(rng, [*leaves, product])])


def _random_sum(rng: random.Random, terms: Sequence[Node]) -> Sum:
    chosen = rng.sample(terms, rng.randrange(1, 5))
    return Sum(tuple((rng.choice((1, -1)), term) for term in chosen))


def functions() -> st.SearchStrategy[Function]:
    """Random straight-line functions."""
    return st.builds(random_function, st.integers(0, 2**32 - 1), st.integers(0, 30))


def values() -> st.SearchStrategy[Values]:
    """Values of inputs and constants; none is zero, so that there are reciprocals."""
    number = st.floats(0.5, 2.0)
    return st.fixed_dictionaries(dict.fromkeys((*INPUTS, *CONSTANTS), number))


def evaluated(function: Function, at: Values) -> list[list[float]]:
    """Entries of each output, by the program's own interpreter."""
    program = ScalarProgram({"q": INPUTS}, CONSTANTS, CONSTANTS, (), (function,))
    parameters = {name: at[name] for name in CONSTANTS}
    return program.evaluate("f", parameters, {"q": [at[name] for name in INPUTS]})


def sines_added(parts: GatheredFunction, at: Values) -> Values:
    """`at`, with the sines and cosines under their names; nothing else of the angles is kept."""
    with_angles = dict(at)
    for statement in parts.angle_statements:
        with_angles[statement.name] = node_value(statement.value, with_angles)
    made = dict(at)
    for i, angle in enumerate(parts.angles):
        made[sine_name(i)] = node_value(sine(angle), with_angles)
        made[cosine_name(i)] = node_value(cosine(angle), with_angles)
    return made


def evaluated_in_parts(parts: GatheredFunction, at: Values) -> list[list[float]]:
    """Entries of each output, angles first, then their sines and cosines, then the rest."""
    made = sines_added(parts, at)
    for statement in parts.statements:
        made[statement.name] = node_value(statement.value, made)
    return [[node_value(entry, made) for entry in output.entries] for output in parts.outputs]
