"""A machine as solvers of optimal control take it: rates of its state, and a step.

The state x has the entries of coordinates, but for angles of wheels, on which nothing depends, then
velocities and states of actuators. A quaternion may be of any length.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Node, Program, constant, entries_of, join, variable, zeros
from gibbs_codegen.machine.base import base_of
from gibbs_codegen.machine.machine import NO_SURROUNDINGS, Machine, Surroundings
from gibbs_codegen.machine.rollout_steps import sent
from gibbs_codegen.machine.state import State
from gibbs_codegen.machine.steps import METHODS, trapezoidal

STEPS = {**METHODS, "trapezoidal": trapezoidal}
# Least rate, rad/s or m/s, of which a tenth is where dry friction is predicted smooth about rest.
_SLOW = 2.0


def steadied(module: Any, h: float) -> dict[str, tuple[float, float, dict[str, float]]]:
    """How parameters change in trapezoidal steps of h, s: factor, least, shares of others in them.

    What dampers and servos pull at the end of a step is that of armatures.
    """
    had, changes = module.PARAMETERS, dict[str, tuple[float, float, dict[str, float]]]()
    pulling = {x: (y, h) for y in had if y[-9:] == "_armature" and (x := f"{y[:-8]}damping") in had}
    drives = getattr(module, "DRIVE_PARAMETERS", {}).values()
    for role in ({x: name for x, name in drive.items() if name in had} for drive in drives):
        # Play holds nothing. Dry friction is as stiff about rest as no step is short: servos,
        # which are stiff themselves, feel it as if it rose slowly, and other joints none.
        served = role.keys() & {"servo_damping", "servo_stiffness"}
        zero = ["servo_backlash", *([] if served else ("friction_coulomb", "friction_static"))]
        changes |= {role[x]: (1.0, _SLOW, {}) for x in role if x == "friction_velocity"}
        changes |= {role[x]: (0.0, 0.0, {}) for x in zero if x in role}
        shares = {"servo_damping": h, "servo_stiffness": 0.5 * h * h}
        pulling |= {role[x]: (role["armature"], shares[x]) for x in served}
    for name, (armature, share) in pulling.items():
        changes.setdefault(armature, (1.0, 0.0, {}))[2][name] = share
    return changes


@dataclass(frozen=True)
class Transition:
    """The programs of a robot, of whose constraints some are `active` (g): 1, else 0.

    At the end of x are thrusts of the rotors `lagging`, by their numbers, with `times`, s.
    """

    robot: Functions
    active: tuple[float, ...] = ()
    lagging: tuple[int, ...] = ()
    times: tuple[float, ...] = ()

    @property
    def entries(self) -> int:
        """Number of coordinates in x."""
        return self.robot.space.coordinates - self.robot.layout.q.wheels

    @property
    def size(self) -> int:
        """Length of x."""
        return self.machine.layout().size - self.robot.layout.q.wheels

    @cached_property
    def machine(self) -> Machine:
        """What moves, with forces of constraints."""
        around = Surroundings(holds=True) if any(self.active) else NO_SURROUNDINGS
        figures = {"active": self.active, "time_constants": self.times}
        return Machine(self.robot, lambda x, *_: constant(figures[x]), around, lagging=self.lagging)

    @property
    def sent(self) -> str:
        """Name of the input that says what is commanded."""
        return sent(self.robot)

    def rates(self) -> Program:
        """The time derivative `x_dot` of x, and the `inputs` (nu) that act."""
        x, whole, state, u = self._inputs
        moved = base_of(self.robot, state.q).rates(state.v, whole)[: self.entries]
        inputs = self.machine.inputs(state, u)
        outputs = {"x_dot": join(moved, self._accelerate(state, inputs, u)), "inputs": inputs}
        return Program("rates", (x, u), outputs)

    def step(self, method: str, h: float) -> Program:
        """The state `x_next` after h (s)."""
        x, _, state, u = self._inputs
        nv = self.robot.space.velocities

        def move(q: Node, displacement: Node) -> Node:
            return self.robot.integrate(q, displacement[:nv])

        def accelerate(q: Node, moved: Node, _: int) -> Node:
            now = state._replace(q=q, v=moved[:nv], actuators=moved[nv:])
            # Servos push by where joints are at the end.
            ahead = self.robot.integrate(q, h * now.v) if method == "trapezoidal" else q
            return self._accelerate(now, self.machine.inputs(now._replace(q=ahead), u), u)

        begin = join(state.v, state.actuators)
        q_next, moved = STEPS[method](move, accelerate, state.q, begin, constant(h))
        after = join(entries_of(q_next)[: self.entries], moved)
        return Program("step", (x, u), {"x_next": after})

    @cached_property
    def _inputs(self) -> tuple[Node, Node, State[Node], Node]:
        """The state x, the same with angles of wheels, its parts, and what is commanded."""
        x, u = variable("x", self.size), variable(self.sent, self.robot.inputs)
        wheels = zeros(self.robot.layout.q.wheels)
        whole = join(x[: self.entries], wheels, x[self.entries :])
        return x, whole, self.machine.parts(whole, self.machine.layout()), u

    def _accelerate(self, state: State[Node], inputs: Node, u: Node) -> Node:
        """Rates of velocities and of states of actuators."""
        rates = self.machine.rates(constant(0.0), state, inputs, u)
        return join(rates.a, rates.actuators)
