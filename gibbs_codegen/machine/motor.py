"""Motors with their rotors: a level follows a command, and gives a thrust and a speed.

A level is a thrust, N, a speed, rad/s, or a throttle:

    dx/dt = (target − x)/T_up, or /T_down where target < x,    F = k₀ + k₁ x + k₂ x²
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from gibbs_codegen.arrays.nodes import (
    Node,
    absolute,
    choose,
    constant,
    copysign,
    is_all,
    square_root,
    zeros,
)
from gibbs_codegen.robot.parts.rotor import Drive

# The curve of thrusts that are commanded.
_IDENTITY = constant(0.0), constant(1.0), constant(0.0)
# A thrust, N, lost beside any other, under a root that would have no derivative at 0.
_NO_THRUST = 1e-30


def positive_root(radicand: Node) -> Node:
    """The root of what is above 0, else 0 with derivatives of 0."""
    return choose(0.0, radicand, 0.0, square_root(absolute(radicand)))


def approach(level: Node, target: Node, up: Node, down: Node) -> Node:
    """The rate of what follows a target with one time constant, or another where it falls."""
    way = target - level
    return way / up if up is down else choose(0.0, way, 1.0 / down, 1.0 / up) * way


@dataclass(frozen=True)
class Motor:
    """A rotor under its command, with its numbers by the keys of the robot file."""

    words: ClassVar[Mapping[str, str]] = {
        "acting": "thrusts by their curves",
        "command": "levels of the thrusts",
        "rate": "lag of the rotors",
        "speed": "speeds of the rotors",
        "power": "power of the rotors",
    }

    drive: Drive
    numbers: Mapping[str, Any]

    @property
    def _curve(self) -> tuple[Node, Node, Node]:
        curve: tuple[Node, Node, Node] = self.numbers.get("thrust_curve", _IDENTITY)
        return curve

    def acting(self, level: Node) -> Node:
        """The thrust at a level, N."""
        k0, k1, k2 = self._curve
        return k0 + level * (k1 + k2 * level)

    def command(self, thrust: Node) -> Node:
        """The level of a thrust, on the rising side of the curve."""
        k0, k1, k2 = self._curve
        rest = thrust - k0
        if is_all(k2, 0.0):
            return rest / k1
        radicand = k1 * k1 + 4.0 * (k2 * rest)
        root = positive_root(radicand)
        if self.drive.curve[1] <= 0.0:
            return (root - k1) / (2.0 * k2)
        # The form of the root that does not cancel.
        over = choose(0.0, radicand, -k1, 2.0 * rest)
        return over / choose(0.0, radicand, 2.0 * k2, k1 + root)

    def speed(self, level: Node) -> Node:
        """The speed at a level, rad/s; 0 where it is not known."""
        if self.drive.command == "speed":
            return level
        numbers = self.numbers
        per: Node = numbers.get("full_speed", numbers.get("speed_per_sqrt_thrust", zeros()))
        if self.drive.command == "thrust":
            level = copysign(1.0, level) * square_root(absolute(level) + _NO_THRUST)
        return per * level

    def rate(self, level: Node, target: Node) -> Node:
        """The rate of a level that follows a target."""
        lag = self.numbers.get("time_constant")
        return approach(level, target, *self.numbers.get("time_constants", (lag, lag)))

    def power(self, level: Node) -> Node:
        """The power that turns the rotor, W."""
        return absolute(self.numbers["drag"] * self.acting(level) * self.speed(level))
