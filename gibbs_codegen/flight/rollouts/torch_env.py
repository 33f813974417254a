"""Many machines as one environment of PyTorch, whose steps are differentiable."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cached_property
from inspect import signature
from itertools import pairwise
from types import ModuleType
from typing import Any

import numpy as np

from gibbs_codegen.arrays.contents import owners_of
from gibbs_codegen.arrays.nodes import (
    Input,
    Node,
    Program,
    clip,
    constant,
    coordinates_of,
    maximum,
    variable,
)
from gibbs_codegen.errors import UsageError, printable, require
from gibbs_codegen.flight.plant.vehicle import Flags
from gibbs_codegen.flight.rollouts.vector_env import VectorEnv
from gibbs_codegen.machine.policies import (
    AHEAD,
    Layer,
    Measure,
    Situation,
    commanded,
    policy_program,
)
from gibbs_codegen.machine.rollout_steps import Parts, decision_program, sent
from gibbs_codegen.runtime.load import load
from gibbs_codegen.runtime.program_blocks import differentiable
from gibbs_codegen.runtime.rollouts import Problem, functions_of, given_inputs

require("torch", "TorchEnv")

import torch  # noqa: E402
from gymnasium.error import ResetNeeded  # noqa: E402

Reward = Callable[[Situation, Node], Node]
_DESIRED = "q_desired", "v_desired", "a_desired", "q_ahead"
# Settings of `VectorEnv` that mean nothing here.
_OTHERS = {"task", "terminated", "autoreset_mode", "precision", "threads", "sensors", "tensors"}


class TorchEnv(VectorEnv):
    """Machines of one robot, as those of `VectorEnv`, with tensors and a `step` with derivatives.

    A decision with its observation and reward is one compiled function, and backward another. The
    state is kept as tensors, so that a reward depends on all actions since `detach`. An episode
    that is over is followed by the next one at once. The desired motion is that of the targets;
    what surroundings do is the same all through a decision.

    Args:
        robot: A generated module with the back end "torch" or "c", with derivatives of what a step,
            the observation and the reward call; or the name or path of one.
        num_envs: How many environments there are, n.
        observe: The observation (m) of a `Situation`, as nodes of array programs.
        reward: The reward of a `Situation` and of the inputs (nu) that led there.
        lost: Above 0 where an episode ends, of a `Situation`; None for no such end.
        settings: Others of `VectorEnv`.

    Raises:
        UsageError: As of `VectorEnv`, and for settings that it does not have.
        MissingFunctionError: If the module lacks a function that is called.
    """

    def __init__(
        self,
        robot: ModuleType | str | os.PathLike[str],
        num_envs: int,
        *,
        observe: Measure,
        reward: Reward,
        lost: Measure | None = None,
        **settings: Any,
    ) -> None:
        if unknown := sorted({*settings} - ({*signature(VectorEnv).parameters} - _OTHERS)):
            raise UsageError(f"TorchEnv has no {', '.join(unknown)}; leave it out")
        module = robot if isinstance(robot, ModuleType) else load(robot, "c")
        self._measures = observe, reward, lost
        self._x: Any = None
        self._constants: dict[str, Any] = {}
        self._loads: dict[str, Any] = {}
        settings |= {"observe": lambda _: self._look().numpy()}
        super().__init__(
            getattr(module, "in_c", module), num_envs, autoreset_mode="SameStep", **settings
        )
        seen = np.zeros(self.observation_space.shape or ())
        self._observe = lambda _: seen  # It has told its shape; tensors are looked for here.

    @property
    def x(self) -> Any:
        """States (n, …): coordinates, velocities, what `Situation.actuators` are, bristles."""
        return self._x

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        """Begin episodes in all environments, or in some, and detach all from what led there.

        Args:
            options: `seed` and `options` of `VectorEnv.reset`.

        Returns:
            Observations (n, m), a tensor, and no further information.

        Raises:
            UsageError: As of `VectorEnv.reset`.
        """
        super().reset(**options)
        self.detach()
        return self._look(), {}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Take a decision in every environment.

        Args:
            actions: Actions (n, na), a tensor; those beyond their range count as at its end.

        Returns:
            Observations (n, m), rewards (n), whether episodes have terminated (n), whether they are
            truncated (n), and information: where episodes are over, `final_obs` (n, m), before the
            next ones begin. Numbers have PyTorch's default precision. A machine that diverges keeps
            the last state that it had, and no gradient goes back through that decision.

        Raises:
            UsageError: If actions are not finite numbers (n, na), or the reward is no number.
            gymnasium.error.ResetNeeded: Before the first `reset`.
        """
        if self._x is None:
            raise ResetNeeded("call reset() first")
        x, actions = self._x.view_as(self._x), torch.as_tensor(actions)
        if actions.shape != self.action_space.shape or not actions.isfinite().all():
            words = f"finite numbers of shape {self.action_space.shape}"
            raise UsageError(f"actions: {words}, not {printable(actions.tolist())}")
        actions = actions.view_as(actions)
        if self._surrounded.environment or self._actions.loop:
            self._give()
        self._decisions += 1
        if self._episodes.values["swings"]:
            self._target = self._wanted_at(self._time())
        self._x, seen, rewards, lost, gone = self._decision(
            x=x, actions=actions, **self._loads, **self._wanted(), constants=self._constants
        )
        if (gone > 0.0).any():  # There derivatives are infinite, and 0 times that is not 0.
            for y in (y for y in (x, actions) if y.requires_grad):
                y.register_hook(lambda by: torch.where(gone[:, None] > 0.0, 0.0, by))
        terminated = lost > 0.0
        truncated = torch.from_numpy(self._decisions >= self._most)
        over, dtype, infos = terminated | truncated, torch.get_default_dtype(), dict[str, Any]()
        seen = seen.to(dtype)
        if over.any():
            infos = {"final_obs": seen.detach(), "_final_obs": over}
            self._begin(over.numpy())
            seen = torch.where(over[:, None], self._look(), seen)
        return seen, rewards.to(dtype), terminated, truncated, infos

    @property
    def now(self) -> Any:
        """There is none, nor are there `rewards` of it: raises `UsageError`."""
        raise UsageError(
            "TorchEnv has no now and rewards; its state is x, and step returns rewards"
        )

    rewards = now

    def detach(self) -> None:
        """Go on from the state as it is: what led there has no part in later gradients."""
        self._x = self._x.detach()

    def policy_program(self, layers: Iterable[Layer], name: str = "policy") -> Program:
        """The policy of a network, as `gibbs_codegen.machine.policies.policy_program` makes it.

        Args:
            layers: Layers of the network, from observations (m) to actions (na).
            name: The name of the program.

        Returns:
            The program, with the observation, the inner loop and limits.

        Raises:
            UsageError: If layers do not go together, or are of an unknown kind.
        """
        robot, actions = functions_of(self._vehicle.module), self._actions

        def act(x: Node, now: Situation) -> Node:
            asked = commanded(x, actions.ranges, normalised=self._normalised)
            if actions.loop is None:
                return asked
            values = {"action": asked, "target": now.q_desired} | {
                name: constant(x) for name, x in actions.loads.items()
            }
            return clip(actions.loop.commands(robot, now.q, now.v, values), *self._limits)

        def observe(now: Situation) -> Node:  # Without lag there are no thrusts to look at.
            return self._measures[0](replace(now, actuators=now.actuators[: self._actuators]))

        return policy_program(robot, layers, observe, act, name)

    @cached_property
    def _actuators(self) -> int:
        """How many thrusts, or states of motors and servos, there are."""
        nothing = self._now.q.shape[1] + self._now.v.shape[1] + self._now.strains
        return int(self._state().shape[1]) - nothing

    def _situation(self, x: Node) -> Situation:
        """The one of a state."""
        robot = functions_of(self._vehicle.module)
        now = Situation.of(robot, self._actuators)
        ends = np.cumsum([0, now.q.size, now.v.size, self._actuators]).tolist()
        q, v, actuators = (x[begin:end] for begin, end in pairwise(ends))
        return replace(now, q=coordinates_of(q, robot.space), v=v, actuators=actuators)

    @cached_property
    def _step(self) -> Program:
        """A decision without observation and reward."""
        robot, problem = functions_of(self._vehicle.module), self._problem()
        return decision_program(robot, problem.method, self._parts, problem.steps)

    @property
    def _parts(self) -> Parts:
        """Parts of all decisions: with lag, too, where there is none before it is drawn."""
        parts = self._problem().parts
        return replace(parts, lag=parts.lag or "time_constant" in self.episodes["disturbances"])

    @cached_property
    def _command(self) -> str:
        """Name of the input of a step that says what is commanded."""
        return "action" if self._actions.loop else sent(functions_of(self._vehicle.module))

    @cached_property
    def _decision(self) -> Callable[..., Any]:
        """The function of tensors of a decision, with observation and reward."""
        observe, reward, lost = self._measures
        time, h, x, *others = self._step.inputs
        [command] = (y for y in others if y.operation == Input(self._command))
        actions = variable("actions", *command.shape)
        ranges, normalised = self._actions.ranges, self._normalised
        replaced = {time: constant(0.0), h: constant(self._now.dt)}
        replaced[command] = commanded(actions, ranges, normalised=normalised)
        made = self._step.results(*(replaced.get(y, y) for y in self._step.inputs))
        then = self._situation(made["x_next"])
        outputs = {
            "x_next": made["x_next"],
            "observation": observe(then),
            "reward": _shaped("reward", reward(then, made["inputs"]), 0),
            "lost": maximum(made["ended"], lost(then)) if lost else made["ended"],
            "diverged": made["diverged"],
        }
        inputs = x, actions, *then.desired, then.q_ahead, *(y for y in others if y is not command)
        program = Program("measured_decision", inputs, outputs)
        return differentiable(program, self._vehicle.module)

    @cached_property
    def _observation(self) -> Callable[..., Any]:
        """The function of tensors of an observation."""
        x = variable("x", self._state().shape[1])
        now = self._situation(x)
        inputs = x, *now.desired, now.q_ahead
        outputs = {"observation": _shaped("observe", self._measures[0](now), 1)}
        program = Program("observation", inputs, outputs)
        seen = differentiable(program, self._vehicle.module)
        if owners_of(program):
            return lambda **nodes: seen(**nodes, constants=self._constants)
        return seen

    def _problem(self) -> Problem:
        """The problem of the next decision."""
        return self._decided(self._now.inputs[:, 0])

    def _begin(self, rows: Flags) -> None:
        super()._begin(rows)
        fresh, began = self._state(), torch.from_numpy(rows)[:, None]
        self._x = fresh if self._x is None else torch.where(began, fresh, self._x)
        self._give()
        if self._parameters:  # Constants, and then parameters, of each machine.
            names, n = self._vehicle.module.PARAMETERS, self.num_envs
            values = [np.broadcast_to(self._parameters.get(x, y), n) for x, y in names.items()]
            made = np.column_stack([self._now.constants, *values])
            self._constants = {"robot": torch.from_numpy(made)}

    def _state(self) -> Any:
        """States (n, …) of machines that have just begun."""
        return torch.from_numpy(np.concatenate(self._problem().begin(self._parts), axis=1))

    def _look(self) -> Any:
        """Observations (n, m) of the machines."""
        x = self._state() if self._x is None else self._x.detach()
        return self._observation(x=x, **self._wanted()).to(torch.get_default_dtype())

    def _wanted(self) -> dict[str, Any]:
        """The desired motion of the machines."""
        ahead = np.stack([self._target[0]] * len(AHEAD))
        if self._episodes.values["swings"]:
            ahead = self._wanted_at(self._time() + AHEAD[:, np.newaxis])[0]
        return dict(zip(_DESIRED, (*self._target, ahead.swapaxes(0, 1)), strict=True))

    def _give(self) -> None:
        """Find limits, lag and what acts in the next decision."""
        inputs = given_inputs(self._problem(), self._parts, np)
        if not self._actions.loop and self._parts.limits:
            inputs |= dict(zip(("least", "most"), self._ends, strict=True))
        self._loads = {
            name: inputs[name] if inputs[name].ndim < 3 else inputs[name][:, 0]
            for name in self._step.names[3:]
            if name != self._command
        }


def _shaped(name: str, x: Any, axes: int) -> Node:
    """What a function of the user's gives; raises `UsageError` if it is not of so many axes."""
    if not (isinstance(x, Node) and len(x.shape) == axes and x.space is None):
        words = ("a number", "a vector")[axes]
        raise UsageError(
            f"{name}: must give {words}, as a node of array programs, not {printable(x)}"
        )
    return x
