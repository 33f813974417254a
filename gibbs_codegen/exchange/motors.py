"""Rotors as motors whose thrust is a constant times the square of their speed, as Gazebo has them.

Missing numbers of rotors get assumed values, which the report names.
"""

from __future__ import annotations

from gibbs_codegen.exchange.sources import Source, SourceRotor

# Speed of a rotor whose file has none, rad/s: about that of a propeller of ten inches.
_USUAL_SPEED = 1000.0
# The greatest thrusts of all rotors together, in weights.
_USUAL_THRUST = 2.0


def motors_of(source: Source, weight: float) -> tuple[dict[str, dict[str, object]], list[str]]:
    """The motors of a robot's rotors by their names, as tags of SDF, and notes on them.

    `weight` is the robot's, N. Notes say what was assumed, or is otherwise in the robot.
    """
    share, named = weight / max(len(source.rotors), 1), dict[str, list[str]]()
    motors = {}
    for number, rotor in enumerate(source.rotors):
        motors[rotor.name], words = _motor(rotor, number, share)
        for line in words:
            named.setdefault(line, []).append(rotor.name)
    return motors, [f"{line} (rotors {', '.join(names)})" for line, names in named.items()]


def _motor(rotor: SourceRotor, number: int, share: float) -> tuple[dict[str, object], list[str]]:
    """The motor of a rotor that bears so much of the weight, N, in hovering, and words on it."""
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
        words.append("changed: thrust depends on the square of the speed alone")
    others = {
        "inflow": rotor.inflow,
        "lift": rotor.translational_lift,
        "ground effect": rotor.ground_effect,
        "thrust by advance ratio": rotor.thrust_by_advance,
    }
    if lost := [name for name, value in others.items() if value]:
        words.append(f"left out: {', '.join(lost)} of the air")
    motor = {
        "linkName": rotor.name,
        "turningDirection": "cw" if rotor.drag > 0.0 else "ccw",
        "motorNumber": number,
        "motorType": "velocity",
        "commandSubTopic": "command/motor_speed",
        "maxRotVelocity": fastest,
        "motorConstant": most / fastest**2,
        "momentConstant": abs(rotor.drag),
        "timeConstantUp": drive.up,
        "timeConstantDown": drive.down,
        "rotorDragCoefficient": rotor.hub_drag,
        "rollingMomentCoefficient": 0.0,
        "rotorVelocitySlowdownSim": 10,
    }
    return motor, words
