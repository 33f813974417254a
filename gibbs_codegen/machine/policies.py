"""Policies: networks that were trained, as array programs for flights and firmware."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import (
    Input,
    Node,
    Program,
    clip,
    coordinates_of,
    exponential,
    maximum,
    minimum,
    ordered,
    variable,
)
from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.machine.base import Base, Motion, base_of

# How far ahead desired coordinates are known, s.
AHEAD = np.array([0.1, 0.2, 0.4])
# Beyond it the hyperbolic tangent is 1 to the last place, and exponentials are far from infinite.
_FAR = 20.0


def tanh(x: Node) -> Node:
    """Hyperbolic tangents of the entries."""
    return 1.0 - 2.0 / (1.0 + exponential(2.0 * clip(x, -_FAR, _FAR)))


# By the names of PyTorch's modules in lower case.
ACTIVATIONS: dict[str, Callable[[Node], Node]] = {
    "elu": lambda x: maximum(x, 0.0) + (exponential(minimum(x, 0.0)) - 1.0),
    "relu": lambda x: maximum(x, 0.0),
    "sigmoid": lambda x: 0.5 + 0.5 * tanh(0.5 * x),
    "tanh": tanh,
}
# A pair of weights (k, m) and offsets (k), as arrays or nodes, or the name of an activation.
Layer = Any


def network(layers: Iterable[Layer], x: Node) -> Node:
    """What a network of fully connected layers makes of a vector.

    Args:
        layers: A `torch.nn.Sequential` of `Linear` and of modules of `ACTIVATIONS`; or pairs of
            weights (k, m) and offsets (k), and names of activations. Nodes among them are
            parameters of the program, all else its constants.
        x: The vector (m).

    Returns:
        The node (k).

    Raises:
        UsageError: If a layer is of another kind, or does not go with the one before.
    """
    for layer in layers:
        kind = type(layer).__name__.lower()
        name = layer if isinstance(layer, str) else kind
        if name in ACTIVATIONS and getattr(layer, "alpha", 1.0) == 1.0:
            x = ACTIVATIONS[name](x)
        elif isinstance(layer, tuple):
            weights, offsets = layer
            x = weights @ x + offsets
        elif kind == "linear":
            weights = layer.weight.detach().double().numpy()
            x = weights @ x + (0.0 if layer.bias is None else layer.bias.detach().double().numpy())
        else:
            raise UsageError(
                f"layers: Linear, pairs of weights and offsets, and {', '.join(ACTIVATIONS)} "
                f"(elu with alpha=1) are known, not {printable(layer)}"
            )
    return x


@dataclass(frozen=True)
class Situation:
    """What observations and rewards are made of: a machine and its desired motion, as nodes.

    - `robot`: the functions of its module: `now.robot.frame_poses(now.q)`
    - `q` (nq), `v` (nv): coordinates and velocities
    - `actuators`: thrusts of motors that lag, N, or the states of motors and servos
    - `q_desired` (nq), `v_desired`, `a_desired` (nv): the desired motion
    - `q_ahead` (3, nq): the desired coordinates in 0.1, 0.2 and 0.4 s
    """

    robot: Functions
    q: Node
    v: Node
    actuators: Node
    q_desired: Node
    v_desired: Node
    a_desired: Node
    q_ahead: Node

    @classmethod
    def of(cls, robot: Functions, actuators: int) -> Situation:
        """That of variables, which are named as entries of an `Observation` are."""
        desired = robot.velocities("v_desired"), robot.velocities("a_desired")
        ahead = variable("q_ahead", len(AHEAD), robot.space.coordinates)
        seen = *robot.state(), variable("actuators", actuators)
        return cls(robot, *seen, robot.coordinates("q_desired"), *desired, ahead)

    @cached_property
    def base(self) -> Base:
        """The base, for vectors from world axes to its own, `to_base`, and back."""
        return base_of(self.robot, self.q)

    @cached_property
    def desired_base(self) -> Base:
        """The base where it is to be."""
        return base_of(self.robot, self.q_desired)

    @cached_property
    def errors(self) -> tuple[Node, Node]:
        """Ways to the desired motion and their rates (nv), those of the position in world axes."""
        return self.base.errors(self.v, Motion(*self.desired))

    @cached_property
    def ways_ahead(self) -> list[Node]:
        """Ways (nv), as those of `errors`, to each of the coordinates `q_ahead`."""
        rows = (coordinates_of(self.q_ahead[k], self.robot.space) for k in range(len(AHEAD)))
        return [self.base.errors(self.v, Motion(q, *self.desired[1:3]))[0] for q in rows]

    @property
    def desired(self) -> tuple[Node, Node, Node]:
        """The desired motion."""
        return self.q_desired, self.v_desired, self.a_desired


Measure = Callable[[Situation], Node]


def policy_program(
    robot: Functions,
    layers: Iterable[Layer],
    observe: Measure,
    act: Callable[[Node, Situation], Node],
    name: str = "policy",
) -> Program:
    """A policy with its observation, from the inputs of a controller to its commands.

    Args:
        robot: The functions of the machine's module.
        layers: As of `network`.
        observe: The observation (m) of a `Situation`.
        act: What actions (k), which the network makes of it, and a `Situation` command: inputs
            (nu), or commands of motors and servos.
        name: The name of the program.

    Returns:
        A program whose inputs are named as entries of an `Observation` are, those that the
        observation needs, then parameters; its output is `u` (nu).

    Raises:
        UsageError: If the layers do not go with each other or the observation.
        MissingFunctionError: If the module lacks a function that the observation calls.
    """
    now = Situation.of(robot, robot.actuator_states or robot.rotors)
    u = act(network(layers, observe(now)), now)
    read = [x for x in ordered([u]) if isinstance(x.operation, Input)]
    known = [now.q, now.v, now.actuators, *now.desired, now.q_ahead]
    state = [x for x in known if x in read]
    return Program(name, (*state, *(x for x in read if x not in state)), {"u": u})


def commanded(actions: Any, ranges: Any, clip: Any = clip, *, normalised: bool = True) -> Any:
    """What actions (na), nodes or as `clip` takes, stand for in ranges (2, na).

    If they are `normalised`, they are between -1 and 1.
    """
    least, most = np.asarray(ranges, dtype=float)
    if normalised:
        actions = least + (0.5 * (most - least)) * (clip(actions, -1.0, 1.0) + 1.0)
    return clip(actions, least, most)
