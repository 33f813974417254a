"""Slopes: the parts of derivatives of nodes, forward and backward.

The derivative of a node of shape S by a vector of n entries has the shape (*S, n); by coordinates
it is that by a displacement in the tangent space, and of coordinates it is a displacement.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from gibbs_codegen.arrays.nodes import (
    Call,
    Node,
    Space,
    Value,
    beside,
    choose,
    constant,
    cosine,
    elementary,
    join,
    reshaped,
    sine,
    transposed,
    zeros,
)
from gibbs_codegen.errors import UsageError
from gibbs_codegen.interface import FUNCTIONS, derivative
from gibbs_codegen.interface.rows import Kind

# Slopes of the elementary functions by their arguments, of their value y and these. Where two
# arguments of a minimum or maximum are equal, the second is taken.
ELEMENTARY_SLOPES: dict[str, Callable[..., Sequence[Value]]] = {
    "add": lambda y, a, b: (1.0, 1.0),
    "subtract": lambda y, a, b: (1.0, -1.0),
    "multiply": lambda y, a, b: (b, a),
    "divide": lambda y, a, b: (1.0 / b, -y / b),
    "minimum": lambda y, a, b: (choose(b, a, 1.0, 0.0), choose(b, a, 0.0, 1.0)),
    "maximum": lambda y, a, b: (choose(a, b, 1.0, 0.0), choose(a, b, 0.0, 1.0)),
    "absolute": lambda y, a: (elementary("copysign", 1.0, a),),
    "copysign": lambda y, a, b: (
        elementary("copysign", 1.0, a) * elementary("copysign", 1.0, b),
        0.0,
    ),
    "sqrt": lambda y, a: (0.5 / y,),
    "exp": lambda y, a: (y,),
    "sin": lambda y, a: (cosine(a),),
    "cos": lambda y, a: (-sine(a),),
    "arctan2": lambda y, a, b: (b / (a * a + b * b), -a / (a * a + b * b)),
    "choose": lambda y, a, b, c, d: (0.0, 0.0, choose(a, b, 1.0, 0.0), choose(a, b, 0.0, 1.0)),
}


# Functions whose derivative by q has a name of its own.
_JACOBIANS = {"centre_of_mass": "centre_of_mass_jacobian"}
_NO_SLOPE = (
    "a drive, or wheels: functions have derivatives along the velocities, but motions and steps "
    "have none, since coordinates have more directions"
)
# Functions that derivatives of a call are made of, the better ones first.
_KINDS: tuple[Kind, ...] = ("jacobian", "jvp")


def elementary_slopes(name: str, x: Node) -> list[Node]:
    """Slopes of an elementary function by its arguments, entry by entry."""
    slopes = ELEMENTARY_SLOPES[name](x, *x.arguments)
    return [slope if isinstance(slope, Node) else constant(slope) for slope in slopes]


def call_slopes(call: Call, x: Node, places: Sequence[int]) -> dict[int, Node]:
    """Derivatives of a call by its arguments at some places, which its function must have.

    They are what a function of the module gives with a matrix for each argument, or else, direction
    by direction, what one gives with products.
    """
    row = FUNCTIONS[call.name]
    value = row.outputs[call.output]
    if value.is_coordinates and call.functions.space.has_drive:
        raise UsageError(_NO_SLOPE)
    if row.kind == "vjp" and derivative(row.derivative_of, "hessian"):
        return _second_slopes(call, x, places)
    if row.kind == "jacobian" and not value.by:
        row = FUNCTIONS[row.derivative_of]  # What a function gives is there with its derivatives.
    if row.name in _JACOBIANS:
        return {0: call.functions.outputs(_JACOBIANS[row.name], *x.arguments)[0]}
    kinds = _KINDS if len(row.outputs) == 1 else _KINDS[:1]
    names = [name for kind in kinds if (name := derivative(row.name, kind))]
    fault = f"no function of a module gives derivatives of {row.name} by "
    if not names:
        raise UsageError(f"{fault}{row.arguments[places[0]]}")
    # Without any of them, the module says which option brings the first.
    name = next((name for name in names if name in call.functions.signatures), names[0])
    if FUNCTIONS[name].kind == "jvp":
        return {place: _by_products(call, x, place, name) for place in places}
    outputs = call.functions.outputs(name, *x.arguments)
    slopes = {
        row.arguments.index(output.by): slope
        for output, slope in zip(FUNCTIONS[name].outputs, outputs, strict=True)
        if output.by and (len(row.outputs) == 1 or output.name == f"{value.name}_d{output.by}")
    }
    if absent := [row.arguments[place] for place in places if place not in slopes]:
        raise UsageError(f"{fault}{absent[0]}")
    return {
        place: reshaped(slopes[place], (*x.tangent, math.prod(x.arguments[place].tangent)))
        for place in places
    }


def direct(call: Call) -> str:
    """The function of the module that gives products with directions; "" if others serve."""
    matrices, products = (derivative(call.name, kind) for kind in _KINDS)
    has = call.functions.signatures
    return products if products in has and matrices not in has else ""


def _by_products(call: Call, x: Node, place: int, name: str) -> Node:
    """The derivative by the argument at a place, from products with unit directions of it."""
    still = [zeros(*argument.tangent) for argument in x.arguments]
    rows = [zeros(0, *x.tangent)]
    for unit in np.eye(still[place].size):
        moved = constant(unit.reshape(still[place].shape))
        directions = [*still[:place], moved, *still[place + 1 :]]
        (product,) = call.functions.outputs(name, *x.arguments, *directions)
        rows.append(reshaped(product, (1, *x.tangent)))
    axes = (*range(1, len(x.tangent) + 1), 0)
    return transposed(join(*rows), axes)


def _second_slopes(call: Call, x: Node, places: Sequence[int]) -> dict[int, Node]:
    """Derivatives of a gradient of wᵀ f: second derivatives of f, and the first by the weights.

    Displacements one after the other differ from their sum by half their commutator, that of SE(3),
    along which the first derivative acts: so much a symmetric second derivative lacks.
    """
    function = FUNCTIONS[FUNCTIONS[call.name].derivative_of]
    *arguments, w = x.arguments
    (value,) = call.functions.outputs(function.name, *arguments)
    first = call_slopes(replace(call, name=function.name, output=0), value, [call.output])
    by_weights = first[call.output].transposed
    slopes = {place: by_weights for place in places if place == len(arguments)}
    if slopes.keys() == {*places}:
        return slopes
    name = derivative(function.name, "hessian")
    outputs = call.functions.outputs(name, *arguments, w)
    blocks = {y.name: block for y, block in zip(FUNCTIONS[name].outputs, outputs, strict=True)}
    if "hessian" in blocks:
        blocks = _split(blocks["hessian"], function.arguments, [y.tangent[0] for y in arguments])
    for place in {*places} - slopes.keys():
        row, column = function.arguments[call.output], function.arguments[place]
        if row + column in blocks:
            slopes[place] = blocks[row + column]
        elif column + row in blocks:
            slopes[place] = blocks[column + row].transposed
        else:
            slopes[place] = zeros(*x.tangent, arguments[place].tangent[0])
        if row == column and arguments[place].space and not call.functions.space.is_flat:
            slopes[place] = slopes[place] + _commutator(by_weights @ w, call.functions.space)
    return slopes


def _split(whole: Node, names: Sequence[str], sizes: Sequence[int]) -> dict[str, Node]:
    """Blocks of a symmetric matrix, on its diagonal and above, by the names of rows and columns."""
    places, blocks = np.cumsum([0, *sizes]).tolist(), {}
    for i, row in enumerate(names):
        rows = whole[places[i] : places[i + 1]].transposed
        for j, column in enumerate(names[i:], start=i):
            blocks[row + column] = rows[places[j] : places[j + 1]].transposed
    return blocks


def _commutator(gradient: Node, space: Space) -> Node:
    """Half the commutator of displacements (nv, nv), the second in columns, along a gradient."""
    if space.has_drive:  # The gradient sideways, which is zero of dynamics on level ground.
        return zeros(gradient.size, gradient.size)
    if space.travels:
        yaw, (by_x, by_y) = space.travels, np.zeros((2, gradient.size, gradient.size))
        by_x[yaw, 1] = by_y[0, yaw] = 0.5
        by_x[1, yaw] = by_y[yaw, 0] = -0.5
        return gradient[0] * constant(by_x) + gradient[1] * constant(by_y)
    linear, angular = (0.5 * _skew(gradient[k : k + 3]) for k in (0, 3))
    rest = gradient.size - 6
    rows = ((zeros(3, 3), linear, zeros(3, rest)), (linear, angular, zeros(3, rest)))
    return join(*(beside(*row) for row in rows), zeros(rest, gradient.size))


def _skew(x: Node) -> Node:
    """The matrix whose product with a vector (3) is the cross product of x (3) and that."""
    return _rows(((zeros(), -x[2], x[1]), (x[2], zeros(), -x[0]), (-x[1], x[0], zeros())))


def entries_slope(entries: Node, space: Space) -> Node | None:
    """Derivative of the entries of coordinates by displacements; None where they are the same."""
    if space.travels:
        return _level(entries, space, 1.0)
    if not space.has_quaternion:
        return None
    rotation, rates = _attitude(entries[3:7])
    return _diagonal(rotation, 0.5 * rates, space.velocities - 6)


def _level(entries: Node, space: Space, side: float) -> Node:
    """Rotation of the position of a level base by its yaw, back if `side` is -1; (nv, nv)."""
    if space.coordinates != space.velocities:
        raise UsageError(_NO_SLOPE)
    yaw, rest = entries[space.travels], np.eye(space.velocities)
    rest[:2, :2], turned = 0.0, np.zeros_like(rest)
    turned[:2, :2] = ((0.0, -side), (side, 0.0))
    plane = np.eye(space.velocities) - rest
    return cosine(yaw) * constant(plane) + sine(yaw) * constant(turned) + constant(rest)


def coordinates_slope(entries: Node, space: Space) -> Node | None:
    """Derivative of displacements by the entries of coordinates, which keep the unit length."""
    if space.travels:
        return _level(entries, space, -1.0)
    if not space.has_quaternion:
        return None
    rotation, rates = _attitude(entries[3:7])
    return _diagonal(rotation.transposed, 2.0 * rates.transposed, space.velocities - 6)


def _attitude(quaternion: Node) -> tuple[Node, Node]:
    """The rotation (3, 3) of a unit quaternion, and twice the rates (4, 3) of its entries."""
    x, y, z, w = (quaternion[i] for i in range(4))
    rotation = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )
    rates = ((w, -z, y), (z, w, -x), (-y, x, w), (-x, -y, -z))
    return _rows(rotation), _rows(rates)


def _rows(rows: Sequence[Sequence[Node]]) -> Node:
    """A matrix of its entries."""
    return join(*(reshaped(join(*row), (1, len(row))) for row in rows))


def _diagonal(position: Node, attitude: Node, joints: int) -> Node:
    """A matrix of blocks on the diagonal; the last block is the identity."""
    blocks = (position, attitude, constant(np.eye(joints)))
    width = sum(block.shape[1] for block in blocks)
    rows, first = [], 0
    for block in blocks:
        after = width - first - block.shape[1]
        columns = (zeros(first, block.shape[0]), block.transposed, zeros(after, block.shape[0]))
        rows.append(join(*columns).transposed)
        first += block.shape[1]
    return join(*rows)
