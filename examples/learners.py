"""Analytic gradients and PPO (Schulman et al., 2017) on `TorchEnv`, for the tasks beside this file.

In processor time of one thread. What is learnt is written as numbers, as C and as a curve, and
flown by 256 machines that it has not seen.
"""

import argparse
import contextlib
import math
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from torch import nn

from gibbs_codegen import generate, load
from gibbs_codegen.arrays import Functions, join, write_c
from gibbs_codegen.flight.rollouts.torch_env import TorchEnv

ROBOT, STEP = "quadrotor_arm_2link", 0.02  # s
DERIVATIVES = ["forward_dynamics_vjp", "integrate_derivatives", "frame_poses_derivatives"]
# Decisions between updates.
WINDOWS = {"gradients": 24, "ppo": 48}


def by_gradients(envs, actor, share):
    """Gradients of windows of half a second, by whose begin some machines have begun anew."""
    optimizer = torch.optim.Adam(actor.parameters())
    envs.reset(seed=0)
    while (done := share()) < 1.0:
        optimizer.param_groups[0]["lr"] = 2e-3 * (1.02 + math.cos(math.pi * done))
        anew = torch.rand(envs.num_envs).numpy() < 0.12
        seen, _ = envs.reset(options={"reset_mask": anew})
        rewards = []
        for _ in range(WINDOWS["gradients"]):
            seen, gained, *_ = envs.step(actor(seen))
            rewards.append(gained.clamp(min=-50.0))
        mean = torch.stack(rewards).mean()
        optimizer.zero_grad()
        (-mean).backward()
        if torch.isfinite(nn.utils.clip_grad_norm_(actor.parameters(), 1.0)):
            optimizer.step()
        yield mean.item()


def by_ppo(envs, actor, share):
    """Proximal policy optimisation, of rewards that are made positive: it pays to stay."""
    critic, spread = (
        network(envs, 1)[:-1],
        nn.Parameter(torch.full(envs.single_action_space.shape, -1.0)),
    )
    learnt = [*actor.parameters(), *critic.parameters(), spread]
    optimizer, (seen, _) = torch.optim.Adam(learnt, eps=1e-5), envs.reset(seed=0)
    while (done := share()) < 1.0:
        optimizer.param_groups[0]["lr"] = 1e-3 * (1.0 - 0.9 * done)
        rows, advantages, last = [], [], torch.zeros(envs.num_envs)
        with torch.no_grad():
            for _ in range(WINDOWS["ppo"]):
                normal = torch.distributions.Normal(actor(seen), spread.exp())
                action, value = normal.sample(), critic(seen)[:, 0]
                after, gained, terminated, truncated, infos = envs.step(action)
                gain, over = 1.0 / (1.0 - gained), terminated | truncated
                if over.any():  # Episodes that are not lost would go on.
                    gain += 0.99 * critic(infos["final_obs"])[:, 0] * (truncated & ~terminated)
                chance = normal.log_prob(action).sum(1)
                rows.append((seen, action, chance, value, gain, ~over, gained))
                seen = after
            ahead = critic(seen)[:, 0]
            for _, _, _, value, gain, goes_on, _ in reversed(rows):
                last = gain + 0.99 * goes_on * (ahead + 0.95 * last) - value
                advantages.insert(0, last)
                ahead = value
        obs, acts, chances, values, *_, gained = map(torch.cat, zip(*rows, strict=True))
        every = torch.cat(advantages)
        for batch in (batch for _ in range(4) for batch in torch.randperm(len(obs)).chunk(8)):
            normal = torch.distributions.Normal(actor(obs[batch]), spread.exp())
            ratio = (normal.log_prob(acts[batch]).sum(1) - chances[batch]).exp()
            a = (every[batch] - every[batch].mean()) / (every[batch].std() + 1e-8)
            miss = critic(obs[batch])[:, 0] - values[batch] - every[batch]
            loss = 0.5 * miss.square().mean() - 1e-3 * normal.entropy().sum(1).mean()
            loss -= torch.min(ratio * a, ratio.clamp(0.8, 1.2) * a).mean()
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(learnt, 0.5)
            optimizer.step()
        yield gained.mean().item()


def network(envs, outputs):
    """Two hidden layers; the last one begins small, so that a policy begins by hovering."""
    sizes = envs.single_observation_space.shape[0], 64, 64, outputs
    pairs = [(nn.Linear(*pair), nn.Tanh()) for pair in pairwise(sizes)]
    pairs[-1][0].weight.data *= 0.1
    return nn.Sequential(*(layer for pair in pairs for layer in pair))


def judged(envs, actor):
    """Root mean squares from 3 to 8 s of errors of base and tip, mm, and machines lost.

    The last six entries of observations are these errors.
    """
    kept, (seen, _) = [], envs.reset(seed=99)
    with torch.no_grad():
        for _ in range(round(8.0 / STEP)):
            seen, *_ = envs.step(actor(seen[:, :-6]))
            kept.append(seen[:, -6:].unflatten(1, (2, 3)).norm(dim=2))
    late = torch.stack(kept[round(3.0 / STEP) :])
    stays = (late < 1.0).all(2).all(0)
    base, tip = (1e3 * late[:, stays].square().mean((0, 1)).sqrt()).tolist()
    return f"base {base:.1f} mm, tip {tip:.1f} mm, lost {(~stays).sum()} of {len(stays)}"


def train(task, observe, reward, lost, errors, **settings):
    """Train, fly and write a policy of a task as the command line says."""
    parser = argparse.ArgumentParser(description=f"Train {ROBOT} to {task}.")
    parser.add_argument("--method", choices=[*METHODS], default="gradients")
    parser.add_argument("--seconds", type=float, default=60.0, help="of processor time")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="folder; trained_TASK_METHOD if left out")
    options = parser.parse_args()
    learn, machines, duration = METHODS[options.method]
    folder = options.out or Path(f"trained_{task}_{options.method}")
    torch.manual_seed(options.seed)
    torch.set_num_threads(1)
    robot = load(generate(ROBOT, folder, derivatives=DERIVATIVES), "torch")
    settings |= {"dt": STEP, "steps": 1, "reward": reward}
    envs = TorchEnv(robot, machines, observe=observe, lost=lost, duration=duration, **settings)
    actor, begun, curve = network(envs, len(envs.actions)), [math.inf], []

    def share():
        return max(0.0, time.process_time() - begun[0]) / options.seconds

    rounds = learn(envs, actor, share)
    next(rounds), next(rounds)  # which compile
    begun[0] = time.process_time()
    for mean in rounds:
        curve.append((share() * options.seconds, mean))
    np.savetxt(folder / "curve.csv", curve, delimiter=",", header="processor time s, mean reward")
    np.savez(folder / "policy.npz", *(x.detach().numpy() for x in actor.parameters()))
    write_c(envs.policy_program(actor), Functions(robot.in_c), folder)
    test = TorchEnv(
        robot,
        256,
        observe=lambda now: join(observe(now), errors(now)),
        duration=None,
        **settings,
    )
    decisions = len(curve) * machines * WINDOWS[options.method]
    print(f"{task} by {options.method}: {decisions} decisions, {judged(test, actor)}")
    with contextlib.suppress(ModuleNotFoundError):
        draw(curve, folder / "curve.png")


def draw(curve, path):
    """Draw the mean reward of each round, where Matplotlib is installed."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 3.0), layout="constrained")
    axes = figure.subplots()
    axes.plot(*np.transpose(curve))
    axes.set(xlabel="processor time, s", ylabel="mean reward")
    figure.savefig(path)


METHODS = {"gradients": (by_gradients, 192, None), "ppo": (by_ppo, 512, 5.0)}
