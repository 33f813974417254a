"""Rotors as motors whose thrust is a constant times the square of their speed, as Gazebo has them.

What a robot does not say of its rotors is taken for something, and told.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gibbs_codegen.exchange.sources import Source, SourceRotor

# Of a rotor whose speed nobody says, rad/s: about that of a propeller of ten inches.
_USUAL_SPEED = 1000.0
# Of the weight, for the greatest thrusts of all rotors together.
_USUAL_THRUST = 2.0


@dataclass(frozen=True)
class GazeboMotor:
    """A rotor as a motor: `constant` in N/(rad/s)², `moment` in m, `fastest` in rad/s.

    `up` and `down` are time constants of its speed, s, `hub_drag` is in kg. `words` says what was
    assumed, or is otherwise in the robot.
    """

    constant: float
    moment: float
    fastest: float
    clockwise: bool
    up: float
    down: float
    hub_drag: float
    words: tuple[str, ...] = ()


def motors_of(source: Source, weight: float) -> dict[str, GazeboMotor]:
    """The motors of a robot's rotors, by their names; `weight` is the robot's, N."""
    share = weight / max(len(source.rotors), 1)
    return {rotor.name: _motor(rotor, share) for rotor in source.rotors}


def motor_notes(motors: Mapping[str, GazeboMotor]) -> list[str]:
    """Assumptions and changes in words, with the rotors that they hold for."""
    words = dict.fromkeys(line for motor in motors.values() for line in motor.words)
    named = {line: [n for n, motor in motors.items() if line in motor.words] for line in words}
    return [f"{line} (rotors {', '.join(names)})" for line, names in named.items()]


def _motor(rotor: SourceRotor, share: float) -> GazeboMotor:
    """The motor of a rotor that bears so much of the weight, N, in hovering."""
    drive, words = rotor.drive, []
    low, most = rotor.limits or (0.0, 0.0)
    if most <= 0.0:
        most = _USUAL_THRUST * share
        words.append(f"assumed: a greatest thrust of {most:.4g} N")
    if low:
        words.append(f"left out: the least thrust, {low:.4g} N; here it is 0")
    level = min(drive.limits[1], drive.rising[1]) if drive.limits else 0.0
    fastest = drive.speed(level) or (rotor.speed_per_sqrt_thrust or 0.0) * most**0.5
    if fastest <= 0.0:
        fastest = _USUAL_SPEED
        words.append(f"assumed: {fastest:g} rad/s at the greatest thrust")
    if drive.command != "thrust" and any(drive.curve[:2]):
        words.append("changed: the thrust is by the square of the speed alone")
    others = {
        "inflow": rotor.inflow,
        "lift": rotor.translational_lift,
        "ground effect": rotor.ground_effect,
        "thrust by advance ratio": rotor.thrust_by_advance,
    }
    if lost := [name for name, value in others.items() if value]:
        words.append(f"left out: {', '.join(lost)} of the air")
    return GazeboMotor(
        most / fastest**2,
        abs(rotor.drag),
        fastest,
        rotor.drag > 0.0,
        drive.up,
        drive.down,
        rotor.hub_drag,
        tuple(words),
    )
