"""Springs between frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from gibbs_codegen.robot.parts.numbers import Label, NotNegative
from gibbs_codegen.robot.parts.part import Part, entry, number

# In a distance ℓ with ℓ² = d² + ε² this ε, m, lets springs have a direction where frames meet.
SHORTEST = 1e-15


@dataclass(frozen=True)
class Spring(Part):
    """A spring with a damper beside it, or a tendon, between two frames of the robot."""

    array: ClassVar[str] = "spring"
    most: ClassVar[int] = 64
    other_end: ClassVar[str] = "at the other end"

    # It pulls with stiffness·(distance − length) + damping·rate of the distance.
    name: Label = entry("name of the spring, any text", ...)
    frame: Label = entry('the frame at one end: "base", "tip" or a name of a [[frame]]', ...)
    to: Label = entry("the frame at the other end, which joints move against the first", ...)
    stiffness: NotNegative = number("force per distance, {N/m}; 0: a damper", ...)
    length: NotNegative = number("distance at which the spring is at rest, {m}", 0.0)
    damping: NotNegative = number("force per rate of that distance, {N s/m}", 0.0)
