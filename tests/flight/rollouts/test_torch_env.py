"""Environments of PyTorch against `VectorEnv`, differences, and what the examples reach."""

from __future__ import annotations

import runpy
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from support.compiled import emit
from support.pages import run_python
from support.tools import tool

from gibbs_codegen import compile_program, scaled, uniform
from gibbs_codegen.arrays import Node, join, total
from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.rollouts.vector_env import Moment, VectorEnv
from gibbs_codegen.machine.policies import Situation
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.runtime.load import load

# CI has it in a folder of its own: it is large.
torch = pytest.importorskip("torch")
tool("cc")

from gibbs_codegen.flight.rollouts.torch_env import TorchEnv  # noqa: E402

pytestmark = pytest.mark.usefixtures("derived_once")
SETTINGS: dict[str, Any] = {
    "offsets": {"vx": uniform(-0.5, 0.5), "wx": uniform(-0.5, 0.5)},
    "rates": {"vy": uniform(-1.0, 1.0)},
    "parameters": {"base_mass": scaled(0.9, 1.1)},
    "duration": 0.1,
    "dt": 0.005,
    "steps": 4,
}
NEEDED = ["forward_dynamics_vjp", "integrate_derivatives", "difference_derivatives"]


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> ModuleType:
    folder = tmp_path_factory.mktemp("torch_env") / "module"
    emit(read_robot("quadrotor")[0], folder, derivatives=NEEDED)
    return load(folder, backend="torch")


def observe(now: Situation) -> Node:
    return join(now.q, now.v, now.actuators, *now.errors)


def reward(now: Situation, u: Node) -> Node:
    return -total(now.v * now.v) - 0.01 * total(u * u) - total(now.errors[0] * now.errors[0])


def environment(robot: ModuleType, n: int, **settings: Any) -> TorchEnv:
    return TorchEnv(robot, n, observe=observe, reward=reward, **(SETTINGS | settings))


@pytest.fixture(autouse=True)
def doubles() -> Any:
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(torch.float32)


def test_machines_fly_as_in_a_vector_environment(robot: ModuleType) -> None:
    """Through ends of episodes, each of which has a mass of its own."""

    def seen(now: Moment) -> np.ndarray:
        return np.concatenate([now.q, now.v, now.thrusts], axis=1)

    ours = environment(robot, 5)
    theirs = VectorEnv(robot.in_c, 5, observe=seen, autoreset_mode="SameStep", **SETTINGS)
    found, right = ours.reset(seed=3)[0], theirs.reset(seed=3)[0]
    generator = torch.Generator().manual_seed(0)
    for _ in range(12):
        np.testing.assert_allclose(found[:, :17].numpy(), right, rtol=1e-6, atol=1e-6)
        actions = 2.4 * torch.rand(5, 4, generator=generator) - 1.2
        found, _, *flags, infos = ours.step(actions)
        right, _, *others, told = theirs.step(actions.numpy())
        assert [x.tolist() for x in flags] == [x.tolist() for x in others]
        for row in np.flatnonzero(flags[1]):
            last = infos["final_obs"][row, :17].numpy()
            np.testing.assert_allclose(last, told["final_obs"][row], rtol=1e-6, atol=1e-6)
    assert ours.single_observation_space.shape == (29,)


def test_gradients_go_back_through_all_decisions_since_detach(robot: ModuleType) -> None:
    envs = environment(robot, 3, duration=None)

    def gained(actions: Any, parted: int = -1) -> Any:
        envs.reset(seed=1)
        rewards = 0.0
        for k, action in enumerate(actions):
            if k == parted:
                envs.detach()
            rewards = rewards + envs.step(action)[1].sum() * (k >= parted)
        return rewards

    actions = torch.full((5, 3, 4), -0.1, requires_grad=True)
    gained(actions).backward()
    way, step = torch.randn(5, 3, 4, generator=torch.Generator().manual_seed(0)), 1e-5
    ahead, behind = (gained(actions.detach() + k * step * way) for k in (1.0, -1.0))
    torch.testing.assert_close(
        (actions.grad * way).sum(), (ahead - behind) / (2 * step), rtol=1e-6, atol=1e-6
    )
    actions.grad = None
    gained(actions, parted=2).backward()
    assert not actions.grad[:2].any()
    assert actions.grad[2:].all()


def test_a_policy_commands_what_actions_of_its_network_do(robot: ModuleType) -> None:
    envs = environment(robot, 3)
    net = torch.nn.Sequential(torch.nn.Linear(29, 8), torch.nn.ELU(), torch.nn.Linear(8, 4))
    seen, _ = envs.reset(seed=0)
    program = envs.policy_program(net)
    places = np.split(np.arange(29), [7, 13, 17])[:3]
    given = {x: seen[:, at].numpy() for x, at in zip(("q", "v", "actuators"), places, strict=True)}
    still = {"q_desired": np.eye(7)[6], "v_desired": np.zeros(6)}
    for single, tolerance in ((False, 1e-12), (True, 1e-6)):
        u = compile_program(program, robot.in_c, single=single)(given | still)["u"]
        low, high = envs._limits
        right = low + 0.5 * (net(seen).detach().numpy().clip(-1.0, 1.0) + 1.0) * (high - low)
        np.testing.assert_allclose(u, right, atol=tolerance * high.max())
    with pytest.raises(UsageError, match=r"known, not ELU\(alpha=2"):
        envs.policy_program(torch.nn.Sequential(net[0], torch.nn.ELU(2.0)))


@pytest.mark.parametrize("action", ["inputs", "rates"])
def test_targets_swing_and_disturbances_act_as_in_a_vector_environment(
    robot: ModuleType, action: str
) -> None:
    """Of inner loops too, so are rewards, and targets where they will be."""
    settings = SETTINGS | {
        "duration": 0.3,
        "action": action,
        "swings": {"vx": uniform(0.1, 0.5)},
        "disturbances": {"strength": uniform(0.5, 1.0), "base_x": uniform(-1.0, 1.0)},
    }

    def seen(now: Moment) -> np.ndarray:
        return np.concatenate([now.q, now.v, now.thrusts, now.target - now.q], axis=1)

    def ahead(now: Situation) -> Node:
        return join(observe(now), *(now.q_ahead[k][0] for k in range(3)), now.ways_ahead[1][0])

    def near(now: Situation, u: Node) -> Node:
        return -total(now.errors[0] * now.errors[0]) - total(now.v * now.v)

    def also_near(now: Moment) -> np.ndarray:
        off = [(now.q - now.target)[:, :3], now.away[:, now.base_rotation], now.v]
        return -(np.hstack(off) ** 2).sum(axis=1)

    ours = TorchEnv(robot, 4, observe=ahead, reward=near, **settings)
    settings |= {"observe": seen, "reward": also_near, "autoreset_mode": "SameStep"}
    theirs = VectorEnv(robot.in_c, 4, **settings)
    first, targets = ours.reset(seed=5)[0], []
    theirs.reset(seed=5)
    for actions in torch.rand(20, 4, 4, generator=torch.Generator().manual_seed(0)) - 0.3:
        found, rewards, *_ = ours.step(actions)
        right, worth, *_ = theirs.step(actions.numpy())
        np.testing.assert_allclose(found[:, :20].numpy(), right[:, :20], rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(rewards.numpy(), worth, rtol=1e-6, atol=1e-9)
        targets.append(right[:, 17] + right[:, 0])
    np.testing.assert_allclose(first[:, 29], targets[4], rtol=1e-6, atol=1e-6)  # in 0.1 s
    np.testing.assert_allclose(first[:, 30], targets[9], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(first[:, 32], first[:, 30] - first[:, 0], atol=1e-6)


def test_what_it_does_not_have_is_refused(robot: ModuleType) -> None:
    with pytest.raises(UsageError, match="TorchEnv has no precision, threads; leave it out"):
        environment(robot, 2, precision="single", threads=2)
    with pytest.raises(UsageError, match="TorchEnv has no motion, task; leave it out"):
        environment(robot, 2, motion=None, task="reach")
    envs = environment(robot, 2)
    envs.reset(seed=0)
    for actions in (np.zeros(4), np.full((2, 4), np.nan)):
        with pytest.raises(UsageError, match=r"actions: finite numbers of shape \(2, 4\)"):
            envs.step(actions)
    with pytest.raises(UsageError, match="has no now"):
        print(envs.now)
    with pytest.raises(UsageError, match="observe: must give a vector"):
        TorchEnv(robot, 2, observe=lambda now: now, reward=reward)
    wrong = TorchEnv(robot, 2, observe=observe, reward=lambda now, u: now.v)
    wrong.reset(seed=0)
    with pytest.raises(UsageError, match="reward: must give a number"):
        wrong.step(np.zeros((2, 4)))


def test_observations_after_reset_know_the_parameters_of_episodes(robot: ModuleType) -> None:
    def force(now: Situation) -> Node:
        return now.robot.mass_matrix(now.q)[0]

    drawn = {"parameters": {"base_mass": uniform(0.5, 2.0)}, "dt": 1e-9, "steps": 1}
    envs = TorchEnv(robot, 3, observe=force, reward=reward, **drawn)
    seen = envs.reset(seed=0)[0]
    torch.testing.assert_close(seen, envs.step(torch.zeros(3, 4))[0], rtol=1e-6, atol=1e-6)


def test_lag_may_be_drawn_where_there_is_none(robot: ModuleType) -> None:
    """And policies look at as many thrusts as they were trained with, which may be none."""
    lag = {"time_constants": 0.0, "disturbances": {"time_constant": uniform(0.02, 0.05)}}
    ours = environment(robot, 3, **lag)
    theirs = VectorEnv(robot.in_c, 3, observe=lambda now: now.v, **(SETTINGS | lag))
    ours.reset(seed=2), theirs.reset(seed=2)
    actions = torch.full((3, 4), 0.3)
    found, right = ours.step(actions)[0][:, 7:13], theirs.step(actions.numpy())[0]
    np.testing.assert_allclose(found.numpy(), right, rtol=1e-6, atol=1e-6)
    without = environment(robot, 1, time_constants=0.0)
    size = without.single_observation_space.shape[0]
    assert size == 25
    assert without.policy_program([(np.zeros((4, size)), np.zeros(4))]).outputs["u"].shape == (4,)


def test_a_decision_ends_where_a_step_leaves_the_bounds(robot: ModuleType) -> None:
    """Thrown up without thrust, and back within bounds at its end."""
    low, high = np.full((2, 13), np.inf) * [[-1.0], [1.0]]
    high[2] = 0.01
    settings = {"rates": {"vz": 0.5}, "bounds": (low, high), "dt": 0.005, "steps": 50}
    ours = TorchEnv(robot, 2, observe=observe, reward=reward, **settings)
    theirs = VectorEnv(
        robot.in_c, 2, observe=lambda now: now.q, autoreset_mode="SameStep", **settings
    )
    ours.reset(seed=0), theirs.reset(seed=0)
    *_, ended, _, infos = ours.step(-torch.ones(2, 4))
    *_, over, _, told = theirs.step(-np.ones((2, 4)))
    assert ended.tolist() == over.tolist() == [True, True]
    np.testing.assert_allclose(infos["final_obs"][0, :7], told["final_obs"][0], atol=1e-6)


def test_no_gradient_goes_back_from_where_a_machine_diverges(robot: ModuleType) -> None:
    envs = environment(robot, 3, duration=None)
    weights = torch.zeros(4, 29, requires_grad=True)
    seen, _ = envs.reset(seed=0)
    envs._x = envs._x.clone()
    envs._x[1, 7:13] = 1e200
    rewards = []
    for _ in range(3):
        seen, gained, terminated, *_ = envs.step(seen @ weights.T)
        rewards.append(gained.clamp(min=-50.0))
        assert terminated.tolist() == [False, len(rewards) == 1, False]
    torch.stack(rewards).sum().backward()
    assert weights.grad.isfinite().all()
    assert weights.grad.any()


@pytest.mark.slow
def test_the_page_runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    torch.set_default_dtype(torch.float32)
    page = run_python("docs/howto/train.md")
    assert page["means"][-1] > 0.5 * page["means"][0]
    assert np.linalg.norm(page["flight"].errors[-1, :3]) < 0.2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("task", "method", "rounds"),
    [("hover", "ppo", 30), ("reach", "gradients", 60)],
)
def test_examples_learn(
    task: str, method: str, rounds: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """In rounds, which take as many steps on every machine: costs fall."""
    torch.set_default_dtype(torch.float32)
    monkeypatch.syspath_prepend(ROOT / "examples")
    command = f"train --method {method} --machines 64 --rounds {rounds} --out {tmp_path}"
    monkeypatch.setattr("sys.argv", command.split())
    runpy.run_path(str(ROOT / f"examples/train_{task}.py"), run_name="__main__")
    _, means = np.loadtxt(tmp_path / "curve.csv", delimiter=",").T
    assert len(means) == rounds
    assert means[-5:].mean() > 0.65 * means[5:10].mean()
    assert {"policy.npz", "quadrotor_arm_2link_policy.c"} <= {x.name for x in tmp_path.iterdir()}
