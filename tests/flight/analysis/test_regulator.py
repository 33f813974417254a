"""Regulators are stable and of least cost; what cannot be regulated is told in coordinates."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest
from support.differences import Array

from gibbs_codegen import UsageError, lqr, trim
from gibbs_codegen.flight.analysis.linear_model import unreached

Load = Callable[[str], ModuleType]


@pytest.mark.parametrize("name", ["hexarotor_3link", "quadrotor"])
@pytest.mark.parametrize("dt", [None, 0.02])
def test_the_gain_is_stable_and_optimal(differentiated: Load, name: str, dt: float | None) -> None:
    module = differentiated(name)
    found = trim(module)
    nv, nu = len(found.v), len(found.u)
    weights, price = np.repeat([4.0, 1.0], nv), np.linspace(0.5, 2.0, nu)
    regulator = lqr(module, found, weights, np.diag(price), dt)
    a, b, gain, cost = regulator.a, regulator.b, regulator.gain, regulator.cost
    assert not np.any((gain != 0.0) & (np.abs(gain) <= 1e-13 * np.abs(gain).max()))
    values = regulator.eigenvalues
    growth = values.real if dt is None else np.abs(values) - 1.0
    assert growth[0] < 0.0
    assert np.all(np.diff(growth) <= 1e-12)
    closed = a - b @ gain
    spent = np.diag(weights) + gain.T @ np.diag(price) @ gain
    if dt is None:
        left = closed.T @ cost + cost @ closed + spent
        best = np.diag(price) @ gain - b.T @ cost
    else:
        left = closed.T @ cost @ closed - cost + spent
        best = np.diag(price) @ gain - b.T @ cost @ closed
    size = np.abs(closed.T @ cost).max()
    assert np.abs(left).max() < 1e-8 * size
    assert np.abs(best).max() < 1e-8 * np.abs(b.T @ cost).max()
    assert np.linalg.eigvalsh(cost)[0] > 0.0


@pytest.mark.slow
def test_a_regulated_robot_comes_back_at_the_cost_that_was_said(differentiated: Load) -> None:
    """The robot itself, not its linear model, from a state beside that of the regulator."""
    module = differentiated("quadrotor")
    found = trim(module)
    weights, price, dt = np.ones(12), np.ones(4), 0.02
    regulator = lqr(module, found.q, found.v, found.u, weights, price, dt)
    rng = np.random.default_rng(0)
    x = 1e-3 * rng.normal(size=12)
    said = x @ regulator.cost @ x
    q, v, paid = module.integrate(found.q, x[:6]), x[6:], 0.0
    for _ in range(600):
        x = np.concatenate([module.difference(found.q, q), v - found.v])
        w = -regulator.gain @ x
        paid += x @ x + w @ w
        q, v = stepped(module, q, v, found.u + w, dt)
    assert np.abs(x).max() < 1e-6
    assert paid == pytest.approx(said, rel=2e-3)


def stepped(module: ModuleType, q: Array, v: Array, u: Array, dt: float) -> tuple[Array, Array]:
    """The state after a period, by steps of the second order."""
    for _ in range(4):
        step = dt / 4.0
        middle = v + 0.5 * step * module.forward_dynamics(q, v, u)
        halfway = module.integrate(q, 0.5 * step * v)
        q = module.integrate(q, step * middle)
        v = v + step * module.forward_dynamics(halfway, middle, u)
    return q, v


def test_motions_that_no_input_changes_are_named(differentiated: Load) -> None:
    module = differentiated("quadrotor")
    without = {name: 0.0 for name in module.PARAMETERS if name.endswith("_drag")}
    found = trim(module, parameters=without)
    for dt in (None, 0.01):
        with pytest.raises(UsageError) as refused:
            lqr(module, found, Q=np.ones(12), R=np.ones(4), dt=dt, parameters=without)
        assert str(refused.value) == (
            "quadrotor: cannot be stabilised here: no input changes attitude about the base's z "
            "and wz"
        )


def test_motions_that_the_weights_leave_free_are_named(differentiated: Load) -> None:
    module = differentiated("hexarotor_3link")
    found = trim(module)
    weights = np.ones(18)
    weights[[6, 15]] = 0.0
    for dt in (None, 0.01):
        with pytest.raises(
            UsageError,
            match=r"Q gives no weight to states that do not decay by themselves: x and the ",
        ):
            lqr(module, found, Q=weights, R=np.ones(9), dt=dt)


@pytest.mark.parametrize(
    ("weights", "price", "words"),
    [
        (np.ones(6), np.ones(4), r"Q: must be a symmetric matrix \(12, 12\) or its diagonal"),
        (np.full(12, np.inf), np.ones(4), "Q: must be .*; some are NaN or infinite"),
        (np.ones(12), np.full(4, np.nan), "R: must be .*; some are NaN or infinite"),
        (np.triu(np.ones((12, 12))), np.ones(4), "Q: must be a symmetric matrix"),
        (-np.ones(12), np.ones(4), "Q: must be positive semidefinite; its least eigenvalue is -1"),
        (np.ones(12), [1.0, 1, 1, 0], "R: must be positive definite; its least eigenvalue is 0"),
    ],
)
def test_weights_that_make_no_cost_are_refused(
    differentiated: Load, weights: Array, price: Array, words: str
) -> None:
    module = differentiated("quadrotor")
    found = trim(module)
    with pytest.raises(UsageError, match=words):
        lqr(module, found.q, found.v, found.u, weights, price)


def test_weights_are_needed(differentiated: Load) -> None:
    module = differentiated("quadrotor")
    with pytest.raises(UsageError, match="Q, R: missing; give weights of deviations"):
        lqr(module, trim(module), Q=np.ones(12))


def test_a_state_that_is_not_balanced_is_told(differentiated: Load) -> None:
    module = differentiated("quadrotor")
    found = trim(module)
    told = (
        r"quadrotor: the state is not an equilibrium: velocities change, vz by -4.91 m/s². Give a t"
    )
    with pytest.warns(RuntimeWarning, match=told):
        lqr(module, found.q, found.v, 0.5 * found.u, np.ones(12), np.ones(4))
    with pytest.warns(RuntimeWarning, match=r"change, vx by .* m/s² and vz by .* m/s²\. Give"):
        lqr(module, trim(module, acceleration=[1.0, 0, 0]), Q=np.ones(12), R=np.ones(4))
    with pytest.warns(RuntimeWarning, match="vz by 8.19 m/s²"):
        lqr(module, found, Q=np.ones(12), R=np.ones(4), parameters={"gravity": 1.62})


def test_a_wrench_of_the_trim_balances_too(differentiated: Load) -> None:
    """Without its wrench the trim is as any other state, and not balanced."""
    module = differentiated("quadrotor")
    found = trim(module, wrenches={"base": [0.0, 0, -3, 0, 0, 0]})
    weights, price = np.ones(12), np.ones(4)
    regulator = lqr(module, found, Q=weights, R=price)
    with pytest.warns(RuntimeWarning, match="vz by 2 m/s²"):
        other = lqr(module, found.q, found.v, found.u, weights, price)
    assert np.array_equal(regulator.gain, other.gain)


def test_what_inputs_reach_is_told_apart_in_any_coordinates() -> None:
    """A reached double integrator, one that is not, and a decay that is not, mixed."""
    rng = np.random.default_rng(3)
    a, b = np.zeros((5, 5)), np.zeros((5, 1))
    a[0, 1] = a[2, 3] = b[1, 0] = 1.0
    a[4, 4] = -2.0
    mix = rng.normal(size=(5, 5))
    a, b = mix @ a @ np.linalg.inv(mix), mix @ b
    stuck = unreached(a, b, lambda value: value.real > -1e-6)
    every = unreached(a, b, lambda value: True)
    assert stuck.shape == (5, 2)
    assert every.shape == (5, 3)
    expected = np.linalg.inv(mix).T[:, 2:4]
    assert np.linalg.matrix_rank(np.column_stack([stuck, expected]), tol=1e-8) == 2
    assert unreached(a, np.eye(5), lambda value: True).shape == (5, 0)
