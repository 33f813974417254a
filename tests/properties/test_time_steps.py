"""Time steps and their derivatives, with attitude angles and with a quaternion, in both targets."""

from __future__ import annotations

import pydoc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import mpmath
import numpy as np
import pytest
from support.compiled import Emitted, Library, emit
from support.differences import rate

from gibbs_codegen.errors import MissingFunctionError, UsageError
from gibbs_codegen.program.choice import chosen_derivatives
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.runtime.load import load

Array = np.ndarray
State = tuple[Array, Array]
STEPS = ["step_euler", "step_rk4", "step_euler_derivatives", "step_rk4_derivatives"]
METHODS = ["euler", "rk4"]
LOW, HIGH = -0.9, 0.9


@pytest.fixture(scope="module", params=["quaternion"])
def emitted(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Emitted:
    """A small robot with all time steps."""
    robot = paper_family(3, 1)
    robot = replace(robot, base=replace(robot.base, attitude=request.param))
    return emit(robot, tmp_path_factory.mktemp("steps") / robot.name, derivatives=STEPS)


@pytest.fixture
def module(emitted: Emitted) -> ModuleType:
    """Its NumPy functions."""
    return emitted.module


def random_states(module: ModuleType, count: int) -> tuple[Array, Array, Array]:
    """Random q, v and u."""
    rng = np.random.default_rng(3)
    names = module.COORDINATES, module.VELOCITIES, module.INPUTS
    q, v, u = (rng.uniform(LOW, HIGH, (count, len(listed))) for listed in names)
    return module.integrate(q, np.zeros_like(v)), v, u


def flown(step: Callable[..., State], start: tuple[Array, Array, Array], parts: int) -> State:
    """Where a flight of 0.2 s in so many steps ends."""
    q, v, u = start
    for _ in range(parts):
        q, v = step(q, v, u, 0.2 / parts)
    return q, v


@pytest.mark.parametrize("name", STEPS)
def test_a_step_that_is_lost_warns_once_by_its_own_name(name: str, module: ModuleType) -> None:
    step = getattr(module, name)
    q, v, u = random_states(module, 3)
    v[1] = 1e200
    for where, state in (("", (q[1], v[1], u[1])), (" in 1 of 3 states, first [1],", (q, v, u))):
        with pytest.warns(RuntimeWarning) as said:
            step(*state, 0.01)
        (warning,) = said
        words = str(warning.message)
        assert words.startswith(f"{module.NAME}.{name} is not finite{where} though"), words
        assert words.endswith(f"largest there: v of {module.VELOCITIES[0]}, 1e+200)")
        assert warning.filename == __file__
    with np.errstate(invalid="raise"), pytest.raises(FloatingPointError, match=f"{name} is not"):
        step(q, v, u, 0.01)
    with np.errstate(invalid="ignore"):
        step(q, v, u, 0.01)
    v[1, 2] = np.nan  # What was given is no surprise; warnings are errors here.
    assert np.isfinite(step(q, v, u, 0.01)[1][0]).all()


def test_methods_have_their_order(module: ModuleType) -> None:
    method = "euler"
    start = random_states(module, 4)
    q, v = flown(module.step_rk4, start, 200)
    errors = []
    for parts in (8, 16):
        ended = flown(getattr(module, f"step_{method}"), start, parts)
        gap = np.concatenate([module.difference(q, ended[0]), ended[1] - v], axis=-1)
        errors.append(np.linalg.norm(gap))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("emitted", ["xyz"], indirect=True)
def test_rk4_is_the_classical_method_for_attitude_angles(module: ModuleType) -> None:
    q, v, u = random_states(module, 4)
    h, state, slopes = 0.05, np.concatenate([q, v], axis=-1), [0.0]
    for share in (0.0, 0.5, 0.5, 1.0):
        there, rates = np.split(state + share * h * slopes[-1], 2, axis=-1)
        acceleration = module.forward_dynamics(there, rates, u)
        slopes.append(np.concatenate([rates, acceleration], axis=-1))
    expected = state + h / 6.0 * (slopes[1] + 2.0 * (slopes[2] + slopes[3]) + slopes[4])
    found = np.concatenate(module.step_rk4(q, v, u, h), axis=-1)
    np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("method", METHODS)
def test_matrices_are_the_derivatives_of_the_step(module: ModuleType, method: str) -> None:
    q, v, u = random_states(module, 3)
    size, inputs, h = v.shape[1], u.shape[1], np.array([0.02, 0.05, 0.1])
    step = getattr(module, f"step_{method}")
    q_next, v_next, *matrices = getattr(module, f"step_{method}_derivatives")(q, v, u, h)
    for found, expected in zip((q_next, v_next), step(q, v, u, h), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13)
    for j, column in enumerate(np.moveaxis(np.concatenate(matrices, axis=-1), -1, 0)):
        along = np.eye(2 * size + inputs)[j]

        def moved(times: Array, along: Array = along) -> Array:
            dq, dv, du = np.split(times[:, None, None] * along, [size, 2 * size], axis=-1)
            there = module.integrate(q, np.broadcast_to(dq, (len(times), 3, size)))
            place, speed = step(there, v + dv, u + du, h)
            return np.concatenate([module.difference(q_next, place), speed], axis=-1)

        np.testing.assert_allclose(rate(moved, np.zeros(1))[0], column, rtol=1e-9, atol=1e-9)


def test_steps_without_inputs_keep_the_energy(module: ModuleType) -> None:
    q, v, _ = random_states(module, 2)
    u = np.zeros((2, len(module.INPUTS)))
    before = module.kinetic_energy(q, v) + module.potential_energy(q)
    drifts = {}
    for method in METHODS:
        ended = flown(getattr(module, f"step_{method}"), (q, v, u), 40)
        after = module.kinetic_energy(*ended) + module.potential_energy(ended[0])
        drifts[method] = np.abs(after - before).max() / module.kinetic_energy(q, v).max()
    assert drifts["rk4"] < 1e-6 < drifts["euler"] < 0.05


@pytest.mark.parametrize("name", STEPS)
def test_batches_broadcast(module: ModuleType, name: str) -> None:
    q, v, u = random_states(module, 3)
    step = getattr(module, name)
    batch = step(q[:, None], v[:, None], u[:1], [0.01, 0.02])
    for i, h in np.ndindex(3, 2):
        for found, one in zip(batch, step(q[i], v[i], u[0], (0.01, 0.02)[h]), strict=True):
            np.testing.assert_allclose(found[i, h], one, rtol=1e-13, atol=1e-13)
    with pytest.raises(ValueError, match="do not broadcast"):
        step(q, v, u, [0.1, 0.2])


@pytest.mark.parametrize("method", METHODS)
def test_a_method_is_chosen_by_its_name(module: ModuleType, method: str) -> None:
    state = [array[0] for array in random_states(module, 1)]
    for ending in ("", "_derivatives"):
        chosen = getattr(module, f"step{ending}")(*state, 0.1, method=method)
        expected = getattr(module, f"step_{method}{ending}")(*state, 0.1)
        for found, one in zip(chosen, expected, strict=True):
            np.testing.assert_array_equal(found, one)
    with pytest.raises(UsageError, match="method rk5: unknown; known: euler, rk4"):
        module.step(*state, 0.1, method="rk5")
    with pytest.raises(UsageError, match="method euler_derivatives: unknown"):
        module.step(*state, 0.1, method="euler_derivatives")
    shown = pydoc.plain(pydoc.render_doc(module.step_derivatives))
    assert "function step_derivatives" in shown
    assert 'or step_rk4_derivatives with method="rk4".' in shown


def test_a_module_without_steps_names_the_option() -> None:
    state = [np.zeros(9), np.zeros(9), np.zeros(9), 0.1]
    with pytest.raises(MissingFunctionError, match="--derivatives"):
        load("hexarotor_3link").step(*state)


def test_a_step_brings_what_it_is_composed_of() -> None:
    assert chosen_derivatives("step_rk4") == ("step_rk4",)
    assert chosen_derivatives("step_rk4_derivatives") == (
        "forward_dynamics_derivatives",
        "integrate_derivatives",
        "step_rk4_derivatives",
    )


@pytest.mark.slow
def test_both_targets_agree(emitted: Emitted, tmp_path: Path) -> None:
    library = Library(emitted, tmp_path / "steps.so", "gcc", ["-O0"])
    *state, h = *random_states(emitted.module, 11), np.linspace(0.01, 0.1, 11)
    for signature in emitted.signatures():
        if signature.name not in STEPS:
            continue
        expected = getattr(emitted.module, signature.name)(*state, h)
        rows = [*state, h]
        unused = np.array(np.nan)
        for found in (library.one(signature, rows), library.batch(signature, rows, unused)):
            for ours, theirs in zip(found, expected, strict=True):
                np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12)


def by_series(v: Array) -> tuple[Array, Array]:
    """exp(−ad) and the sum of (−ad)^k/(k + 1)! of a displacement, in numbers of 60 digits."""
    with mpmath.workdps(60):
        p, w = ([mpmath.mpf(float(x)) for x in part] for part in (v[:3], v[3:]))

        def across(x: list[mpmath.mpf]) -> list[list[mpmath.mpf]]:
            return [[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]]

        rows = [[*a, *b] for a, b in zip(across(w), across(p), strict=True)]
        rows += [[0, 0, 0, *a] for a in across(w)]
        minus, power = -mpmath.matrix(rows), mpmath.eye(6)
        place, motion = mpmath.zeros(6), mpmath.zeros(6)
        for k in range(120):
            place += power / mpmath.factorial(k)
            motion += power / mpmath.factorial(k + 1)
            power *= minus
        return tuple(np.array(m.tolist(), dtype=float) for m in (place, motion))


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-9, 1e-6, 1e-3, 0.1, 0.999, 1.001, 3.0, 6.0, 20.0])
def test_derivatives_of_displacements_are_accurate_at_any_angle(
    module: ModuleType, angle: float
) -> None:
    q, v, _ = (array[0] for array in random_states(module, 1))
    by_q, by_v = np.eye(len(v)), np.eye(len(v))
    if module.ATTITUDE == "quaternion":
        v[3:6] *= angle / np.linalg.norm(v[3:6])
        by_q[:6, :6], by_v[:6, :6] = by_series(v[:6])
    found = module.integrate_derivatives(q, v)
    np.testing.assert_allclose(found[0], by_q, rtol=0.0, atol=2e-15)
    np.testing.assert_allclose(found[1], by_v, rtol=0.0, atol=2e-15)
