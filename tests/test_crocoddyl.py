"""The page about Crocoddyl: its flight arrives, and its model is Crocoddyl's own."""

from __future__ import annotations

import importlib.util
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.pages import run_python
from support.tools import missing

pytestmark = pytest.mark.usefixtures("derived_once")

# Of the acceleration and all derivatives, as a share of the largest entry.
AGREEMENT = 1e-10
DERIVATIVES = ("Fx", "Fu", "Lx", "Lu", "Lxx", "Lxu", "Luu")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the page defines."""
    if importlib.util.find_spec("crocoddyl") is None:
        missing("crocoddyl is not installed")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("page"))
        return run_python("docs/howto/crocoddyl.md")


@pytest.fixture(scope="module")
def own(page: dict[str, Any]) -> Any:
    """What makes Crocoddyl's own models of the robot of the page."""
    from support.robot_in_crocoddyl import crocoddyls_own

    return crocoddyls_own(page["uav"].NAME)


def evaluated(model: Any, x: Any, u: Any) -> Any:
    """The data of a model at a state."""
    data = model.createData()
    model.calc(data, x, u)
    model.calcDiff(data, x, u)
    return data


def states(page: dict[str, Any], count: int) -> list[tuple[Any, Any]]:
    """States near the start, of any attitude and speed, and inputs within the limits."""
    rng = np.random.default_rng(0)
    moves = rng.uniform(-2.0, 2.0, (count, page["state"].ndx))
    xs = [page["state"].integrate(page["start"], move) for move in moves]
    return [(x, rng.uniform(*page["hover"].limits)) for x in xs]


@pytest.mark.slow
def test_the_flight_arrives_within_its_limits(page: dict[str, Any]) -> None:
    flight, limits, goal = page["flight"], page["hover"].limits, page["goal"]
    inputs = np.array(flight.us)
    assert flight.isFeasible
    assert flight.iter <= 20
    assert np.all((limits[0] <= inputs) & (inputs <= limits[1]))
    # The limits matter: thrusts are at both of them, and torques at theirs, for a while.
    assert np.sum(inputs[:, :6] == limits[0, :6]) >= 3
    assert np.sum(inputs == limits[1]) >= 3
    assert np.linalg.norm(page["state"].diff(goal, flight.xs[-1])) < 1e-4
    assert np.linalg.norm(page["state"].diff(goal, flight.xs[0])) > 1.0


@pytest.mark.slow
def test_derivatives_are_crocoddyls_own(page: dict[str, Any], own: Any) -> None:
    arguments = page["state"], page["costs"](1.0), page["hover"].limits
    models = page["Dynamics"](*arguments), own(*arguments)
    for x, u in states(page, 20):
        ours, theirs = (evaluated(model, x, u) for model in models)
        for name in ("xout", *DERIVATIVES):
            expected = getattr(theirs, name)
            atol = AGREEMENT * max(1e-3, np.abs(expected).max())
            assert_allclose(getattr(ours, name), expected, rtol=0.0, atol=atol, err_msg=name)


@pytest.mark.slow
def test_derivatives_are_those_of_differences(page: dict[str, Any]) -> None:
    import crocoddyl

    problem = page["flight"].problem
    for model in (problem.runningModels[0].differential, problem.runningModels[0]):
        is_step = model is problem.runningModels[0]
        kind = "ActionModelNumDiff" if is_step else "DifferentialActionModelNumDiff"
        for x, u in states(page, 2):
            ours = evaluated(model, x, u)
            theirs = evaluated(getattr(crocoddyl, kind)(model, True), x, u)
            for name in ("Fx", "Fu", "Lx", "Lu"):
                expected = getattr(theirs, name)
                atol = 1e-5 * np.abs(expected).max()
                assert_allclose(getattr(ours, name), expected, rtol=0.0, atol=atol, err_msg=name)


@pytest.mark.slow
def test_crocoddyls_own_model_flies_the_same(page: dict[str, Any], own: Any) -> None:
    import crocoddyl

    flight, hover = page["flight"], page["hover"]
    other = crocoddyl.SolverBoxFDDP(page["problem"](own))
    assert other.solve([page["start"]] * 101, [hover.u] * 100, 50)
    assert other.iter == flight.iter
    for xs, ys in ((other.xs, flight.xs), (other.us, flight.us)):
        assert_allclose(np.array(xs), np.array(ys), rtol=0.0, atol=1e-6)
