"""Motors behind gears, whose rotors turn in what carries a joint."""

from __future__ import annotations

from dataclasses import dataclass

from gibbs_codegen.robot.parts.numbers import Positive, Size
from gibbs_codegen.robot.parts.part import Part, number


@dataclass(frozen=True, kw_only=True)
class Motor(Part):
    """The motor of a joint that turns: its rotor turns about the joint's axis, on the carrier.

    Mass and inertia of the rotor at rest are part of those of what carries the joint.
    """

    rotor_inertia: Positive = number(
        "inertia of the rotor about its axis, {kg m^2}", ..., keeps_sign=True
    )
    gear_ratio: Size = number(
        "angle of the rotor for each rad of the joint, {rad/rad}; negative: opposite to it", ...
    )
