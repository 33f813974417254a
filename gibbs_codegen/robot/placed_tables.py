"""The tables of what is placed on bodies in a robot file: rotors and named frames."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import Field

from gibbs_codegen.files.table import Table
from gibbs_codegen.robot.model import AXES, Frame, Pose, Rotor
from gibbs_codegen.robot.quantities import (
    Direction,
    Label,
    NotNegative,
    Range,
    Size,
    Sizes3,
    Turns3,
    exact3,
)

_ON = 'what carries it: "base" or the name of a link'


class PoseTable(Table):
    """A pose in the frame of a body."""

    xyz: Sizes3 | None = Field(
        default=None, description="place in the frame of what carries it, m; default [0, 0, 0]"
    )
    rpy_deg: Turns3 | None = Field(
        default=None,
        description="roll, pitch and yaw in that frame, R = R_z·R_y·R_x as in URDF, degrees; "
        "default [0, 0, 0]",
    )

    @classmethod
    def synonyms(cls) -> Mapping[str, str]:
        """Rotors have a position."""
        return {"position": "xyz"}

    def pose(self) -> Pose:
        """The pose that the table describes."""
        return Pose(self.xyz or (0.0,) * 3, exact3(self.rpy_deg or (0.0,) * 3))


class RotorTable(Table):
    """A rotor on the base or on a link."""

    name: Label | None = Field(
        default=None, description="name of the rotor, any text; without it its number counts"
    )
    on: Label = Field(default="base", description=_ON)
    position: Sizes3 = Field(
        default=(0.0, 0.0, 0.0), description="place in the frame of what carries it, m"
    )
    direction: Direction = Field(
        default=AXES["z"],
        description='direction of its thrust in that frame: an axis such as "x" or "-y", or '
        "[x, y, z]",
        json_schema_extra={"default": "z"},
    )
    drag: Size = Field(
        default=0.0,
        description="reaction torque about its direction per unit of thrust, m: negative for a "
        "rotor that spins counter-clockwise, seen from the tip of its thrust",
    )
    limits: Range | None = Field(
        default=None,
        description="least and greatest thrust, for simulators and controllers, N; default: none",
    )
    time_constant: NotNegative | None = Field(
        default=None, description="time constant of its thrust, for simulators, s; default: none"
    )
    spin_inertia: NotNegative | None = Field(
        default=None,
        description="moment of inertia of what spins with it, about its axis, for gyroscopic "
        "torques in simulators, kg m^2; default: none",
    )
    speed_per_sqrt_thrust: NotNegative | None = Field(
        default=None,
        description="its speed by the square root of its thrust, for simulators, (rad/s)/sqrt(N); "
        "default: none",
    )

    @classmethod
    def synonyms(cls) -> Mapping[str, str]:
        """Links and frames have their place in xyz."""
        return {"xyz": "position"}

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of a rotor of which the angular momentum is not known."""
        for key, other in itertools.permutations(("spin_inertia", "speed_per_sqrt_thrust")):
            if key in values and other not in values:
                yield key, f"needs {other} beside it: give both or none"
        if "spin_inertia" in values and values.get("drag", 0.0) == 0.0:
            yield "spin_inertia", "needs a drag that is not 0: its sign tells which way it spins"

    def rotor(self, on: int) -> Rotor:
        """The rotor that the table describes, on the body of that number."""
        return Rotor(
            self.position,
            self.direction,
            self.drag,
            on,
            self.name,
            self.limits,
            self.time_constant,
            self.spin_inertia,
            self.speed_per_sqrt_thrust,
        )


class FrameTable(PoseTable):
    """A named frame, such as an end effector or a sensor."""

    name: Label = Field(description="name of the frame, any text")
    on: Label = Field(default="base", description=_ON)

    def frame(self, on: int) -> Frame:
        """The frame that the table describes, on the body of that number."""
        return Frame(self.name, on, self.pose())
