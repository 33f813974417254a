"""The rows of the table for robots whose commands are not thrusts and torques: their actuators.

`u` are thrusts and torques that act, as everywhere; commands are what motors and servos are sent.
The state x of the actuators is rotor levels (thrusts, speeds or throttles) that lag, references of
servos, and the charge of the battery.
"""

from __future__ import annotations

from typing import Any

from gibbs_codegen.interface.rows import Output, Row, derivative, jacobian_row, on_request

_OF = "motors, servos and battery of the robot file"
# Lists that a robot must have for its module to have a function.
_SOME, _DRIVEN, _STATED = ("COMMANDS",), ("COMMANDS", "ROTORS"), ("ACTUATOR_STATES",)


def _row(
    name: str,
    arguments: tuple[str, ...],
    needs: tuple[str, ...],
    output: Output,
    summary: str,
    source: str = _OF,
    details: str = "",
) -> Row:
    """A row of the group."""
    return Row(name, arguments, (output,), summary, source, details, needs, group="actuators")


ACTUATORS = (
    _row(
        "thrusts_of",
        ("command",),
        _DRIVEN,
        Output("thrusts", "r", "N", "{rotors}"),
        "Steady-state thrusts for constant commands, at the battery's nominal voltage.",
        "thrust curves of the robot file",
    ),
    _row(
        "command_of",
        ("q", "v", "u"),
        _SOME,
        Output("command", "m", "1, rad/s, rad, m, N or N m", "{commands}"),
        "Commands whose steady-state thrusts and torques are u, at the nominal voltage.",
        "thrust curves and servos of the robot file, inverted",
        "For a servo, the position or rate at which it exerts u at q, v, without friction, "
        "backlash and limits. A thrust outside the range of its curve gives the command at the "
        "end of the range.",
    ),
    _row(
        "inputs_of",
        ("q", "v", "x", "command"),
        _SOME,
        Output("inputs", "u", "N or N m", "{inputs}"),
        "Thrusts and torques u at a state x of the actuators.",
        details="Entries of joints include dry friction.",
    ),
    _row(
        "actuator_rates",
        ("x", "command"),
        _STATED,
        Output("rates", "z", "rad/s^2, rad/s, m/s, N/s or 1/s", "{actuator_rates}"),
        "Time derivative of the state x of the actuators (motors, servos, battery).",
    ),
    _row(
        "actuator_state_of",
        ("command",),
        _STATED,
        Output("state", "z", "rad/s, 1, rad, m or N", "{actuator_states}"),
        "Steady state x of the actuators for constant commands, with a full battery.",
        details="References of servos equal their commands.",
    ),
    _row(
        "rotor_speeds",
        ("x", "command"),
        _DRIVEN,
        Output("speeds", "r", "rad/s", "[rad/s] of {rotor_names}"),
        "Speeds of the rotors at a state x of the actuators; 0 if unknown.",
    ),
)
# What functions give where commands are inputs, and nothing follows them: entries of their last
# argument, all or none.
_TRIVIAL = {
    **dict.fromkeys(("command_of", "inputs_of"), slice(None)),
    **dict.fromkeys(("actuator_rates", "actuator_state_of"), slice(0)),
}


def trivial(module: Any) -> dict[str, slice]:
    """Functions that a module has not, as its robot has no such drives, by what stands for them."""
    return {
        row.name: _TRIVIAL[row.name]
        for row in ACTUATORS
        if row.name in _TRIVIAL and not all(getattr(module, need, ()) for need in row.needs)
    }


def _parameters(row: Row) -> Row:
    """The derivatives of a function by the parameters."""
    [output] = row.outputs
    words = "[{unit}], each by each of PARAMETERS"
    slope = Output(f"{output.name}_dp", f"{output.shape}p", output.unit, words, f"{row.name}_dp")
    summary = f"Derivatives of the results of {row.name} by the parameters."
    return derivative(row, "parameters", (slope,), summary)


ACTUATOR_DERIVATIVES = on_request(
    "derivatives", *(jacobian_row(row) for row in ACTUATORS if row.name != "actuator_state_of")
)
ACTUATOR_PARAMETERS = on_request(
    "parameters",
    *(_parameters(row) for row in ACTUATORS if row.name in ("inputs_of", "actuator_rates")),
)
