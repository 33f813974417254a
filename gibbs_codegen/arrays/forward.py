"""Forward derivatives: a program's results and their matrices by some of its inputs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from gibbs_codegen.arrays import nodes
from gibbs_codegen.arrays.labels import label
from gibbs_codegen.arrays.nodes import Label, Node, Program
from gibbs_codegen.arrays.slopes import (
    by_side,
    by_velocities,
    call_slopes,
    coordinates_slope,
    direct,
    elementary_slopes,
    entries_slope,
    narrowed,
)
from gibbs_codegen.errors import UsageError
from gibbs_codegen.interface import FUNCTIONS, derivative


def jacobian(program: Program, by: str | Iterable[str]) -> Program:
    """A program's results and their derivatives by some inputs.

    Args:
        program: The program.
        by: Names of inputs, or one name.

    Returns:
        A program of the same inputs whose outputs are those of the program and, for each of them
        and each input, `<output>_by_<input>`: the derivatives of each entry, in the last axis by
        the entries of the input. Derivatives by coordinates are by a displacement in the tangent
        space; derivatives of coordinates are displacements.

    Raises:
        UsageError: If a function that the program calls has no derivatives, or an input is unknown.
        MissingFunctionError: If the module was generated without the derivatives that it needs.
    """
    return _jacobian(program, program.chosen(by))


@lru_cache(maxsize=256)
def _jacobian(program: Program, by: tuple[str, ...]) -> Program:
    inputs = dict(zip(program.names, program.inputs, strict=True))
    outputs, labels = dict(program.outputs), dict(program.labels)
    for name in by:
        x = inputs[name]
        derivatives = _derivatives(program.nodes, {x: _units(x)})
        for output, x in program.outputs.items():
            shape = (*x.tangent, math.prod(inputs[name].tangent))
            outputs[f"{output}_by_{name}"] = derivatives.get(x) or nodes.zeros(*shape)
        called = [(x, output) for output, x in program.outputs.items()]
        for x, its in (*called, *((x, its.name) for x, its in program.labels.items())):
            if x in derivatives:
                label(labels, derivatives[x], Label(f"{its}_by_{name}"))
    return from_derivatives(
        Program(f"{program.name}_by_{'_'.join(by)}", program.inputs, outputs, labels)
    )


def from_derivatives(program: Program) -> Program:
    """The same, with values of a function from the call that gives its derivatives with them."""
    order = program.nodes
    names: dict[object, str] = {}
    for x in order:
        if isinstance(x.operation, nodes.Call):
            row = FUNCTIONS[x.operation.name]
            if row.kind == "jacobian" and not row.outputs[0].by:
                names[x.operation.functions, row.derivative_of, x.arguments] = row.name
    made: dict[Node, Node] = {}
    for x in order:
        operation = x.operation
        if isinstance(operation, nodes.Call):
            name = names.get((operation.functions, operation.name, x.arguments), operation.name)
            value = FUNCTIONS[operation.name].outputs[operation.output].name
            places = [output.name for output in FUNCTIONS[name].outputs]
            operation = replace(operation, name=name, output=places.index(value))
        arguments = [made[y] for y in x.arguments]
        made[x] = nodes.node(operation, arguments, x.shape, x.space, x.is_uniform)
    return replace(
        program,
        outputs={name: made[x] for name, x in program.outputs.items()},
        labels={made[x]: its for x, its in program.labels.items() if x in made},
    )


def along(program: Program, by: Iterable[str], name: str) -> Program:
    """Derivatives `<output>_dot` of a program's results along a direction `<input>_dot` of inputs.

    Its inputs are those of the program, then the directions of some, which are displacements in the
    tangent space. Functions of a module that give products with directions serve, if it has them.
    """
    inputs = dict(zip(program.names, program.inputs, strict=True))
    directions = {x: nodes.variable(f"{x}_dot", *inputs[x].tangent) for x in program.chosen(by)}
    columns = {inputs[x]: nodes.reshaped(y, (*y.shape, 1)) for x, y in directions.items()}
    outputs = {
        f"{output}_dot": nodes.reshaped(d, d.shape[:-1])
        for output, d in moved(program.outputs, columns).items()
    }
    inputs_and_directions = (*program.inputs, *directions.values())
    return from_derivatives(Program(name, inputs_and_directions, outputs, dict(program.labels)))


def moved(results: Mapping[str, Node], directions: Mapping[Node, Node]) -> dict[str, Node]:
    """Displacements (…, k) of results along k directions (…, k) of nodes of which they are made."""
    derivatives = _derivatives(nodes.ordered(results.values(), directions), {**directions})
    columns = next(iter(directions.values())).shape[-1]
    return {
        name: derivatives.get(x) or nodes.zeros(*x.tangent, columns) for name, x in results.items()
    }


def _units(x: Node) -> Node:
    """Unit directions of an input, in the last axis."""
    columns = math.prod(x.tangent)
    return nodes.reshaped(nodes.constant(np.eye(columns)), (*x.tangent, columns))


def _derivatives(order: Iterable[Node], derivatives: dict[Node, Node]) -> dict[Node, Node]:
    """Derivatives of all nodes that depend on some, from those of these themselves."""
    columns = next(iter(derivatives.values())).shape[-1]
    for x in order:
        inner = {place: derivatives[y] for place, y in enumerate(x.arguments) if y in derivatives}
        if inner and x not in derivatives:
            terms = [term for term in _terms(x, inner) if not nodes.is_all(term, 0.0)]
            if terms:
                derivatives[x] = sum(terms[1:], terms[0])
                assert derivatives[x].shape == (*x.tangent, columns)  # noqa: S101 - see `_terms`
    return derivatives


def _terms(x: Node, inner: dict[int, Node]) -> list[Node]:
    """The derivative of a node, in terms whose sum it is, given those of its arguments."""
    columns = next(iter(inner.values())).shape[-1]
    match x.operation:
        case nodes.Elementary(name):
            slopes = elementary_slopes(name, x)
            ones = nodes.constant(np.ones((*x.shape, columns)))  # Where arguments are repeated.
            return [
                _column(_spread(slopes[place], x)) * _aligned(d, x) * ones
                for place, d in inner.items()
            ]
        case nodes.Call() as call:
            if columns == 1 and (name := direct(call)):
                return [_product_with(call, name, x, inner), *_sideways(call, x, inner)]
            if columns == 1 and call.name == "frame_poses" and not _has_derivative(call):
                return [_poses_along(call, x, inner[0]), *_sideways(call, x, inner)]
            call_slope = call_slopes(call, x, [*inner])
            if call.name == "integrate" and not call.functions.space.has_drive:
                return [_moved(call_slope, inner)]
            return [_through(call_slope[place], d) for place, d in inner.items()]
        case nodes.Invocation(program, output):
            names = tuple(program.names[place] for place in inner)
            results = jacobian(program, names).results(*x.arguments)
            slopes_by = {place: results[f"{output}_by_{program.names[place]}"] for place in inner}
            return [_through(slopes_by[place], d) for place, d in inner.items()]
        case nodes.External():
            return _terms(nodes.formula_of(x), inner)
        case nodes.Contraction():
            return [_product_term(x, place, d) for place, d in inner.items()]
        case nodes.Solution():
            return [_solution_term(x, place, d) for place, d in inner.items()]
        case nodes.Joining():
            pieces = [
                inner.get(place) or nodes.zeros(*y.shape, columns)
                for place, y in enumerate(x.arguments)
            ]
            return [nodes.join(*pieces)]
        case _:
            return [_alone(x, next(iter(inner.values())))]


def _alone(x: Node, d: Node) -> Node:
    """The derivative of a node that rearranges its one argument, from that of the argument."""
    argument = x.arguments[0]
    match x.operation:
        case nodes.RowRange(begin, end):
            return nodes.part(d, begin, end)
        case nodes.Reshaping():
            return nodes.reshaped(d, (*x.shape, d.shape[-1]))
        case nodes.Transposition(axes):
            return nodes.transposed(d, (*axes, len(axes)))
        case nodes.Total(axes):
            return nodes.total(d, *axes)
        case nodes.Entries(space):
            slope = entries_slope(x, space)
        case nodes.Coordinates(space):
            slope = coordinates_slope(argument, space)
        case _:
            raise UsageError(f"{x} has no derivative")
    return d if slope is None else slope @ d


def _product_with(call: nodes.Call, name: str, x: Node, inner: dict[int, Node]) -> Node:
    """The derivative of a call along one direction, by the function that gives products."""
    directions = [
        narrowed(nodes.reshaped(inner[place], y.tangent), y)
        if place in inner
        else nodes.zeros(*by_velocities(y))
        for place, y in enumerate(x.arguments)
    ]
    (product,) = call.functions.outputs(name, *x.arguments, *directions)
    return nodes.reshaped(product, (*x.tangent, 1))


def _sideways(call: nodes.Call, x: Node, inner: dict[int, Node]) -> list[Node]:
    """The derivative of a call along the part of one direction that no velocity of a drive has."""
    if not call.functions.space.has_drive:
        return []
    moved = (place for place in inner if x.arguments[place].space)
    return [by_side(call, x, place) @ inner[place][1:2] for place in moved]


def _has_derivative(call: nodes.Call) -> bool:
    """True if the module has the derivatives of a function by matrices."""
    return derivative(call.name, "jacobian") in call.functions.signatures


def _poses_along(call: nodes.Call, x: Node, direction: Node) -> Node:
    """Poses move along a direction as they would at that velocity: twists take few operations."""
    move = narrowed(nodes.reshaped(direction, (direction.shape[0],)), x.arguments[0])
    (twists,) = call.functions.outputs("frame_velocities", *x.arguments, move)
    matrices = []
    for k in range(x.shape[0]):
        axes = x[k][:3].transposed
        columns = [nodes.cross(twists[k][3:], axes[j]) for j in range(3)]
        rows = [nodes.reshaped(y, (1, 3)) for y in (*columns, twists[k][:3])]
        matrix = nodes.join(nodes.join(*rows).transposed, nodes.zeros(1, 4))
        matrices.append(nodes.reshaped(matrix, (1, 4, 4)))
    return nodes.reshaped(nodes.join(*matrices), (*x.shape, 1))


def _moved(slopes: dict[int, Node], inner: dict[int, Node]) -> Node:
    """The derivative of coordinates with a quaternion that are displaced: joints move by sums."""
    base, joints = [], []
    for place, d in inner.items():
        rows = slopes[place][:6]
        turned = rows @ d
        if isinstance(turned.operation, nodes.Contraction):
            turned = rows.transposed[:6].transposed @ d[:6]
        base.append(turned)
        joints.append(d[6:])
    return nodes.join(sum(base[1:], base[0]), sum(joints[1:], joints[0]))


def _through(slope: Node, d: Node) -> Node:
    """A derivative by an argument, times that of the argument."""
    return slope @ nodes.reshaped(d, (slope.shape[-1], d.shape[-1]))


def _column(x: Node) -> Node:
    """The same with one more axis, of one entry."""
    return nodes.reshaped(x, (*x.shape, 1))


def _spread(x: Node, like: Node) -> Node:
    """A number with as many axes, of one entry, as an array has."""
    return nodes.reshaped(x, (1,) * len(like.shape)) if x.shape == () else x


def _aligned(d: Node, x: Node) -> Node:
    """The derivative of an argument with the axes of the node's."""
    axes = len(x.shape) + 1
    return nodes.reshaped(d, (*(1,) * (axes - len(d.shape)), *d.shape))


def _product_term(x: Node, place: int, d: Node) -> Node:
    """The derivative of a product by one of its factors."""
    matrix, other = x.arguments
    if place == 1:
        return matrix @ d
    # (..., n, k) to (..., k, n), times the other factor; then k goes to the end again.
    lead = len(matrix.shape) - 1
    turned = nodes.transposed(d, (*range(lead), lead + 1, lead)) @ other
    axes = (*range(lead), *range(lead + 1, len(turned.shape)), lead)
    return nodes.transposed(turned, axes)


def _solution_term(x: Node, place: int, d: Node) -> Node:
    """The derivative of x in A x = b: that of b, or -dA x in its place, divided by A."""
    matrix, _ = x.arguments
    columns = d.shape[-1]
    if place == 0:
        moved = nodes.transposed(d, (0, 2, 1)) @ x
        axes = (0, 2, 1) if len(moved.shape) == 3 else (0, 1)
        d = -nodes.transposed(moved, axes)
    rows = x.shape[0]
    flat = nodes.reshaped(d, (rows, d.size // rows))
    return nodes.reshaped(nodes.solve(matrix, flat), (*x.shape, columns))
