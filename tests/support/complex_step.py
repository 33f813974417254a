"""Exact derivatives of a program's functions, by a step along the imaginary axis (Squire & Trapp).

f(x + ih) = f(x) + ih f'(x) + O(h²): with h = 1e-30 nothing is subtracted, so nothing is lost.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping, Sequence

import numpy as np

from gibbs_codegen.program.nodes import Call, Function, Name, Node, Number, Product, Reciprocal, Sum

_STEP = 1e-30
_CALLS = {"sin": cmath.sin, "cos": cmath.cos, "sqrt": cmath.sqrt, "atan": cmath.atan}


def outputs(function: Function, values: Mapping[str, complex]) -> list[np.ndarray]:
    """Entries of each output of a function, given all that it reads."""
    found = dict(values)
    for statement in function.statements:
        found[statement.name] = _value(statement.value, found)
    return [np.array([_value(entry, found) for entry in o.entries]) for o in function.outputs]


def derivative(
    function: Function, values: Mapping[str, complex], change: Mapping[str, float]
) -> list[np.ndarray]:
    """What a change of some values, per unit, does to each output of a function."""
    moved = dict(values) | {name: values[name] + 1j * _STEP * d for name, d in change.items()}
    return [output.imag / _STEP for output in outputs(function, moved)]


def jacobian(
    function: Function, values: Mapping[str, complex], names: Sequence[str]
) -> list[np.ndarray]:
    """Derivatives of each output by some values: a row for each entry."""
    columns = [derivative(function, values, {name: 1.0}) for name in names]
    return [np.array(output).T for output in zip(*columns, strict=True)]


def _value(node: Node, values: Mapping[str, complex]) -> complex:
    match node:
        case Name(name):
            return values[name]
        case Number(value):
            return value
        case Sum(terms):
            return sum(sign * _value(term, values) for sign, term in terms)
        case Product(factors):
            return math.prod(_value(factor, values) for factor in factors)
        case Reciprocal(argument):
            return 1.0 / _value(argument, values)
        case Call(function, argument):
            return _CALLS[function](_value(argument, values))
