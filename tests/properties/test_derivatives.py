"""Derivatives against complex steps of the functions themselves, and what mechanics says of them.

Complex steps are exact to rounding, also for thrusts on links that move.
"""

from __future__ import annotations

from functools import cache
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pytest
from support.comparison import assert_close
from support.comparison import states as random_states
from support.complex_step import along, derivative
from support.derivative_oracle import DerivativeOracle
from support.emitted import module_with_derivatives
from support.random_robots import random_tree
from support.tree_cases import QUICK_TREES

from gibbs_codegen.interface import FUNCTIONS, module_signatures
from gibbs_codegen.robot.model import Robot

Array = np.ndarray

TOLERANCE = 1e-12

# What each function differentiates, and by which argument each of its outputs is.
PRODUCTS = {
    "inverse_dynamics": "qva",
    "forward_dynamics": "qvu",
    "forward_dynamics_with_wrenches": "qvuW",
    "input_matrix": "q",
    "centre_of_mass_jacobian": "q",
}
HESSIANS = {"inverse_dynamics": "qva", "forward_dynamics": "qvu"}


class Case(NamedTuple):
    """A robot with its module, and a state: arguments by their names."""

    robot: Robot
    module: ModuleType
    state: dict[str, Array]

    def call(self, name: str) -> Any:
        """A function at the state, as a tuple of its outputs."""
        shapes = {one.name: one.argument_shapes for one in module_signatures(self.module)}[name]
        arguments = [
            self.state[argument].reshape(self.state[argument].shape[:-1] + shape)
            for argument, shape in zip(FUNCTIONS[name].arguments, shapes, strict=True)
        ]
        found = getattr(self.module, name)(*arguments)
        return found if isinstance(found, tuple) else (found,)

    def by(self, name: str, argument: str) -> list[Array]:
        """Exact derivatives of a function's outputs at the state."""
        return derivative(self.module, name, self.state, argument)


@cache
def case(number: int, attitude: str) -> Case:
    """A random tree of every structure, with all derivatives."""
    robot = random_tree(number, attitude)
    module = module_with_derivatives(robot)
    q, v, a, u = (rows[0] for rows in random_states(robot, module, 1))
    state = {"q": q, "v": v, "a": a, "u": u}
    rng = np.random.default_rng(5)
    state |= {f"{key}_dot": rng.normal(size=len(v)) for key in "qva"}
    state |= {"w": rng.normal(size=len(v)), "u_dot": rng.normal(size=len(u))}
    state |= {key: rng.normal(size=6 * len(module.FRAMES)) for key in ("W", "W_dot")}
    state |= {"w_input_matrix": rng.normal(size=len(v) * len(u))}
    state |= {"w_jacobian": rng.normal(size=3 * len(v))}
    return Case(robot, module, state)


@pytest.fixture(params=QUICK_TREES, ids=lambda value: value[1])
def tree(request: pytest.FixtureRequest) -> Case:
    return case(*request.param)


@pytest.mark.slow
@pytest.mark.parametrize(
    "function",
    [
        "forward_dynamics",
        "forward_dynamics_with_wrenches",
        "input_matrix",
        "centre_of_mass_jacobian",
    ],
)
def test_products_with_jacobians_are_those_of_the_jacobians(function: str, tree: Case) -> None:
    """J d is exact, and <w, J d> is <Jᵀ w, d> for every part of d."""
    letters = PRODUCTS[function]
    directions = {key: tree.state[f"{key}_dot"][None] for key in letters}
    (expected,) = along(tree.module, function, tree.state, directions)
    (pushed,) = tree.call(f"{function}_jvp")
    assert_close("jvp", pushed, expected[0], TOLERANCE)
    weights = tree.state[FUNCTIONS[f"{function}_vjp"].arguments[-1]]
    for pulled, by in zip(tree.call(f"{function}_vjp"), letters, strict=True):
        (jacobian,) = tree.by(function, by)
        whole = weights @ jacobian.reshape(len(weights), -1)
        assert_close(f"{by}_bar", pulled.ravel(), whole, TOLERANCE)


@pytest.mark.slow
@pytest.mark.parametrize("size", [0.0, 1e-160, 1e-9, 1e-5, 1e-3, 0.1, 0.999, 1.001, 3.0])
def test_derivatives_of_difference_are_those_that_integrate_takes_back(
    size: float, tree: Case
) -> None:
    """Of small and large displacements alike; without one they are the identity, and no 0/0."""
    q, step = tree.state["q"], tree.state["v"].copy()
    if tree.module.ATTITUDE == "quaternion":
        turning = tree.module.VELOCITY_PLACES["attitude"]
        step[turning] /= np.linalg.norm(step[turning])
    end = tree.module.integrate(q, size * step)
    displacement, by_start, by_end = tree.module.difference_derivatives(q, end)
    assert_close("displacement", displacement, tree.module.difference(q, end), TOLERANCE)
    dq, dv = tree.module.integrate_derivatives(q, displacement)
    same = np.eye(len(step))
    assert_close("by the end", dv @ by_end, same, TOLERANCE)
    assert_close("by the start", dv @ by_start, -dq, TOLERANCE)
    if size == 0.0:
        assert_close("by the end, at no displacement", by_end, same, 1e-15)
        assert_close("by the start, at no displacement", by_start, -same, 1e-15)


def gradient_rates(tree: Case, function: str) -> Array:
    """Second derivatives of w·f by all arguments, from a complex step of the gradient.

    A gradient is by the tangent space where it is taken, so that its derivative by q lacks the
    symmetry of second derivatives of δ ↦ f(q (+) δ), which are its symmetric part.
    """
    letters = HESSIANS[function]
    by = [np.concatenate(tree.by(f"{function}_vjp", argument)) for argument in letters]
    found = np.concatenate(by, axis=1)
    q = slice(0, len(tree.state["v"]))
    found[q, q] = (found[q, q] + found[q, q].T) / 2
    return found


@pytest.mark.slow
def test_hessian_of_inverse_dynamics_is_the_derivative_of_the_gradient(tree: Case) -> None:
    size = len(tree.state["v"])
    q, v, a = (slice(k * size, (k + 1) * size) for k in range(3))
    whole = gradient_rates(tree, "inverse_dynamics")
    blocks = dict(zip(("qq", "qv", "vv", "qa"), tree.call("inverse_dynamics_hessian"), strict=True))
    for key, place in {"qq": (q, q), "qv": (q, v), "vv": (v, v), "qa": (q, a)}.items():
        assert_close(key, blocks[key], whole[place], TOLERANCE)
    for key in ("qq", "vv"):
        assert np.array_equal(blocks[key], blocks[key].T)


def mass_matrix_rate(tree: Case) -> Array:
    """Ṁ at the state's velocities."""
    return tree.by("mass_matrix", "q")[0] @ tree.state["v"]


@pytest.mark.slow
def test_coriolis_matrix_leaves_energy_alone(tree: Case) -> None:
    (coriolis,) = tree.call("coriolis_matrix")
    skew = mass_matrix_rate(tree) - 2 * coriolis
    size = np.linalg.norm(coriolis)
    assert np.linalg.norm(skew + skew.T) < TOLERANCE * size
    q, v = tree.state["q"], tree.state["v"]
    damping = DerivativeOracle(tree.robot).passive_terms(q).damping
    effects = tree.module.residual(q, 0 * v) - tree.module.residual(q, v) - damping * v
    assert_close("C v", coriolis @ v, effects, TOLERANCE)


@pytest.mark.slow
def test_patterns_are_the_entries_that_are_not_always_zero(tree: Case) -> None:
    """Off the pattern everything is exactly zero; nothing on it is zero at every state."""
    samples = random_states(tree.robot, tree.module, 20, seed=3)
    state = tree.state | dict(zip("qvau", samples, strict=True))
    many = tree._replace(state=state)
    checked = set()
    for name in tree.module.DERIVATIVES:
        if not set(FUNCTIONS[name].arguments) <= set("qvau"):
            continue
        for output, values in zip(FUNCTIONS[name].outputs, many.call(name), strict=True):
            if output.name in tree.module.PATTERNS and values.ndim == 3:
                rows, columns = (np.array(x, int) for x in tree.module.PATTERNS[output.name])
                present = np.zeros(values.shape[1:], bool)
                present[rows, columns] = True
                assert np.array_equal((values != 0).any(axis=0), present), output.name
                order = np.lexsort((rows, columns))
                assert np.array_equal(order, np.arange(len(rows))), output.name
                checked.add(output.name)
    assert {"acceleration_dq", "acceleration_dv", "acceleration_du", "force_dq"} <= checked
