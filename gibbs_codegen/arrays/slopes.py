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
    Shape,
    Space,
    Value,
    absolute,
    beside,
    choose,
    constant,
    cosine,
    elementary,
    entries_of,
    join,
    maximum,
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
# Functions that tell places, which move with a base that a drive has moved sideways.
_PLACES = ("frame_poses", "centre_of_mass")
# The least half of an angle, rad, that divides.
_LEAST_ANGLE = 1e-9
# Functions that derivatives of a call are made of, the better ones first.
_KINDS: tuple[Kind, ...] = ("jacobian", "jvp")


def elementary_slopes(name: str, x: Node) -> list[Node]:
    """Slopes of an elementary function by its arguments, entry by entry."""
    slopes = ELEMENTARY_SLOPES[name](x, *x.arguments)
    return [slope if isinstance(slope, Node) else constant(slope) for slope in slopes]


def call_slopes(call: Call, x: Node, places: Sequence[int]) -> dict[int, Node]:
    """Derivatives of a call by its arguments at some places, which its function must have.

    With a drive the module has those along velocities, beside which others are put here.
    """
    slopes = _slopes_by_velocities(call, x, places)
    if not call.functions.space.has_drive:
        return slopes
    if x.space:
        return {place: _driven(x, place, slope) for place, slope in slopes.items()}
    return {
        place: _with_side(slope, by_side(call, x, place)) if x.arguments[place].space else slope
        for place, slope in slopes.items()
    }


def by_velocities(x: Node) -> Shape:
    """Shape of a displacement of a value along velocities, as the module's derivatives have it."""
    return (x.space.velocities,) if x.space else x.shape


def widened(bar: Node, x: Node) -> Node:
    """The gradient by displacements of an argument, from the module's, which is by velocities.

    Sideways it is zero: no function that has a gradient depends on the place.
    """
    return bar if bar.shape == x.tangent else join(bar[:1], zeros(1), bar[1:])


def narrowed(move: Node, x: Node) -> Node:
    """What of a displacement of an argument is along velocities."""
    return move if move.shape == by_velocities(x) else join(move[:1], move[2:])


def _with_side(slope: Node, side: Node) -> Node:
    """Derivatives (…, nd) by displacements: those along velocities (…, nv), and sideways (…, 1)."""
    last = len(slope.shape) - 1
    columns, side = (transposed(x, (last, *range(last))) for x in (slope, side))
    return transposed(join(columns[:1], side, columns[1:]), (*range(1, last + 1), 0))


def by_side(call: Call, x: Node, place: int) -> Node:
    """The derivative (…, 1) of a call as a base with a drive is displaced to its left."""
    row = FUNCTIONS[call.name]
    name, space = row.derivative_of or row.name, call.functions.space
    if row.needs == ("CONSTRAINTS",):
        raise UsageError(f"{name} has no derivatives with a drive: {call.functions.name} has one")
    if name == "difference":  # By the logarithm of the plane half the turn, of either end.
        return constant(np.eye(x.size, 1)) * reshaped(-0.5 * x[space.travels - 1], (1, 1))
    if name not in _PLACES:
        return zeros(*x.shape, 1)
    yaw = entries_of(x.arguments[place])[space.travels]
    left = reshaped(join(-sine(yaw), cosine(yaw), 0.0), (3, 1))
    if name == "centre_of_mass":
        return left
    pose = reshaped(join(beside(zeros(3, 3), left), zeros(1, 4)), (1, 4, 4, 1))
    return join(*[pose] * x.shape[0])


def _driven(x: Node, place: int, slope: Node) -> Node:
    """Derivative (nd, nd) or (nd, nv) of `integrate` where it moves ahead and turns, in the plane.

    The place before is seen from that after it. (1 − cos θ)/θ² is sinc²(θ/2)/2 of the turn θ.
    """
    step = x.arguments[1]
    ahead, turn = step[0], step[1]
    half = maximum(absolute(0.5 * turn), _LEAST_ANGLE)
    ratio = sine(half) / half
    bend, rest = 0.5 * ratio * ratio, zeros(step.size - 2)
    if place == 1:
        side = join(-bend * turn, bend * ahead, rest)
        return join(slope[:1], reshaped(side, (1, side.size)), slope[1:])
    side = join(-sine(turn), ahead * ratio * cosine(half), rest)
    column = join(sine(turn), cosine(turn), zeros(step.size - 1))
    rows = join(slope[:1], reshaped(side, (1, side.size)), slope[1:])
    return _with_side(rows, reshaped(column, (column.size, 1)))


def _slopes_by_velocities(call: Call, x: Node, places: Sequence[int]) -> dict[int, Node]:
    """Derivatives of a call by its arguments, of coordinates along velocities.

    They are what a function of the module gives with a matrix for each argument, or else, direction
    by direction, what one gives with products.
    """
    row = FUNCTIONS[call.name]
    value = row.outputs[call.output]
    if row.name == "coordinate_rates" and call.functions.space.travels:
        return _rates_slopes(call, x)
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
        place: reshaped(
            slopes[place], (*by_velocities(x), math.prod(by_velocities(x.arguments[place])))
        )
        for place in places
    }


def _rates_slopes(call: Call, x: Node) -> dict[int, Node]:
    """Derivatives of the rates of a level base, of joints and of wheels: linear in velocities."""
    q, v = x.arguments
    units = map(constant, np.eye(v.size))
    columns = [
        reshaped(call.functions.outputs(call.name, q, unit)[0], (1, x.size)) for unit in units
    ]
    turned = np.zeros((v.size, x.size, x.size))
    turned[call.functions.layout.v.attitude.start, [0, 1], [1, 0]] = -1.0, 1.0
    return {0: (constant(turned) @ x).transposed, 1: join(*columns).transposed}


def direct(call: Call) -> str:
    """The function of the module that gives products with directions; "" if others serve."""
    matrices, products = (derivative(call.name, kind) for kind in _KINDS)
    has = call.functions.signatures
    return products if products in has and matrices not in has else ""


def _by_products(call: Call, x: Node, place: int, name: str) -> Node:
    """The derivative by the argument at a place, from products with unit directions of it."""
    still = [zeros(*by_velocities(argument)) for argument in x.arguments]
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
    first = _slopes_by_velocities(replace(call, name=function.name, output=0), value, [call.output])
    by_weights = first[call.output].transposed
    slopes = {place: by_weights for place in places if place == len(arguments)}
    if slopes.keys() == {*places}:
        return slopes
    name = derivative(function.name, "hessian")
    outputs = call.functions.outputs(name, *arguments, w)
    blocks = {y.name: block for y, block in zip(FUNCTIONS[name].outputs, outputs, strict=True)}
    if "hessian" in blocks:
        blocks = _split(
            blocks["hessian"], function.arguments, [by_velocities(y)[0] for y in arguments]
        )
    for place in {*places} - slopes.keys():
        row, column = function.arguments[call.output], function.arguments[place]
        if row + column in blocks:
            slopes[place] = blocks[row + column]
        elif column + row in blocks:
            slopes[place] = blocks[column + row].transposed
        else:
            slopes[place] = zeros(*x.tangent, by_velocities(arguments[place])[0])
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
        shape = space.coordinates, space.displacements
        return _level(entries[space.travels], *shape, 1.0)
    if not space.has_quaternion:
        return None
    rotation, rates = _attitude(entries[3:7])
    return _diagonal(rotation, 0.5 * rates, space.velocities - 6)


def _level(yaw: Node, rows: int, columns: int, side: float) -> Node:
    """Rotation of the position of a level base by its yaw, back if `side` is -1."""
    rest = np.eye(rows, columns)
    rest[:2, :2], turned = 0.0, np.zeros_like(rest)
    turned[:2, :2] = ((0.0, -side), (side, 0.0))
    plane = np.eye(rows, columns) - rest
    return cosine(yaw) * constant(plane) + sine(yaw) * constant(turned) + constant(rest)


def coordinates_slope(entries: Node, space: Space) -> Node | None:
    """Derivative of displacements by the entries of coordinates, which keep the unit length."""
    if space.travels:
        shape = space.displacements, space.coordinates
        return _level(entries[space.travels], *shape, -1.0)
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
