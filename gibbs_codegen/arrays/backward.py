"""Backward derivatives: the gradient of a weighted sum of a program's results by its inputs."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from gibbs_codegen.arrays import nodes
from gibbs_codegen.arrays.nodes import Node, Program, Shape
from gibbs_codegen.arrays.slopes import (
    call_slopes,
    coordinates_slope,
    elementary_slopes,
    entries_slope,
    widened,
)
from gibbs_codegen.errors import UsageError
from gibbs_codegen.interface import FUNCTIONS, derivative

# Functions in which no parameter occurs.
_WITHOUT_PARAMETERS = ("coordinate_rates", "integrate", "difference")


def gradient(program: Program, by: str | Iterable[str]) -> Program:
    """The gradient of a weighted sum of a program's results by some inputs.

    Args:
        program: The program.
        by: Names of inputs, or one name. `<owner>_parameters` are the parameters of an owner whose
            functions are called, as `robot_parameters`, in the order of the module's `PARAMETERS`.

    Returns:
        A program that takes the inputs and, for each result, its weights `<output>_bar`, and
        returns `<input>_bar` for each of the inputs. Weights of coordinates are of displacements,
        and gradients by coordinates by displacements in the tangent space.

    Raises:
        UsageError: If a function that the program calls has no derivatives, or an input is unknown.
        MissingFunctionError: If the module was generated without the derivatives that it needs.
    """
    names = (by,) if isinstance(by, str) else tuple(by)
    program.chosen([name for name in names if name not in _owners(program)])
    return _gradient(program, names)


@lru_cache(maxsize=256)
def _gradient(program: Program, by: tuple[str, ...]) -> Program:
    inputs = dict(zip(program.names, program.inputs, strict=True))
    weights = {
        name: nodes.variable(f"{name}_bar", *x.tangent) for name, x in program.outputs.items()
    }
    owners = frozenset(by) - frozenset(inputs)
    moving = _moving(program, {inputs[name] for name in by if name in inputs}, owners)
    weights_of: dict[Node | str, Node] = {}
    for name, x in program.outputs.items():
        if x in moving:
            _add(weights_of, x, weights[name])
    _collect(program, moving, owners, weights_of)
    outputs = {}
    for name in by:
        key = inputs.get(name, name)
        outputs[f"{name}_bar"] = weights_of.get(key) or nodes.zeros(
            *(inputs[name].tangent if name in inputs else _owners(program)[name])
        )
    name = f"{program.name}_gradient_by_{'_'.join(by)}"
    return Program(name, (*program.inputs, *weights.values()), outputs, program.labels)


@lru_cache(maxsize=256)
def _owners(program: Program) -> dict[str, Shape]:
    """Names of the parameters of all whose functions are called, and their shapes."""
    shapes: dict[str, Shape] = {}
    for x in program.nodes:
        match x.operation:
            case nodes.Call(functions):
                shapes[f"{functions.owner}_parameters"] = (functions.parameters,)
            case nodes.Invocation(inner):
                shapes |= _owners(inner)
    return shapes


def _moving(program: Program, by: set[Node], owners: frozenset[str]) -> set[Node]:
    """The nodes that depend on some inputs, or on parameters."""
    moving = set(by)
    for x in program.nodes:
        if _owned(x, owners) or any(argument in moving for argument in x.arguments):
            moving.add(x)
    return moving


def _owned(x: Node, owners: frozenset[str]) -> list[str]:
    """Those names of parameters on which a node itself depends."""
    match x.operation:
        case nodes.Call(functions):
            there: Collection[str] = (f"{functions.owner}_parameters",)
        case nodes.Invocation(program):
            there = _owners(program)
        case _:
            return []
    return [name for name in owners if name in there]


def _add(weights: dict[Node | str, Node], x: Node | str, weight: Node) -> None:
    """Add to the weights of a node, or of parameters."""
    weights[x] = weights[x] + weight if x in weights else weight


def _collect(
    program: Program, moving: set[Node], owners: frozenset[str], weights_of: dict[Node | str, Node]
) -> None:
    """The weights of all nodes, from the results to the inputs.

    What several results of one call pass on is asked once, where the first of them was made: then
    all that is made of any of them has been gone through.
    """
    siblings: dict[Any, list[Node]] = {}
    for x in program.nodes:
        siblings.setdefault(_origin(x), []).append(x)
    for x in reversed(program.nodes):
        results = siblings[_origin(x)]
        if x is not results[0] or x not in moving or not x.arguments:
            continue
        weights = {y: weights_of[y] for y in results if y in weights_of}
        places = [place for place, argument in enumerate(x.arguments) if argument in moving]
        for place, weight in _passed(x, weights, places, _owned(x, owners)) if weights else ():
            if not nodes.is_all(weight, 0.0):
                _add(weights_of, place if isinstance(place, str) else x.arguments[place], weight)


def _origin(x: Node) -> Any:
    """The call that a node is a result of; any other node is alone."""
    match x.operation:
        case nodes.Call(functions, name):
            return functions, name, x.arguments
        case nodes.Invocation(program):
            return program, x.arguments
    return x


def _passed(
    x: Node, weights: dict[Node, Node], places: list[int], parameters: Sequence[str] = ()
) -> Iterator[tuple[int | str, Node]]:
    """Weights for arguments and parameters from those of a node, or of the results of a call."""
    match x.operation:
        case nodes.Call() as call:
            for name in parameters:
                yield from ((name, _of_parameters(call, y, w)) for y, w in weights.items())
            if places:
                yield from _of_call(call, weights, places)
            return
        case nodes.Invocation(program):
            by_name = {
                name: weights[y]
                for name, y in program.results(*x.arguments).items()
                if y in weights
            }
            yield from _of_invocation(program, x.arguments, by_name, places, parameters)
            return
        case nodes.External():
            formula = nodes.formula_of(x)
            yield from _passed(formula, {formula: weights[x]}, places)
            return
    w = weights[x]
    arguments = x.arguments
    match x.operation:
        case nodes.Elementary(name):
            slopes = elementary_slopes(name, x)
            for place in places:
                yield place, _folded(slopes[place] * w, arguments[place].shape)
        case nodes.Contraction():
            for place in places:
                yield place, _of_product(w, arguments, place)
        case nodes.Solution():
            right = nodes.solve(arguments[0].transposed, w)
            if 1 in places:
                yield 1, right
            if 0 in places:
                columns = (x.shape[0], x.size // x.shape[0])
                yield 0, -(nodes.reshaped(right, columns) @ nodes.reshaped(x, columns).transposed)
        case nodes.Joining():
            first = 0
            for place, argument in enumerate(arguments):
                if place in places:
                    yield place, nodes.part(w, first, first + argument.shape[0])
                first += argument.shape[0]
        case _:
            yield 0, _of_rearranged(x, w)


def _of_rearranged(x: Node, w: Node) -> Node:
    """Weights of the one argument of an operation that rearranges it."""
    argument = x.arguments[0]
    match x.operation:
        case nodes.RowRange(begin, end):
            rest = argument.shape[1:]
            after = argument.shape[0] - end
            return nodes.join(nodes.zeros(begin, *rest), w, nodes.zeros(after, *rest))
        case nodes.Reshaping():
            return nodes.reshaped(w, argument.shape)
        case nodes.Transposition(axes):
            return nodes.transposed(w, tuple(axes.index(axis) for axis in range(len(axes))))
        case nodes.Total():
            return w * nodes.constant(np.ones(argument.shape))
        case nodes.Entries(space):
            slope = entries_slope(x, space)
        case nodes.Coordinates(space):
            slope = coordinates_slope(argument, space)
        case _:
            raise UsageError(f"{x} has no derivative")
    return w if slope is None else slope.transposed @ w


def _folded(w: Node, shape: nodes.Shape) -> Node:
    """Weights summed over the axes along which an argument was repeated."""
    if w.shape == shape:
        return w
    if shape == ():
        return nodes.total(w)
    axes = tuple(i for i, (a, b) in enumerate(zip(w.shape, shape, strict=True)) if a != b)
    return nodes.total(w, *axes)


def _of_product(w: Node, arguments: tuple[Node, ...], place: int) -> Node:
    """Weights of a factor."""
    matrix, other = arguments
    rows, inner = math.prod(matrix.shape[:-1]), matrix.shape[-1]
    columns = math.prod(other.shape[1:])
    weight = nodes.reshaped(w, (rows, columns))
    if place == 0:
        matrix_weight = weight @ nodes.reshaped(other, (inner, columns)).transposed
        return nodes.reshaped(matrix_weight, matrix.shape)
    matrix_weight = nodes.reshaped(matrix, (rows, inner)).transposed @ weight
    return nodes.reshaped(matrix_weight, other.shape)


def _of_call(
    call: nodes.Call, weights: dict[Node, Node], places: list[int]
) -> Iterator[tuple[int, Node]]:
    """Weights of the arguments of a call: by its function's gradient, or by its matrices."""
    row = FUNCTIONS[call.name]
    name = derivative(call.name, "vjp")
    for x, w in weights.items():
        if name in call.functions.signatures and len(row.outputs) == 1:
            bars = call.functions.outputs(name, *x.arguments, w)
            for output, bar in zip(FUNCTIONS[name].outputs, bars, strict=True):
                place = row.arguments.index(output.name.removesuffix("_bar"))
                if place in places:
                    yield place, widened(bar, x.arguments[place])
            continue
        # Weights are of any of its outputs.
        callee = x.operation if isinstance(x.operation, nodes.Call) else call
        slopes = call_slopes(callee, x, places)
        for place in places:
            matrix = nodes.reshaped(slopes[place], (w.size, slopes[place].shape[-1]))
            bar = matrix.transposed @ nodes.reshaped(w, (w.size,))
            yield place, nodes.reshaped(bar, x.arguments[place].tangent)


def _of_parameters(call: nodes.Call, x: Node, w: Node) -> Node:
    """Weights of the parameters: by the function of the module that has their derivatives."""
    if call.name in _WITHOUT_PARAMETERS:
        return nodes.zeros(call.functions.parameters)
    name = derivative(call.name, "parameters")
    if not name:
        raise UsageError(f"no function of a module gives derivatives of {call.name} by parameters")
    row = FUNCTIONS[name]
    if len(row.arguments) > len(x.arguments):
        return call.functions.outputs(name, *x.arguments, w)[0]
    (matrix,) = call.functions.outputs(name, *x.arguments)
    return matrix.transposed @ w


def _of_invocation(
    program: Program,
    arguments: tuple[Node, ...],
    weights: dict[str, Node],
    places: list[int],
    parameters: Sequence[str],
) -> Iterator[tuple[int | str, Node]]:
    """Weights of the arguments of a program that was called, given those of its results."""
    bars = [weights.get(name) or nodes.zeros(*x.tangent) for name, x in program.outputs.items()]
    inner = gradient(program, (*(program.names[place] for place in places), *parameters))
    yield from zip((*places, *parameters), inner(*arguments, *bars), strict=True)
