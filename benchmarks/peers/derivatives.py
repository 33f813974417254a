"""Tasks and oracle of derivatives: what each tool gives, in its own coordinates.

A tool is right if it gives what Pinocchio's Python module gives for the robot in the tool's
coordinates: a vector and its derivatives by q (in the tangent space), v, and a, τ or u.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from peers import free_flyer
from peers.contender import Array, Contender, Results, States
from support.derivative_oracle import DerivativeOracle

from gibbs_codegen.robot.model import Robot

INVERSE = "inverse dynamics, derivatives, mass matrix"
FORWARD = "forward dynamics, derivatives"
DERIVATIVE_TASKS = (INVERSE, FORWARD)


@dataclass(frozen=True, kw_only=True)
class DerivativeContender(Contender):
    """A tool at derivatives; `right` gives what its outputs have to be."""

    right: Callable[[States], Results]


def by_oracle(robot: Robot, task: str, states: States, inputs: bool = False) -> Results:
    """What is right for a robot at states (q, v, a), (q, v, τ), or with `inputs` (q, v, u)."""
    oracle = DerivativeOracle(robot)
    if task == INVERSE:
        compute = oracle.inverse_dynamics_derivatives
    else:
        compute = oracle.forward_dynamics_derivatives if inputs else oracle.derivatives_by_forces
    found = [compute(*state) for state in zip(*states, strict=True)]
    return tuple(np.array(each) for each in zip(*found, strict=True))


class FreeFlyer:
    """A robot with attitude angles as a free-flyer, which has a quaternion."""

    def __init__(self, robot: Robot) -> None:
        self.robot = replace(robot, base=replace(robot.base, attitude="quaternion"))

    def inputs(self, task: str, states: States) -> States:
        """The free-flyer's configuration and velocity, and its accelerations or forces."""
        q, v, accelerations = states
        if task == FORWARD:
            return free_flyer.inputs(states)
        at = free_flyer.jacobian(q)
        moving = free_flyer.applied(at, accelerations) + free_flyer.bias(q, v)
        return free_flyer.configuration(q), free_flyer.applied(at, v), moving

    def right(self, task: str, states: States) -> Results:
        """What is right for the free-flyer."""
        return by_oracle(self.robot, task, self.inputs(task, states))

    def outputs(self, states: States, first: Array, second: Array) -> Results:
        """The vector and its matrices, as they are."""
        size = states[1].shape[1]
        vectors, *matrices = np.split(first, size + size**2 * np.arange(3), axis=1)
        return vectors, *(rows.reshape(-1, size, size) for rows in matrices)
