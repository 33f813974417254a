"""Analytic gradients and PPO (Schulman et al., 2017) on `TorchEnv`, for the tasks beside this file.

In processor time of one thread. What is learnt is written as numbers, as C and as a curve, flown by
256 machines that it has not seen, and as C by `simulate`. `python examples/learners.py FOLDER …`
draws the curves of several folders as one figure, `training.png`.
"""

import argparse
import contextlib
import math
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from torch import nn

from gibbs_codegen import ProgramController, generate, load, read_scenario, simulate
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
        anew |= ~anew.any()  # Few machines: if none is drawn, all are.
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


def flown(program, module, scenario):
    """Root mean squares of errors of base and tip from 3 s on, mm, of flights of the policy's C."""
    air = {"wind": {"velocity": [3.0, 0.0, 0.0], "drag": {"base": 0.3}}}  # which pushes with 0.9 N
    heavy = {"plant": {x: 1.1 * y for x, y in module.PARAMETERS.items() if x.endswith("mass")}}
    told = []
    for name, others in ("calm", {}), ("wind", air), ("heavy", heavy), ("both", air | heavy):
        law = ProgramController(program, module, rate=1.0 / STEP, single=True)
        flight = simulate(module, read_scenario("hover", scenario | others), controller=law)
        late = flight.time >= 3.0
        here, there = (
            module.frame_poses(q[late])[:, [0, -1]][..., :3, 3]
            for q in (flight.q, flight.q_desired)
        )
        off = np.sqrt(np.square(1e3 * (here - there)).sum(2).mean(0))
        told.append(f"{name} {off[0]:.1f} and {off[1]:.1f} mm" + " (lost)" * bool(flight.stopped))
    return ", ".join(told)


def train(task, observe, reward, lost, errors, scenario, **settings):
    """Train, fly and write a policy of a task as the command line says."""
    parser = argparse.ArgumentParser(description=f"Train {ROBOT} to {task}.")
    parser.add_argument("--method", choices=[*METHODS], default="gradients")
    parser.add_argument("--seconds", type=float, default=60.0, help="of processor time")
    parser.add_argument("--rounds", type=int, help="in the place of seconds")
    parser.add_argument("--machines", type=int, help="that learn")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="folder; trained_TASK_METHOD if left out")
    options = parser.parse_args()
    learn, many, duration = METHODS[options.method]
    machines = options.machines or many
    folder = options.out or Path(f"trained_{task}_{options.method}")
    torch.manual_seed(options.seed)
    torch.set_num_threads(1)
    robot = load(generate(ROBOT, folder, derivatives=DERIVATIVES), "torch")
    settings |= {"dt": STEP, "steps": 1, "reward": reward}
    envs = TorchEnv(robot, machines, observe=observe, lost=lost, duration=duration, **settings)
    actor, begun, curve = network(envs, len(envs.actions)), [math.inf], []

    def seconds():
        return max(0.0, time.process_time() - begun[0])

    def share():
        return len(curve) / options.rounds if options.rounds else seconds() / options.seconds

    rounds = learn(envs, actor, share)
    next(rounds), next(rounds)  # which compile
    begun[0] = time.process_time()
    for mean in rounds:
        curve.append((seconds(), mean))
    np.savetxt(folder / "curve.csv", curve, delimiter=",", header="processor time s, mean reward")
    np.savez(folder / "policy.npz", *(x.detach().numpy() for x in actor.parameters()))
    program = envs.policy_program(actor)
    write_c(program, Functions(robot.in_c), folder)
    test = TorchEnv(
        robot,
        options.machines or 256,
        observe=lambda now: join(observe(now), errors(now)),
        duration=None,
        **settings,
    )
    decisions = len(curve) * machines * WINDOWS[options.method]
    print(f"{task} by {options.method}: {decisions} decisions, {judged(test, actor)}")
    print(f"as C: {flown(program, robot.in_c, scenario)}")
    with contextlib.suppress(ModuleNotFoundError):
        draw([folder], folder / "curve.png")


def draw(folders, path):
    """Draw the mean costs of decisions, smoothed, where Matplotlib is installed."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 3.0), layout="constrained")
    axes = figure.subplots()
    for folder in folders:
        times, means = np.loadtxt(folder / "curve.csv", delimiter=",").T
        share = np.full(max(1, len(times) // 60), 1.0 / max(1, len(times) // 60))
        axes.plot(times[len(share) - 1 :], -np.convolve(means, share, "valid"), label=folder.name)
    axes.set(xlabel="processor time, s", ylabel="mean cost of a decision", yscale="log")
    axes.grid(alpha=0.3, which="both")
    axes.legend()
    figure.savefig(path, dpi=110)


METHODS = {"gradients": (by_gradients, 192, None), "ppo": (by_ppo, 512, 5.0)}

if __name__ == "__main__":
    draw([Path(name) for name in sys.argv[1:]], "training.png")
