"""Steps of time and their derivatives: against an accurate solution, and against differences."""

from __future__ import annotations

from functools import cache, partial
from types import ModuleType

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.comparison import assert_close, states
from support.differences import rate
from support.emitted import module_with_derivatives
from support.random_robots import random_tree
from support.tree_cases import QUICK_TREES

Array = np.ndarray

STEP = 0.02
# What central differences of eighth order keep.
TOLERANCE = 1e-9


@cache
def case(number: int, attitude: str) -> tuple[ModuleType, tuple[Array, Array, Array]]:
    """The module of a random tree, and a state (q, v, u)."""
    robot = random_tree(number, attitude)
    module = module_with_derivatives(robot)
    q, v, _, u = (rows[0] for rows in states(robot, module, 1))
    return module, (q, v, u)


@pytest.fixture(params=QUICK_TREES[:1], ids=lambda value: value[1])
def tree(request: pytest.FixtureRequest) -> tuple[ModuleType, tuple[Array, Array, Array]]:
    return case(*request.param)


@pytest.mark.slow
def test_runge_kutta_is_of_fourth_order(tree) -> None:
    """A step of half the length errs a thirty-second."""
    module, state = tree
    errors = []
    for step in (STEP, STEP / 2):
        q, v = accurate(module, state, step)
        found, velocities = module.step_rk4(*state, step)
        away = np.concatenate([module.difference(q, found), velocities - v])
        errors.append(np.linalg.norm(away))
    assert 20 < errors[0] / errors[1] < 50


def accurate(module: ModuleType, state: tuple[Array, Array, Array], step: float) -> list[Array]:
    """Coordinates and velocities after a step, integrated to rounding."""
    q, v, u = state

    def rates(_: float, x: Array) -> Array:
        q, v = np.split(x, [len(state[0])])
        return np.concatenate([module.coordinate_rates(q, v), module.forward_dynamics(q, v, u)])

    whole = solve_ivp(rates, (0.0, step), np.concatenate([q, v]), "DOP853", rtol=1e-13, atol=1e-14)
    return np.split(whole.y[:, -1], [len(q)])


@pytest.mark.slow
def test_derivatives_of_a_step_are_its_differences(tree) -> None:
    """In the tangent spaces at q and at the next q: A of (q, v), B of u."""
    method = "rk4"
    module, state = tree
    q, v, by_state, by_inputs = getattr(module, f"step_{method}_derivatives")(*state, STEP)
    plain = getattr(module, f"step_{method}")(*state, STEP)
    assert_close("q", q, plain[0])
    assert_close("v", v, plain[1])
    assert_close("by default", module.step(*state, STEP, method=method)[0], q)
    size, inputs = len(v), len(state[2])
    along = partial(moved, module, state, f"step_{method}", (q, v))
    columns = [
        rate(partial(along, direction), np.zeros(1))[0] for direction in np.eye(2 * size + inputs)
    ]
    expected = np.array(columns).T
    assert_close("A", by_state, expected[:, : 2 * size], TOLERANCE)
    assert_close("B", by_inputs, expected[:, 2 * size :], TOLERANCE)


def moved(
    module: ModuleType,
    state: tuple[Array, Array, Array],
    name: str,
    end: tuple[Array, Array],
    direction: Array,
    times: Array,
) -> Array:
    """How far steps from states along a direction end from the step from the state itself."""
    q, v, u = state
    of_q, of_v, of_u = np.split(direction, [len(v), 2 * len(v)])
    rows = times[:, None]
    found, velocities = getattr(module, name)(
        module.integrate(q, rows * of_q), v + rows * of_v, u + rows * of_u, STEP
    )
    return np.concatenate([module.difference(end[0], found), velocities - end[1]], axis=1)
