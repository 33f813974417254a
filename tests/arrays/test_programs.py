"""Array programs: one value in every language, and derivatives that are those of complex steps.

JAX warns of forks once it has computed, so that this comes after tests whose programs fork.
"""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from support.comparison import assert_close
from support.differences import rate
from support.emitted import module_with_derivatives
from support.kept import kept_folder, made_once
from support.random_robots import random_tree
from support.tree_cases import QUICK_TREES

from gibbs_codegen.arrays import (
    Functions,
    Node,
    Program,
    absolute,
    arctan2,
    choose,
    clip,
    constant,
    cosine,
    cross,
    dot,
    evaluate,
    evaluate_casadi,
    external,
    gradient,
    jacobian,
    join,
    maximum,
    minimum,
    nodes,
    sine,
    solve,
    square_root,
    total,
    variable,
)
from gibbs_codegen.arrays.c_text import CProgram
from gibbs_codegen.arrays.labels import labelled, named
from gibbs_codegen.arrays.slopes import ELEMENTARY_SLOPES
from gibbs_codegen.arrays.steps import METHODS, step_program
from gibbs_codegen.errors import MissingFunctionError, UsageError
from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.runtime.load import load
from gibbs_codegen.verification.complex_steps import ComplexSteps

Array = np.ndarray
ROOTS = [attitude for _, attitude in QUICK_TREES]
STEP = 1e-40
COUNT = 3


def tree(attitude: str) -> Robot:
    """A random tree with rotors on links."""
    return random_tree(*next(case for case in QUICK_TREES if case[1] == attitude))


@pytest.fixture(scope="module")
def module() -> Callable[[str], ModuleType]:
    """A random tree with all derivatives, by its attitude."""
    return cache(lambda attitude: module_with_derivatives(tree(attitude)))


class Complex:
    """A module's functions of one result at complex arguments."""

    def __init__(self, module: ModuleType) -> None:
        attitude = "quaternion" if module.ATTITUDE == "quaternion" else "tait_bryan"
        self._at = ComplexSteps(module, tree(attitude))
        self._signatures = Functions(module).signatures

    def __getattr__(self, name: str) -> Callable[..., Any]:
        """What computes a function, of which matrices are rows of their entries."""
        shapes = self._signatures[name].argument_shapes

        def result(*arguments: Array) -> Any:
            pairs = zip(arguments, shapes, strict=True)
            rows = [x.reshape(*x.shape[: x.ndim - len(shape)], -1) for x, shape in pairs]
            return self._at(name, *rows)

        return result


def payload(robot: Functions, q: Node, v: Node, u: Node, pull: Node) -> Node:
    """The force (3) of a mass of 2 kg at the last frame: (1/m + J M⁻¹ Jᵀ) f = g − J̇ v − J a.

    `pull` (3) acts there as well. J a is the velocity at the velocities a: no Jacobian is needed.
    """
    frames = robot.signatures["wrench_forces"].argument_shapes[1][0]
    still = nodes.zeros(6 * frames - 6)

    def moved(force: Node) -> Node:
        wrenches = nodes.reshaped(join(still, force, nodes.zeros(3)), (frames, 6))
        acceleration = robot.forward_dynamics_with_wrenches(q, v, u, wrenches)
        return robot.frame_velocities(q, acceleration)[frames - 1][:3]

    free = moved(pull)
    columns = [moved(pull + constant(unit)) - free for unit in np.eye(3)]
    matrix = nodes.reshaped(join(*columns), (3, 3)) + constant(0.5 * np.eye(3))
    drift = robot.frame_bias_accelerations(q, v)[frames - 1][:3]
    return solve(matrix, constant([0.0, 0.0, -9.81]) - drift - free)


def everything(robot: Functions) -> Program:
    """A program with nodes of every kind that complex steps go through."""
    q, v = robot.state()
    u = variable("u", robot.inputs)
    x, matrix, scale = variable("x", 3), variable("A", 3, 3), variable("s", uniform=True)
    moved = robot.integrate(q, 0.1 * v)
    inner = Program(
        "inner",
        (q, v, x),
        {"d": robot.difference(q, robot.integrate(q, v)), "e": sine(x) * v[0]},
    )
    d, e = inner(moved, 0.3 * v, x)
    regular = matrix + constant(4.0 * np.eye(3))
    poses = robot.frame_poses(moved)
    poses = nodes.reshaped(poses, (poses.size // 4, 4))
    entries = nodes.entries_of(moved)
    again = nodes.coordinates_of(entries, robot.space)
    count = robot.space.coordinates
    outputs = {
        "difference": d * scale,
        "norm": square_root(dot(x, x) + 1.0) * scale / (2.0 + cosine(x[1])),
        "solved": solve(regular, x) @ matrix,
        "solved_matrix": solve(regular, matrix)[1:],
        "turned": cross(x, e),
        "entries": entries * 2.0,
        "acceleration": robot.forward_dynamics(again, v, u),
        "force": robot.inverse_dynamics(moved, v, d),
        "poses": poses @ join(x, scale),
        "columns": nodes.transposed(robot.frame_poses(q), (2, 0, 1))[0],
        "sums": total(matrix * matrix, 0) - total(x),
        "mass": robot.centre_of_mass(q) * scale,
        "outer": nodes.reshaped(x, (3, 1)) * nodes.reshaped(e, (1, 3)),
        "rates": robot.frame_velocities(moved, v) @ constant(np.ones(6)),
        "next": robot.integrate(moved, v),
        "thrust": robot.input_matrix(moved) @ u,
        "levers": nodes.transposed(robot.input_matrix(q), (1, 0)) @ v,
        "momentum": robot.centre_of_mass_jacobian(moved) @ d,
        "payload": payload(robot, moved, v, u, x),
        "way": robot.difference(moved, again),
        "same": constant([1.0, 2.0]),
        # What is repeated along axes that it lacks, where the slope is a number.
        "spread": join(scale + constant([1.0, 2.0, 3.0]), total(constant(np.ones((2, 3))) - x[0])),
        "spread_rows": (nodes.reshaped(x, (1, 3)) - constant(np.ones((2, 3))))[1],
        "spread_dot": dot(constant([1.0, 2.0, 3.0]) - scale, x),
        "spread_choice": choose(scale, 0.0, scale * x[1], constant([1.0, 2.0])),
        # Coordinates as the vectors of their entries.
        "coordinates": join(
            total(moved), total(moved, -1), dot(moved, moved), nodes.reshaped(moved, (1, count))[0]
        ),
        "coordinates_solved": solve(4.0 * np.eye(count), moved) @ np.ones((count, 2)),
        "numbers": np.ones(3) * x - np.ones((3, 3)) @ x,
    }
    return Program("everything", (q, v, u, x, matrix, scale), outputs)


def arguments(module: ModuleType, seed: int = 0) -> dict[str, Array]:
    """Random values of the inputs of `everything` and of a step."""
    rng = np.random.default_rng(seed)
    robot = Functions(module)
    start = np.zeros(robot.space.coordinates)
    start[module.COORDINATE_PLACES["attitude"]] = (
        [0.0, 0.0, 0.0, 1.0] if robot.space.has_quaternion else [0.3, -0.5, 0.8]
    )
    q = module.integrate(start, rng.normal(size=(COUNT, robot.space.velocities)) * 0.5)
    return {
        "q": q,
        "v": rng.normal(size=(COUNT, robot.space.velocities)),
        "u": rng.normal(size=(COUNT, robot.inputs)),
        "x": rng.normal(size=(COUNT, 3)),
        "A": rng.normal(size=(COUNT, 3, 3)),
        "s": np.float64(1.3),
        "h": np.float64(0.01),
    }


def complex_steps(
    program: Program, module: ModuleType, values: dict[str, Array], by: str
) -> dict[str, Array]:
    """Derivatives of the results at one state by an input, by complex steps of the kernels."""
    own = dict(zip(program.names, program.inputs, strict=True))
    functions = Complex(module)
    columns: dict[str, list[Array]] = {name: [] for name in program.outputs}
    width = math.prod(own[by].tangent)
    for row in np.eye(width):
        given: dict[str, Any] = {name: values[name] for name in program.names}
        if own[by].space:
            given[by] = values[by] + 1j * STEP * module.coordinate_rates(values[by], row)
        else:
            given[by] = values[by] + 1j * STEP * row.reshape(own[by].shape)
        found = evaluate(program, given, {"robot": functions})
        for name, result in found.items():
            slope = np.imag(result) / STEP
            if program.outputs[name].space:
                slope = displacement(module, np.real(result), slope)
            columns[name].append(slope)
    return {name: np.stack(found, axis=-1) for name, found in columns.items()}


def displacement(module: ModuleType, q: Array, rates: Array) -> Array:
    """The displacement (nv) that moves coordinates at some rates."""
    rows = np.eye(len(module.VELOCITIES))
    matrix = np.stack([module.coordinate_rates(q, row) for row in rows], axis=-1)
    found: Array = np.linalg.lstsq(matrix, rates, rcond=None)[0]
    return found


@pytest.mark.parametrize(
    "attitude", ["tait_bryan", pytest.param("quaternion", marks=pytest.mark.slow)]
)
def test_derivatives_are_those_of_complex_steps(
    attitude: str, module: Callable[[str], ModuleType]
) -> None:
    robot = module(attitude)
    program, values = everything(Functions(robot)), arguments(robot)
    by = tuple(program.names)
    matrices = evaluate(jacobian(program, by), values, {"robot": robot})
    rng = np.random.default_rng(1)
    weights = {
        f"{name}_bar": rng.normal(size=(COUNT, *x.tangent)) for name, x in program.outputs.items()
    }
    bars = evaluate(gradient(program, by), values | weights, {"robot": robot})
    last = {name: x if np.ndim(x) == 0 else x[-1] for name, x in values.items()}
    for name in by:
        expected = complex_steps(program, robot, last, name)
        whole = np.zeros(math.prod(dict(zip(by, program.inputs, strict=True))[name].tangent))
        for output, slope in expected.items():
            found = matrices[f"{output}_by_{name}"]
            found = found[-1] if found.ndim > slope.ndim else found
            size = max(1.0, float(np.max(np.abs(slope))))
            assert np.max(np.abs(found - slope)) < 1e-11 * size, (output, name)
            weight = weights[f"{output}_bar"][-1].ravel()
            whole += weight @ slope.reshape(weight.size, -1)
        assert np.max(np.abs(bars[f"{name}_bar"][-1].ravel() - whole)) < 1e-10 * np.max(
            np.abs(whole)
        ), name


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["forward_dynamics", pytest.param("inverse_dynamics", marks=pytest.mark.slow)]
)
def test_gradients_have_second_derivatives(name: str) -> None:
    """They are differences of eighth order, though displacements of a quaternion do not commute."""
    robot = paper_family(2, 1)
    robot = replace(robot, base=replace(robot.base, attitude="quaternion"))
    functions = [f"{name}_{kind}" for kind in ("vjp", "hessian", "derivatives")]
    folder = kept_folder(robot, " ".join(functions))

    def make() -> None:
        generate_robot(robot, robot_text(robot), folder, verify=False, derivatives=functions)

    module = load(made_once(folder / robot.name, make))
    calls = Functions(module)
    w = variable("w", calls.space.velocities)
    q, v = calls.state()
    last = variable(name[0], calls.inputs if name[0] == "f" else calls.space.velocities)
    bars = getattr(calls, f"{name}_vjp")(q, v, last, w)
    program = Program("pull", (q, v, last, w), {"bars": join(*bars)})
    rng = np.random.default_rng(3)
    at = [rng.normal(size=x.size) for x in program.inputs]
    at[0] = module.integrate(at[0] / np.linalg.norm(at[0][3:7]), np.zeros(calls.space.velocities))
    found = evaluate(
        jacobian(program, program.names),
        dict(zip(program.names, at, strict=True)),
        {"robot": module},
    )
    for place, (by, x) in enumerate(zip(program.names, program.inputs, strict=True)):

        def moved(steps: Array, place: int = place) -> Array:
            given = [*at]
            given[place] = module.integrate(at[0], steps) if place == 0 else at[place] + steps
            return np.concatenate(getattr(module, f"{name}_vjp")(*given), axis=-1)

        columns = [
            rate(lambda t, unit=unit, moved=moved: moved(t[:, None] * unit), np.zeros(1), 2e-3)[0]
            for unit in np.eye(x.tangent[0])
        ]
        assert_close(by, found[f"bars_by_{by}"], np.stack(columns, axis=-1), 1e-9)


@pytest.mark.parametrize("attitude", ROOTS)
@pytest.mark.parametrize("method", METHODS)
def test_steps_are_those_of_the_module(
    method: str, attitude: str, module: Callable[[str], ModuleType]
) -> None:
    robot = module(attitude)
    program, values = step_program(Functions(robot), method), arguments(robot)
    given = [values[name] for name in program.names]
    found = evaluate(jacobian(program, ("q", "v", "u")), values, {"robot": robot})
    *after, state, inputs = getattr(robot, f"step_{method}_derivatives")(*given)
    np.testing.assert_allclose(found["q_next"], after[0], atol=1e-13)
    np.testing.assert_allclose(found["v_next"], after[1], atol=1e-11)
    rows = [
        np.concatenate([found[f"{x}_by_{by}"] for by in "qv"], axis=-1)
        for x in ("q_next", "v_next")
    ]
    np.testing.assert_allclose(np.concatenate(rows, axis=-2), state, atol=1e-11)
    columns = np.concatenate([found[f"{x}_by_u"] for x in ("q_next", "v_next")], axis=-2)
    np.testing.assert_allclose(columns, inputs, atol=1e-11)


@pytest.mark.parametrize("attitude", ROOTS)
def test_casadi_has_the_numbers_of_numpy(
    attitude: str, module: Callable[[str], ModuleType]
) -> None:
    casadi = pytest.importorskip("casadi")
    robot = module(attitude)
    program, values = everything(Functions(robot)), arguments(robot)
    one = {name: values[name] if name == "s" else values[name][0] for name in program.names}
    symbols = {name: casadi.MX.sym(name, *np.atleast_1d(x).shape) for name, x in one.items()}
    other = load(Path(str(robot.__file__)).parent, "casadi")
    found = evaluate_casadi(program, symbols, {"robot": other})
    results = casadi.Function("f", [*symbols.values()], [*found.values()])(*one.values())
    expected = evaluate(program, one, {"robot": robot})
    for name, result in zip(found, results, strict=True):
        shaped = np.asarray(result).reshape(expected[name].shape)
        np.testing.assert_allclose(shaped, expected[name], rtol=1e-12, atol=1e-12)


@pytest.mark.slow
def test_jax_has_the_numbers_of_numpy(
    module: Callable[[str], ModuleType], jax_in_double_precision: ModuleType
) -> None:
    jax = jax_in_double_precision
    robot = module("quaternion")
    whole, values = everything(Functions(robot)), arguments(robot)
    # Functions of the module are compiled for JAX in the tests of that back end.
    costly = {"acceleration", "force", "payload", "momentum", "thrust", "levers", "rates"}
    outputs = {name: node for name, node in whole.outputs.items() if name not in costly}
    program = Program(whole.name, whole.inputs, outputs)
    other = load(Path(str(robot.__file__)).parent, "jax")
    # Compiled as a whole: by themselves, hundreds of operations take a minute.
    compute = jax.jit(lambda given: evaluate(program, given, {"robot": other}, xp=jax.numpy))
    found = compute(values)
    for name, expected in evaluate(program, values, {"robot": robot}).items():
        np.testing.assert_allclose(found[name], expected, rtol=1e-11, atol=1e-11)


# Arguments at which the functions of two or four numbers are smooth, on either side of a choice.
POINTS: dict[str, list[tuple[float, ...]]] = {
    "minimum": [(0.3, 1.1), (1.1, 0.3)],
    "maximum": [(0.3, 1.1), (1.1, 0.3)],
    "absolute": [(0.4,), (-0.4,)],
    "copysign": [(0.4, -1.0), (-0.4, -1.0)],
    "choose": [(0.3, 1.1, 0.5, 0.7), (1.1, 0.3, 0.5, 0.7)],
    "arctan2": [(0.3, 1.1), (-0.4, -0.7)],
    **{name: [(0.3,)] for name in ("sqrt", "exp", "sin", "cos")},
    **{name: [(0.3, 1.1)] for name in ("add", "subtract", "multiply", "divide")},
}


def result(program: Program, values: dict[str, float], name: str, x: Array) -> Array:
    """The result y of a program at other values of one input."""
    found: Array = evaluate(program, values | {name: x}, {})["y"]
    return found


@pytest.mark.parametrize("name", nodes.ELEMENTARY)
def test_slopes_of_elementary_functions(name: str) -> None:
    assert ELEMENTARY_SLOPES.keys() == nodes.ELEMENTARY.keys() == POINTS.keys()
    for point in POINTS[name]:
        inputs = tuple(variable(f"x{i}") for i in range(len(point)))
        program = Program("f", inputs, {"y": nodes.elementary(name, *inputs)})
        values = dict(zip(program.names, point, strict=True))
        found = evaluate(jacobian(program, tuple(program.names)), values, {})
        for x in program.names:
            expected = rate(partial(result, program, values, x), np.array([values[x]]))
            np.testing.assert_allclose(found[f"y_by_{x}"], expected, atol=1e-9)


def test_limits_and_choices_have_derivatives_on_either_side() -> None:
    x = variable("x", 3)
    limited = clip(x, -0.5, constant([0.5, 0.5, 9.0]))
    outputs = {
        "limited": limited,
        "chosen": choose(x, 0.0, x * x, -x),
        "least": minimum(x, maximum(x[::1] * 2.0, absolute(x))),
        "angle": arctan2(x, limited + 2.0),
    }
    program = Program("limits", (x,), outputs)
    found = evaluate(jacobian(program, ("x",)), {"x": [0.9, -0.2, 0.7]}, {})
    np.testing.assert_array_equal(found["limited_by_x"], np.diag([0.0, 1.0, 1.0]))
    np.testing.assert_array_equal(found["chosen_by_x"], np.diag([1.8, -1.0, 1.4]))
    np.testing.assert_array_equal(found["least_by_x"], np.eye(3))


def test_a_program_within_a_program_is_evaluated_once_and_derived_once() -> None:
    calls = []

    def counted(x: Array) -> Array:
        calls.append(x)
        return x + 1.0

    x = variable("x", 2)
    inner = Program("inner", (x,), {"a": external("counted", (2,), x), "b": 2.0 * x})
    a, b = inner(x)
    once_more, _ = inner(x)
    assert once_more is a
    program = Program("outer", (x,), {"sum": a + b, "product": a * b})
    found = evaluate(program, {"x": np.array([1.0, 2.0])}, {}, externals={"counted": counted})
    np.testing.assert_array_equal(found["product"], [4.0, 12.0])
    assert len(calls) == 1
    smooth = Program("smooth", (x,), {"s": sine(x)})
    twice = Program("twice", (x,), {"y": smooth(smooth(x)[0])[0]})
    inside = {
        y.operation.program
        for y in jacobian(twice, ("x",)).nodes
        if isinstance(y.operation, nodes.Invocation)
    }
    assert inside == {smooth, jacobian(smooth, ("x",))}
    with pytest.raises(UsageError, match="has no derivative"):
        jacobian(program, ("x",))


@pytest.mark.slow
def test_nodes_are_made_once_and_forgotten() -> None:
    x = variable("x", 3)
    assert 2.0 * sine(x) is 2.0 * sine(x)
    assert variable("x", 3) is x
    assert variable("x", 3, uniform=True) is not x
    assert (x + 0.0) is x
    assert (1.0 * x) is x
    assert nodes.is_all(0.0 * x, 0.0)
    assert constant(np.eye(3)) @ x is x
    assert join(x[:1], x)[1:] is x
    assert nodes.reshaped(nodes.reshaped(x, (3, 1)), (3,)) is x
    assert x[2:1].shape == (0,)
    assert x[np.int64(1)] is x[1]
    assert total(x, -1) is total(x, 0)
    assert total(x, 0, -1) is total(x, 0)
    gc.collect()
    before = len(nodes._NODES)
    for k in range(100):
        sine(x * float(k + 2))
    gc.collect()
    assert len(nodes._NODES) <= before + 1


def test_text_has_the_names_of_its_own_program() -> None:
    """Programs share nodes, and what one calls them is nothing to another, whichever is older."""
    x = variable("x", 9)

    @labelled
    def made(name: str) -> Program:
        doubled = 2.0 * x
        if name:
            named(doubled, name, f"It is called {name}.")
        return Program("twice", (x,), {"y": doubled @ doubled, "z": doubled + 1.0})

    programs = {name: made(name) for name in ("first", "", "second")}
    for name, program in programs.items():
        for derived in (program, jacobian(program, "x"), gradient(program, "x")):
            text = "\n".join(CProgram(derived).function())
            assert {one for one in programs if one and one in text} == ({name} - {""})
    assert programs["first"].labels != programs["second"].labels


def test_threads_make_a_node_once(monkeypatch: pytest.MonkeyPatch) -> None:
    made = nodes.Node

    def slow(*values: Any) -> Node:
        time.sleep(0.05)
        return made(*values)

    monkeypatch.setattr(nodes, "Node", slow)
    with ThreadPoolExecutor(2) as threads:
        one, other = threads.map(variable, ["of_threads"] * 2)
    assert one is other


def test_derivatives_by_an_input_without_entries() -> None:
    x, u = variable("B", 3, 0), variable("u", 0)
    program = Program("p", (x, u), {"y": x @ u})
    found = evaluate(
        gradient(program, ("u", "B")), {"B": np.ones((3, 0)), "u": [], "y_bar": [1.0] * 3}, {}
    )
    assert [found["u_bar"].shape, found["B_bar"].shape] == [(0,), (3, 0)]
    found = evaluate(jacobian(program, "u"), {"B": np.ones((3, 0)), "u": []}, {})
    assert found["y_by_u"].shape == (3, 0)


def wrong() -> Iterator[tuple[Callable[[Functions, Node, Node], object], str]]:
    """What is refused, and a part of the words."""
    yield lambda r, q, v: q + v, "coordinates are no vectors"
    yield lambda r, q, v: v + constant(np.ones(2)), "do not go together"
    yield lambda r, q, v: v @ constant(np.eye(2)), "does not go with"
    yield lambda r, q, v: solve(constant(np.eye(2)), v), "does not go with"
    yield lambda r, q, v: r.integrate(v, v), "integrate: q is coordinates of shape"
    yield lambda r, q, v: r.difference(q), "difference takes q0, q1"
    yield lambda r, q, v: nodes.coordinates_of(v[:2], r.space), "entries"
    yield lambda r, q, v: join(v, constant(np.eye(2))), "do not go together"
    yield lambda r, q, v: nodes.reshaped(v, (2,)), "has not the entries"
    yield lambda r, q, v: v[::2], "side by side"
    yield lambda r, q, v: [*total(v)], "a number has no parts"
    yield lambda r, q, v: solve(v, total(v)), "does not go with"
    yield lambda r, q, v: total(v, 0, 5), "has not the axes 0, 5"
    yield lambda r, q, v: Program("p", (q,), {"v": v}), "p: no inputs, but needed: v"
    yield lambda r, q, v: Program("p", (v, variable("v")), {"v": v}), "two inputs have one name"
    yield lambda r, q, v: Program("p", (v, 2.0 * v), {"v": v}), "an input that is no variable"
    yield lambda r, q, v: jacobian(Program("p", (v,), {"v": v}), ["gain"]), "p has no inputs gain"
    yield lambda r, q, v: gradient(Program("p", (v,), {"v": v}), "gain"), "p has no inputs gain"
    for derived in (jacobian, gradient):
        yield (
            lambda r, q, v, derived=derived: derived(
                Program("p", (v,), {"y": external("f", (2,), v, 2.0 * v)}), "v"
            ),
            "has no derivative",
        )
    yield lambda r, q, v: Program("p", (v,), {"v": v})(v[:1]), "does not go with its input"
    shared = variable("v", 1, uniform=True)
    yield lambda r, q, v: Program("p", (shared,), {"v": shared})(v[:1]), "does not go with"
    yield (
        lambda r, q, v: jacobian(Program("p", (q,), {"y": r.mass_matrix(q)}), ("q",)),
        "derivatives of mass_matrix by q",
    )
    yield lambda r, q, v: evaluate(Program("p", (v,), {"v": v}), {}, {}), "no value for v"
    yield (
        lambda r, q, v: evaluate(Program("p", (), {"y": external("f", (2,))}), {}, {}),
        "no external function is given for 'f'",
    )
    yield (
        lambda r, q, v: evaluate(
            Program("p", (q,), {"y": r.mass_matrix(q)}), {"q": np.ones(q.size)}, {}
        ),
        "no module is given for 'robot'",
    )
    yield (
        lambda r, q, v: evaluate(Program("p", (v,), {"v": v}), {"v": np.ones(2)}, {}),
        "should be the last axes",
    )


@pytest.mark.parametrize("case", range(len([*wrong()])))
def test_what_does_not_fit_is_refused(case: int, module: Callable[[str], ModuleType]) -> None:
    robot = Functions(module("quaternion"))
    build, words = [*wrong()][case]
    with pytest.raises(UsageError, match=words):
        build(robot, *robot.state())


def test_a_function_that_the_module_lacks_is_named_with_its_option(small: Path) -> None:
    robot = Functions(load(small))
    with pytest.raises(MissingFunctionError, match="--functions=default,gibbs"):
        robot.gibbs(*robot.state(), robot.velocities("a"))
    with pytest.raises(AttributeError, match="forward_dynamic"):
        _ = robot.forward_dynamic
