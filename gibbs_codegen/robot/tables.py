"""The tables of a robot file: what each key may hold, and the robot that they make.

A key is one field with its description; those of arms and links are in `body_tables`.
`docs/robot-file.md` explains them at length.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from gibbs_codegen.files.faults import fault, refusal, shown
from gibbs_codegen.files.fields import Bounds, Tables, at_most, list_of
from gibbs_codegen.files.table import Table
from gibbs_codegen.robot.body_tables import ArmTable, LinkTable, NotNegative, Size
from gibbs_codegen.robot.model import (
    AXES,
    MAX_LINKS,
    MAX_ROTORS,
    Attitude,
    Base,
    Origin,
    Robot,
    Vector3,
    alternating_thrust,
)
from gibbs_codegen.robot.names import NAME_PATTERN, name_fault


def _named(name: str) -> str:
    if words := name_fault(name):
        raise fault(words)
    return name


def _axis(value: object) -> object:
    if not isinstance(value, str):
        return tuple(list_of(value, 3))
    if value not in AXES:
        raise fault(f'must be "x", "y", "z" or a direction [x, y, z], not {shown(value)}')
    return AXES[value]


def _unit_vector(direction: Vector3) -> Vector3:
    x, y, z = direction
    largest = max(abs(x), abs(y), abs(z))
    if largest == 0.0:
        raise fault("a direction of length zero; give at least one entry that is not 0")
    if abs(math.hypot(x, y, z) - 1.0) < 1e-15:  # A unit vector stays what it is, bit for bit.
        return (x, y, z)
    # Scaled by the largest entry first, so that tiny and huge vectors neither vanish nor overflow.
    x, y, z = x / largest, y / largest, z / largest
    norm = math.hypot(x, y, z)
    return (x / norm, y / norm, z / norm)


Name = Annotated[
    str, AfterValidator(_named), WithJsonSchema({"type": "string", "pattern": NAME_PATTERN})
]
Direction = Annotated[
    Vector3,
    BeforeValidator(_axis),
    AfterValidator(_unit_vector),
    WithJsonSchema(
        {
            "anyOf": [
                {"enum": list(AXES)},
                {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3},
            ]
        }
    ),
]


_ARMS = TypeAdapter(list[ArmTable])


class BaseTable(Table):
    """The flying base: arms from its centre, rigid to each other, with a motor on each."""

    rotors: Annotated[int, Bounds(2, MAX_ROTORS)] = Field(
        description="the number of rotors and arms, N"
    )
    attitude: Attitude = Field(
        default="xyz",
        description="intrinsic sequence of the attitude angles, or quaternion",
    )
    origin: Origin = Field(default="motor1", description="the point whose position is x, y, z")
    thrust: list[Direction] | None = Field(
        default=None,
        description="direction of the thrust of each motor in its arm's frame: an axis, or "
        "[x, y, z]; default: z for odd motors, y for even ones",
    )
    drag: list[Size] | None = Field(
        default=None,
        description="reaction torque of each motor about its thrust's direction per unit of "
        "thrust, m; default 0",
    )
    arm: ArmTable | list[ArmTable] = Field(
        description="one table for all arms, or a list of one for each"
    )

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Fault of a list of arms that is not as long as there are rotors.

        Args:
            values: The table as it stands in the file.

        Yields:
            Key and words of the fault.
        """
        arms, rotors = values.get("arm"), values.get("rotors")
        if not isinstance(arms, list) or not isinstance(rotors, int):
            return
        if 1 < rotors <= MAX_ROTORS and rotors != len(arms) <= MAX_ROTORS:
            what = f"a list of {len(arms)} for {rotors} rotors"
            yield "arm", f"{what}; give one table for all, or one each"

    @field_validator("thrust", "drag", mode="before")
    @classmethod
    def _one_per_motor(cls, value: object, info: ValidationInfo) -> object:
        rotors = info.data.get("rotors")
        if rotors is None:  # How many there must be is not known; a flood there is not.
            return value[:MAX_ROTORS] if isinstance(value, list) else value
        if info.field_name == "drag":
            return list_of(value, rotors)
        if not isinstance(value, list) or len(value) != rotors:
            raise fault(f"must be a list of {rotors} directions, one per motor")
        return value

    @field_validator("arm", mode="wrap")
    @classmethod
    def _one_or_each(cls, value: object, _: object) -> ArmTable | list[ArmTable]:
        if isinstance(value, list):
            return _ARMS.validate_python(at_most(value, MAX_ROTORS, "arms"))
        return ArmTable.model_validate(value)

    def built(self) -> Base:
        """The base that the table describes."""
        arms = self.arm if isinstance(self.arm, list) else [self.arm]
        return Base(
            self.rotors,
            tuple(arm.body() for arm in arms),
            tuple(self.thrust) if self.thrust else alternating_thrust(self.rotors),
            tuple(self.drag or (0.0,) * self.rotors),
            self.attitude,
            self.origin,
        )


class RobotTable(Table):
    """A flying robot: a base with rotors, and an arm of links at its centre.

    SI units: kg, m, s. Angles are in degrees, in keys that end in `_deg`.
    """

    model_config = ConfigDict(title="Robot file of gibbs_codegen")

    name: Name = Field(
        description="the robot's name, which becomes that of the module and the prefix in C"
    )
    gravity: NotNegative = Field(default=9.81, description="acceleration of gravity, m/s²")
    base: BaseTable = Field(description="the flying base, [base]")
    link: Annotated[list[LinkTable], Tables("link", MAX_LINKS, "links")] = Field(
        default_factory=list, description="the links of the arm, from the base centre outwards"
    )

    @model_validator(mode="after")
    def _has_mass(self) -> Self:
        if self.robot().total_mass <= 0:
            raise refusal([(("base", "arm"), "the robot has no mass; give its arms or links some")])
        return self

    def robot(self) -> Robot:
        """The robot that the file describes."""
        links = tuple(link.link() for link in self.link)
        return Robot(self.name, self.base.built(), links, self.gravity)
