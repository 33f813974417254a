"""The rows of the table for robots whose commands are not thrusts and torques: their actuators.

`u` are thrusts and torques that act, as everywhere; commands are what motors and servos are sent.
The state x of the actuators is rotor levels (thrusts, speeds or throttles) that lag, references of
servos, and the charge of the battery.
"""

from __future__ import annotations

from dataclasses import replace

from gibbs_codegen.interface.rows import Kind, Output, Row, on_request

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
        "Thrusts at rest for commands that stay, at the battery's nominal voltage.",
        "thrust curves of the robot file",
    ),
    _row(
        "command_of",
        ("q", "v", "u"),
        _SOME,
        Output("command", "m", "1, rad/s, rad, m, N or N m", "{commands}"),
        "Commands that give thrusts and torques u at rest, at the nominal voltage.",
        "thrust curves and servos of the robot file, inverted",
        "Of a servo the position or rate at which it pushes so much at q, v, without friction, "
        "backlash and limits. Thrusts that a curve does not reach give the level where it turns.",
    ),
    _row(
        "inputs_of",
        ("q", "v", "x", "command"),
        _SOME,
        Output("inputs", "u", "N or N m", "{inputs}"),
        "Thrusts and torques u that act at a state x of the actuators.",
        details="Those of joints include their dry friction.",
    ),
    _row(
        "actuator_rates",
        ("x", "command"),
        _STATED,
        Output("rates", "z", "rad/s^2, rad/s, m/s, N/s or 1/s", "{actuator_rates}"),
        "Rates of the state x of the actuators: of motors, servos and battery.",
    ),
    _row(
        "actuator_state_of",
        ("command",),
        _STATED,
        Output("state", "z", "rad/s, 1, rad, m or N", "{actuator_states}"),
        "State x of the actuators that commands keep, with a full battery.",
        details="References of servos are their commands.",
    ),
    _row(
        "rotor_speeds",
        ("x", "command"),
        _DRIVEN,
        Output("speeds", "r", "rad/s", "[rad/s] of {rotor_names}"),
        "Speeds of the rotors at a state x of the actuators; 0 where they are not known.",
    ),
)
_ROWS = {row.name: row for row in ACTUATORS}
# By arguments: what a derivative is by, and the letter of its columns.
_BY = {
    "q": ("a displacement along each of VELOCITIES", "v"),
    "v": ("each of VELOCITIES", "v"),
    "u": ("each of INPUTS", "u"),
    "x": ("each of ACTUATOR_STATES", "z"),
    "command": ("each of COMMANDS", "m"),
}


def _derived(of: str, ending: str, kind: Kind, outputs: tuple[Output, ...], summary: str) -> Row:
    """A row that gives derivatives of a function."""
    row = _ROWS[of]
    base = replace(row, name=f"{of}_{ending}", source=f"{row.source}, differentiated", details="")
    return replace(base, outputs=outputs, summary=summary, derivative_of=of, kind=kind, group="")


def _jacobian(of: str, *by: str) -> Row:
    """The derivatives of a function by its arguments, with what it returns."""
    [output] = _ROWS[of].outputs
    slopes = tuple(
        Output(
            f"{output.name}_d{y}",
            output.shape + _BY[y][1],
            output.unit,
            f"[{{unit}}], by {_BY[y][0]}",
            f"{of}_d{y}",
            y,
        )
        for y in by
    )
    summary = f"What {of} returns, and its derivatives by {', '.join(by)}."
    return _derived(
        of, "derivatives", "jacobian", (replace(output, derivation=of), *slopes), summary
    )


def _parameters(of: str) -> Row:
    """The derivatives of a function by the parameters."""
    [output] = _ROWS[of].outputs
    words = "[{unit}], each by each of PARAMETERS"
    derivative = Output(f"{output.name}_dp", f"{output.shape}p", output.unit, words, f"{of}_dp")
    summary = f"Derivatives of what {of} returns by the parameters."
    return _derived(of, "parameters", "parameters", (derivative,), summary)


ACTUATOR_DERIVATIVES = on_request(
    "derivatives",
    _jacobian("thrusts_of", "command"),
    _jacobian("command_of", "q", "v", "u"),
    _jacobian("inputs_of", "q", "v", "x", "command"),
    _jacobian("actuator_rates", "x", "command"),
    _jacobian("rotor_speeds", "x", "command"),
)
ACTUATOR_PARAMETERS = on_request(
    "parameters", _parameters("inputs_of"), _parameters("actuator_rates")
)
