"""Inner loops of learned policies: what a policy asks for, as inputs by the laws of `machine.laws`.

They are evaluated at every step, of which a decision has several, and know the robot by parameters
of their own, those of the owner `model`.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import (
    Node,
    constant,
    coordinates_of,
    entries_of,
    join,
    variable,
    zeros,
)
from gibbs_codegen.machine.base import Motion, base_of, length, placed, spread
from gibbs_codegen.machine.laws import (
    Aim,
    CentrePath,
    FrameAim,
    Gains,
    Rotors,
    at_frame,
    geometric,
    inputs_of,
    weight_of,
    with_thrust,
)
from gibbs_codegen.machine.mechanism import carried, closed

# What actions ask of the base or the tip, and of the joints.
ACTIONS = "rates", "attitude", "velocity", "tip"
JOINTS = "position", "velocity", "torque"


@dataclass(frozen=True)
class InnerLoop:
    """What an action asks for, of `ACTIONS` and `JOINTS`; with "tip" joints have nothing of theirs.

    The base `leans`, if its rotors push along one axis; servos hold the joints `held`, by their
    numbers. `tip` is the number of the frame that is moved.
    """

    action: str
    joints: str = "position"
    leans: bool = False
    held: tuple[int, ...] = ()
    tip: int = 0

    def parts(self, robot: Functions) -> tuple[list[str], list[str], list[str]]:
        """What each entry of an action is: along axes, about axes, and of the joints.

        - with "rates" and "attitude" accelerations of the base, m/s², beyond what holds its weight:
          of one that leans along its thrust axis, else along axes of the world; then angular
          velocities, rad/s, base's frame, or the turn from the attitude of the target, rad, as
          `difference` of the module tells it
        - with "velocity" velocities, m/s, along axes of the world, of one that leans of the centre
          of mass, of one that drives ahead; and angular velocities, rad/s, base's frame, of one
          that leans about its thrust axis
        - with "tip" velocities of the tip, m/s, along axes of the world
        - of each joint its coordinate, rad or m, its velocity, or its torque or force, N m or N
        """
        if self.action == "tip":
            return [*"xyz"], [], []
        along, about = robot.layout.driven_axes
        word = "turn" if self.action == "attitude" else "spin"
        ways, turns = ["xyz"[k] for k in along], [f"{word}_{'xyz'[k]}" for k in about]
        if self.leans and self.action == "velocity":
            turns = [word] * (len(about) == 3)
        elif self.leans:
            ways = ["thrust"]
        return ways, turns, [*robot.layout.v.names[robot.layout.v.joints]]

    def inputs(self, robot: Functions) -> list[Node]:
        """Inputs of its program: `action`, `target` (nq), gains, and figures of the robot.

        `stiffness` and `damping` (nv) are gains of errors, `frame_damping` (3), 1/s, of the tip's
        velocity; the figures are as the laws for firmware have them.
        """
        count, size = len(robot.base_inputs), robot.space.velocities
        shapes: dict[str, tuple[int, ...]] = {"stiffness": (size,), "damping": (size,)}
        if self.action == "tip":
            shapes["frame_damping"] = (3,)
        if count:
            shapes |= {"centre": (3,), "distribution": (count, 6)}
        if self.leans:
            shapes |= {"mass": (), "weight": (3,), "axis": (3,)}
        action = variable("action", sum(map(len, self.parts(robot))))
        figures = (variable(name, *shape, uniform=True) for name, shape in shapes.items())
        return [action, robot.coordinates("target"), *figures]

    def commands(self, robot: Functions, q: Node, v: Node, values: Mapping[str, Node]) -> Node:
        """Inputs (nu), or commands of motors and servos, at coordinates q (nq), velocities v (nv).

        `robot` is what flies; `values` are values of the inputs by name.
        """
        model, count = copy.copy(robot), robot.rotors
        model.owner = "model"
        asked = values["action"][sum(map(len, self.parts(robot)[:2])) :]

        def figure(name: str, *shape: int) -> Node:
            return values.get(name, zeros(*shape))

        none = zeros(len(robot.base_inputs))
        of_rotors = figure("centre", 3), figure("distribution", none.size, 6), zeros(none.size, 6)
        rotors = Rotors(*of_rotors, none, none, limited=False)
        force = carried(model, q, self._force(model, q, v, values, rotors))
        u, _ = inputs_of(model, q, force, rotors)
        if self.joints == "torque" and asked.size:
            u = join(u[:count], asked, u[count + asked.size :])
        sent = model.command_of(q, v, u)
        if not (self.held and self.joints == "position" and asked.size):
            return sent
        entries = [*sent]
        for k in self.held:
            entries[count + k] = asked[k]
        return join(*entries)

    def _force(
        self, robot: Functions, q: Node, v: Node, values: Mapping[str, Node], rotors: Rotors
    ) -> Node:
        """Generalised force (nv) for an action, of joints with torques that at rest."""
        base, places, at = base_of(robot, q), robot.layout.v, robot.layout.q
        (along, about), leads = robot.layout.driven_axes, self.action in ("velocity", "tip")
        action, here, target = values["action"], entries_of(q), entries_of(values["target"])
        ways, turns, _ = map(len, self.parts(robot))
        moved, turned, asked = action[:ways], action[ways : ways + turns], action[ways + turns :]
        still, none = zeros(places.size), zeros(asked.size)
        linear = moved if ways != len(along) else spread(along, moved)
        attitude, posture = target[at.attitude], here[at.joints]
        if self.action == "attitude":
            way = placed(robot, turned, zeros(3), none)
            attitude = entries_of(robot.integrate(values["target"], way))[at.attitude]
        elif self.action == "rates" or (self.action == "velocity" and not self.leans):
            attitude = here[at.attitude]
        if self.action == "tip":
            posture = target[at.joints]
        elif self.joints == "position":
            posture = asked
        parts = (at.position, here[at.position]), (at.attitude, attitude), (at.joints, posture)
        entries = join(*(x for _, x in sorted(parts, key=lambda part: part[0].start)))
        q_still = coordinates_of(join(entries, here[entries.size :]), robot.space)
        rates = asked if self.joints == "velocity" else none
        aim = Aim(Motion(q_still, still, still), Gains(values["stiffness"], values["damping"]))
        if self.leans:
            aim = replace(aim, weight=weight_of(robot, q, lambda name, *_: values[name], rotors))
        if self.action == "tip":
            rates, wrench = zeros(places.joints.stop - places.joints.start), zeros(6)
            of_tip = zeros(3), values["frame_damping"], constant(np.ones(3)), wrench
            aim = replace(aim, frame=FrameAim(self.tip, *of_tip, velocity=moved))
        if aim.weight is not None and leads:
            about_axis = turned[0] * aim.weight.axis if turns else zeros(3)
            spin = base_of(robot, q_still).attitude_entries(still, about_axis)
            path = CentrePath(robot.centre_of_mass(q), linear, zeros(3))
            led = Motion(q_still, placed(robot, spin, zeros(3), rates), still)
            return geometric(robot, q, v, replace(aim, desired=led, path=path))
        if aim.frame is not None:
            return at_frame(robot, q, v, aim)
        asks = self.action != "attitude"
        spin = base.attitude_entries(still, spread(about, turned)) if asks else zeros(3)
        error, rate = base.errors(v, aim.desired)
        wish = placed(robot, spin, linear if leads else zeros(3), rates)
        pull = aim.gains.stiffness * error + aim.gains.damping * (wish + rate)
        if aim.weight is None:
            pull = pull + placed(robot, zeros(3), zeros(3) if leads else linear, none)
            a = closed(robot, q, v, base.corrected(v, aim.desired, pull))
            return robot.inverse_dynamics(q, v, a)
        a = placed(robot, pull[places.attitude], zeros(3), pull[places.joints])
        thrust = length(aim.weight.weight) + aim.weight.mass * moved[0]
        generalised = robot.inverse_dynamics(q, v, closed(robot, q, v, a))
        return with_thrust(robot, q, generalised, thrust * base.to_world(aim.weight.axis))
