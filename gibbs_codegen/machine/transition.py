"""A machine as solvers of optimal control take it: rates of its state, and a step.

The state x has the entries of coordinates, but for angles of wheels, on which nothing depends, then
velocities and states of actuators. A quaternion may be of any length.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Node, Program, constant, entries_of, join, variable, zeros
from gibbs_codegen.machine.base import base_of
from gibbs_codegen.machine.machine import NO_SURROUNDINGS, Machine, Surroundings
from gibbs_codegen.machine.rollout_steps import sent
from gibbs_codegen.machine.state import State
from gibbs_codegen.machine.steps import METHODS, trapezoidal

STEPS = {**METHODS, "trapezoidal": trapezoidal}


@dataclass(frozen=True)
class Transition:
    """The programs of a robot, of whose constraints some are `active` (g): 1, else 0."""

    robot: Functions
    active: tuple[float, ...] = ()

    @property
    def entries(self) -> int:
        """Number of coordinates in x."""
        return self.robot.space.coordinates - self.robot.layout.q.wheels

    @property
    def size(self) -> int:
        """Length of x."""
        return self.entries + self.robot.space.velocities + self.robot.actuator_states

    @cached_property
    def machine(self) -> Machine:
        """What moves, with forces of constraints."""
        around = Surroundings(holds=True) if any(self.active) else NO_SURROUNDINGS
        return Machine(self.robot, lambda *_: constant(self.active), around)

    @property
    def sent(self) -> str:
        """Name of the input that says what is commanded."""
        return sent(self.robot)

    def rates(self) -> Program:
        """The time derivative `x_dot` of x, and the `inputs` (nu) that act."""
        x, whole, state, u = self._given
        moved = base_of(self.robot, state.q).rates(state.v, whole)[: self.entries]
        outputs = {"x_dot": join(moved, self._accelerate(state, u))}
        return Program("rates", (x, u), {**outputs, "inputs": self.machine.inputs(state, u)})

    def step(self, method: str, h: float) -> Program:
        """The state `x_next` after h (s)."""
        x, _, state, u = self._given
        nv = self.robot.space.velocities

        def move(q: Node, displacement: Node) -> Node:
            return self.robot.integrate(q, displacement[:nv])

        def accelerate(q: Node, moved: Node, _: int) -> Node:
            return self._accelerate(state._replace(q=q, v=moved[:nv], actuators=moved[nv:]), u)

        begin = join(state.v, state.actuators)
        q_next, moved = STEPS[method](move, accelerate, state.q, begin, constant(h))
        after = join(entries_of(q_next)[: self.entries], moved)
        return Program("step", (x, u), {"x_next": after})

    @cached_property
    def _given(self) -> tuple[Node, Node, State[Node], Node]:
        """The state x, the same with angles of wheels, its parts, and what is commanded."""
        x, u = variable("x", self.size), variable(self.sent, self.robot.inputs)
        wheels = zeros(self.robot.layout.q.wheels)
        whole = join(x[: self.entries], wheels, x[self.entries :])
        return x, whole, self.machine.parts(whole, self.machine.layout()), u

    def _accelerate(self, state: State[Node], u: Node) -> Node:
        """Rates of velocities and of states of actuators."""
        rates = self.machine.rates(constant(0.0), state, self.machine.inputs(state, u), u)
        return join(rates.a, rates.actuators)
