"""Evaluation of array programs: with NumPy and JAX for any number of states, and with CasADi.

What a language does for each kind of node is one method. Arrays of NumPy and JAX have the states in
leading axes. CasADi has matrices only: there a value of more axes has its last axis in columns.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from gibbs_codegen.arrays import nodes
from gibbs_codegen.arrays.nodes import Node, Program, Shape
from gibbs_codegen.errors import UsageError
from gibbs_codegen.interface import FUNCTIONS

# What computes a function of a name from its arguments.
Modules = Mapping[str, Any]
Externals = Mapping[str, Callable[..., Any]]


class Evaluation:
    """The values of a program's nodes, in one language; see `evaluate` for what it is given."""

    def __init__(
        self, modules: Modules, constants: Mapping[str, Any] | None, externals: Externals | None
    ) -> None:
        self.modules = modules
        self.constants = constants or {}
        self.externals = externals or {}

    def program(self, program: Program, arguments: Sequence[Any]) -> dict[str, Any]:
        """The outputs for arrays in the order of the inputs."""
        found: dict[Node, Any] = dict(zip(program.inputs, arguments, strict=True))
        calls: dict[Any, Any] = {}
        for x in program.nodes:
            if x not in found:
                given = [found[argument] for argument in x.arguments]
                found[x] = self.value(x, given, calls)
        return {name: found[x] for name, x in program.outputs.items()}

    def value(self, x: Node, given: Sequence[Any], calls: dict[Any, Any]) -> Any:
        """The value of a node; `calls` keeps all outputs of what was called."""
        match x.operation:
            case nodes.Call(functions, name, output):
                key: Any = (functions, name, x.arguments)
                if key not in calls:
                    function = getattr(_given(self.modules, functions.owner, "module"), name)
                    constants = self.constants.get(functions.owner)
                    named = {} if constants is None else {"constants": constants}
                    calls[key] = function(*given, **named)
                return calls[key][output] if len(FUNCTIONS[name].outputs) > 1 else calls[key]
            case nodes.Invocation(program, name):
                key = (program, x.arguments)
                if key not in calls:
                    calls[key] = self.program(program, given)
                return calls[key][name]
            case nodes.External(name):
                return _given(self.externals, name, "external function")(*given)
            case nodes.Entries() | nodes.Coordinates():
                return given[0]
            case _:
                shapes = [argument.shape for argument in x.arguments]
                return self.array(x, shapes, given)

    def array(self, x: Node, shapes: list[Shape], given: Sequence[Any]) -> Any:
        """The value of a node that is no call."""
        raise NotImplementedError


def _given(things: Mapping[str, Any], name: str, what: str) -> Any:
    """What the caller gives under a name that the program has."""
    if name not in things:
        raise UsageError(f"no {what} is given for {name!r}")
    return things[name]


class _Batches(Evaluation):
    """Arrays with any leading axes, of NumPy or a library that speaks as NumPy does."""

    def __init__(self, xp: Any, *others: Any) -> None:
        super().__init__(*others)
        self.xp = xp

    def array(self, x: Node, shapes: list[Shape], given: Sequence[Any]) -> Any:
        xp = self.xp
        match x.operation:
            case nodes.Constant():
                return xp.asarray(nodes.numbers_of(x))
            case nodes.Elementary(name):
                function = xp.where if name == "choose" else getattr(xp, name)
                axes = (len(shape) for shape in shapes)
                given = [_spread(a, n, len(x.shape)) for a, n in zip(given, axes, strict=True)]
                if name == "choose":
                    given = [given[0] > given[1], *given[2:]]
                return function(*given)
            case nodes.Product():
                left, right = shapes
                one = self._shaped(given[0], left, (math.prod(left[:-1]), left[-1]))
                two = self._shaped(given[1], right, (right[0], math.prod(right[1:])))
                return self._shaped(one @ two, (one.shape[-2], two.shape[-1]), x.shape)
            case nodes.Solution():
                right = (*shapes[1], 1)[:2]
                found = xp.linalg.solve(given[0], self._shaped(given[1], shapes[1], right))
                return self._shaped(found, right, x.shape)
            case nodes.Transposition(axes):
                lead = given[0].ndim - len(axes)
                return xp.transpose(given[0], (*range(lead), *(lead + axis for axis in axes)))
            case nodes.Reshaping():
                return self._shaped(given[0], shapes[0], x.shape)
            case nodes.Part(begin, end):
                return given[0][(..., slice(begin, end), *[slice(None)] * (len(x.shape) - 1))]
            case nodes.Joining():
                lead = np.broadcast_shapes(*(a.shape[: a.ndim - len(x.shape)] for a in given))
                full = [(*lead, *shape) for shape in shapes]
                pieces = [xp.broadcast_to(a, f) for a, f in zip(given, full, strict=True)]
                return xp.concatenate(pieces, -len(x.shape))
            case nodes.Total(axes):
                summed = tuple(axis - len(x.shape) for axis in axes)
                return xp.sum(given[0], summed, keepdims=True)
        raise UsageError(f"{x} is no node of an array program")

    def _shaped(self, array: Any, shape: Shape, new: Shape) -> Any:
        """The same entries of every state in another shape."""
        return array.reshape((*array.shape[: array.ndim - len(shape)], *new))


def _spread(array: Any, axes: int, wanted: int) -> Any:
    """An array of numbers beside arrays of more axes."""
    array = np.asarray(array) if isinstance(array, float | int) else array
    return array[(..., *[None] * (wanted - axes))] if axes < wanted else array


def evaluate(
    program: Program,
    inputs: Mapping[str, Any],
    modules: Modules,
    constants: Mapping[str, Any] | None = None,
    externals: Externals | None = None,
    xp: Any = np,
) -> dict[str, Any]:
    """The outputs of a program for any number of states, with NumPy or JAX.

    Args:
        program: The program.
        inputs: Arrays by the names of the inputs: the states in leading axes, which broadcast.
        modules: The module whose functions are called, by the name of each owner. With JAX they are
            loaded for JAX.
        constants: Constants by owner, from the module's `prepare`; those of the robot file if left
            out.
        externals: Functions by name for what is written by hand.
        xp: `numpy` or `jax.numpy`.

    Returns:
        Arrays by the names of the outputs, with the leading axes of what they are made of: none
        where an output is constant or made of inputs without.

    Raises:
        UsageError: If inputs, modules or externals are missing, or inputs are not of the shapes
            that the program has.
    """
    return _Batches(xp, modules, constants, externals).program(
        program, [_array(xp, inputs, name, x) for name, x in _inputs(program, inputs)]
    )


def _inputs(program: Program, inputs: Mapping[str, Any]) -> zip[tuple[str, Node]]:
    """Names and nodes of the inputs, all of which are there."""
    missing = [name for name in program.names if name not in inputs]
    if missing:
        raise UsageError(f"{program.name}: no value for {', '.join(missing)}")
    return zip(program.names, program.inputs, strict=True)


def _array(xp: Any, inputs: Mapping[str, Any], name: str, x: Node) -> Any:
    """An input, of whose axes the last are those of one state."""
    array = xp.asarray(inputs[name])
    if array.shape[array.ndim - len(x.shape) :] != x.shape or array.ndim < len(x.shape):
        raise UsageError(
            f"{name} has the shape {array.shape}, where {x.shape} should be the last axes"
        )
    return array


class _Casadi(Evaluation):
    """Matrices of CasADi's MX. Of more axes the last is in columns, the others are in rows."""

    def array(self, x: Node, shapes: list[Shape], given: Sequence[Any]) -> Any:
        import casadi

        rows, columns = _matrix(x.shape)
        match x.operation:
            case nodes.Constant(data):
                return casadi.MX(casadi.DM(np.frombuffer(data).reshape(rows, columns)))
            case nodes.Elementary(name):
                pairs = zip(given, shapes, strict=True)
                given = [a if a.is_scalar() else _spread_rows(a, s, x.shape) for a, s in pairs]
                return _CASADI[name](casadi)(*given)
            case nodes.Product():
                left, right = shapes
                one = _row_major(given[0], math.prod(left[:-1]), left[-1])
                two = _row_major(given[1], right[0], math.prod(right[1:]))
                return _row_major(casadi.mtimes(one, two), rows, columns)
            case nodes.Solution():
                return casadi.solve(*given)
            case nodes.Transposition(axes):
                places = np.arange(x.size).reshape(shapes[0]).transpose(axes)
                return _gathered(given[0], places, rows, columns)
            case nodes.Reshaping():
                return _row_major(given[0], rows, columns)
            case nodes.Part(begin, end):
                width = math.prod(shapes[0][1:-1])
                return given[0][begin * width : end * width, :]
            case nodes.Joining():
                return casadi.vertcat(*given)
            case nodes.Total(axes):
                places = np.arange(given[0].numel()).reshape(shapes[0])
                places = np.moveaxis(places, axes, range(-len(axes), 0)).reshape(x.size, -1)
                summed = casadi.sum2(_gathered(given[0], places, *places.shape))
                return _row_major(summed, rows, columns)
        raise UsageError(f"{x} is no node of an array program")


# Elementary functions of CasADi, where it has another name for them than NumPy.
_CASADI: dict[str, Callable[[Any], Callable[..., Any]]] = {
    name: operator.attrgetter(name) for name in nodes.ELEMENTARY
} | {
    "add": lambda _: operator.add,
    "subtract": lambda _: operator.sub,
    "multiply": lambda _: operator.mul,
    "divide": lambda _: operator.truediv,
    "minimum": operator.attrgetter("fmin"),
    "maximum": operator.attrgetter("fmax"),
    "absolute": operator.attrgetter("fabs"),
    "arctan2": operator.attrgetter("atan2"),
    "choose": lambda casadi: lambda a, b, *others: casadi.if_else(a > b, *others),
}


def _matrix(shape: Shape) -> tuple[int, int]:
    """Rows and columns that CasADi has for a shape."""
    return (math.prod(shape[:-1]), shape[-1]) if len(shape) > 1 else (math.prod(shape), 1)


def _row_major(matrix: Any, rows: int, columns: int) -> Any:
    """The entries of a matrix of CasADi, row by row, in another shape."""
    return matrix if matrix.shape == (rows, columns) else matrix.T.reshape((columns, rows)).T


def _gathered(matrix: Any, places: np.ndarray, rows: int, columns: int) -> Any:
    """Entries at places that count row by row."""
    return _row_major(matrix.T.reshape((-1, 1))[places.ravel().tolist()], rows, columns)


def _spread_rows(matrix: Any, shape: Shape, wanted: Shape) -> Any:
    """A matrix of CasADi whose axes of one entry are as long as wanted."""
    if shape == wanted:
        return matrix
    places = np.broadcast_to(np.arange(matrix.numel()).reshape(shape), wanted)
    return _gathered(matrix, places, *_matrix(wanted))


def evaluate_casadi(
    program: Program,
    inputs: Mapping[str, Any],
    modules: Modules,
    constants: Mapping[str, Any] | None = None,
    externals: Externals | None = None,
) -> dict[str, Any]:
    """The outputs of a program as CasADi's expressions.

    Args:
        program: The program.
        inputs: MX by the names of the inputs, of one state; vectors are columns.
        modules: The module, loaded for CasADi, whose functions are called, by owner.
        constants: Constants by owner, from the module's `prepare`; those of the robot file if left
            out.
        externals: Functions by name for what is written by hand.

    Returns:
        MX by the names of the outputs; of more than two axes the last is in columns.

    Raises:
        UsageError: If inputs, modules or externals are missing.
    """
    values = [inputs[name] for name, _ in _inputs(program, inputs)]
    return _Casadi(modules, constants, externals).program(program, values)
