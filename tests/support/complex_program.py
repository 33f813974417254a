"""Exact derivatives of a function of a program, by steps along the imaginary axis.

The imaginary part of f(x + ih) is h·f′(x) up to terms of h³, which are nothing for h = 1e-30, and
no difference of nearly equal numbers is taken.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce

import numpy as np

from gibbs_codegen.program.nodes import Call, Name, Node, Number, Product, Program, Reciprocal, Sum

_STEP = 1e-30
_FUNCTIONS = {"sin": np.sin, "cos": np.cos, "sqrt": np.sqrt, "atan": np.arctan}


def complex_step(
    program: Program,
    name: str,
    parameters: Mapping[str, float],
    arguments: Mapping[str, Sequence[float]],
    directions: Mapping[str, np.ndarray],
    output: int = 0,
) -> np.ndarray:
    """Derivatives of an output of a function, a row for each of its entries.

    Directions are a row for each entry of an argument, or of "parameters", and a column for each
    derivative; arguments without one stay as they are.
    """
    function = program.function(name)
    entries_of = {"parameters": program.parameters, **program.inputs}
    given = {"parameters": [parameters[entry] for entry in program.parameters], **arguments}
    values: dict[str, np.ndarray] = {}
    for argument in ("parameters", *function.arguments):
        for i, entry in enumerate(entries_of[argument]):
            along = directions[argument][i] if argument in directions else 0.0
            values[entry] = given[argument][i] + 1j * _STEP * np.asarray(along)
    for statement in (*program.prepare, *function.statements):
        values[statement.name] = _value(statement.value, values)
    entries = [_value(entry, values) for entry in function.outputs[output].entries]
    columns = next(iter(directions.values())).shape[1]
    return np.array([np.broadcast_to(entry, columns) for entry in entries]).imag / _STEP


def _value(node: Node, values: Mapping[str, np.ndarray]) -> np.ndarray:
    match node:
        case Name(name):
            return values[name]
        case Number(value):
            return np.asarray(value)
        case Sum(terms):
            return sum((sign * _value(term, values) for sign, term in terms), np.asarray(0.0))
        case Product(factors):
            return reduce(np.multiply, (_value(factor, values) for factor in factors))
        case Reciprocal(argument):
            return 1.0 / _value(argument, values)
        case Call(function, argument):
            return _FUNCTIONS[function](_value(argument, values))
