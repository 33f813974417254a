"""The drives of a robot: what its motors, servos, friction and battery make of commands.

Each function of the table's group "actuators" is a program. The state x has the levels of rotors
that lag, references of servos with a delay, and the charge. A throttle's target is the command
times the battery's voltage over the nominal one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from gibbs_codegen.arrays.labels import labelled, named
from gibbs_codegen.arrays.nodes import (
    Input,
    Node,
    Program,
    Space,
    constant,
    entries_of,
    join,
    ordered,
    total,
    variable,
    zeros,
)
from gibbs_codegen.machine.battery import discharge
from gibbs_codegen.machine.motor import Motor
from gibbs_codegen.machine.servo import DrivenJoint
from gibbs_codegen.robot.description import ActuatorKey, Description
from gibbs_codegen.robot.names import parameter_prefix, rotor_prefix
from gibbs_codegen.robot.parts.part import RobotNumber, changed_numbers

# Values by what they belong to.
Values = Mapping[ActuatorKey, Node]


class Drives:
    """The programs of a robot's drives; `number` gives a node for each of their numbers."""

    def __init__(self, description: Description, number: Callable[[RobotNumber], Node]) -> None:
        robot, layout = description.robot, description.layout
        rods: Any = changed_numbers(robot.base, "base", number)["drag"]
        numbers: list[dict[str, Any]] = [{"drag": drag} for drag in rods]
        for k, rotor in enumerate(robot.thrusters, start=1):
            kinds = rotor.parameters() | rotor.drive_parameters()
            prefix = rotor_prefix(robot, k)
            numbers.append(changed_numbers(rotor, prefix, number, marks=kinds))
        motors = map(Motor, robot.drives, numbers)
        self._parts: dict[ActuatorKey, Any] = {
            ("rotor", k): motor for k, motor in enumerate(motors, start=1)
        }
        drives = zip(self._parts, robot.drives, strict=True)
        self._throttles = {key for key, drive in drives if drive.command == "throttle"}
        q = variable("q", layout.q.size, space=Space.of(layout))
        moving = entries_of(q)[layout.q.joints], variable("v", layout.v.size)[layout.v.joints]
        for i, *motion in zip(robot.moving, *moving, strict=True):
            link, prefix = robot.links[i - 1], parameter_prefix(robot, i)
            servo, friction = (
                changed_numbers(part, f"{prefix}_{name}", number, link.slides) if part else {}
                for name, part in (("servo", link.servo), ("friction", link.friction))
            )
            self._parts["link", i] = DrivenJoint(motion[0], motion[1], servo, friction)
        for i in robot.wheels:  # Commanded their torques.
            self._parts["link", i] = DrivenJoint(zeros(), zeros(), {}, {})
        self._battery: dict[str, Any] = {}
        if robot.battery is not None:  # Its voltages are the last of the parameters.
            entries = changed_numbers(robot.battery, "battery", lambda entry: entry)
            voltages = entries.pop("voltages")
            self._battery = {key: number(entry) for key, entry in entries.items()}
            self._battery["voltages"] = [*map(number, voltages)]
        keys, size = description.actuator_keys, len(self._parts)
        self._x = dict(zip(keys, variable("x", len(keys)), strict=True))
        self._command, self._u = (
            dict(zip(self._parts, variable(name, size), strict=True)) for name in ("command", "u")
        )
        self._acting = self._command | self._x

    @labelled
    def program(self, name: str) -> Program:
        """A function of the table's: of its arguments, and of numbers that are inputs."""
        outputs = {name: join(*getattr(self, name)())}
        inputs = [x for x in ordered(outputs.values()) if isinstance(x.operation, Input)]
        return Program(name, tuple(inputs), outputs)

    def _by_part(self, kinds: tuple[str, ...], quantity: str, *values: Values) -> list[Node]:
        """Results of drives of some kinds from values of theirs."""
        return [
            named(
                getattr(part, quantity)(*(x[key] for x in values)), quantity, part.words[quantity]
            )
            for key, part in self._parts.items()
            if key[0] in kinds and all(key in x for x in values)
        ]

    def thrusts_of(self) -> list[Node]:
        """Thrusts, N, for commands that stay, at the nominal voltage."""
        return self._by_part(("rotor",), "acting", self._command)

    def rotor_speeds(self) -> list[Node]:
        """Speeds of the rotors, rad/s."""
        return self._by_part(("rotor",), "speed", self._acting)

    def inputs_of(self) -> list[Node]:
        """Thrusts and torques that act."""
        return self._by_part(("rotor", "link"), "acting", self._acting)

    def command_of(self) -> list[Node]:
        """Commands that give the inputs u at rest."""
        return self._by_part(("rotor", "link"), "command", self._u)

    def actuator_rates(self) -> list[Node]:
        """Rates of the states."""
        targets, charges = self._command, list[Node]()
        if self._battery:
            power = total(join(0.0, *self._by_part(("rotor",), "power", self._acting)))
            voltage, *charges = discharge(self._battery, self._x["charge", 0], power)
            share = voltage / self._battery["nominal"]
            targets = {
                key: x * share if key in self._throttles else x for key, x in targets.items()
            }
        return [*self._by_part(("rotor", "link"), "rate", self._x, targets), *charges]

    def actuator_state_of(self) -> list[Node]:
        """States that commands keep, with a full battery."""
        return [self._command.get(key, constant(1.0)) for key in self._x]
