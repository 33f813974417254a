"""Policies as array programs: numbers, C for firmware, and flights."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from support.compiled import build

from gibbs_codegen import ProgramController, compile_program, read_scenario, simulate, trim
from gibbs_codegen.arrays import Functions, Node, Program, evaluate, join, variable, write_c
from gibbs_codegen.errors import UsageError
from gibbs_codegen.machine.policies import Situation, commanded, network, policy_program

pytestmark = pytest.mark.usefixtures("derived_once")
Array = np.ndarray
RANDOM = np.random.default_rng(0)
HIDDEN = RANDOM.normal(0.0, 0.3, (9, 19)), RANDOM.normal(0.0, 1.0, 9)
LAST = RANDOM.normal(0.0, 0.4, (4, 9)), RANDOM.normal(0.0, 0.1, 4)
RANGES = np.array([[0.0] * 4, [6.0, 7.0, 8.0, 9.0]])
BY_NAME: dict[str, Callable[[Array], Array]] = {
    "elu": lambda x: np.where(x > 0.0, x, np.expm1(x)),
    "relu": lambda x: np.where(x > 0.0, x, 0.0),
    "sigmoid": lambda x: 1.0 / (1.0 + np.exp(-x)),
    "tanh": np.tanh,
}


@pytest.fixture(scope="module")
def robot(fast: Callable[[str], ModuleType]) -> ModuleType:
    return fast("quadrotor")


def observe(now: Situation) -> Node:
    """Errors and their rates, and the rest."""
    return join(*now.errors, 4.0 * now.base.to_world(now.v[3:6]), now.actuators)


def policy(robot: ModuleType, activation: str) -> Program:
    layers = [HIDDEN, activation, LAST, "tanh"]
    return policy_program(Functions(robot), layers, observe, lambda x, _: commanded(x, RANGES))


def states(robot: ModuleType, program: Program, count: int) -> dict[str, Array]:
    """Random values of the inputs of a policy."""
    given = {
        x: RANDOM.normal(size=(count, *y.shape))
        for x, y in zip(program.names, program.inputs, strict=True)
    }
    away = RANDOM.normal(size=(2, count, 6))
    neutral = np.eye(7)[6]
    return given | {
        "q": robot.integrate(neutral, away[0]),
        "q_desired": robot.integrate(neutral, away[1]),
    }


@pytest.mark.parametrize("activation", BY_NAME)
def test_a_policy_is_its_network_of_its_observation(robot: ModuleType, activation: str) -> None:
    program = policy(robot, activation)
    assert program.names == ["q", "v", "actuators", "q_desired", "v_desired"]
    given = states(robot, program, 50)
    now = Situation.of(Functions(robot), 4)
    seen = evaluate(Program("seen", program.inputs, {"x": observe(now)}), given, {"robot": robot})
    hidden = BY_NAME[activation](seen["x"] @ HIDDEN[0].T + HIDDEN[1])
    actions = np.tanh(hidden @ LAST[0].T + LAST[1])
    right = 0.5 * (actions + 1.0) * RANGES[1]
    np.testing.assert_allclose(evaluate(program, given, {"robot": robot})["u"], right, atol=1e-12)
    np.testing.assert_allclose(compile_program(program, robot)(given)["u"], right, atol=1e-12)
    single = compile_program(program, robot, single=True)(given)["u"]
    np.testing.assert_allclose(single, right, atol=1e-6 * RANGES.max())


@pytest.mark.slow
@pytest.mark.parametrize(("flag", "real"), [("", np.float64), ("-DQUADROTOR_FLOAT", np.float32)])
def test_firmware_computes_it(robot: ModuleType, flag: str, real: Any, tmp_path: Path) -> None:
    program, folder = policy(robot, "tanh"), Path(robot.__path__[0])
    _, source = write_c(program, Functions(robot), tmp_path)
    options = ["-O1", f"-I{folder}", "-shared", "-fPIC", *([flag] if flag else [])]
    path = build("gcc", options, [str(source), str(folder / "quadrotor.c")], tmp_path / "policy.so")
    library, given = ctypes.CDLL(str(path)), states(robot, program, 1)
    assert "malloc" not in source.read_text(encoding="utf-8")
    found = np.zeros(4, real)
    arrays = [np.ascontiguousarray(given[name][0], real) for name in program.names]
    suffix = "_float" if flag else ""
    defaults = ctypes.c_char.in_dll(library, f"quadrotor_default_constants{suffix}")
    constants = ctypes.byref(defaults)
    library.quadrotor_policy(constants, *(ctypes.c_void_p(x.ctypes.data) for x in (*arrays, found)))
    right = evaluate(program, given, {"robot": robot})["u"][0]
    np.testing.assert_allclose(
        found, right, atol=1e-12 if real is np.float64 else 1e-6 * RANGES.max()
    )


def test_a_policy_flies(robot: ModuleType) -> None:
    """One layer is linear feedback, which `simulate` flies as it flies the same in Python."""
    hover, gain = trim(robot).u, RANDOM.normal(0.0, 0.02, (4, 12))
    layers = [(gain, np.zeros(4))]
    ranges = np.stack([hover - 1.0, hover + 1.0])
    program = policy_program(
        Functions(robot),
        layers,
        lambda now: join(*now.errors),
        lambda actions, now: commanded(actions, ranges),
    )
    circle = {"kind": "circle", "centre": [0.0, 0.0, 2.0], "radius": 0.3, "period": 4.0}
    scenario = read_scenario(
        "hover", {"duration": 0.2, "base.path": circle, "start": {"offset": [0.1, 0.0, 0.1]}}
    )
    told = []

    def same(seen: Any) -> Array:
        told.append((seen.q_desired, seen.q_ahead))
        off = seen.q_desired[:3] - seen.q[:3]
        turn = robot.difference(seen.q, seen.q_desired)[3:]
        here, there = (robot.frame_poses(q)[0, :3, :3] for q in (seen.q, seen.q_desired))
        drift = there @ seen.v_desired[:3] - here @ seen.v[:3]
        spin = here.T @ there @ seen.v_desired[3:] - seen.v[3:]
        return hover + np.clip(gain @ np.concatenate([off, turn, drift, spin]), -1.0, 1.0)

    ours = simulate(robot, scenario, controller=ProgramController(program, robot, rate=100.0))
    theirs = simulate(robot, scenario, controller=same)
    assert ours.control_rate == 100.0
    np.testing.assert_allclose(ours.q[-1], theirs.q[-1], atol=1e-4)
    (start, ahead), (later, _) = told[0], told[100]
    assert np.linalg.norm(later - start) > 0.01
    np.testing.assert_allclose(ahead[0], later, atol=1e-12)  # in 0.1 s


def test_what_is_no_policy_is_refused(robot: ModuleType) -> None:
    with pytest.raises(UsageError, match=r"product: \(3, 2\) does not go with \(4,\)"):
        network([(np.zeros((3, 2)), np.zeros(3))], variable("x", 4))
    with pytest.raises(UsageError, match=r"elu, relu, sigmoid, tanh .* are known, not gelu"):
        network(["gelu"], variable("x", 3))
    program = Program("policy", (x := variable("distance"),), {"u": join(x, x, x, x)})
    with pytest.raises(UsageError, match="distance: no observation has this name"):
        ProgramController(program, robot)
