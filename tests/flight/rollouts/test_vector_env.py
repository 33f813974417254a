"""The vector environment against Gymnasium's own, integration by SciPy, and Gymnasium's checks."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.stats import norm, uniform

from gibbs_codegen import rollout, scaled
from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.rollouts.tasks import is_lost
from gibbs_codegen.flight.rollouts.vector_env import Moment, VectorEnv
from gibbs_codegen.flight.scenario.parts import Control
from gibbs_codegen.flight.scenario.walls import Plane
from gibbs_codegen.runtime.rollouts import DIVERGED, OUT_OF_BOUNDS

Array = NDArray[np.float64]
Load = Callable[[str], ModuleType]

SETTINGS: dict[str, Any] = {
    "limits": (0.0, 8.0),
    "time_constants": 0.03,
    "offsets": {"vx": uniform(-0.5, 1.0), "wy": norm(0.0, 0.1), "vz": 0.25},
    "rates": {"wx": uniform(-1.0, 2.0)},
    "parameters": {"base_mass": uniform(0.9, 0.4), "base_com_z": scaled([0.0, 2.0])},
    "duration": 0.3,
    "dt": 0.005,
    "steps": 4,
}
# What is drawn beside that, below an inner loop.
EVERYTHING: dict[str, Any] = {
    "action": "rates",
    "task": "track",
    "targets": {"vx": uniform(-0.3, 0.6)},
    "swings": {"vy": 0.2, "vz": uniform(0.0, 0.3)},
    "disturbances": {
        "time_constant": uniform(0.01, 0.04),
        "strength": uniform(0.7, 0.3),
        "base_x": norm(0.0, 0.5),
    },
    "sensors": {"position": 0.02, "angular_velocity": uniform(0.0, 0.1), "delay": 0.03},
}


@pytest.fixture
def quadrotor(fast: Load) -> ModuleType:
    return fast("quadrotor")


class One(gymnasium.Env[Any, Any]):
    """One environment, which a vector environment of one makes."""

    metadata = {"render_modes": []}  # noqa: RUF012

    def __init__(self, robot: ModuleType, **settings: Any) -> None:
        self.many = VectorEnv(robot, 1, autoreset_mode=AutoresetMode.DISABLED, **settings)
        self.action_space = self.many.single_action_space
        self.observation_space = self.many.single_observation_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        super().reset(seed=seed)
        observations, _ = self.many.reset(seed=seed)
        return observations[0], {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Take a decision."""
        observations, rewards, terminated, truncated, infos = self.many.step(action[np.newaxis])
        ended = {"ended": infos["ended"][0]}
        return observations[0], float(rewards[0]), bool(terminated[0]), bool(truncated[0]), ended


@pytest.mark.parametrize("mode", ["SameStep"])
def test_is_what_gymnasium_makes_of_single_environments(quadrotor: ModuleType, mode: str) -> None:
    """So episodes neither depend on how many environments there are, nor on each other."""
    count = 4
    settings = {**SETTINGS, **EVERYTHING, "rates": {"wx": uniform(-8.0, 16.0)}}  # Some turn over.
    ours = VectorEnv(quadrotor, count, autoreset_mode=mode, **settings)
    singles = [lambda: One(quadrotor, **settings)] * count
    theirs = SyncVectorEnv(singles, autoreset_mode=AutoresetMode(mode))
    assert ours.metadata["autoreset_mode"] == theirs.metadata["autoreset_mode"]
    assert ours.single_action_space == theirs.single_action_space
    assert ours.action_space == theirs.action_space
    assert ours.observation_space == theirs.observation_space
    assert data_equivalence(ours.reset(seed=7), theirs.reset(seed=7), exact=True)
    rng, endings = np.random.default_rng(1), np.zeros(2)
    for number in range(50):
        actions = rng.uniform(-1.2, 0.4, (count, 4))
        here, there = ours.step(actions), theirs.step(actions)
        assert data_equivalence(here, there, exact=True), number
        endings += [here[2].sum(), here[3].sum()]
    assert np.all(endings > 2)


def test_single_environment_passes_the_checks_of_gymnasium(quadrotor: ModuleType) -> None:
    with pytest.warns(UserWarning, match="Box observation space"):  # It has no bounds.
        check_env(One(quadrotor, **SETTINGS), skip_render_check=True)


def test_gymnasium_makes_and_wraps_it(quadrotor: ModuleType) -> None:
    spec = EnvSpec(
        "Hover-v0", vector_entry_point="gibbs_codegen.flight.rollouts.vector_env:VectorEnv"
    )
    made = gymnasium.make_vec(spec, num_envs=3, robot=quadrotor, **SETTINGS)
    counted = RecordEpisodeStatistics(made)
    counted.reset(seed=0)
    for _ in range(15):
        *_, infos = counted.step(np.zeros((3, 4)))
    assert list(infos["episode"]["l"]) == [15, 15, 15]


def test_flies_as_the_equations_of_motion_say(quadrotor: ModuleType) -> None:
    """A decision with lag and a mass of its own, integrated by SciPy with tight tolerances."""
    settings = {**SETTINGS, "observe": lambda now: np.concatenate([now.q, now.v], axis=1)}
    ours = VectorEnv(quadrotor, 3, **settings)
    start, _ = ours.reset(seed=11)
    actions = np.array([[0.1, -0.2, 0.3, 0.0], [-0.5, 0.5, 2.0, 0.5], [-1.0, -1.0, 0.0, 0.0]])
    after = ours.step(actions)[0]
    inputs = 4.0 * (np.clip(actions, -1.0, 1.0) + 1.0)
    still = np.zeros(6)
    weight = quadrotor.inverse_dynamics(np.array([0, 0, 0, 0, 0, 0, 1.0]), still, still)[2]
    for i, mass in enumerate(ours.parameters["base_mass"]):
        com = ours.parameters["base_com_z"][i]
        constants = quadrotor.prepare({"base_mass": mass, "base_com_z": com})

        def rates(time: float, state: Array) -> Array:
            q, v = state[:7], state[7:]
            u = inputs[i] + (weight / 4 - inputs[i]) * np.exp(-time / 0.03)  # noqa: B023
            a = quadrotor.forward_dynamics(q, v, u, constants)  # noqa: B023
            return np.concatenate([quadrotor.coordinate_rates(q, v), a])

        found = solve_ivp(rates, (0.0, 0.02), start[i], rtol=1e-10, atol=1e-12).y[:, -1]
        np.testing.assert_allclose(after[i], found, atol=3e-6)


def test_what_episodes_draw_acts_as_in_rollouts(quadrotor: ModuleType) -> None:
    """Lag, weaker motors, forces and masses of each episode, as of single rollouts."""
    drawn = {"disturbances": {**EVERYTHING["disturbances"], "base_z": -1.0}}
    settings = {**SETTINGS, **drawn, "observe": lambda now: np.concatenate([now.q, now.v], axis=1)}
    ours = VectorEnv(quadrotor, 3, **settings)
    ours.reset(seed=2)
    now = ours.now
    assert now.begun.all()
    ours.step(np.full((3, 4), 0.7))
    values = ours.episodes["disturbances"]
    for i, strength in enumerate(values["strength"]):
        wrench = np.zeros((len(quadrotor.FRAMES), 6))
        wrench[quadrotor.FRAMES.index("base"), :3] = values["base_x"][i], 0.0, -1.0
        u = np.minimum(6.8, 8.0 * strength)
        alone = rollout(
            *(quadrotor, now.q[i], now.v[i], np.full(4, u), 4, 0.005),
            parameters={name: x[i] for name, x in ours.parameters.items()},
            wrenches=wrench,
            time_constants=values["time_constant"][i],
            thrusts=now.thrusts[i],
        )
        np.testing.assert_allclose(ours.now.q[i], alone.q[0, -1], atol=1e-13)
        np.testing.assert_allclose(ours.now.v[i], alone.v[0, -1], atol=1e-12)


def test_targets_swing_and_observations_are_late(quadrotor: ModuleType) -> None:
    """Targets by sines, of which rates are the derivatives; what is seen is two decisions old."""
    settings = {**SETTINGS, "swings": {"vy": 0.4, "vz": uniform(0.1, 0.2)}, "duration": 5.0}
    ours = VectorEnv(quadrotor, 2, task="track", sensors={"delay": 0.039}, **settings)
    seen, _ = ours.reset(seed=4)
    assert seen.shape == (2, 18)
    moments = [ours.now]
    for _ in range(6):
        seen, *_ = ours.step(np.zeros((2, 4)))
        moments.append(ours.now)
    late = quadrotor.difference(moments[-1].target, moments[-3].q)
    np.testing.assert_allclose(seen[:, :12], np.hstack([late, moments[-3].v]), atol=1e-6)
    values = ours.episodes
    for name, place in (("vy", 1), ("vz", 2)):
        size, rate, phase = (values[x][name] for x in ("swings", "swing_rates", "phases"))
        assert np.all((rate > 0.3) & (rate < 1.5))
        for now in moments:
            angle = rate * now.time + phase
            np.testing.assert_allclose(now.target[:, place], size * np.sin(angle), atol=1e-13)
            np.testing.assert_allclose(now.target_v[:, place], size * rate * np.cos(angle))
    assert not moments[-1].begun.any()
    ours.data["mine"] = 3
    assert ours.now.data == {"mine": 3}


def test_a_target_that_turns_moves_at_its_velocity(quadrotor: ModuleType) -> None:
    """Integrated by the module along the velocities and accelerations that are told."""
    swings = {name: uniform(0.2, 0.3) for name in quadrotor.VELOCITIES}
    h, targets = 1e-3, {"wz": 1.0, "wx": -0.5}
    ours = VectorEnv(
        quadrotor, 5, limits=(0, 8), swings=swings, targets=targets, steps=1, dt=h, task="track"
    )
    ours.reset(seed=0)
    now = ours.now
    _, v, a = ours._target
    ours.step(np.zeros((5, 4)))
    after, v_after, _ = ours._target
    moved = quadrotor.integrate(now.target, h * (v + v_after) / 2.0)
    np.testing.assert_allclose(quadrotor.difference(moved, after), 0.0, atol=2e-9)
    np.testing.assert_allclose(v_after - v, h * (a + ours._target[2]) / 2.0, atol=2e-9)


def test_a_base_that_drives_is_off_sideways_too(shipped: Load) -> None:
    """It is lost there, begins there, and has targets and noise there; rates are ahead alone."""
    rover = shipped("rover_arm")
    place, settings = rover.COORDINATES.index("y"), {"limits": (-5.0, 5.0)}
    ours = VectorEnv(rover, 3, offsets={"vy": uniform(-3.0, 6.0)}, **settings)
    seen, _ = ours.reset(seed=1)
    now = ours.now
    assert seen.shape == (3, len(rover.VELOCITIES) * 2 + 1)
    np.testing.assert_allclose(now.away[:, 1], now.q[:, place])
    np.testing.assert_allclose(ours.rewards(now), 1.0 / (1.0 + now.q[:, place] ** 2))
    far = VectorEnv(rover, 2, offsets={"vy": 3.1}, **settings)
    far.reset()
    assert is_lost(far.now).all()
    ours = VectorEnv(rover, 400, task="reach", sensors={"position": 0.1}, **settings)
    seen, _ = ours.reset(seed=0)
    assert np.ptp(ours.now.target[:, place]) > 0.9
    np.testing.assert_allclose((seen[:, :2] - ours.now.away[:, :2]).std(0), 0.1, rtol=0.1)
    for wrong, message in (
        ({"swings": {"vy": 1.0}}, "swings: vy: unknown"),
        ({"swings": {"vx": 1.0}, "targets": {"wz": 1.0}}, "would slip sideways"),
    ):
        with pytest.raises(UsageError, match=message):
            VectorEnv(rover, 2, **settings, **wrong)


@pytest.mark.parametrize("task", ["reach", "track"])
def test_targets_of_tasks_are_within_limits_of_joints(shipped: Load, task: str) -> None:
    panda = shipped("panda")
    with pytest.raises(UsageError, match=r"hover: joint4: outside COORDINATE_LIMITS"):
        VectorEnv(panda, 2, task=task)
    low, high = np.transpose([panda.COORDINATE_LIMITS[name] for name in panda.COORDINATES])
    hover = 0.9 * high + 0.1 * low
    ours = VectorEnv(panda, 300, task=task, hover=hover)
    ours.reset(seed=0)
    wanted = [ours.now.target]
    for _ in range(20):
        ours.step(np.zeros((300, ours.single_action_space.shape[0])))
        wanted.append(ours.now.target)
    assert np.all((np.array(wanted) >= low) & (np.array(wanted) <= high))
    assert np.ptp(wanted[0], axis=0).min() > 0.3


def test_bristles_of_friction_go_from_decision_to_decision(quadrotor: ModuleType) -> None:
    """As of one rollout through both, of a machine that slides over the ground."""
    ground = Plane(frame="base", point=(0, 0, 0.001), normal=(0, 0, 1), stiffness=2e3, friction=0.5)
    settings = {"walls": [ground], "dt": 1e-3, "normalised": False, "limits": (0.0, 8.0)}
    ours = VectorEnv(quadrotor, 2, rates={"vx": uniform(0.1, 0.2)}, time_constants=0.0, **settings)
    ours.reset(seed=0)
    now, inputs = ours.now, np.full((2, 4), 1.0)
    for _ in range(2):
        ours.step(inputs)
    held = inputs[:, np.newaxis]
    once = rollout(quadrotor, now.q, now.v, held, 20, 1e-3, walls=[ground], time_constants=0.0)
    np.testing.assert_allclose(ours.now.v, once.v[:, -1], atol=1e-12)
    assert np.all(np.abs(once.v[:, -1, 0]) < 0.95 * now.v[:, 0])


def test_noise_is_as_wide_as_it_is_told(quadrotor: ModuleType) -> None:
    ours = VectorEnv(
        *(quadrotor, 4000), limits=(0, 8), sensors={"position": 0.1, "velocity": uniform(0.2, 0.4)}
    )
    seen, _ = ours.reset(seed=0)
    np.testing.assert_allclose(seen[:, :3].std(axis=0), 0.1, rtol=0.05)
    np.testing.assert_allclose(seen[:, 6:9].std(axis=0), np.sqrt(0.16 + 0.16 / 12), rtol=0.05)
    assert not seen[:, 3:6].any()
    assert not seen[:, 9:].any()


def test_tasks_see_tips_and_walls(fast: Load) -> None:
    """The tip off its target by forward kinematics, and the spring of a wall in which it is."""
    arm, hover = fast("quadrotor_arm_2link"), np.array([0, 0, 0, 0, 0, 0, 1.0, 0.3, 1.2])
    ours = VectorEnv(arm, 5, hover=hover, action="tip", task="reach")
    seen, _ = ours.reset(seed=1)
    assert ours.single_action_space.shape == (3,)
    now, tip = ours.now, arm.FRAMES.index("tip")
    places = [arm.frame_poses(q)[:, tip, :3, 3] for q in (now.q, now.target)]
    np.testing.assert_allclose(seen[:, 16:], places[0] - places[1], atol=1e-6)
    assert np.ptp(now.target[:, 7]) > 0.1
    rewards = 1.0 / (1.0 + 10.0 * (seen[:, 16:] ** 2).sum(1) + 0.1 * (seen[:, :8] ** 2).sum(1))
    np.testing.assert_allclose(ours.rewards(now), rewards, rtol=1e-5)
    at = arm.frame_poses(hover)[tip, :3, 3]
    wall = Plane(
        frame="tip", point=tuple(at - [0.01, 0, 0]), normal=(-1.0, 0.0, 0.0), stiffness=500.0
    )
    ours = VectorEnv(arm, 2, hover=hover, walls=[wall], task="push", targets={"force": 4.0})
    seen, _ = ours.reset()
    np.testing.assert_allclose(seen[:, 16:], [[-5.0, 0.0, 0.0, 4.0]] * 2, rtol=1e-6)
    np.testing.assert_allclose(ours.rewards(ours.now), 1.0 / (1.0 + 0.25**2))


@pytest.mark.parametrize("action", ["rates", "velocity"])
def test_actions_of_the_middle_hover(quadrotor: ModuleType, action: str) -> None:
    ours = VectorEnv(quadrotor, 2, limits=(0.0, 8.0), action=action, time_constants=0.02)
    ours.reset()
    for _ in range(10):
        _, rewards, *_ = ours.step(np.zeros((2, 4)))
    np.testing.assert_allclose(rewards, 1.0, atol=1e-9)
    ours.step(np.tile([0.5, 0.0, 0.0, 0.0], (2, 1)))
    assert np.all(ours.now.v[:, 2 if action == "rates" else 0] != 0.0)


def test_tensors_share_memory(quadrotor: ModuleType) -> None:
    torch = pytest.importorskip("torch")
    arrays, tensors = (VectorEnv(quadrotor, 3, tensors=each, **SETTINGS) for each in (False, True))
    first, found = arrays.reset(seed=5)[0], tensors.reset(seed=5)[0]
    assert torch.equal(found, torch.from_numpy(first))
    actions = torch.zeros(3, 4, requires_grad=True)
    for one, other in zip(
        tensors.step(actions)[:4], arrays.step(np.zeros((3, 4)))[:4], strict=True
    ):
        assert torch.equal(one, torch.from_numpy(other))


def test_only_environments_of_the_mask_begin_again(quadrotor: ModuleType) -> None:
    ours = VectorEnv(quadrotor, 4, autoreset_mode="Disabled", **SETTINGS)
    with pytest.raises(ResetNeeded):
        ours.step(np.zeros((4, 4)))
    with pytest.raises(UsageError, match="reset_mask: the first reset must begin all episodes"):
        ours.reset(options={"reset_mask": np.arange(4) > 1})
    first, _ = ours.reset(seed=0)
    for _ in range(15):
        last, _, _, truncated, _ = ours.step(np.zeros((4, 4)))
    assert truncated.all()
    with pytest.raises(ResetNeeded, match=r"over: \[0 1 2 3\]"):
        ours.step(np.zeros((4, 4)))
    before = ours.parameters["base_mass"]
    mask = np.array([False, True, False, True])
    again, _ = ours.reset(seed=[5, 1, 5, None], options={"reset_mask": mask})
    np.testing.assert_array_equal(again[~mask], last[~mask])
    np.testing.assert_array_equal(again[1], first[1])
    assert not np.allclose(again[3], first[3])
    np.testing.assert_array_equal(ours.parameters["base_mass"] == before, [True, True, True, False])
    assert ours.np_random_seed == (0, 1, 2, 3)
    assert np.all(np.abs(ours.parameters["base_mass"] - 1.1) <= 0.2)
    assert np.all(np.isin(ours.parameters["base_com_z"], [0.0, -0.02]))


def test_seed_of_its_own_can_be_had_again(quadrotor: ModuleType) -> None:
    ours = VectorEnv(quadrotor, 2, **SETTINGS)
    start, _ = ours.reset()
    other = VectorEnv(quadrotor, 2, **SETTINGS)
    np.testing.assert_array_equal(other.reset(seed=ours.np_random_seed)[0], start)
    assert [g.random() for g in other.np_random] == [g.random() for g in ours.np_random]


def test_inputs_that_hold_it_hold_it(shipped: Load) -> None:
    """At rest where it is wanted, an arm stretched out, the reward stays 1."""
    robot = shipped("hexarotor_3link")
    hover = np.array([0.0, 0.0, 0.0, 0.2, -0.7, 0.4, 1.0, 2.0, 3.0])
    still = np.zeros(9)
    holding = np.linalg.solve(
        robot.input_matrix(hover), robot.inverse_dynamics(hover, still, still)
    )
    limits = holding - 30.0, holding + 30.0
    ours = VectorEnv(robot, 2, hover=hover, limits=limits, time_constants=0.02, steps=5)
    start, _ = ours.reset()
    assert np.all(start == 0.0)
    _, rewards, terminated, _, _ = ours.step(np.zeros((2, 9)))
    np.testing.assert_allclose(rewards, 1.0, atol=1e-12)
    assert not terminated.any()
    plain = VectorEnv(robot, 2, hover=hover, limits=limits, normalised=False)
    np.testing.assert_allclose(plain.single_action_space.high, holding + 30.0, rtol=1e-6)
    plain.reset()
    assert np.all(plain.step(np.tile(holding, (2, 1)))[1] > 0.999999)


def test_functions_of_the_user_and_bounds(quadrotor: ModuleType) -> None:
    """Rewards see what was told and when; ends come from functions, bounds and divergence."""
    seen: list[Moment] = []

    def reward(now: Moment) -> Array:
        seen.append(now)
        return now.inputs.sum(axis=1)

    bounds = np.array([[-np.inf] * 13, [np.inf] * 13])
    bounds[0, 2], bounds[1, 10] = -0.001, 1e150
    ours = VectorEnv(
        *(quadrotor, 4),
        limits=(0.0, 8.0),
        time_constants=0.0,
        bounds=bounds,
        reward=reward,
        terminated=lambda now: now.inputs[:, 0] > 7.0,
        observe=lambda now: now.q[:, 2:3],
    )
    start, _ = ours.reset(seed=0)
    assert start.shape == (4, 1)
    up, down, over = [0.5, 0.5, 0.5, 0.5], [-1.0] * 4, [1.0, 0.5, 0.5, 0.5]
    _, rewards, terminated, _, infos = ours.step([up, down, over, up])
    np.testing.assert_allclose(rewards, [24.0, 0.0, 26.0, 24.0])
    np.testing.assert_array_equal(terminated, [False, True, True, False])
    np.testing.assert_array_equal(infos["ended"], [0, OUT_OF_BOUNDS, 0, 0])
    np.testing.assert_allclose(seen[-1].time, 0.02)
    observed, rewards, terminated, _, infos = ours.step([up] * 4)
    assert rewards[1] == rewards[2] == 0.0
    assert observed[1] == observed[2] == 0.0 < observed[0]
    np.testing.assert_array_equal(infos["_ended"], [True, False, False, True])


def test_machine_that_diverges_ends_without_warnings(quadrotor: ModuleType) -> None:
    ours = VectorEnv(quadrotor, 2, limits=(0.0, 8.0), rates={"wx": uniform(0.0, 1e155)}, dt=0.1)
    ours.reset(seed=3)
    observed, rewards, terminated, _, infos = ours.step(np.zeros((2, 4)))
    assert terminated.all()
    assert np.all(infos["ended"] == DIVERGED)
    assert np.isfinite(observed).all()
    assert np.isfinite(rewards).all()


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"limits": (0.0, np.inf)}, "limits: F_front_left, .*: no limits"),
    ({"limits": (0.0, [1.0, 2.0])}, "limits: must be the least and the greatest values"),
    ({"limits": 3}, "limits: must be the least and the greatest values"),
    ({"limits": (5.0, 1.0)}, "limits: entry 0: the least value 5 must not be above"),
    ({"bounds": (5.0, -5.0)}, "bounds: entry 0: the least value 5 must not be above"),
    ({"num_envs": 0}, "num_envs: must be a whole number of 1 or more, not 0"),
    ({"duration": 0.0}, "duration: must be a finite time above 0 s"),
    ({"dt": "0"}, "dt: must be a finite time above 0 s, not '0'"),
    ({"steps": True}, "steps: must be a whole number of 1 or more, not True"),
    ({"threads": 0}, "threads: must be a whole number of 1 or more, not 0"),
    ({"method": "foo"}, "method: 'foo' is unknown; known: euler, rk4"),
    ({"precision": "half"}, "precision: 'half' is unknown; known: double, single"),
    ({"autoreset_mode": "foo"}, "autoreset_mode: one of NextStep, SameStep, Disabled, not foo"),
    ({"hover": [0.0, 1.0]}, r"hover: its shape must be \(7,\)"),
    ({"hover": [np.nan] * 7}, "hover: value 0 of 7 must be finite, not nan"),
    ({"hover": np.ones((3, 7))}, "hover, time_constants: they are the same for all"),
    ({"time_constants": -0.1}, "time_constants.* must be 0 or more, in s"),
    ({"reward": 3}, "reward: must be a function"),
    ({"rates": 3}, "rates: values by name, not 3"),
    ({"offsets": {"x": 1.0}}, "offsets: x: unknown; known: vx, vy, vz, wx, wy, wz"),
    ({"rates": {"wx": scaled(0.8, 1.2)}}, "rates: wx: the value is 0"),
    ({"parameters": {"base_mass": "big"}}, "parameters: base_mass: a finite number or a distr"),
    ({"action": "fly"}, "action: one of inputs, rates, attitude, velocity, tip, not fly"),
    ({"joints": "rate"}, "joints: one of position, velocity, torque, not rate"),
    ({"action": "tip"}, "action: quadrotor has no tip; choose"),
    ({"action": "rates", "ranges": {"x": 1.0}}, "ranges: x: not an entry of the action"),
    ({"ranges": {"F_front_left": (2.0, 1.0)}}, r"ranges: F_front_left: .* not \(2.0, 1.0\)"),
    ({"task": "dance"}, "task: one of hover, reach, track, push, not dance"),
    ({"task": "push"}, "task: push needs tip: quadrotor has none here"),
    ({"disturbances": {"wind_x": 1.0}}, "disturbances: wind_x: unknown; known: base_x"),
    ({"sensors": {"delay": "long"}}, "sensors: delay: a finite number or a distribution"),
    ({"ranges": 3}, "ranges: values by name, not 3"),
    (
        {"ranges": {"F_front_left": (-5.0, 30.0)}},
        'ranges: with action="inputs" must be within the limits',
    ),
    ({"task": ["hover"]}, "task: one of hover, reach, track, push, not"),
    ({"joints": "torque"}, 'joints: has no effect with action="inputs"; leave it out'),
    ({"control": Control()}, 'control: has no effect with action="inputs"; leave it out'),
    ({"action": "rates", "control": 5}, "control: a Control, not 5"),
    ({"swings": 3}, "swings: values by name, not 3"),
    ({"observe": lambda now: now.time}, r"observe: an array \(3, m\), not of shape \(3,\)"),
]


@pytest.mark.parametrize(("wrong", "message"), WRONG)
def test_what_is_wrong_is_told(quadrotor: ModuleType, wrong: dict[str, Any], message: str) -> None:
    given = {"num_envs": 3, "limits": (0.0, 8.0), **wrong}
    with pytest.raises(UsageError, match=message):
        VectorEnv(quadrotor, **given)


@pytest.mark.parametrize(
    ("part", "name", "least"),
    [
        ("disturbances", "strength", "0"),
        ("disturbances", "time_constant", "0"),
        ("sensors", "position", "0"),
        ("sensors", "delay", "0"),
        ("targets", "force", "0.001"),
    ],
)
def test_what_is_drawn_too_small_is_told(
    quadrotor: ModuleType, part: str, name: str, least: str
) -> None:
    ours = VectorEnv(quadrotor, 9, limits=(0.0, 8.0), **{part: {name: uniform(-1.0, 1.1)}})
    with pytest.raises(UsageError, match=f"{part}: {name}: must be {least} or more"):
        ours.reset(seed=0)


def test_motors_without_limits_have_no_strength(quadrotor: ModuleType) -> None:
    """It would be a factor of what is infinite."""
    free = {"limits": (-np.inf, np.inf), "normalised": False}
    with pytest.raises(UsageError, match="disturbances: strength: unknown"):
        VectorEnv(quadrotor, 2, disturbances={"strength": 0.0}, **free)


def test_wrong_actions_and_results_are_told(quadrotor: ModuleType) -> None:
    ours = VectorEnv(quadrotor, 3, limits=(0.0, 8.0), reward=lambda now: now.q)
    ours.reset()
    with pytest.raises(UsageError, match=r"actions: must be finite numbers of shape \(3, 4\)"):
        ours.step(np.zeros(4))
    with pytest.raises(UsageError, match=r"actions: must be finite numbers of shape \(3, 4\)"):
        ours.step(np.full((3, 4), np.nan))
    with pytest.raises(UsageError, match=r"reward: an array \(3,\), not of shape \(3, 7\)"):
        ours.step(np.zeros((3, 4)))
    with pytest.raises(UsageError, match=r"actions: must be finite numbers of .*, not 'abc'"):
        ours.step("abc")
    for seed in ([1, 2], 3.5):
        with pytest.raises(UsageError, match="seed: a whole number, or 3 of them, not "):
            ours.reset(seed=seed)  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="reset_mask: must be 3 flags"):
        ours.reset(options={"reset_mask": np.zeros(3, dtype=bool)})


def test_parameters_of_no_machine_are_told(fast: Load, shipped: Load) -> None:
    for load in (fast, shipped):  # By C, by NumPy.
        ours = VectorEnv(load("quadrotor"), 2, limits=(0, 8), parameters={"base_mass": -1.0})
        with pytest.raises(UsageError, match="quadrotor: parameters: state 0 of 2: "):
            ours.reset()


def test_arguments_that_rollouts_take_are_taken(quadrotor: ModuleType) -> None:
    """Whole numbers of NumPy, and bounds that are the same for all coordinates."""
    ours = VectorEnv(quadrotor, np.int64(2), limits=(0.0, 8.0), bounds=(-5, 5), threads=2)  # type: ignore[arg-type]
    assert len(ours.reset()[0]) == 2


@pytest.mark.parametrize(("duration", "decisions"), [(0.14, 28), (0.142, 29), (0.001, 1)])
def test_episodes_are_truncated_in_time(
    quadrotor: ModuleType, duration: float, decisions: int
) -> None:
    """After the first decision at whose end the duration is over, whatever rounding says."""
    ours = VectorEnv(quadrotor, 1, limits=(0.0, 8.0), duration=duration, dt=0.005, steps=1)
    ours.reset()
    truncated = [bool(ours.step(np.zeros((1, 4)))[3][0]) for _ in range(decisions)]
    assert truncated == [False] * (decisions - 1) + [True]


def test_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.delitem(sys.modules, "gibbs_codegen.flight.rollouts.vector_env")
    with pytest.raises(UsageError, match="gibbs_codegen with its extra gymnasium"):
        importlib.import_module("gibbs_codegen.flight.rollouts.vector_env")
