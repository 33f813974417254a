"""`rollout`: what it takes, in which shapes, and what it says of what it does not take."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from support.compiled import Emitted

from gibbs_codegen import Feedback, Rollout, UsageError, load, rollout

Array = np.ndarray
STATES, STEPS, DT = 3, 4, 0.02


def arguments(module: ModuleType) -> dict[str, Any]:
    """States and inputs that differ from state to state and from step to step."""
    rng = np.random.default_rng(2)
    sizes = len(module.COORDINATES), len(module.VELOCITIES)
    q, v = (rng.uniform(-0.5, 0.5, (STATES, size)) for size in sizes)
    u = rng.uniform(0.0, 4.0, (STATES, STEPS, len(module.INPUTS)))
    return {"q0": q, "v0": v, "control": u, "steps": STEPS, "dt": DT}


def same(found: Rollout, expected: Rollout, lane: Any = slice(None)) -> None:
    """Whether a rollout is another, or some of its states."""
    for name in ("q", "v", "thrusts", "steps", "ended"):
        ours, others = getattr(found, name), getattr(expected, name)
        assert (ours is None) == (others is None), name
        if ours is not None:
            np.testing.assert_allclose(ours, others[lane], rtol=1e-13, atol=1e-13, err_msg=name)


def test_what_is_said_once_is_said_of_all_states(module: ModuleType) -> None:
    settings = arguments(module)
    wrenches = np.random.default_rng(1).normal(size=(STEPS, len(module.FRAMES), 6))
    more = {"time_constants": 0.05, "limits": (0.5, 3.5), "wrenches": wrenches, "every": 2}
    q0, u = settings["q0"][0], settings["control"][0]
    once = rollout(module, **settings | {"q0": q0, "control": u}, **more)
    each = {
        "q0": np.tile(q0, (STATES, 1)),
        "control": np.tile(u, (STATES, 1, 1)),
        "time_constants": np.full((STATES, 3), 0.05),
        "limits": np.multiply.outer([0.5, 3.5], np.ones(len(module.INPUTS))),
        "wrenches": np.tile(wrenches, (STATES, 1, 1, 1)),
    }
    same(once, rollout(module, **settings | more | each))
    assert once.q.shape[:2] == (STATES, STEPS // 2 + 1)


def test_states_by_themselves_are_those_of_a_batch(module: ModuleType) -> None:
    settings = arguments(module)
    whole = rollout(module, **settings, method="euler")
    for i in range(STATES):
        own = {name: settings[name][i] for name in ("q0", "v0", "control")}
        same(rollout(module, **settings | own, method="euler"), whole, slice(i, i + 1))


def test_a_quaternion_is_normalised_at_the_begin(module: ModuleType) -> None:
    settings = arguments(module)
    normal = module.integrate(settings["q0"], np.zeros_like(settings["v0"]))
    same(rollout(module, **settings), rollout(module, **settings | {"q0": normal}))
    if module.ATTITUDE == "quaternion":
        for factor in (0.0, 1e200):
            settings["q0"][1, 3:7] *= factor
            with pytest.raises(UsageError, match=r"q0: value 1 of .* a quaternion of length 1 "):
                rollout(module, **settings)
            settings["q0"][1, 3:7] = 1.0


def test_a_controller_is_asked_at_every_sample(module: ModuleType) -> None:
    settings, calls = arguments(module), []
    held = settings["control"].copy()
    held[:, 1::2] = held[:, ::2]

    def controller(time: float, q: Array, v: Array) -> Array:
        calls.append((time, q, v))
        q[:], v[:] = np.nan, np.nan  # What it gets is its own.
        return held[:, round(time / DT)]

    more = {"time_constants": [0.0, 0.04, 0.02], "limits": (1.0, 3.0), "every": 2}
    found = rollout(module, **settings | {"control": controller}, **more)
    same(found, rollout(module, **settings | {"control": held}, **more))
    assert [time for time, _, _ in calls] == pytest.approx([0.0, 2 * DT])


def test_states_that_ended_stay_ended_under_a_controller(module: ModuleType) -> None:
    settings = arguments(module)
    settings["v0"][1] = 40.0
    size = len(module.COORDINATES) + len(module.VELOCITIES)
    most = np.where(np.arange(size) < len(module.COORDINATES), np.inf, 30.0)
    more = {"bounds": (-most, most), "time_constants": 0.05}
    inputs = settings["control"][:, 0]
    found = rollout(module, **settings | {"control": lambda time, q, v: inputs}, **more)
    same(found, rollout(module, **settings | {"control": inputs[:, None]}, **more))
    assert found.ended.tolist() == [0, 2, 0]
    assert found.steps.tolist() == [STEPS, 1, STEPS]


def test_feedback_is_added_to_inputs(module: ModuleType) -> None:
    settings, size = arguments(module), len(module.VELOCITIES)
    gain = np.random.default_rng(4).normal(size=(len(module.INPUTS), 2 * size))
    desired = settings["q0"][0], settings["v0"][0]
    found = rollout(module, **settings | {"control": Feedback(gain, *desired, settings["control"])})

    def law(time: float, q: Array, v: Array) -> Array:
        wanted = module.integrate(desired[0], np.zeros(size))
        error = np.concatenate([module.difference(q, wanted), desired[1] - v], axis=1)
        return settings["control"][:, round(time / DT)] + error @ gain.T

    same(found, rollout(module, **settings | {"control": law}))
    alike = [Feedback(gain, *desired, u) for u in (2, 2.0, np.full(len(module.INPUTS), 2.0))]
    ours, others, expected = (rollout(module, **settings | {"control": each}) for each in alike)
    same(ours, expected)
    same(others, expected)


def test_parameters_change_the_robot(module: ModuleType) -> None:
    settings, name = arguments(module), "link1_mass_per_length"
    heavy = {name: 2.0 * module.PARAMETERS[name]}
    found = rollout(module, **settings, parameters=heavy)
    q, v = found.q[1, 0], settings["v0"][1]
    for u in settings["control"][1]:
        q, v = module.step_rk4(q, v, u, DT, module.prepare(heavy))
    np.testing.assert_allclose(found.v[1, -1], v, rtol=1e-12)
    assert np.abs(found.v - rollout(module, **settings).v).max() > 1e-3


def test_progress_gets_to_its_end_and_can_interrupt(module: ModuleType) -> None:
    settings, told = arguments(module), []
    rollout(module, **settings, progress=lambda what, share: told.append((what, share)))
    assert told[-1] == ("rolling out", 1.0)
    assert [share for _, share in told] == sorted(share for _, share in told)

    def interrupt(what: str, share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        rollout(module, **settings, progress=interrupt)


@pytest.mark.slow
def test_c_and_numpy_do_the_same(
    emitted_steps: Emitted, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Parameters of each state too; what they are is tested with the compiled rollout."""
    compiled = load(emitted_steps.folder, backend="c")
    settings, inputs = arguments(compiled), len(compiled.INPUTS)
    settings["parameters"] = {"link1_mass_per_length": [0.5, 0.7, 0.9], "gravity": 3.7}
    settings["control"] = lambda time, q, v: 2.0 + time - v[:, :inputs]
    found, expected = (rollout(m, **settings) for m in (compiled, emitted_steps.module))
    np.testing.assert_allclose(found.q, expected.q, rtol=1e-12, atol=1e-13)
    rolled = rollout(compiled, **settings, precision="single", time_constants=0.05)
    assert {x.dtype for x in (rolled.q, rolled.v, rolled.thrusts)} == {np.dtype(np.float32)}
    single = rollout(compiled, **settings, precision="single").q
    assert 0.0 < np.abs(single - expected.q).max() < 1e-4
    monkeypatch.setenv("CC", "no-such-compiler")
    same(rollout(compiled, **settings), expected)
    assert caplog.text.count("rollouts run in NumPy instead of C: ") == 1
    assert rollout(compiled, **settings, precision="single").v.dtype == np.float32


def test_parameters_of_each_state_are_its_own(module: ModuleType) -> None:
    settings, masses = arguments(module), np.array([0.5, 0.7, 0.9])
    whole = rollout(module, **settings, parameters={"link1_mass_per_length": masses})
    for i in range(STATES):
        own = {name: settings[name][i] for name in ("q0", "v0", "control")}
        heavy = {"link1_mass_per_length": masses[i]}
        same(rollout(module, **settings | own, parameters=heavy), whole, slice(i, i + 1))


WRONG = {
    "q0: its shape must be (9,) or (states, 9), not (8,)": {"q0": np.zeros(8)},
    "q0: value [1, 2] of 18 must be finite, not nan": {
        "q0": [[0.0] * 9, [0.0, 0.0, np.nan] + [0.0] * 6]
    },
    "q0: has no states": {"q0": np.zeros((0, 9))},
    "v0 must be real numbers: not str": {"v0": "v"},
    "4 in v0, 2 in control; give equally many, or one": {
        "v0": np.zeros((4, 9)),
        "control": np.zeros((2, 1, 9)),
    },
    "control: its shape must be (9,), (steps, 9) or (states, steps, 9) with 1 or 4 steps": {
        "control": np.zeros((5, 9))
    },
    "what the controller returned: its shape must be (9,)": {"control": lambda *_: np.zeros(3)},
    "what the controller returned: value 0 of 9 must be finite": {
        "control": lambda *_: np.full(9, np.inf)
    },
    "what the controller returned: has 3 rows for 1 states": {
        "control": lambda *_: np.zeros((3, 9))
    },
    "q0: missing; only scenarios have a start": {"q0": None},
    "parameters: must map names to numbers or arrays, not [1]": {"parameters": [1]},
    "control.gain: its shape must be (9, 18), not (9, 9)": {
        "control": Feedback(np.eye(9), np.zeros(9), np.zeros(9))
    },
    "steps: must be a whole number of 1 or more, not 0": {"steps": 0},
    "dt: must be a finite time above 0 s, not nan": {"dt": float("nan")},
    "every: must divide the 4 steps, not 3": {"every": 3},
    "method: 'rk5' is unknown; known: euler, rk4": {"method": "rk5"},
    "precision: 'half' is unknown; known: double, single": {"precision": "half"},
    "threads: must be a whole number of 1 or more, not 0": {"threads": 0},
    "time_constants: value [1, 0] of 12 must be 0 or more, in s": {
        "time_constants": [[0.1] * 6, [-1.0] * 6]
    },
    "thrusts: without time_constants": {"thrusts": 1.0},
    "limits: entry 8: the least value 3 must not be above the greatest, 2": {
        "limits": (3.0, [3.0] * 8 + [2.0])
    },
    "limits: must be the least and the greatest values": {"limits": 5.0},
    "bounds: entry 0: the least value nan": {"bounds": (np.nan, 1.0)},
    "wrenches: its shape must be (2, 6), (steps, 2, 6) or": {"wrenches": np.zeros(6)},
    "hexarotor_3link: parameters: unknown parameter 'link2_lenght'": {
        "parameters": {"link2_lenght": 1.0}
    },
    "parameters: link2_length: value 17 of 1000 must be finite, not inf": {
        "parameters": {"link2_length": np.where(np.arange(1000) == 17, np.inf, 1.0)}
    },
}


@pytest.mark.parametrize("message", WRONG)
def test_what_is_wrong_is_told(message: str) -> None:
    module = load(ROOT / "generated" / "hexarotor_3link")
    right = {"q0": np.zeros(9), "v0": np.zeros(9), "control": np.zeros(9), "steps": 4, "dt": 0.01}
    with pytest.raises(UsageError) as error:
        rollout(module, **right | WRONG[message])
    assert message in str(error.value)
    assert len(str(error.value)) < 250


def test_a_back_end_without_rollouts_is_told() -> None:
    settings = {"q0": 0.0, "v0": 0.0, "control": 0.0, "steps": 1, "dt": 0.1}
    other = ModuleType("other")
    other.backend = "casadi"
    with pytest.raises(UsageError, match="back end numpy, c, jax"):
        rollout(other, **settings)
    with pytest.raises(UsageError, match="robot: must be a module, or the name or path of one"):
        rollout(3, **settings)
