"""Servos of joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

from gibbs_codegen.robot.parts.numbers import NotNegative, Positive
from gibbs_codegen.robot.parts.part import Parameter, Part, entry, number, sized

ServoCommand = Literal["position", "rate"]
# Keys of servos that are commanded positions.
_OF_POSITIONS = ("stiffness", "backlash")


@dataclass(frozen=True, kw_only=True)
class Servo(Part):
    """A servo, which holds a joint where it is commanded to be, by a position or a rate."""

    # Its torque is stiffness·(reference − coordinate) − damping·rate, at most `torque`; within
    # `backlash` (the whole play) it pushes neither way. The reference follows the command with the
    # time constant `delay`, at most at `rate`. Where rates are commanded, its torque is
    # damping·(reference − rate), without stiffness and backlash, and `rate` is the greatest
    # command. None is no limit.
    conditions: ClassVar[dict[str, Any]] = {
        "if": {"properties": {"command": {"const": "rate"}}, "required": ["command"]},
        "then": {"required": ["damping"], "properties": dict.fromkeys(_OF_POSITIONS, False)},
        "else": {"required": ["stiffness"]},
    }

    command: ServoCommand = entry("kind of command: a position or a rate", "position")
    stiffness: Positive = sized(
        "torque or force per distance from the reference, {N m/rad or N/m}", unsaid=0.0
    )
    damping: NotNegative = number(
        "torque or force per rate, {N m s/rad or N s/m}; per difference from the commanded rate "
        "if rates are commanded",
        0.0,
    )
    torque: Positive | None = sized(
        "greatest torque or force, {N m or N}; default: the joint's effort"
    )
    rate: Positive | None = sized(
        "greatest rate of its reference, or greatest commanded rate, {rad/s or m/s}; default: "
        "none, or the velocity of the joint"
    )
    delay: NotNegative = sized(
        "time constant with which its reference follows the command, {s}", 0.0
    )
    backlash: NotNegative = sized("play within which it does not push, {rad or m}", 0.0)

    def parameters(self) -> dict[str, Parameter]:
        """Numbers that can be parameters and count for its command."""
        marks = super().parameters()
        if self.command == "position":
            return marks
        marks = {key: mark for key, mark in marks.items() if key not in (*_OF_POSITIONS, "rate")}
        return marks | {"damping": replace(marks["damping"], keeps_sign=True, no_zero=True)}

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of a rate that nothing delays, and of what only one kind of servo has."""
        if values.get("command") == "rate":
            for key in _OF_POSITIONS:
                if key in values:
                    yield key, "must be left out if rates are commanded"
            if values.get("damping", 0.0) == 0.0:
                yield (
                    "damping",
                    "must be given, above 0, because it drives the servo towards a rate",
                )
            return
        if values.get("command", "position") != "position":  # That is a fault by itself.
            return
        if "stiffness" not in values:
            yield "stiffness", cls._missing("stiffness")
        if "rate" in values and values.get("delay", 0.0) == 0.0:
            yield "rate", "needs delay beside it, s, the time in which the reference comes to rest"
