"""Exact derivatives of what is on a tape, by steps along the imaginary axis (Squire and Trapp).

f(x + ih) = f(x) + ih·f'(x) + O(h²): with h = 1e-30 nothing is subtracted, so nothing is lost.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import sympy as sp

from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.symbolic.tape import Tape

_STEP = 1e-30
Values = dict[sp.Expr, Any]


def tape_values(tape: Tape, inputs: Mapping[sp.Expr, Any]) -> Values:
    """Values of all that is named on a tape, of its inputs' values, which may be arrays."""
    values: Values = dict(inputs)
    for name, expression in tape.statements.items():
        values[name] = _value(expression, values)
    return values


def inputs_at(symbolic: SymbolicRobot, point: dict[str, Any]) -> Values:
    """Values of all inputs of the tape: parameters, coordinates, velocities and inputs."""
    values: Values = dict.fromkeys(symbolic.tape.stages, 0.0)
    values |= {sp.Symbol(name): value for name, value in symbolic.parameters.defaults.items()}
    for name, numbers in point.items():
        values |= zip(getattr(symbolic, name), numbers, strict=True)
    return values


def stepped(point: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Entries of a point, each as an array of steps in several directions, which are columns."""
    return point[:, None] + 1j * _STEP * directions


def entries(values: Values, expressions: Sequence[sp.Expr]) -> np.ndarray:
    """Values of entries in one direction only, which are real."""
    found = [np.real(_value(expression, values)) for expression in expressions]
    return np.array([value if np.ndim(value) == 0 else value[0] for value in found])


def derivatives(values: Values, expressions: Sequence[sp.Expr], width: int) -> np.ndarray:
    """Derivatives of entries, a row for each, along all `width` directions."""
    found = [np.imag(_value(expression, values)) / _STEP for expression in expressions]
    return np.array([np.broadcast_to(value, width) for value in found])


def _value(expression: sp.Expr, values: Values) -> Any:
    if expression.is_Symbol:
        return values[expression]
    if expression.is_number:
        return float(expression)
    parts = [_value(part, values) for part in expression.args]
    if expression.is_Add:
        return sum(parts)
    if expression.is_Mul:
        product = parts[0]
        for part in parts[1:]:
            product = product * part
        return product
    if expression.is_Pow:
        return np.power(parts[0], parts[1])
    return getattr(np, expression.func.__name__)(parts[0])
