"""Programs in many digits, each value with a bound of what rounding makes of it.

The bound is that of a running error analysis (Higham, Accuracy and Stability of Numerical
Algorithms, § 3.3): every operation hands on the errors of its operands, to first order, and adds
one rounding of its own result. It holds for the statements as they are emitted, so it says what
they may lose, state by state, without anything that was observed put into it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mpmath

from gibbs_codegen.program.nodes import (
    Call,
    Function,
    Name,
    Node,
    Number,
    Product,
    Reciprocal,
    ScalarProgram,
    Sum,
)

# At the double nearest 90° the mass matrix has a condition number of 1e33 and more.
DIGITS = 110
# Roundings in a sine or cosine: 2 units in the last place in C, 4 in NumPy's batches.
SINE_COSINE_ROUNDINGS = 8
_ONE, _ZERO = mpmath.mpf(1), mpmath.mpf(0)


@dataclass(frozen=True)
class Bounded:
    """An exact value and how far off it may be computed, in roundings."""

    value: Any
    error: Any = _ZERO

    def __add__(self, other: Bounded) -> Bounded:
        total = self.value + other.value
        return Bounded(total, self.error + other.error + abs(total))

    def __mul__(self, other: Bounded) -> Bounded:
        product = self.value * other.value
        handed_on = self.error * abs(other.value) + other.error * abs(self.value)
        return Bounded(product, handed_on + abs(product))

    def inverse(self) -> Bounded:
        """1/x."""
        inverse = 1 / self.value
        return Bounded(inverse, self.error * inverse**2 + abs(inverse))

    def times(self, sign: int) -> Bounded:
        """The same with a sign, which costs no rounding."""
        return Bounded(sign * self.value, self.error)


Values = Mapping[str, Bounded]


def exact(numbers: Mapping[str, float]) -> dict[str, Bounded]:
    """Numbers that are what they are."""
    return {name: Bounded(mpmath.mpf(number)) for name, number in numbers.items()}


def prepared(
    program: ScalarProgram, parameters: Mapping[str, float], rounded: bool = False
) -> dict[str, Bounded]:
    """Parameters, which single precision has `rounded`, and what `prepare` makes of them."""
    values = exact(parameters)
    if rounded:
        values = {name: Bounded(p.value, abs(p.value)) for name, p in values.items()}
    for statement in program.prepare:
        values[statement.name] = _value(statement.value, values)
    return values


def evaluated(
    program: ScalarProgram,
    function: Function,
    constants: Values,
    state: Mapping[str, Sequence[float]],
) -> list[list[Bounded]]:
    """Entries of each output of a function at a state, given by argument."""
    values = dict(constants)
    for argument in function.arguments:
        values |= exact(dict(zip(program.inputs[argument], state[argument], strict=True)))
    for statement in function.statements:
        values[statement.name] = _value(statement.value, values)
    return [[_value(entry, values) for entry in output.entries] for output in function.outputs]


def accelerations(
    program: ScalarProgram,
    constants: Values,
    state: Mapping[str, Sequence[float]],
    wrenches: bool = False,
) -> list[Any]:
    """What M a = R + B u gives, solved in the coordinates themselves; with `wrenches` on frames."""
    (matrix,), (residual,), (inputs,) = (
        evaluated(program, program.function(name), constants, state)
        for name in ("mass_matrix", "residual", "input_matrix")
    )
    n, u = len(residual), state["u"]
    right = [
        residual[i].value
        + mpmath.fdot((inputs[i * len(u) + k].value, float(u[k])) for k in range(len(u)))
        for i in range(n)
    ]
    if wrenches:
        (forces,) = evaluated(program, program.function("wrench_forces"), constants, state)
        right = [entry + force.value for entry, force in zip(right, forces, strict=True)]
    rows = [[matrix[i * n + j].value for j in range(n)] for i in range(n)]
    return list(mpmath.lu_solve(mpmath.matrix(rows), mpmath.matrix(right)))


def _value(node: Node, values: Values) -> Bounded:
    match node:
        case Name(name):
            return values[name]
        case Number(number):
            # Sines and cosines of the robot file's angles, for one.
            return Bounded(mpmath.mpf(number), abs(mpmath.mpf(number)))
        case Sum(terms):
            sign, first = terms[0]
            total = _value(first, values).times(sign)
            for sign, term in terms[1:]:
                total += _value(term, values).times(sign)
            return total
        case Product(factors):
            product = _value(factors[0], values)
            for factor in factors[1:]:
                product *= _value(factor, values)
            return product
        case Reciprocal(argument):
            return _value(argument, values).inverse()
        case Call("sqrt", argument):
            square = _value(argument, values)
            root = mpmath.sqrt(square.value)
            return Bounded(root, square.error / (2 * root) + root)
        case Call(function, argument):
            angle = _value(argument, values)
            sine, cosine = mpmath.sin(angle.value), mpmath.cos(angle.value)
            found, slope = (sine, cosine) if function == "sin" else (cosine, sine)
            own = SINE_COSINE_ROUNDINGS * abs(found)
            return Bounded(found, angle.error * abs(slope) + own)
