"""Rollouts in C: against the module's own steps state by state, and against those in NumPy."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from support.derived import derived

from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.runtime.load import load
from gibbs_codegen.runtime.rollouts import (
    DIVERGED,
    OUT_OF_BOUNDS,
    RUNNING,
    Feedback,
    Method,
    MotorModel,
    Piece,
    Precision,
    Problem,
    Rollout,
    compiled_rollout,
    numpy_rollout,
    rollout_function,
    take_pieces,
)
from gibbs_codegen.targets.registry import find_targets, render_module

# A whole block and a part of one, also of single precision.
STATES, STEPS, DT = 21, 30, 0.002
ROTORS = 3
ROOM = {"double": 1e-12, "single": 2e-4}


@pytest.fixture(scope="module", params=["xyz", "quaternion"])
def module(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> ModuleType:
    """A small robot with its time steps."""
    robot = paper_family(ROTORS, 1)
    robot = replace(robot, base=replace(robot.base, attitude=request.param))
    folder = tmp_path_factory.mktemp("rollouts") / robot.name
    folder.mkdir()
    model = derived(robot, derivatives=("step_euler", "step_rk4"))
    for name, text in render_module(model, "", find_targets(("numpy", "c", "rollout"))).items():
        (folder / name).write_text(text, encoding="utf-8")
    return load(folder)


def problem_of(module: ModuleType, **changes: Any) -> Problem:
    """Random states and inputs, another input for each state and step."""
    rng = np.random.default_rng(5)
    v = rng.uniform(-0.5, 0.5, (STATES, len(module.VELOCITIES)))
    q = rng.uniform(-0.5, 0.5, (STATES, len(module.COORDINATES)))
    inputs = rng.uniform(0.0, 4.0, (STATES, STEPS, len(module.INPUTS)))
    q = module.integrate(q, np.zeros_like(v))
    return replace(Problem(module, None, q, v, inputs, STEPS, DT), **changes)


def motors_of(problem: Problem) -> MotorModel:
    """Motors that limit inputs, of which every second one lags."""
    rng = np.random.default_rng(6)
    lags = np.arange(ROTORS) % 2 * rng.uniform(0.01, 0.05, (STATES, ROTORS))
    limits = np.ones(problem.inputs.shape[-1])
    return MotorModel(0.5 * limits, 3.5 * limits, lags, rng.uniform(1.0, 2.0, (STATES, ROTORS)))


def feedback_of(problem: Problem) -> Feedback:
    """Feedback to another desired state in every step."""
    rng = np.random.default_rng(7)
    widths = problem.inputs.shape[-1], problem.v.shape[-1]
    by_step = np.linspace(0.0, 0.1, STEPS)[None, :, None]
    gain = rng.normal(size=(widths[0], 2 * widths[1]))
    return Feedback(gain, problem.q[:1, None], by_step * np.ones((1, STEPS, widths[1])))


def wrenches_of(problem: Problem) -> np.ndarray:
    """A wrench on every frame, another for each state."""
    frames = len(problem.module.FRAMES)
    return np.random.default_rng(8).normal(size=(STATES, 1, frames, 6))


def bounds_of(problem: Problem) -> np.ndarray:
    """Bounds of velocities of which half of the states go out, were they not held otherwise."""
    free = numpy_rollout(replace(problem, precision="double", every=1))
    most = np.full(problem.q.shape[1] + problem.v.shape[1], 1e3)
    most[problem.q.shape[1] :] = np.median(np.abs(free.v).max(axis=(1, 2)))
    return np.array([-most, most])


# What a problem may have besides, made from it as it is without.
PARTS: dict[str, Callable[[Problem], Any]] = {
    "motors": motors_of,
    "feedback": feedback_of,
    "wrenches": wrenches_of,
    "bounds": bounds_of,
}


def assert_same(found: Rollout, expected: Rollout, room: float) -> None:
    """All that comes out is the same, but for rounding."""
    np.testing.assert_array_equal(found.steps, expected.steps)
    np.testing.assert_array_equal(found.ended, expected.ended)
    np.testing.assert_allclose(found.time, expected.time)
    for name in ("q", "v", "thrusts"):
        ours, theirs = getattr(found, name), getattr(expected, name)
        assert (ours is None) == (theirs is None)
        if ours is not None:
            np.testing.assert_allclose(ours, theirs, rtol=room, atol=room)


@pytest.mark.parametrize("method", ["rk4"])
def test_a_hundred_steps_are_those_of_the_module(module: ModuleType, method: Method) -> None:
    problem = problem_of(module, method=method, steps=100)
    inputs = np.random.default_rng(9).uniform(0.0, 4.0, (STATES, 100, problem.inputs.shape[-1]))
    found = compiled_rollout(replace(problem, inputs=inputs))
    step = getattr(module, f"step_{method}")
    for state in (0, 11, STATES - 1):
        q, v = problem.q[state], problem.v[state]
        for number in range(100):
            q, v = step(q, v, inputs[state, number], DT)
            np.testing.assert_allclose(found.q[state, number + 1], q, rtol=1e-11, atol=1e-11)
            np.testing.assert_allclose(found.v[state, number + 1], v, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("precision", ["double", pytest.param("single", marks=pytest.mark.slow)])
@pytest.mark.parametrize("parts", [(), ("bounds",), tuple(PARTS)])
def test_all_parts_are_as_in_numpy(
    parts: tuple[str, ...], precision: Precision, module: ModuleType
) -> None:
    problem = problem_of(module, precision=precision, every=4)
    problem = replace(problem, **{part: PARTS[part](problem) for part in parts})
    if "bounds" in parts and precision == "single":
        problem = replace(problem, bounds=100.0 * bounds_of(problem))
    expected = numpy_rollout(problem)
    for function in (None, rollout_function(module, precision)):
        found = compiled_rollout(problem, function=function)
        assert_same(found, expected, ROOM[precision])
    if parts == ("bounds",) and precision == "double":
        assert {RUNNING, OUT_OF_BOUNDS} == set(found.ended)


@pytest.mark.slow
@pytest.mark.parametrize("precision", ["double"])
def test_every_state_may_have_parameters_of_its_own(
    precision: Precision, module: ModuleType
) -> None:
    problem = problem_of(module, precision=precision, wrenches=wrenches_of(problem_of(module)))
    given = {"gravity": np.linspace(3.0, 12.0, STATES), "link1_length": 0.4}
    found = compiled_rollout(replace(problem, constants=module.prepare(given)))
    for state in range(0, STATES, 4):
        own = {name: float(np.broadcast_to(x, STATES)[state]) for name, x in given.items()}
        one = slice(state, state + 1)
        alone = replace(
            problem,
            constants=module.prepare(own),
            q=problem.q[one],
            v=problem.v[one],
            inputs=problem.inputs[one],
            wrenches=wrenches_of(problem)[one],
        )
        expected = numpy_rollout(alone)
        np.testing.assert_allclose(found.q[one], expected.q, rtol=1e-12, atol=ROOM[precision])
        np.testing.assert_allclose(found.v[one], expected.v, rtol=1e-12, atol=ROOM[precision])
    assert np.ptp(found.v[:, -1, -1]) > 0.1


@pytest.mark.parametrize("rows", [(1, 1), (1, STEPS), (STATES, 1)])
def test_inputs_may_be_the_same_for_all_states_or_steps(
    rows: tuple[int, int], module: ModuleType
) -> None:
    problem = problem_of(module)
    problem = replace(problem, inputs=problem.inputs[: rows[0], : rows[1]])
    assert_same(compiled_rollout(problem), numpy_rollout(problem), 1e-12)


def test_a_state_that_diverges_changes_no_other(module: ModuleType) -> None:
    problem = problem_of(module)
    spoiled = problem.inputs.copy()
    spoiled[3, 10:] = 1e200
    found, whole = compiled_rollout(replace(problem, inputs=spoiled)), compiled_rollout(problem)
    others = np.arange(STATES) != 3
    assert found.ended[3] == DIVERGED
    assert 10 <= found.steps[3] < STEPS
    assert np.isfinite(found.q).all()
    np.testing.assert_array_equal(found.q[others], whole.q[others])
    np.testing.assert_array_equal(found.v[others], whole.v[others])
    np.testing.assert_array_equal(found.q[3, : 10 + 1], whole.q[3, : 10 + 1])
    last = found.v[3, found.steps[3]]
    np.testing.assert_array_equal(
        found.v[3, found.steps[3] :], np.broadcast_to(last, (STEPS + 1 - found.steps[3], len(last)))
    )


def test_threads_and_pieces_change_nothing(
    module: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = problem_of(module)
    problem = replace(problem, **{part: PARTS[part](problem) for part in PARTS}, every=4)
    expected = compiled_rollout(problem)
    for name in ("_FIRST", "_LEAST", "_CALL_SECONDS"):
        monkeypatch.setattr(f"gibbs_codegen.runtime.rollouts.{name}", 1)
    for threads in (1, 3):
        shares: list[float] = []
        assert_same(compiled_rollout(problem, threads, shares.append), expected, 0.0)
        assert shares == sorted(shares)
        assert shares[-1] == 1.0


@pytest.mark.parametrize("threads", [1, 2])
def test_what_is_told_may_end_a_rollout(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gibbs_codegen.runtime.rollouts._LEAST", 1)
    taken: list[Piece] = []
    before: list[int] = []

    def slow(piece: Piece) -> None:
        taken.append(piece)
        time.sleep(0.1)

    def stopped(share: float) -> None:
        assert share < 1.0
        before.append(len(taken))
        raise KeyboardInterrupt

    # Pieces that take this long do not grow: all of them would take more than an hour.
    with pytest.raises(KeyboardInterrupt):
        take_pieces(slow, 64, 1_000_000_000, threads, stopped)
    assert len(taken) <= before[0] + threads
