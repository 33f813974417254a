"""Named frames on bodies."""

from __future__ import annotations

from dataclasses import dataclass

from gibbs_codegen.robot.parts.numbers import BASE, Label
from gibbs_codegen.robot.parts.part import entry
from gibbs_codegen.robot.parts.pose import CARRIER, BodyNumber, Pose, Posed

MAX_FRAMES = 256


@dataclass(frozen=True)
class Frame:
    """A named frame on a body, such as an end effector, a sensor or the place of a payload.

    `rotor` is the number, from 1, of the rotor at whose hub it is.
    """

    name: str
    on: int = BASE
    pose: Pose = Pose()
    rotor: int | None = None


@dataclass(frozen=True, kw_only=True)
class FrameTable(Posed):
    """A named frame, such as an end effector or a sensor."""

    name: Label = entry("name of the frame, any text", ...)
    on: BodyNumber = entry(CARRIER, BASE, written="base")
