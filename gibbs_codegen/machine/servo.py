"""Joints with servos: a torque towards a reference, which follows a command, less dry friction.

The torque is stiffness·e − damping·rate, within its limit, where e is the way to the reference,
less the backlash. The reference r follows with dr/dt = (command − r)/delay, within its rate. A
servo of rates pushes with damping·(r − rate), and without a servo the command is the torque.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from gibbs_codegen.arrays.nodes import Node, clip, is_all
from gibbs_codegen.machine.friction import friction
from gibbs_codegen.machine.motor import approach


def _within(x: Node, most: Node | None) -> Node:
    """A value within a limit either way, if there is one."""
    return x if most is None else clip(x, -most, most)


@dataclass(frozen=True)
class DrivenJoint:
    """A joint at a coordinate and a rate, with numbers by the keys of the robot file, if any."""

    words: ClassVar[Mapping[str, str]] = {
        "acting": "torques of servos, within their limits, and friction",
        "command": "positions and rates at which servos push so much",
        "rate": "references of servos",
    }

    q: Node
    v: Node
    servo: Mapping[str, Node]
    friction: Mapping[str, Node]

    def acting(self, reference: Node) -> Node:
        """Torque or force, N m or N."""
        torque, servo = reference, self.servo
        if "stiffness" in servo:
            way = reference - self.q
            if not is_all(servo["backlash"], 0.0):
                way = way - _within(way, 0.5 * servo["backlash"])
            torque = servo["stiffness"] * way - servo["damping"] * self.v
        elif servo:
            torque = servo["damping"] * (reference - self.v)
        torque = _within(torque, servo.get("torque"))
        return torque - friction(self.friction, self.v) if self.friction else torque

    def command(self, torque: Node) -> Node:
        """The position or rate, rad, m, rad/s or m/s, at which a servo at rest pushes so much."""
        servo = self.servo
        if "stiffness" in servo:
            return self.q + (torque + servo["damping"] * self.v) / servo["stiffness"]
        return self.v + torque / servo["damping"] if servo else torque

    def rate(self, reference: Node, command: Node) -> Node:
        """The rate of the reference."""
        delay = self.servo["delay"]
        return _within(approach(reference, command, delay, delay), self.servo.get("rate"))
