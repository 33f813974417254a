"""A and B are how the flow of a robot moves deviations, and their discrete form is exact."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.differences import Array

from gibbs_codegen import UsageError, linearise, trim
from gibbs_codegen.flight.analysis.linear_model import held

Load = Callable[[str], ModuleType]

# Deviations, and how long they flow, s.
SMALL, SOON = 1e-4, 1e-5


def moving_state(module: ModuleType) -> tuple[Array, Array, Array]:
    """A state far from rest, and inputs."""
    rng = np.random.default_rng(1)
    q = np.array([float(name == "qw") for name in module.COORDINATES])
    q = module.integrate(q, 0.4 * rng.normal(size=len(module.VELOCITIES)))
    return q, rng.normal(size=len(module.VELOCITIES)), 3.0 * rng.normal(size=len(module.INPUTS))


def flowed(module: ModuleType, q: Array, v: Array, u: Array, time: float) -> tuple[Array, Array]:
    """The state a short time later or earlier, by one step of the fourth order."""

    def rates(q: Array, v: Array) -> tuple[Array, Array]:
        return module.coordinate_rates(q, v), module.forward_dynamics(q, v, u)

    first = rates(q, v)
    second = rates(q + 0.5 * time * first[0], v + 0.5 * time * first[1])
    third = rates(q + 0.5 * time * second[0], v + 0.5 * time * second[1])
    last = rates(q + time * third[0], v + time * third[1])
    dq, dv = (
        a + 2.0 * b + 2.0 * c + d for a, b, c, d in zip(first, second, third, last, strict=True)
    )
    return q + time / 6.0 * dq, v + time / 6.0 * dv


def flow_of_deviations(module: ModuleType, q: Array, v: Array, u: Array, time: float) -> Array:
    """The derivative by the deviation now of the deviation later; then that by inputs."""
    nv, nu = len(v), len(u)
    there = flowed(module, q, v, u, time)
    columns = []
    for way in SMALL * np.eye(2 * nv + nu):
        ends = []
        for sign in (1.0, -1.0):
            by_q, by_v, by_u = np.split(sign * way, [nv, 2 * nv])
            now = flowed(module, module.integrate(q, by_q), v + by_v, u + by_u, time)
            ends.append(np.concatenate([module.difference(there[0], now[0]), now[1] - there[1]]))
        columns.append((ends[0] - ends[1]) / (2.0 * SMALL))
    return np.transpose(columns)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hexarotor_3link"])
def test_deviations_grow_as_the_model_says(differentiated: Load, name: str) -> None:
    module = differentiated(name)
    q, v, u = moving_state(module)
    a, b = linearise(module, q, v, u)
    later, earlier = (flow_of_deviations(module, q, v, u, t) for t in (SOON, -SOON))
    found = (later - earlier) / (2.0 * SOON)
    nv = len(v)
    assert a == pytest.approx(found[:, : 2 * nv], rel=1e-5, abs=1e-5 * np.abs(a).max())
    assert b == pytest.approx(found[:, 2 * nv :], rel=1e-5, abs=1e-5 * np.abs(b).max())
    # The upper left block is what the flow makes of it, not nothing.
    assert bool(np.any(np.abs(a[:nv, :nv]) > 0.1)) == (module.ATTITUDE == "quaternion")
    assert np.array_equal(a[:nv, nv:], np.eye(nv))


def test_the_hold_is_exact(differentiated: Load) -> None:
    module = differentiated("quadrotor")
    q, v, u = moving_state(module)
    a, b = linearise(module, q, v, u)
    dt, rng = 0.13, np.random.default_rng(2)
    by_period = linearise(module, q, v, u, dt)
    assert all(map(np.array_equal, by_period, held(a, b, dt)))
    x, w = rng.normal(size=len(a)), rng.normal(size=b.shape[1])
    flown = solve_ivp(
        lambda _, x: a @ x + b @ w, (0.0, dt), x, method="DOP853", rtol=1e-12, atol=1e-12
    )
    assert by_period[0] @ x + by_period[1] @ w == pytest.approx(flown.y[:, -1], rel=1e-9, abs=1e-9)


def test_parameters_are_those_of_the_model(differentiated: Load) -> None:
    module = differentiated("quadrotor")
    moon = {"gravity": 1.62}
    found = trim(module, parameters=moon)
    a, _ = linearise(module, found, parameters=moon)
    # A tilt accelerates at g.
    assert np.abs(a[6:9, 3:6]).max() == pytest.approx(1.62, abs=1e-9)


def test_a_trim_stands_for_its_state(differentiated: Load) -> None:
    module = differentiated("quadrotor")
    found = trim(module, velocity=[1.0, 2.0, 0.0])
    by_parts = linearise(module, found.q, found.v, found.u, 0.1)
    assert all(map(np.array_equal, linearise(module, found, dt=0.1), by_parts))


@pytest.mark.slow
def test_a_trim_is_given_alone_and_of_the_same_robot(differentiated: Load) -> None:
    module = differentiated("quadrotor")
    found = trim(module)
    with pytest.raises(UsageError, match="v, u: a trim has its own"):
        linearise(module, found, found.v)
    with pytest.raises(UsageError, match="q, v, u: give all three, or a trim in the place of q"):
        linearise(module, found.q, found.v)
    with pytest.raises(UsageError, match="the trim is of quadrotor, not of hexarotor_3link"):
        linearise(differentiated("hexarotor_3link"), found)


def test_a_module_without_derivatives_is_told_the_option(shipped: Load) -> None:
    module = shipped("quadrotor")
    q, v, u = moving_state(module)
    with pytest.raises(UsageError, match="quadrotor --derivatives=forward_dynamics_derivatives"):
        linearise(module, q, v, u)


@pytest.mark.parametrize("dt", [0.0, -1.0, np.nan, np.inf, "soon", [0.1, 0.2]])
def test_a_period_is_above_zero(differentiated: Load, dt: float) -> None:
    module = differentiated("quadrotor")
    with pytest.raises(UsageError, match="dt: must be a period above zero, s"):
        linearise(module, *moving_state(module), dt)


@pytest.mark.parametrize(
    ("place", "given", "words"),
    [
        (0, np.zeros(7), "q: its quaternion qx, qy, qz, qw must have the length 1, not 0"),
        (1, np.full(6, np.nan), r"v \(.*\): must be 6 finite numbers; some are NaN"),
        (
            1,
            np.zeros((3, 6)),
            r"v \(.*\): must be 6 finite numbers, not an array of shape \(3, 6\)",
        ),
        (2, "four", r"u \(F_front_left, .*\): must be 4 finite numbers, not 'four'"),
    ],
)
def test_a_state_that_is_none_is_refused(
    differentiated: Load, place: int, given: Array, words: str
) -> None:
    module = differentiated("quadrotor")
    state = [*moving_state(module)]
    state[place] = given
    with pytest.raises(UsageError, match=words):
        linearise(module, *state)
