"""Evaluation of array programs: with NumPy and JAX for any number of states, and with CasADi.

What a language does for each kind of node is one method. Arrays of NumPy and JAX have the states in
leading axes. CasADi has matrices only: there a value of more axes has its last axis in columns.
"""

from __future__ import annotations

import itertools
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from gibbs_codegen.arrays import nodes
from gibbs_codegen.arrays.nodes import Node, Program, Shape
from gibbs_codegen.errors import UsageError
from gibbs_codegen.interface import FUNCTIONS

# Modules by owner, whose functions compute calls.
Modules = Mapping[str, Any]
Externals = Mapping[str, Callable[..., Any]]


class Context(NamedTuple):
    """Values of a call beside inputs: constants by owner, and externals by name."""

    constants: Mapping[str, Any]
    externals: Externals


class Step(NamedTuple):
    """A function of nodes; what has one `key` is computed once, and one of its results `chosen`.

    A function that `takes_context` has that of the call as its first argument.
    """

    function: Callable[..., Any]
    reads: tuple[Node, ...]
    key: Any = None
    chosen: int | str | None = None
    takes_context: bool = False


class Evaluation:
    """The values of programs in one language; `evaluate` has its inputs.

    What each node reads, and what is done with it, is looked up once for each program. No text is
    made of it: text is never run here.
    """

    def __init__(self, modules: Modules) -> None:
        self.modules = modules
        self._prepared: dict[Program, Callable[..., dict[str, Any]]] = {}

    def program(
        self, program: Program, arguments: Sequence[Any], context: Context
    ) -> dict[str, Any]:
        """The outputs for arrays in the order of the inputs."""
        prepared = self._prepared.get(program)
        if prepared is None:
            prepared = self._prepared[program] = self._prepare(program)
        return prepared(context, *arguments)

    def _prepare(self, program: Program) -> Callable[..., dict[str, Any]]:
        """A function that takes the steps that outputs need, in an order in which they can be."""
        made: dict[Node, Step] = {}
        needed = {*program.outputs.values()}
        for x in reversed(program.nodes):
            if x in needed and x not in program.inputs:
                made[x] = self.step(x)
                needed.update(made[x].reads)
        # Values of a call stand in a row: what is given, inputs, and one for each step.
        places: dict[Any, int] = {x: place for place, x in enumerate(program.inputs, start=1)}
        steps: list[tuple[Callable[..., Any], Callable[..., Any], bool]] = []

        def take(function: Callable[..., Any], read: list[int]) -> int:
            # A getter takes one value as it is, several as a tuple.
            reads = operator.itemgetter(*read) if read else _nothing
            steps.append((function, reads, len(read) == 1))
            return len(program.inputs) + len(steps)

        for x in program.nodes:
            if x in made:
                function, reads, key, chosen, takes_context = made[x]
                if key is None or key not in places:
                    read = [*([0] if takes_context else []), *(places[y] for y in reads)]
                    places[x if key is None else key] = take(function, read)
                if chosen is not None:
                    places[x] = take(operator.itemgetter(chosen), [places[key]])
                elif key is not None:
                    places[x] = places[key]
        outputs = {name: places[x] for name, x in program.outputs.items()}

        def evaluated(context: Context, *arguments: Any) -> dict[str, Any]:
            values: list[Any] = [context, *arguments]
            for function, read, is_one in steps:
                values.append(function(read(values)) if is_one else function(*read(values)))
            return {name: values[place] for name, place in outputs.items()}

        return evaluated

    def step(self, x: Node) -> Step:
        """The step that computes the value of a node."""
        match x.operation:
            case nodes.Call(functions, name, output):
                module = _entry(self.modules, functions.owner, "module")
                function = _with_constants(self.function(module, name, x), functions.owner)
                chosen = output if len(FUNCTIONS[name].outputs) > 1 else None
                return Step(function, x.arguments, (functions, name, x.arguments), chosen, True)
            case nodes.Invocation(program, name):
                return self._invoked(program, name, x.arguments)
            case nodes.External(name):
                return Step(_external(name), x.arguments, takes_context=True)
            case nodes.Entries() | nodes.Coordinates():
                return Step(_same, x.arguments, x.arguments[0])
            case _:
                shapes = [argument.shape for argument in x.arguments]
                return Step(self.array(x, shapes), x.arguments)

    def _invoked(self, program: Program, name: str, arguments: tuple[Node, ...]) -> Step:
        """An output of a program within another, for which nothing is computed that it ignores."""
        inside = set(program.nodes)
        read = [x in inside for x in program.inputs]

        def function(context: Context, *values_read: Any) -> dict[str, Any]:
            values = iter(values_read)
            arguments = [next(values) if is_read else None for is_read in read]
            return self.program(program, arguments, context)

        reads = tuple(itertools.compress(arguments, read))
        return Step(function, reads, (program, arguments), name, True)

    def function(self, module: Any, name: str, x: Node) -> Callable[..., Any]:
        """A function of a module, of which a node is an output."""
        function: Callable[..., Any] = getattr(module, name)
        return function

    def array(self, x: Node, shapes: list[Shape]) -> Callable[..., Any]:
        """The function that computes a node that is no call, from such shapes."""
        raise NotImplementedError


def _with_constants(function: Callable[..., Any], owner: str) -> Callable[..., Any]:
    """A function of a module with the constants of an owner, or those of the robot file."""

    def called(context: Context, *arguments: Any) -> Any:
        constants = context.constants.get(owner)
        if constants is None:
            return function(*arguments)
        return function(*arguments, constants=constants)

    return called


def _external(name: str) -> Callable[..., Any]:
    """A function written by hand, as the caller gives it."""
    return lambda context, *arguments: _entry(context.externals, name, "external function")(
        *arguments
    )


def _entry(entries: Mapping[str, Any], name: str, kind: str) -> Any:
    """The caller's value under a name that the program has."""
    if name not in entries:
        raise UsageError(f"no {kind} is given for {name!r}")
    return entries[name]


def _same(x: Any) -> Any:
    return x


def _nothing(values: Sequence[Any]) -> tuple[()]:
    """The values that a constant reads."""
    return ()


# Functions of two arrays that Python has signs for.
_INFIX: dict[str, Callable[..., Any]] = {
    name: getattr(operator, of)
    for name, of in (
        ("add", "add"),
        ("subtract", "sub"),
        ("multiply", "mul"),
        ("divide", "truediv"),
    )
}


class _Batches(Evaluation):
    """Arrays with any leading axes, of NumPy or a library that speaks as NumPy does."""

    def __init__(self, xp: Any, modules: Modules) -> None:
        super().__init__(modules)
        self.xp = xp

    def array(self, x: Node, shapes: list[Shape]) -> Callable[..., Any]:
        xp = self.xp
        match x.operation:
            case nodes.Constant():
                numbers: Any = nodes.numbers_of(x)
                # JAX takes a number of Python in the precision of what is beside it.
                return lambda: xp.asarray(numbers if x.shape else numbers.item())
            case nodes.Elementary(name):
                function = _choice(xp) if name == "choose" else getattr(xp, name)
                lacking = [len(x.shape) - len(shape) for shape in shapes]
                if not any(lacking):
                    return _INFIX.get(name, function)
                return lambda *values: function(*map(_spread, values, lacking))
            case nodes.Contraction():
                left, right = shapes
                flat = (math.prod(left[:-1]), left[-1]), (right[0], math.prod(right[1:]))
                return lambda one, two: shaped(
                    shaped(one, left, flat[0]) @ shaped(two, right, flat[1]),
                    (flat[0][0], flat[1][1]),
                    x.shape,
                )
            case nodes.Solution():
                wide = (*shapes[1], 1)[:2]
                return lambda matrix, other: shaped(
                    xp.linalg.solve(matrix, shaped(other, shapes[1], wide)), wide, x.shape
                )
            case nodes.Transposition(order):

                def transposed(array: Any) -> Any:
                    lead = array.ndim - len(order)
                    return xp.transpose(array, (*range(lead), *(lead + axis for axis in order)))

                return transposed
            case nodes.Reshaping():
                return lambda entries: shaped(entries, shapes[0], x.shape)
            case nodes.RowRange(begin, end):
                rest = [slice(None)] * (len(x.shape) - 1)
                return operator.itemgetter((..., slice(begin, end), *rest))
            case nodes.Joining():

                def joined(*arrays: Any) -> Any:
                    lead = np.broadcast_shapes(*(a.shape[: a.ndim - len(x.shape)] for a in arrays))
                    full = [(*lead, *shape) for shape in shapes]
                    pieces = [xp.broadcast_to(a, f) for a, f in zip(arrays, full, strict=True)]
                    return xp.concatenate(pieces, -len(x.shape))

                return joined
            case nodes.Total(axes):
                summed = tuple(axis - len(x.shape) for axis in axes)
                return lambda terms: xp.sum(terms, summed, keepdims=True)
        raise UsageError(f"{x} is no node of an array program")


def _choice(xp: Any) -> Callable[..., Any]:
    """The third value where the first is greater than the second, or else the fourth."""
    return lambda a, b, above, otherwise: xp.where(a > b, above, otherwise)


def shaped(array: Any, shape: Shape, new: Shape) -> Any:
    """The same entries of every state in another shape."""
    return array.reshape((*array.shape[: array.ndim - len(shape)], *new))


def _spread(array: Any, lacking: int) -> Any:
    """An array of numbers beside arrays of more axes."""
    array = np.asarray(array) if isinstance(array, float | int) else array
    return array[(..., *[None] * lacking)] if lacking else array


class _SeveralStatesError(Exception):
    """A function of a module returned more than the values of one state."""


class _OneState(_Batches):
    """Arrays of NumPy without leading axes, of which much less is to be asked."""

    def step(self, x: Node) -> Step:
        step = super().step(x)
        match x.operation:
            case nodes.Reshaping() if not x.shape:
                whole, first = x.arguments[0], 0
                match whole.operation:
                    case nodes.RowRange(begin, _):
                        whole, first = whole.arguments[0], begin
                index = (first, *[0] * (len(whole.shape) - 1))
                return Step(operator.itemgetter(index), (whole,))
            case nodes.Joining() if len(x.shape) == 1:
                pieces = tuple(map(_number, x.arguments))
                return Step(_concatenated if any(y.shape for y in pieces) else _array_of, pieces)
        return step

    def function(self, module: Any, name: str, x: Node) -> Callable[..., Any]:
        match x.operation:
            case nodes.Call(functions, _, _):
                axes = [len(shape) for shape in functions.signatures[name].shapes]
                return _of_one_state(super().function(module, name, x), axes)
        raise UsageError(f"{x} is no call")

    def array(self, x: Node, shapes: list[Shape]) -> Callable[..., Any]:
        match x.operation:
            case nodes.Constant():
                numbers = np.asarray(nodes.numbers_of(x))[()]
                return lambda: numbers
            case nodes.Elementary(name) if name in _INFIX:
                return _INFIX[name]
            case nodes.Elementary(name) if name != "choose":
                return nodes.ELEMENTARY[name]
            case nodes.Contraction() if max(map(len, shapes)) < 3:
                return operator.matmul
            case nodes.Solution():
                return np.linalg.solve
            case nodes.RowRange(begin, end):
                return operator.itemgetter(slice(begin, end))
            case nodes.Joining():
                return lambda *arrays: np.concatenate(arrays)
            case nodes.Reshaping():
                return operator.methodcaller("reshape", x.shape)
        return super().array(x, shapes)


def _number(x: Node) -> Node:
    """A number that is a vector of one entry, as a number; other nodes as they are."""
    shaped = isinstance(x.operation, nodes.Reshaping) and x.arguments[0].shape == ()
    return x.arguments[0] if shaped else x


def _array_of(*numbers: Any) -> Any:
    return np.array(numbers)


def _concatenated(*pieces: Any) -> Any:
    """Numbers and vectors, one after the other."""
    return np.concatenate(pieces, axis=None)


def _of_one_state(function: Callable[..., Any], axes: Sequence[int]) -> Callable[..., Any]:
    """A function whose results have so many axes, or it refuses."""

    def checked(*values: Any, **named: Any) -> Any:
        results = function(*values, **named)
        for array, count in zip(results if len(axes) > 1 else (results,), axes, strict=True):
            if array.ndim != count:
                raise _SeveralStatesError
        return results

    return checked


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
        Arrays by the names of the outputs, with the leading axes of what they are made of: no axes
            where an output is constant or depends on inputs without axes.

    Raises:
        UsageError: If inputs, modules or externals are missing, or inputs are not of the shapes
            that the program has.
    """
    return Evaluator(program, modules, xp)(inputs, constants, externals)


class Evaluator:
    """A program that is evaluated again and again; `evaluate` has its inputs."""

    def __init__(self, program: Program, modules: Modules, xp: Any = np) -> None:
        self._program, self._xp = program, xp
        self._batches = _Batches(xp, modules)
        self._one = _OneState(xp, modules) if xp is np else None

    def __call__(
        self,
        inputs: Mapping[str, Any],
        constants: Mapping[str, Any] | None = None,
        externals: Externals | None = None,
    ) -> dict[str, Any]:
        """The outputs for arrays by the names of the inputs."""
        named = _inputs(self._program, inputs)
        arrays = [_array(self._xp, inputs, name, x) for name, x in named]
        context = Context(constants or {}, externals or {})
        axes = [len(x.shape) for x in self._program.inputs]
        if self._one is not None and all(x.ndim == n for x, n in zip(arrays, axes, strict=True)):
            try:
                return self._one.program(self._program, [x[()] for x in arrays], context)
            except _SeveralStatesError:
                pass  # Constants have leading axes.
        return self._batches.program(self._program, arrays, context)


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
        raise UsageError(f"{name} has the shape {array.shape}; its last axes must be {x.shape}")
    return array


class _Casadi(Evaluation):
    """Matrices of CasADi's MX: the last axis is in columns, all others are in rows."""

    def array(self, x: Node, shapes: list[Shape]) -> Callable[..., Any]:
        return lambda *values: self.value(x, shapes, values)

    def value(self, x: Node, shapes: list[Shape], values: Sequence[Any]) -> Any:
        """The value of a node that is no call."""
        import casadi

        rows, columns = _matrix(x.shape)
        match x.operation:
            case nodes.Constant(data):
                return casadi.DM(np.frombuffer(data).reshape(rows, columns))
            case nodes.Elementary(name):
                pairs = zip(values, shapes, strict=True)
                values = [a if a.is_scalar() else _spread_rows(a, s, x.shape) for a, s in pairs]
                return _CASADI[name](casadi)(*values)
            case nodes.Contraction():
                left, right = shapes
                one = _row_major(values[0], math.prod(left[:-1]), left[-1])
                two = _row_major(values[1], right[0], math.prod(right[1:]))
                return _row_major(casadi.mtimes(one, two), rows, columns)
            case nodes.Solution():
                return casadi.solve(*values)
            case nodes.Transposition(axes):
                places = np.arange(x.size).reshape(shapes[0]).transpose(axes)
                return _gathered(values[0], places, rows, columns)
            case nodes.Reshaping():
                return _row_major(values[0], rows, columns)
            case nodes.RowRange(begin, end):
                width = math.prod(shapes[0][1:-1])
                return values[0][begin * width : end * width, :]
            case nodes.Joining():
                return casadi.vertcat(*values)
            case nodes.Total(axes):
                places = np.arange(values[0].numel()).reshape(shapes[0])
                places = np.moveaxis(places, axes, range(-len(axes), 0)).reshape(x.size, -1)
                summed = casadi.sum2(_gathered(values[0], places, *places.shape))
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
    return _Casadi(modules).program(program, values, Context(constants or {}, externals or {}))
