"""The nodes of array programs: how a value of one state is made of others.

A node is made once: asking for the same again gives the same object, so that common subexpressions
are found as they are written. Shapes are checked when a node is made, and what is zero or one is
left out. Coordinates are a type of their own beside plain vectors, since their derivatives are
displacements in the tangent space: `entries_of` and `coordinates_of` go between both. A value that
all states share, as a gain, is uniform.

    x = variable("x", 3)
    y = 2.0 * x[:2]

is `Node(Elementary("multiply"), (constant(2.0), Node(Part(0, 2), (x,), (2,))), (2,))`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from threading import Lock
from typing import Any, NamedTuple, TypeAlias
from weakref import WeakValueDictionary

import numpy as np

from gibbs_codegen.errors import UsageError
from gibbs_codegen.robot.layout import Layout

Shape = tuple[int, ...]
# A node, or numbers.
Value: TypeAlias = "Node | float | np.ndarray"


@dataclass(frozen=True)
class Space:
    """The space of a robot's coordinates: how many entries they have, and displacements of them.

    With a quaternion coordinates begin with the base's position (3) and the quaternion (4), and
    displacements with the linear (3) and the angular (3) one, in the base's axes. Of a base that
    stays level they begin with `travels` of its position, and then the yaw, and displacements with
    as many, along and about its axes; with a drive the second, sideways, is none of the velocities.
    All others are sums of entry and displacement. Angles of wheels at the end have no displacements
    of their own: what is on a wheel apart, nothing depends on them.
    """

    coordinates: int
    velocities: int
    travels: int = 0
    has_drive: bool = False

    @classmethod
    def of(cls, layout: Layout) -> Space:
        """The space of a robot's coordinates by their layout."""
        level = layout.turns_with_base and not layout.is_quaternion
        travels = range(layout.q.size)[layout.q.position]
        drive = layout.v.size < layout.q.size - layout.q.wheels
        return cls(layout.q.size, layout.v.size, len(travels) if level else 0, level and drive)

    @property
    def displacements(self) -> int:
        """Number of directions in which coordinates are displaced."""
        return self.velocities + self.has_drive

    @property
    def is_flat(self) -> bool:
        """True if displacements are differences of entries."""
        return not (self.has_quaternion or self.travels)

    @property
    def has_quaternion(self) -> bool:
        """True if entries of the attitude and of its displacements differ."""
        return self.coordinates != self.velocities and not self.travels


@dataclass(frozen=True)
class Input:
    """An argument of a program, by its name."""

    name: str


@dataclass(frozen=True)
class Constant:
    """Numbers, as the bytes of doubles."""

    data: bytes


@dataclass(frozen=True)
class Call:
    """An output of a function of a module, `owner` being whose parameters it is called with."""

    functions: Any
    name: str
    output: int


@dataclass(frozen=True)
class Invocation:
    """An output of another program, which stays a program: it is derived and printed once."""

    program: Program
    output: str


@dataclass(frozen=True)
class External:
    """A function written by hand in every language.

    `formula` gives, for its size, a program of its arguments and its result whose value is the
    result, and whose derivatives by the arguments are its own; None where it has no derivatives.
    """

    name: str
    formula: Callable[[int], Program] | None = None


@dataclass(frozen=True)
class Elementary:
    """A function of numbers, entry by entry; axes of one entry and numbers go with any others."""

    name: str


@dataclass(frozen=True)
class Contraction:
    """The sum over the last axis of the first and the first axis of the second argument."""


@dataclass(frozen=True)
class Solution:
    """The inverse of a matrix times a vector or matrix."""


@dataclass(frozen=True)
class Transposition:
    """The same entries with axes in another order."""

    axes: tuple[int, ...]


@dataclass(frozen=True)
class Reshaping:
    """The same entries, row by row, in another shape."""


@dataclass(frozen=True)
class RowRange:
    """Entries or rows from one to another, along the first axis."""

    begin: int
    end: int


@dataclass(frozen=True)
class Joining:
    """Vectors, or arrays along their first axis, one after the other."""


@dataclass(frozen=True)
class Total:
    """The sum over some axes, which are kept with one entry."""

    axes: tuple[int, ...]


@dataclass(frozen=True)
class Entries:
    """The entries of coordinates, as a plain vector."""

    space: Space


@dataclass(frozen=True)
class Coordinates:
    """Coordinates with these entries, of which a quaternion has unit length."""

    space: Space


Operation = (
    Input | Constant | Call | Invocation | External | Elementary | Contraction | Solution
    | Transposition | Reshaping | RowRange | Joining | Total | Entries | Coordinates
)  # fmt: skip
_NODES: WeakValueDictionary[Any, Node] = WeakValueDictionary()
_LOCK = Lock()


@dataclass(frozen=True, eq=False, repr=False)
class Node:
    """A value of one state: an operation on the values of other nodes.

    Arithmetic operators are entry by entry, `@` is the product of a matrix, and a slice takes
    entries of a vector or rows of a matrix. Coordinates have a `space`.
    """

    operation: Operation
    arguments: tuple[Node, ...]
    shape: Shape
    space: Space | None = None
    is_uniform: bool = False

    __array_ufunc__ = None  # NumPy's arrays leave operators to the node beside them.

    def __repr__(self) -> str:
        """Operation and shape."""
        return f"<{self.operation} {self.shape}>"

    def __reduce__(self) -> tuple[Any, ...]:
        # A copy is the node that there is.
        return node, (self.operation, self.arguments, self.shape, self.space, self.is_uniform)

    @property
    def size(self) -> int:
        """Number of entries."""
        return math.prod(self.shape)

    @property
    def tangent(self) -> Shape:
        """Shape of a displacement of the value."""
        return (self.space.displacements,) if self.space else self.shape

    @property
    def transposed(self) -> Node:
        """A matrix with rows and columns exchanged."""
        return transposed(self, (1, 0))

    def __getitem__(self, rows: slice | int) -> Node:
        if not self.shape:
            raise UsageError("a number has no parts")
        selected = range(self.shape[0])[rows]
        if isinstance(selected, int):
            return reshaped(part(self, selected, selected + 1), self.shape[1:])
        if selected.step != 1:
            raise UsageError("a part of an array has its entries side by side")
        return part(self, selected.start, selected.start + len(selected))

    def __iter__(self) -> Iterator[Node]:
        return map(self.__getitem__, range(self.shape[0] if self.shape else 1))

    def __add__(self, other: Value) -> Node:
        return elementary("add", self, other)

    __radd__ = __add__

    def __sub__(self, other: Value) -> Node:
        return elementary("subtract", self, other)

    def __rsub__(self, other: Value) -> Node:
        return elementary("subtract", other, self)

    def __mul__(self, other: Value) -> Node:
        return elementary("multiply", self, other)

    __rmul__ = __mul__

    def __truediv__(self, other: Value) -> Node:
        return elementary("divide", self, other)

    def __rtruediv__(self, other: Value) -> Node:
        return elementary("divide", other, self)

    def __neg__(self) -> Node:
        return elementary("multiply", -1.0, self)

    def __matmul__(self, other: Value) -> Node:
        return product(self, other)

    def __rmatmul__(self, other: Value) -> Node:
        return product(other, self)


def node(
    operation: Operation,
    arguments: Iterable[Node],
    shape: Shape,
    space: Space | None = None,
    is_uniform: bool | None = None,
) -> Node:
    """The node of an operation, made where there is none; uniform where its arguments are."""
    arguments = tuple(arguments)
    uniform = all(x.is_uniform for x in arguments) if is_uniform is None else is_uniform
    key = (operation, tuple(map(id, arguments)), shape, space, uniform)
    with _LOCK:
        known_node = _NODES.get(key)
        if known_node is None:
            known_node = _NODES[key] = Node(operation, arguments, shape, space, uniform)
    return known_node


def variable(name: str, *shape: int, uniform: bool = False, space: Space | None = None) -> Node:
    """An input of a program, of each state or the same for all of them.

    Args:
        name: Name by which it is given.
        shape: Its axes; a number has none.
        uniform: Whether all states share it.
        space: The space of coordinates, if it is a robot's coordinates.

    Returns:
        The node.
    """
    return node(Input(name), (), shape, space, uniform)


def constant(values: Any) -> Node:
    """Numbers that are part of a program."""
    array = np.array(values, dtype=np.float64, order="C")
    return node(Constant(array.tobytes()), (), array.shape)


def numbers_of(x: Node) -> np.ndarray | None:
    """The numbers of a constant; None of any other node."""
    if isinstance(x.operation, Constant):
        return np.frombuffer(x.operation.data).reshape(x.shape)
    return None


def _all_numbers(arguments: Sequence[Node]) -> list[np.ndarray] | None:
    """The numbers of all arguments, if all are constants."""
    constants = [numbers for x in arguments if (numbers := numbers_of(x)) is not None]
    return constants if len(constants) == len(arguments) else None


def is_all(x: Node, value: float) -> bool:
    """True if a node is a constant of which every entry is a value."""
    numbers = numbers_of(x)
    return numbers is not None and bool(np.all(numbers == value))


def diagonal_of(x: Node) -> tuple[int, float] | None:
    """In which column the diagonal of a constant matrix begins, and its value; None of others."""
    numbers = numbers_of(x)
    if numbers is None or len(x.shape) != 2 or not x.size:
        return None
    shift = int(abs(numbers[0]).argmax())
    value = float(numbers[0, shift])
    return (shift, value) if np.array_equal(numbers, value * np.eye(*x.shape, shift)) else None


def _is_identity(x: Node) -> bool:
    """True if a node is a constant that is the identity matrix."""
    return diagonal_of(x) == (0, 1.0) and x.shape[0] == x.shape[1]


def zeros(*shape: int) -> Node:
    """Zeros of a shape."""
    return constant(np.zeros(shape))


def elementary(name: str, *values: Value) -> Node:
    """A function of numbers of every entry; coordinates must be taken apart before."""
    if any(isinstance(x, Node) and x.space for x in values):
        raise UsageError(
            f"{name}: coordinates are no vectors; their differences are displacements, which "
            "difference gives, and entries_of gives their entries"
        )
    arguments = [entries_of(x) for x in values]
    shapes = [x.shape for x in arguments]
    axes = {len(shape) for shape in shapes} - {0}
    try:
        shape = np.broadcast_shapes(*shapes) if len(axes) < 2 else None
    except ValueError:
        shape = None
    if shape is None:
        raise UsageError(f"{name}: the shapes {' and '.join(map(str, shapes))} do not go together")
    numbers = _all_numbers(arguments)
    if numbers is not None:
        with np.errstate(all="ignore"):
            return constant(ELEMENTARY[name](*numbers))
    return _simpler(name, arguments, shape) or node(Elementary(name), arguments, shape)


def _simpler(name: str, arguments: Sequence[Node], shape: Shape) -> Node | None:
    """The simpler form of an elementary function where an argument is zero or one, or None."""
    if name not in ("add", "subtract", "multiply", "divide"):
        return None
    one, two = arguments
    kept = None
    if name == "add" and _is_negated(two):
        return elementary("subtract", one, two.arguments[1])
    if name in ("multiply", "divide") and is_all(one, 0.0):
        return zeros(*shape)
    if name == "multiply" and is_all(two, 0.0):
        return zeros(*shape)
    if (name in ("add", "subtract") and is_all(two, 0.0)) or (
        name in ("multiply", "divide") and is_all(two, 1.0)
    ):
        kept = one
    elif (name == "add" and is_all(one, 0.0)) or (name == "multiply" and is_all(one, 1.0)):
        kept = two
    return kept if kept is not None and kept.shape == shape else None


def _is_negated(x: Node) -> bool:
    """True if a node is minus another of its shape."""
    if x.operation != Elementary("multiply"):
        return False
    factor, other = x.arguments
    return is_all(factor, -1.0) and other.shape == x.shape


def _choose(a: Any, b: Any, above: Any, otherwise: Any) -> Any:
    return np.where(a > b, above, otherwise)


# Elementary functions, for NumPy. JAX has all but the choice under these names.
ELEMENTARY: dict[str, Callable[..., Any]] = {
    "add": np.add,
    "subtract": np.subtract,
    "multiply": np.multiply,
    "divide": np.divide,
    "minimum": np.minimum,
    "maximum": np.maximum,
    "absolute": np.absolute,
    "copysign": np.copysign,
    "sqrt": np.sqrt,
    "exp": np.exp,
    "sin": np.sin,
    "cos": np.cos,
    "arctan2": np.arctan2,
    "choose": _choose,
}


def minimum(a: Value, b: Value) -> Node:
    """The lesser of two values, entry by entry."""
    return elementary("minimum", a, b)


def maximum(a: Value, b: Value) -> Node:
    """The greater of two values, entry by entry."""
    return elementary("maximum", a, b)


def clip(value: Node, lower: Value, upper: Value) -> Node:
    """A value within limits, entry by entry."""
    return maximum(minimum(value, upper), lower)


def choose(a: Value, b: Value, above: Value, otherwise: Value) -> Node:
    """The third value where the first is greater than the second, or else the fourth."""
    return elementary("choose", a, b, above, otherwise)


def absolute(a: Node) -> Node:
    """Magnitudes of the entries."""
    return elementary("absolute", a)


def copysign(a: Node | float, sign: Node | float) -> Node:
    """Magnitudes of entries with the signs of others."""
    return elementary("copysign", a, sign)


def square_root(a: Node) -> Node:
    """Square roots of the entries."""
    return elementary("sqrt", a)


def exponential(a: Node) -> Node:
    """Exponentials of the entries."""
    return elementary("exp", a)


def sine(a: Node) -> Node:
    """Sines of angles in rad."""
    return elementary("sin", a)


def cosine(a: Node) -> Node:
    """Cosines of angles in rad."""
    return elementary("cos", a)


def arctan2(a: Value, b: Value) -> Node:
    """Angle in rad of the vector (b, a) from the first axis."""
    return elementary("arctan2", a, b)


def product(matrix: Value, other: Value) -> Node:
    """A matrix (..., n) times a vector (n) or a matrix (n, ...)."""
    matrix, other = entries_of(matrix), entries_of(other)
    if not matrix.shape or not other.shape or matrix.shape[-1] != other.shape[0]:
        raise UsageError(f"product: {matrix.shape} does not go with {other.shape}")
    shape = (*matrix.shape[:-1], *other.shape[1:])
    if _is_identity(matrix):
        return other
    if _is_identity(other):
        return matrix
    if is_all(matrix, 0.0) or is_all(other, 0.0) or other.shape[0] == 0:
        return zeros(*shape)
    numbers = _all_numbers((matrix, other))
    if numbers is not None:
        return constant(np.tensordot(numbers[0], numbers[1], 1))
    for scaled, kept in ((matrix, other), (other, matrix)):
        scale = _scale_of(scaled)
        if scale is not None:
            return scale * kept
    return node(Contraction(), (matrix, other), shape)


def _scale_of(x: Node) -> Node | None:
    """The number that the identity matrix is multiplied by; None of what is another matrix."""
    if isinstance(x.operation, Elementary) and x.operation.name == "multiply":
        for scale, matrix in (x.arguments, x.arguments[::-1]):
            if scale.size == 1 and _is_identity(matrix):
                return reshaped(scale, ())
    return None


def solve(matrix: Value, right: Value) -> Node:
    """The inverse of a matrix (n, n) times a vector (n) or a matrix (n, k)."""
    matrix, right = entries_of(matrix), entries_of(right)
    if len(matrix.shape) != 2 or matrix.shape != right.shape[:1] * 2:
        raise UsageError(f"solve: {matrix.shape} does not go with {right.shape}")
    return (
        zeros(*right.shape)
        if is_all(right, 0.0)
        else node(Solution(), (matrix, right), right.shape)
    )


def transposed(x: Node, axes: tuple[int, ...]) -> Node:
    """The same entries with axes in another order."""
    x = entries_of(x)
    if axes == tuple(range(len(x.shape))):
        return x
    numbers = numbers_of(x)
    if numbers is not None:
        return constant(numbers.transpose(axes))
    if isinstance(x.operation, Transposition):
        return transposed(x.arguments[0], tuple(x.operation.axes[axis] for axis in axes))
    return node(Transposition(axes), (x,), tuple(x.shape[axis] for axis in axes))


def reshaped(x: Node, shape: Shape) -> Node:
    """The same entries, row by row, in another shape."""
    x = entries_of(x)
    if x.shape == shape:
        return x
    if math.prod(shape) != x.size:
        raise UsageError(f"{x.shape} has not the entries of {shape}")
    numbers = numbers_of(x)
    if numbers is not None:
        return constant(numbers.reshape(shape))
    if isinstance(x.operation, Reshaping):
        return reshaped(x.arguments[0], shape)
    return node(Reshaping(), (x,), shape)


def part(x: Node, begin: int, end: int) -> Node:
    """Entries of a vector, or rows of an array, from one to another."""
    x = entries_of(x)
    if (begin, end) == (0, x.shape[0]):
        return x
    numbers = numbers_of(x)
    if numbers is not None:
        return constant(numbers[begin:end])
    if isinstance(x.operation, RowRange):
        return part(x.arguments[0], x.operation.begin + begin, x.operation.begin + end)
    if isinstance(x.operation, Joining):
        first = 0
        for piece in x.arguments:
            if first <= begin and end <= first + piece.shape[0]:
                return part(piece, begin - first, end - first)
            first += piece.shape[0]
    return node(RowRange(begin, end), (x,), (end - begin, *x.shape[1:]))


def join(*pieces: Value) -> Node:
    """Numbers and vectors, or arrays along their first axis, one after the other."""
    parts = [reshaped(x, (1,)) if x.shape == () else x for x in map(entries_of, pieces)]
    rows = {x.shape[1:] for x in parts}
    if len(rows) != 1:
        raise UsageError(f"join: rows of {' and '.join(map(str, rows))} do not go together")
    parts = [x for x in parts if x.shape[0]] or parts[:1]
    if len(parts) == 1:
        return parts[0]
    numbers = _all_numbers(parts)
    if numbers is not None:
        return constant(np.concatenate(numbers))
    return node(Joining(), parts, (sum(x.shape[0] for x in parts), *rows.pop()))


def beside(*blocks: Node) -> Node:
    """Matrices of as many rows, one beside the other."""
    return join(*(block.transposed for block in blocks)).transposed


def total(x: Node, *axes: int) -> Node:
    """The sum of all entries, or over some axes, which are kept with one entry."""
    x = entries_of(x)
    places = range(len(x.shape))
    if any(axis not in (*places, *(~place for place in places)) for axis in axes):
        raise UsageError(f"total: {x.shape} has not the axes {', '.join(map(str, axes))}")
    kept = tuple(sorted({places[axis] for axis in axes})) if axes else tuple(places)
    shape = tuple(1 if axis in kept else length for axis, length in enumerate(x.shape))
    summed = x if shape == x.shape else node(Total(kept), (x,), shape)
    return summed if axes else reshaped(summed, ())


def mark(x: Node) -> Node:
    """Zero, or no number where an entry is not finite or the sum of them is not."""
    summed = total(x)
    return summed - summed


def dot(a: Value, b: Value) -> Node:
    """The sum of the products of the entries of two vectors."""
    return product(a, b)


def cross(a: Node, b: Node) -> Node:
    """The cross product of two vectors (3)."""
    pairs = ((1, 2), (2, 0), (0, 1))
    return join(*(a[i] * b[j] - a[j] * b[i] for i, j in pairs))


def entries_of(x: Value) -> Node:
    """The entries of coordinates, as a plain vector; numbers, and other nodes, as they are."""
    if not isinstance(x, Node):
        return constant(x)
    if not x.space:
        return x
    if isinstance(x.operation, Coordinates):
        return x.arguments[0]
    return node(Entries(x.space), (x,), x.shape)


def coordinates_of(vector: Node, space: Space) -> Node:
    """Coordinates with these entries, of which a quaternion has unit length."""
    if vector.shape != (space.coordinates,):
        raise UsageError(f"coordinates have {space.coordinates} entries, not {vector.shape}")
    if isinstance(vector.operation, Entries) and vector.arguments[0].space == space:
        return vector.arguments[0]
    return node(Coordinates(space), (vector,), vector.shape, space)


def external(
    name: str,
    shape: Shape,
    *arguments: Node,
    formula: Callable[[int], Program] | None = None,
) -> Node:
    """A function written by hand in every language, as bounded least squares; see `External`."""
    return node(External(name, formula), arguments, shape)


def formula_of(x: Node) -> Node:
    """The formula of a function written by hand, with the same result and derivatives."""
    if not isinstance(x.operation, External) or x.operation.formula is None:
        raise UsageError(f"{x} has no derivative")
    return x.operation.formula(x.size)(*x.arguments, x)[0]


class Label(NamedTuple):
    """The name of a variable, and a sentence on what it is."""

    name: str
    words: str = ""


@dataclass(frozen=True, eq=False)
class Program:
    """Named results of named inputs. Called with nodes, it gives those of its results.

    A program that is called within another is derived and printed once, however often it is called.

    Args:
        name: Its name, as it is printed.
        inputs: Variables, in the order of the arguments.
        outputs: Results by name.
        labels: What text in other languages calls nodes.
    """

    name: str
    inputs: tuple[Node, ...]
    outputs: Mapping[str, Node]
    labels: Mapping[Node, Label] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check that every variable is an input."""
        missing = sorted(
            x.operation.name
            for x in self.nodes
            if isinstance(x.operation, Input) and x not in self.inputs
        )
        if missing:
            raise UsageError(f"{self.name}: no inputs, but needed: {', '.join(missing)}")
        if len(self.names) < len(self.inputs):
            raise UsageError(f"{self.name}: an input that is no variable")
        if len(set(self.names)) < len(self.inputs):
            raise UsageError(f"{self.name}: two inputs have one name")

    @cached_property
    def names(self) -> list[str]:
        """Names of the inputs."""
        return [x.operation.name for x in self.inputs if isinstance(x.operation, Input)]

    def chosen(self, by: str | Iterable[str]) -> tuple[str, ...]:
        """Names of some inputs, each of which there must be.

        Args:
            by: A name, or several.

        Returns:
            The names.

        Raises:
            UsageError: If the program has no such input.
        """
        names = (by,) if isinstance(by, str) else tuple(by)
        unknown = sorted({*names} - {*self.names})
        if unknown:
            raise UsageError(f"{self.name} has no inputs {', '.join(unknown)}")
        return names

    @cached_property
    def nodes(self) -> list[Node]:
        """All nodes, each after its arguments."""
        return ordered(self.outputs.values())

    @cached_property
    def inner(self) -> list[Program]:
        """The programs that it invokes, each after those that it invokes itself."""
        invoked = [x.operation.program for x in self.nodes if isinstance(x.operation, Invocation)]
        return list(dict.fromkeys(y for x in invoked for y in (*x.inner, x)))

    @cached_property
    def of_states(self) -> Program:
        """The same of inputs each of which may differ from state to state."""
        taken = {
            x: variable(name, *x.shape, space=x.space)
            for name, x in zip(self.names, self.inputs, strict=True)
        }
        return Program(self.name, tuple(taken.values()), substituted(self, taken))

    @cached_property
    def readers(self) -> dict[Node, list[Node]]:
        """The nodes that read each node."""
        readers: dict[Node, list[Node]] = {x: [] for x in self.nodes}
        for x in self.nodes:
            for argument in x.arguments:
                readers[argument].append(x)
        return readers

    def __call__(self, *arguments: Node) -> tuple[Node, ...]:
        """The results of other nodes in place of the inputs, in the order of `outputs`."""
        return tuple(self.results(*arguments).values())

    def results(self, *arguments: Node) -> dict[str, Node]:
        """The same by the names of the results.

        Args:
            arguments: Nodes in place of the inputs, in their order.

        Returns:
            Nodes by the names of the results.

        Raises:
            UsageError: If a node has not the shape of its input, or differs from state to state
                where that does not.
        """
        for x, inner in zip(arguments, self.inputs, strict=True):
            if (x.shape, x.space) != (inner.shape, inner.space) or inner.is_uniform > x.is_uniform:
                raise UsageError(f"{self.name}: {x} does not go with its input {inner}")
        return {
            name: node(Invocation(self, name), arguments, x.shape, x.space, x.is_uniform or None)
            for name, x in self.outputs.items()
        }


def substituted(
    program: Program,
    arguments: Mapping[Node, Node],
    changed: Callable[[Node], Node] = lambda x: x,
) -> dict[str, Node]:
    """Results of a program, by name, with nodes in place of its inputs, which may be of each state.

    Unlike the results of a call they are nodes of the caller's; `changed` gives what is in place of
    others.
    """
    made = dict(arguments)
    for x in program.nodes:
        if x not in made:
            operation, operands = x.operation, [made[y] for y in x.arguments]
            if isinstance(operation, Invocation):
                inner, varies = operation.program, [not y.is_uniform for y in operands]
                if any(
                    y.is_uniform and differs
                    for y, differs in zip(inner.inputs, varies, strict=True)
                ):
                    operation = replace(operation, program=inner.of_states)
            made[x] = changed(node(operation, operands, x.shape, x.space))
    return {name: made[x] for name, x in program.outputs.items()}


def ordered(results: Iterable[Node], known: Container[Node] = ()) -> list[Node]:
    """Nodes of which results are made, each after its arguments, without what is `known`."""
    nodes_in_order: dict[Node, None] = {}
    stack = [(x, False) for x in reversed(list(results))]
    while stack:
        x, has_arguments = stack.pop()
        if x in nodes_in_order or x in known:
            continue
        if has_arguments:
            nodes_in_order[x] = None
        else:
            stack.append((x, True))
            stack += [(argument, False) for argument in reversed(x.arguments)]
    return list(nodes_in_order)
