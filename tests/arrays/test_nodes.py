"""Nodes of array programs, one by one, in every language and with derivatives.

A case is one formula, of nodes and of NumPy's own arrays: these say what is right, at complex
numbers the derivatives too. Cases are outputs of one program, so that a language compiles once.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from support.compiled import build
from support.made_up import STEP, Array, MadeUp, close
from support.octave import octave_arrays
from support.tools import tool

from gibbs_codegen import compile_program, load
from gibbs_codegen.arrays import (
    Functions,
    Program,
    evaluate,
    evaluate_casadi,
    gradient,
    jacobian,
    nodes,
    variable,
    write_c,
    write_matlab,
)
from gibbs_codegen.arrays.contents import solve_room
from gibbs_codegen.arrays.matlab_text import MatlabPages
from gibbs_codegen.arrays.nodes import Node
from gibbs_codegen.arrays.numpy_text import NumpyText
from gibbs_codegen.errors import UsageError
from gibbs_codegen.files.verbatim import matlab_source
from gibbs_codegen.machine.steps import emitted_step
from gibbs_codegen.runtime.programs import CompiledProgram

NAME = "hexarotor_3link"
COUNT = 11


class Plain:
    """The functions of `nodes` by NumPy alone, at real and complex numbers."""

    sine, cosine, exponential, square_root = np.sin, np.cos, np.exp, np.sqrt
    cross, constant = staticmethod(np.cross), staticmethod(np.array)
    zeros = staticmethod(lambda *shape: np.zeros(shape))
    transposed = staticmethod(lambda x, axes: np.transpose(x, axes))
    part = staticmethod(lambda x, begin, end: x[begin:end])
    join = staticmethod(lambda *x: np.concatenate([np.atleast_1d(each) for each in x]))
    beside = staticmethod(lambda *x: np.concatenate(x, 1))
    reshaped = staticmethod(np.reshape)
    product = staticmethod(lambda a, b: np.tensordot(a, b, 1))
    dot = product
    total = staticmethod(lambda x, *axes: np.sum(x, axes, keepdims=True) if axes else np.sum(x))
    absolute = staticmethod(lambda a: a * np.sign(np.real(a)))
    arctan2 = staticmethod(lambda a, b: 2.0 * np.arctan(a / (np.sqrt(a * a + b * b) + b)))

    @staticmethod
    def choose(a: Any, b: Any, above: Any, other: Any) -> Array:
        """One of two values, by which of two is greater."""
        return np.where(np.real(a) > np.real(b), above, other)

    def minimum(self, a: Any, b: Any) -> Array:
        """The lesser of two values."""
        return self.choose(b, a, a, b)

    def maximum(self, a: Any, b: Any) -> Array:
        """The greater of two values."""
        return self.choose(a, b, a, b)

    def clip(self, x: Any, lower: Any, upper: Any) -> Array:
        """A value within limits."""
        return self.maximum(self.minimum(x, upper), lower)

    def copysign(self, a: Any, sign: Any) -> Array:
        """Magnitudes with the signs of others."""
        return self.absolute(a) * np.copysign(1.0, np.real(sign))

    def solve(self, a: Any, b: Any) -> Array:
        """The inverse of a matrix times a vector or matrix."""
        return np.linalg.solve(a, np.reshape(b, (len(b), -1))).reshape(np.shape(b))

    def called(self, x: Any, s: Any) -> tuple[Any, Any, Any]:
        """Results of a program that is called."""
        return within(self, x, s)

    def twice(self, x: Any, s: Any) -> Any:
        """What a program within a program returns."""
        return within(self, within(self, x, s)[0], s)[0]


def within(m: Any, x: Any, s: Any) -> tuple[Any, Any, Any]:
    """What a program returns that others call: a vector, a number, and what nobody reads."""
    return m.sine(x) * s, m.dot(x, x), x + s


@cache
def inner() -> Program:
    x, s = variable("x", 3), variable("s")
    return Program("inner", (x, s), dict(zip("abc", within(nodes, x, s), strict=True)))


class Nodes:
    """The functions of `nodes`, and calls of a program."""

    def __getattr__(self, name: str) -> Any:
        return getattr(nodes, name)

    def called(self, x: Node, s: Node) -> Any:
        """Results of a program that is called."""
        return inner()(x, s)

    def twice(self, x: Node, s: Node) -> Node:
        """What a program within a program returns."""
        outer = Program(
            "outer",
            inner().inputs,
            {"y": inner()(inner()(*inner().inputs)[0], inner().inputs[1])[0]},
        )
        return outer(x, s)[0]


# Inputs by name; what all states share ends with an underscore.
SHAPES: dict[str, tuple[int, ...]] = {
    "x": (3,), "y": (3,), "s": (), "k": (7,), "A": (3, 4), "S": (3, 3), "B": (4, 2, 3),
    "W": (8, 7), "e": (0,), "E": (3, 0), "t_": (), "j_": (3,), "K_": (3, 3),
}  # fmt: skip
EYE = np.eye(3)
Case = Callable[[Any, Any], Any]
CASES: dict[str, Case] = {
    "add": lambda m, g: g.x + g.y + g.s + 1.5,
    "subtract": lambda m, g: g.x - (g.y - g.s) - (2.0 - g.x),
    "multiply": lambda m, g: -(g.x * g.y) * (g.s + g.t_) * -1.0,
    "divide": lambda m, g: g.x / (3.0 + g.y) / (g.s + 4.0) * (1.0 / (2.0 + g.x / g.t_)),
    "minimum": lambda m, g: m.minimum(g.x, g.y) + m.minimum(g.s, 0.1) + m.minimum(g.j_, g.t_),
    "maximum": lambda m, g: m.maximum(g.x, g.y) - m.maximum(g.s, 0.1) * m.maximum(g.t_, g.j_),
    "clip": lambda m, g: m.clip(g.k, -0.3, 0.2),
    "choose": lambda m, g: m.choose(g.x, g.s, 1.0 / g.x, g.t_) + m.choose(g.t_, g.j_, g.x, 0.5),
    "choice_of_numbers": lambda m, g: m.choose(g.s, g.t_, 2.0, g.s * g.s),
    "absolute": lambda m, g: m.absolute(g.k) * m.absolute(g.t_),
    "copysign": lambda m, g: m.copysign(g.x, g.y) + m.copysign(2.0, g.x) * m.copysign(g.t_, g.j_),
    "square_root": lambda m, g: m.square_root(g.x * g.x + 1.0) * m.square_root(g.t_ + 2.0),
    "exponential": lambda m, g: m.exponential(g.x - g.s) + m.exponential(g.t_),
    "sine": lambda m, g: m.sine(g.k) + m.sine(g.t_) + m.cosine(g.k),
    "angles_of_matrices": lambda m, g: m.sine(g.A) * m.cosine(g.A),
    "cosine": lambda m, g: m.cosine(g.s) * m.cosine(g.j_) - m.sine(g.s),
    "arctan2": lambda m, g: m.arctan2(g.x, g.y) + m.arctan2(g.t_, g.j_) + m.arctan2(g.s, -0.5),
    "row_and_column": lambda m, g: m.reshaped(g.x, (3, 1)) * m.reshaped(g.y, (1, 3)) + g.s,
    "spread": lambda m, g: (m.reshaped(g.x, (1, 3)) - np.ones((2, 3)))[1] + np.ones(3) * g.t_,
    "same_twice": lambda m, g: g.x * g.x - (g.y + g.y),
    "matrix_by_vector": lambda m, g: m.product(g.S, g.x) + m.product(g.K_, g.j_),
    "matrix_by_matrix": lambda m, g: m.product(g.S, g.A),
    "long_products": lambda m, g: m.product(g.W, g.k) + 0.5 + m.product(g.W, m.sine(g.k)),
    "sums_of_products": lambda m, g: m.product(g.S, g.x) + g.y + m.product(g.K_, g.y),
    "dot": lambda m, g: m.dot(g.k, g.k) * m.dot(g.x, g.j_) + m.dot(g.j_, g.j_),
    "vector_by_matrix": lambda m, g: m.product(g.x, g.A),
    "array_by_vector": lambda m, g: m.product(g.B, g.x),
    "matrix_by_array": lambda m, g: m.product(g.A, g.B),
    "scaled_identity": lambda m, g: m.product(g.s * EYE, g.A) + m.product(EYE, g.A),
    "no_inner_axis": lambda m, g: m.product(g.E, g.e) + g.x,
    "diagonal": lambda m, g: -0.5 * np.eye(3, 4) * g.A + np.eye(3, 4, 1) * g.s + np.eye(3, 4, 1),
    "large_diagonal": lambda m, g: g.W + 2.0 * np.eye(8, 7, 2),
    "diagonal_product": lambda m, g: m.product(2.5 * np.eye(3), g.A),
    "table": lambda m, g: (np.arange(24.0).reshape(3, 4, 2) - 5.5) * g.s,
    "column_table": lambda m, g: g.x - np.array([0.0, -0.0, 3.25]) + np.arange(3.0) * g.j_,
    "infinities": lambda m, g: m.clip(g.x, [-np.inf, 0.1, -9.0], [np.inf, np.inf, 0.2]),
    "solve": lambda m, g: m.solve(g.S + 4.0 * EYE, g.x),
    "solve_matrix": lambda m, g: m.solve(g.S + 4.0 * EYE, g.A) + m.solve(g.K_ + 4.0 * EYE, g.A),
    "solve_shared": lambda m, g: m.solve(g.K_ - 5.0 * EYE, g.j_),
    "solve_turned": lambda m, g: m.solve(m.transposed(g.S + 4.0 * EYE, (1, 0)), g.A),
    "solve_number": lambda m, g: m.solve(m.transposed(g.S[:1], (1, 0))[:1], g.x[:1]),
    "transposed": lambda m, g: m.transposed(g.A, (1, 0)) + 1.0,
    "turned_array": lambda m, g: m.transposed(g.B, (2, 0, 1)),
    "turned_twice": lambda m, g: m.transposed(m.transposed(g.B, (1, 2, 0)) * 2.0, (2, 1, 0)),
    "columns": lambda m, g: m.transposed(m.transposed(g.A + 1.0, (1, 0))[1:3], (1, 0)),
    "one_column": lambda m, g: m.transposed(g.A, (1, 0))[2],
    "turned_pieces": lambda m, g: m.transposed(m.join(g.A, g.A[:1] + 1.0), (1, 0)),
    "rows": lambda m, g: m.reshaped(g.A, (2, 6)),
    "flat": lambda m, g: m.reshaped(m.reshaped(g.B, (8, 3)), (24,)),
    "thick": lambda m, g: m.reshaped(m.transposed(g.A, (1, 0)), (2, 3, 2)),
    "one_row": lambda m, g: m.reshaped(g.x, (1, 3)),
    "column_of_a_sum": lambda m, g: m.reshaped(g.x + g.y, (3, 1)),
    "number_of_vector": lambda m, g: m.reshaped(g.x[1:2], ()) + g.t_,
    "turned_flat": lambda m, g: m.reshaped(m.transposed(g.W, (1, 0)), (56,)) * 0.5,
    "part": lambda m, g: g.k[2:5] + g.x,
    "rows_of_array": lambda m, g: g.B[1:3],
    "part_of_sum": lambda m, g: (g.W - g.s)[3:],
    "part_of_part": lambda m, g: m.part(m.part(g.k, 1, 6), 2, 4),
    "part_of_join": lambda m, g: m.join(g.x, g.y + g.s, g.x)[3:6] + m.join(g.x, g.y)[2:5],
    "entry": lambda m, g: (g.x * g.s)[2] + g.S[1][2] + g.k[-1],
    "join": lambda m, g: m.join(g.x, g.s, g.y[1:], 2.0, g.t_, g.x[0] * g.y[1]),
    "join_rows": lambda m, g: m.join(g.A, m.reshaped(g.k[:4], (1, 4)), g.A - 1.0),
    "join_arrays": lambda m, g: m.join(g.B, m.zeros(1, 2, 3), g.B[:2] * g.t_),
    "join_none": lambda m, g: m.join(g.e, g.x, g.e),
    "join_shared": lambda m, g: m.join(g.j_ + 1.0, g.t_),
    "joined_then_read": lambda m, g: m.product(m.join(g.S, g.K_), g.x),
    "beside": lambda m, g: m.beside(g.S, g.A, m.reshaped(g.x, (3, 1))),
    "beside_and_below": lambda m, g: m.join(m.beside(g.S, g.K_), m.beside(m.zeros(3, 3), g.S)),
    "total": lambda m, g: m.total(g.A) + m.total(g.j_) + m.total(g.e),
    "total_of_axis": lambda m, g: m.total(g.A * g.A, 0) + m.total(g.A, -2),
    "total_of_axes": lambda m, g: m.total(g.B, 0, 2) + m.total(g.t_ * np.ones((1, 2, 3)), 2),
    "total_of_one": lambda m, g: m.total(m.reshaped(g.x, (1, 3)), 0),
    "cross": lambda m, g: m.cross(g.x, g.y + g.j_),
    "empty": lambda m, g: g.e,
    "input": lambda m, g: g.x,
    "shared_input": lambda m, g: g.j_,
    "constant": lambda m, g: m.constant([1.0, -2.0]),
    "call": lambda m, g: m.called(g.x, g.s)[0] + m.called(g.y - 1.0, 2.0 * g.t_)[1],
    "call_of_call": lambda m, g: m.twice(g.x * 0.5, g.s + 1.0) * m.called(g.x, g.s)[1],
    "chain": lambda m, g: m.sine(m.product(g.S, m.cosine(g.x * g.s)) / (2.0 + m.dot(g.y, g.y))),
    "overwritten": lambda m, g: (g.W * 2.0)[:7] - m.transposed((g.W + 1.0)[:7], (1, 0)),
    "again": lambda m, g: g.x,
}  # fmt: skip
# In Octave nothing has more than two axes and none entries.
PLAIN = Plain()


@cache
def program(*left_out: str) -> Program:
    """All cases but some."""
    inputs = {n: variable(n, *shape, uniform=n[-1] == "_") for n, shape in SHAPES.items()}
    given = SimpleNamespace(**inputs)
    made = {
        n: nodes.entries_of(case(Nodes(), given)) for n, case in CASES.items() if n not in left_out
    }
    return Program("nodes", tuple(inputs.values()), {f"{name}_of": x for name, x in made.items()})


def numbers() -> dict[str, Array]:
    """Random inputs of all states."""
    random = np.random.default_rng(4)
    return {
        name: random.uniform(-1.0, 1.0, shape if name[-1] == "_" else (COUNT, *shape))
        + (1.7 if name == "t_" else 0.0)
        for name, shape in SHAPES.items()
    }


def plain(given: dict[str, Any]) -> dict[str, Array]:
    """What each case is of one state."""
    own = SimpleNamespace(**given)
    return {f"{name}_of": np.asarray(case(PLAIN, own)) for name, case in CASES.items()}


def one(given: dict[str, Array], k: int) -> dict[str, Array]:
    """One of several states."""
    return {name: x if name[-1] == "_" else x[k] for name, x in given.items()}


def some(given: dict[str, Array], count: int) -> dict[str, Array]:
    """The first of several states."""
    return {name: x if name[-1] == "_" else x[:count] for name, x in given.items()}


def check(found: dict[str, Any], given: dict[str, Array], tolerance: float = 1e-13) -> None:
    """Compare results of all states with those of each by itself."""
    states = [plain(one(given, k)) for k in range(len(given["x"]))]
    for name, values in found.items():
        for k, state in enumerate(states):
            value = np.asarray(values)
            value = value[k] if value.ndim > state[name].ndim else value
            close(value, state[name], tolerance, name)


def single(found: dict[str, Any]) -> dict[str, Array]:
    """Results of one state as those of several."""
    return {name: np.asarray(x)[np.newaxis] for name, x in found.items()}


def test_numpy_has_the_numbers_of_plain_arrays() -> None:
    """Of states in two axes, of one, and of inputs that some states share."""
    given = numbers()
    check(evaluate(program(), given, {}), given)
    check(single(evaluate(program(), one(given, 0), {})), some(given, 1))
    grid = {
        name: x if name[-1] == "_" else x[:10].reshape(2, 5, *x.shape[1:])
        for name, x in given.items()
    }
    found = evaluate(program(), grid | {"y": given["y"][0]}, {})
    shared = given | {"y": np.tile(given["y"][0], (COUNT, 1))}
    flat = {
        n: x.reshape(10, *x.shape[2:]) if x.ndim - len(program().outputs[n].shape) == 2 else x
        for n, x in found.items()
    }
    check(flat, some(shared, 10))


def slopes() -> dict[str, Array]:
    """Derivatives of one state by all inputs, by complex steps."""
    given = one(numbers(), 0)
    values, found = plain(given), {}
    for by, shape in SHAPES.items():
        columns = [
            plain(given | {by: given[by] + 1j * STEP * unit.reshape(shape)})
            for unit in np.eye(int(np.prod(shape)))
        ]
        for name, right in values.items():
            rows = [np.imag(column[name]) / STEP for column in columns]
            found[f"{name}_by_{by}"] = np.stack(rows, -1) if rows else np.zeros((*right.shape, 0))
    return found


def test_derivatives_are_those_of_complex_steps() -> None:
    given, right = one(numbers(), 0), slopes()
    found = evaluate(jacobian(program(), tuple(SHAPES)), given, {})
    for name, slope in right.items():
        close(found[name], slope, 2e-13, name)
    random = np.random.default_rng(5)
    for name, x in program().outputs.items():
        alone = gradient(Program("alone", program().inputs, {name: x}), tuple(SHAPES))
        weight = random.normal(size=x.shape)
        bars = evaluate(alone, given | {f"{name}_bar": weight}, {})
        for by, shape in SHAPES.items():
            wanted = np.tensordot(weight, right[f"{name}_by_{by}"], weight.ndim).reshape(shape)
            close(bars[f"{by}_bar"], wanted, 1e-12, f"{name} {by}")


def test_casadi_has_the_numbers_of_plain_arrays() -> None:
    casadi = pytest.importorskip("casadi")
    given = one(numbers(), 0)
    flat = {
        n: x.reshape((int(np.prod(x.shape[:-1])), x.shape[-1]) if x.ndim > 1 else (x.size, 1))
        for n, x in given.items()
    }
    symbols = {name: casadi.MX.sym(name, *x.shape) for name, x in flat.items()}
    found = evaluate_casadi(program(), symbols, {})
    results = casadi.Function("f", [*symbols.values()], [*found.values()])(*flat.values())
    shapes = (program().outputs[name].shape for name in found)
    arrays = (np.asarray(x).reshape(shape) for x, shape in zip(results, shapes, strict=True))
    check(single(dict(zip(found, arrays, strict=True))), some(numbers(), 1))


@pytest.fixture(scope="module")
def robot() -> ModuleType:
    tool("cc")
    return load(ROOT / "generated" / NAME, backend="c")


def derived() -> Program:
    """All cases with some derivatives, and calls of a robot's functions."""
    return jacobian(program(), ("x", "j_"))


def check_slopes(found: dict[str, Array], tolerance: float) -> None:
    """Compare derivatives of the first of several states."""
    for name, right in slopes().items():
        if name in found:
            value = found[name] if found[name].ndim == right.ndim else found[name][0]
            close(value, right, tolerance, name)


@pytest.mark.parametrize(("is_single", "tolerance"), [(False, 1e-13), (True, 5e-5)])
def test_c_has_the_numbers_of_plain_arrays(
    is_single: bool, tolerance: float, robot: ModuleType
) -> None:
    """In blocks of states, the last of which is not full."""
    assert solve_room(program()) == 9  # Of the largest matrix that it solves with.
    given = numbers()
    found = compile_program(derived(), robot, single=is_single)(given)
    check({name: found[name] for name in program().outputs}, given, tolerance)
    check_slopes(found, tolerance)


def test_c_of_one_state_has_the_numbers_of_plain_arrays(robot: ModuleType) -> None:
    given = some(numbers(), 1)
    found = CompiledProgram(robot, derived())(*one(given, 0).values())
    check(single({name: found[name] for name in program().outputs}), given)
    check_slopes(found, 1e-13)


@pytest.mark.parametrize("real", [np.float64, np.float32])
def test_c_for_firmware_has_the_numbers_of_plain_arrays(
    real: Any, robot: ModuleType, tmp_path: Path
) -> None:
    folder = Path(robot.__path__[0])
    _, source = write_c(derived(), Functions(robot), tmp_path)
    options = ["-O0", "-shared", "-fPIC", f"-I{folder}"]
    options += [f"-D{NAME.upper()}_FLOAT"] if real is np.float32 else []
    library = ctypes.CDLL(str(build("gcc", options, [str(source)], tmp_path / "program.so")))
    given = {name: x.astype(real) for name, x in one(numbers(), 0).items()}
    found = {name: np.full(x.shape, np.nan, real) for name, x in derived().outputs.items()}
    number = ctypes.c_float if real is np.float32 else ctypes.c_double
    arguments = [
        number(x) if not x.ndim else ctypes.c_void_p(x.ctypes.data) for x in given.values()
    ]
    arguments += [ctypes.c_void_p(x.ctypes.data) for x in found.values()]
    library[f"{NAME}_{derived().name}"](*arguments)
    tolerance = 1e-13 if real is np.float64 else 5e-5
    check(single({name: found[name] for name in program().outputs}), some(numbers(), 1), tolerance)
    check_slopes(found, tolerance)


def test_octave_has_the_numbers_of_plain_arrays(robot: ModuleType, tmp_path: Path) -> None:
    """Of one state, and where it has only matrices, vectors and numbers of many."""
    given = one(numbers(), 0)
    path = write_matlab(program(), Functions(robot), tmp_path)
    columns = {n: np.reshape(x, (*x.shape, 1, 1)[: max(2, x.ndim)]) for n, x in given.items()}
    names = [*program().outputs]
    call = f"[{', '.join(names)}] = {path.stem}({', '.join(given)});"
    arrays = octave_arrays(tmp_path, columns, [call], names)
    found = {}
    for name, array in zip(names, arrays, strict=True):
        shape = program().outputs[name].shape
        assert array.size == np.prod(shape), name
        found[name] = array.reshape(shape)
    check(single(found), some(numbers(), 1))


def pages() -> Program:
    """A program of what is written for many states in MATLAB."""
    x, s, matrix = variable("x", 3), variable("s"), variable("A", 3, 3)
    left, table = matrix @ matrix + s * EYE, nodes.constant(np.eye(3, 2, -1))
    blocks = nodes.beside(left, nodes.zeros(3, 2)), nodes.beside(matrix * 0.5, table)
    outputs = {
        "sum": s * x - 2.0 * nodes.sine(x) / (s + 3.0),
        "blocks": nodes.join(*blocks),
        "part": nodes.join(left[1:], matrix),
        "columns": matrix.transposed[1:3].transposed,
        "entry": x[1:] * s,
        "number": s * s,
    }
    return Program("pages", (x, s, matrix), outputs)


def test_octave_takes_many_states_in_pages(tmp_path: Path) -> None:
    x = variable("x", 3)
    for wrong in (nodes.reshaped(x, (3, 1)), nodes.total(x, 0), nodes.product(x, EYE + 1.0)):
        with pytest.raises(UsageError, match="is not written in MATLAB for many states"):
            MatlabPages(Program("wrong", (x,), {"y": wrong}), "product").lines()
    random = np.random.default_rng(3)
    x, s, matrix = (random.uniform(-1.0, 1.0, (5, *y.shape)) for y in pages().inputs)
    lines = MatlabPages(pages(), "product").lines()
    (tmp_path / "product.m").write_text("\n".join(matlab_source("product")), encoding="utf-8")
    given = {"x": x.T, "s": s[np.newaxis], "A": np.moveaxis(matrix, 0, -1), "count": np.array(5.0)}
    arrays = octave_arrays(tmp_path, given, lines, [*pages().outputs])
    for k in range(5):
        left = matrix[k] @ matrix[k] + s[k] * EYE
        rows = [[left, np.zeros((3, 2))], [matrix[k] * 0.5, np.eye(3, 2, -1)]]
        wanted = {
            "sum": s[k] * x[k] - 2.0 * np.sin(x[k]) / (s[k] + 3.0),
            "blocks": np.block(rows),
            "part": np.concatenate([left[1:], matrix[k]]),
            "columns": matrix[k][:, 1:3],
            "entry": x[k][1:] * s[k],
            "number": s[k] ** 2,
        }
        for array, (name, right) in zip(arrays, wanted.items(), strict=True):
            close(array[..., k].reshape(right.shape), right, 1e-13, name)


@pytest.mark.parametrize("name", ["step_euler", "step_rk4", "step_rk4_derivatives"])
@pytest.mark.parametrize("attitude", ["zyx", "quaternion"])
def test_numpy_text_has_the_numbers_of_the_program(attitude: str, name: str) -> None:
    """Which `test_systems` knows; the text calls a robot's functions by their names."""
    module = MadeUp(attitude)
    step = emitted_step(Functions(module), name)
    random = np.random.default_rng(2)
    q, v = module.state(random)
    given = {"q": q, "v": v, "u": random.normal(size=6), "h": np.array([0.1])}
    body = "\n".join(f"    {line}" for line in NumpyText(step).lines())
    assert "# accelerations at the beginning\n    acceleration" in body

    def joined(axis: int, *arrays: Array) -> Array:
        return np.concatenate(arrays, axis)

    names: dict[str, Any] = {"np": np, "_joined": joined}
    for x in module.FUNCTIONS:
        names[x] = lambda *given, x=x: getattr(module, x)(*given[:-1])
    exec(f"def f({', '.join(given)}, constants):\n{body}\n", names)  # noqa: S102 - it is ours
    found = names["f"](*given.values(), None)
    wanted = evaluate(step, given | {"h": np.array(0.1)}, {"robot": module})
    for value, (output, right) in zip(found, wanted.items(), strict=True):
        close(value, right, 1e-13, output)


@pytest.mark.slow
def test_jax_has_the_numbers_of_plain_arrays(jax_in_double_precision: ModuleType) -> None:
    jax, given = jax_in_double_precision, numbers()
    check(jax.jit(lambda x: evaluate(program(), x, {}, xp=jax.numpy))(given), given)
