"""The rows of the table for robots whose commands are not thrusts and torques: their actuators.

`u` are thrusts and torques that act, as everywhere; commands are what motors and servos are sent.
The state x of the actuators is rotor levels (thrusts, speeds or throttles) that lag, references of
servos, and the charge of the battery.
"""

from __future__ import annotations

from dataclasses import replace

from gibbs_codegen.interface.rows import Output, Row, on_request

_THRUSTS = Output("thrusts", "r", "N", "{rotors}")
_COMMAND = Output("command", "m", "1, rad/s, rad, m, N or N m", "{commands}")
_RATES = Output("rates", "z", "rad/s^2, rad/s, m/s, N/s or 1/s", "{actuator_rates}")
_INPUTS = Output("inputs", "u", "N or N m", "{inputs}")
_SPEEDS = Output("speeds", "r", "rad/s", "[rad/s] of {rotor_names}")
_STATE = Output("state", "z", "rad/s, 1, rad, m or N", "{actuator_states}")
_OF = "motors, servos and battery of the robot file"


def _of(needs: tuple[str, ...], *rows: Row) -> tuple[Row, ...]:
    """Rows of the group, which robots have whose modules list something under some names."""
    return tuple(replace(row, group="actuators", needs=needs) for row in rows)


_SOME, _DRIVEN, _STATED = ("COMMANDS",), ("COMMANDS", "ROTORS"), ("ACTUATOR_STATES",)
ACTUATORS = (
    *_of(
        _DRIVEN,
        Row(
            "thrusts_of",
            ("command",),
            (_THRUSTS,),
            "Thrusts at rest for commands that stay, at the battery's nominal voltage.",
            "thrust curves of the robot file",
        ),
    ),
    *_of(
        _SOME,
        Row(
            "command_of",
            "qvu",
            (_COMMAND,),
            "Commands that give thrusts and torques u at rest, at the nominal voltage.",
            "thrust curves and servos of the robot file, inverted",
            "Of a servo the position or rate at which it pushes so much at q, v, without friction, "
            "backlash and limits. Thrusts that a curve does not reach give the level where it "
            "turns.",
        ),
    ),
    *_of(
        _SOME,
        Row(
            "inputs_of",
            ("q", "v", "x", "command"),
            (_INPUTS,),
            "Thrusts and torques u that act at a state x of the actuators.",
            _OF,
            "Those of joints include their dry friction.",
        ),
    ),
    *_of(
        _STATED,
        Row(
            "actuator_rates",
            ("x", "command"),
            (_RATES,),
            "Rates of the state x of the actuators: of motors, servos and battery.",
            _OF,
        ),
    ),
    *_of(
        _STATED,
        Row(
            "actuator_state_of",
            ("command",),
            (_STATE,),
            "State x of the actuators that commands keep, with a full battery.",
            _OF,
            "References of servos are their commands.",
        ),
    ),
    *_of(
        _DRIVEN,
        Row(
            "rotor_speeds",
            ("x", "command"),
            (_SPEEDS,),
            "Speeds of the rotors at a state x of the actuators; 0 where they are not known.",
            _OF,
        ),
    ),
)


def _jacobian(of: str, output: Output, by: tuple[str, ...]) -> Row:
    """The derivatives of a function by its arguments, with what it returns."""
    words = {
        "q": "a displacement along each of VELOCITIES",
        "v": "each of VELOCITIES",
        "u": "each of INPUTS",
        "x": "each of ACTUATOR_STATES",
        "command": "each of COMMANDS",
    }
    columns = {"q": "v", "v": "v", "u": "u", "x": "z", "command": "m"}
    found = tuple(
        Output(
            f"{output.name}_d{y}",
            output.shape + columns[y],
            output.unit,
            f"[{{unit}}], by {words[y]}",
            f"{of}_d{y}",
            y,
        )
        for y in by
    )
    own = Output(output.name, output.shape, output.unit, output.entries, of)
    row = next(row for row in ACTUATORS if row.name == of)
    return Row(
        f"{of}_derivatives",
        row.arguments,
        (own, *found),
        f"What {of} returns, and its derivatives by {', '.join(by)}.",
        f"{row.source}, differentiated",
        derivative_of=of,
        kind="jacobian",
        needs=row.needs,
    )


def _parameters(of: str, output: Output) -> Row:
    """The derivatives of a function by the parameters."""
    row = next(row for row in ACTUATORS if row.name == of)
    return Row(
        f"{of}_parameters",
        row.arguments,
        (
            Output(
                f"{output.name}_dp",
                f"{output.shape}p",
                output.unit,
                "[{unit}], each by each of PARAMETERS",
                f"{of}_dp",
            ),
        ),
        f"Derivatives of what {of} returns by the parameters.",
        f"{row.source}, differentiated",
        derivative_of=of,
        kind="parameters",
        needs=row.needs,
    )


ACTUATOR_DERIVATIVES = on_request(
    "derivatives",
    _jacobian("thrusts_of", _THRUSTS, ("command",)),
    _jacobian("command_of", _COMMAND, ("q", "v", "u")),
    _jacobian("inputs_of", _INPUTS, ("q", "v", "x", "command")),
    _jacobian("actuator_rates", _RATES, ("x", "command")),
    _jacobian("rotor_speeds", _SPEEDS, ("x", "command")),
)
ACTUATOR_PARAMETERS = on_request(
    "parameters", _parameters("inputs_of", _INPUTS), _parameters("actuator_rates", _RATES)
)
