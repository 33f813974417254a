"""Types of the quantities and texts in a robot file, for the fields of its tables."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Annotated

from pydantic import AfterValidator, AllowInfNan, BeforeValidator, WithJsonSchema

from gibbs_codegen.files.faults import fault, shown
from gibbs_codegen.files.fields import Bounds, list_of, listed
from gibbs_codegen.robot.magnitude import size_fault
from gibbs_codegen.robot.model import AXES, Angles3, Vector3
from gibbs_codegen.robot.names import LONGEST_LABEL, NAME_PATTERN, name_fault

_SIGNED_AXES = AXES | {
    f"-{letter}": (0.0 - x, 0.0 - y, 0.0 - z) for letter, (x, y, z) in AXES.items()
}


def _sized(number: float) -> float:
    if words := size_fault(number):
        raise fault(words)
    return number


def _bound(number: float) -> float:
    if math.isnan(number):
        raise fault("must be a number, or inf where there is no limit, not nan")
    return number if math.isinf(number) else _sized(number)


def _in_order(limits: tuple[float, float]) -> tuple[float, float]:
    low, high = limits
    if not low <= high or low == math.inf or high == -math.inf:
        raise fault(f"must be [lower, upper], not [{low:g}, {high:g}]")
    return limits


def _named(name: str) -> str:
    if words := name_fault(name):
        raise fault(words)
    return name


def _label(text: str) -> str:
    if not 0 < len(text) <= LONGEST_LABEL:
        raise fault(f"must be 1 to {LONGEST_LABEL} characters, not {len(text)}")
    return text


def _axis(value: object) -> object:
    if not isinstance(value, str):
        return tuple(list_of(value, 3))
    if value not in _SIGNED_AXES:
        letters = ", ".join(f'"{axis}"' for axis in _SIGNED_AXES)
        raise fault(f"must be {letters} or a direction [x, y, z], not {shown(value)}")
    return _SIGNED_AXES[value]


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


def exact(angle: float) -> Fraction:
    """An angle, degrees, as the shortest decimal that is its float: what the file says."""
    return Fraction(repr(angle))


def exact3(angles: tuple[float, float, float]) -> Angles3:
    """Roll, pitch and yaw, degrees, each as `exact` gives it."""
    roll, pitch, yaw = angles
    return (exact(roll), exact(pitch), exact(yaw))


Size = Annotated[float, AfterValidator(_sized)]
NotNegative = Annotated[Size, Bounds(0.0)]
# In radians huge angles lose the part of a turn that they end in.
Angle = Annotated[float, Bounds(-360.0, 360.0, " degrees", "; leave out whole turns")]
Sizes3 = Annotated[tuple[Size, Size, Size], listed(3)]
_ENTRIES = "numbers, xx, yy, zz, xy, xz, yz"
Sizes6 = Annotated[tuple[Size, Size, Size, Size, Size, Size], listed(6, _ENTRIES)]
Turns3 = Annotated[tuple[Angle, Angle, Angle], listed(3)]
Range = Annotated[tuple[Size, Size], listed(2), AfterValidator(_in_order)]
_Bound = Annotated[float, AllowInfNan(True), AfterValidator(_bound)]
OpenRange = Annotated[tuple[_Bound, _Bound], listed(2), AfterValidator(_in_order)]

Name = Annotated[
    str, AfterValidator(_named), WithJsonSchema({"type": "string", "pattern": NAME_PATTERN})
]
Label = Annotated[
    str,
    AfterValidator(_label),
    WithJsonSchema({"type": "string", "minLength": 1, "maxLength": LONGEST_LABEL}),
]
Direction = Annotated[
    Vector3,
    BeforeValidator(_axis),
    AfterValidator(_unit_vector),
    WithJsonSchema(
        {
            "anyOf": [
                {"enum": list(_SIGNED_AXES)},
                {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3},
            ]
        }
    ),
]
