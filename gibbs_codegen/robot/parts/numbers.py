"""Numbers, angles, directions and names as robot files have them."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Annotated

from pydantic import (
    AfterValidator,
    BeforeValidator,
    GetCoreSchemaHandler,
    GetPydanticSchema,
)
from pydantic_core import CoreSchema, core_schema

from gibbs_codegen.files.table import (
    AnyReal,
    Bounds,
    InSchema,
    Real,
    fault,
    list_of,
    listed,
    rule,
    shown,
)

Vector3 = tuple[float, float, float]
Angles3 = tuple[Fraction, Fraction, Fraction]
ORIGIN: Vector3 = (0.0, 0.0, 0.0)
NO_ANGLE = Fraction(0)
LEVEL: Angles3 = (NO_ANGLE, NO_ANGLE, NO_ANGLE)
AXES: dict[str, Vector3] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
XYZ = tuple(AXES)
# Entries of inertias, and of other symmetric matrices, in their order everywhere.
AXIS_PAIRS = ("xx", "yy", "zz", "xy", "xz", "yz")
BASE = 0
# Most characters that names of links, rotors, frames and coordinates have.
LONGEST_LABEL = 128
# Squares, and products of a few, are far from overflow and underflow.
LEAST, MOST = 1e-50, 1e50
# As robot files have them.
SIGNED_AXES = AXES | {
    f"-{letter}": (0.0 - x, 0.0 - y, 0.0 - z) for letter, (x, y, z) in AXES.items()
}


def size_fault(value: float) -> str | None:
    """Why a finite number of a robot, in its SI unit, cannot be computed with; None if it can."""
    if value == 0.0 or LEAST <= abs(value) <= MOST:
        return None
    effect = "overflow" if abs(value) > MOST else "vanish"
    return f"must be 0 or from {LEAST:g} to {MOST:g} in size, not {value:g}; its products {effect}"


def _end_fault(end: float) -> str | None:
    if math.isnan(end):
        return "must be a number, or inf where there is no limit, not nan"
    return None if math.isinf(end) else size_fault(end)


def _order_fault(limits: tuple[float, float]) -> str | None:
    low, high = limits
    right = low <= high and low != math.inf and high != -math.inf
    return None if right else f"must be [lower, upper], not [{low:g}, {high:g}]"


def _axis(value: object) -> object:
    if not isinstance(value, str):
        return tuple(list_of(value, 3))
    if value not in SIGNED_AXES:
        letters = ", ".join(f'"{axis}"' for axis in SIGNED_AXES)
        raise fault(f"must be {letters} or a direction [x, y, z], not {shown(value)}")
    return SIGNED_AXES[value]


def _unit_vector(direction: Vector3) -> Vector3:
    largest = max(map(abs, direction))
    if largest == 0.0:
        raise fault("a direction of length zero; give at least one entry that is not 0")
    if abs(math.hypot(*direction) - 1.0) < 1e-15:  # A unit vector stays what it is, bit for bit.
        return direction
    # Scaled by the largest entry first, so that tiny and huge vectors neither vanish nor overflow.
    x, y, z = (entry / largest for entry in direction)
    norm = math.hypot(x, y, z)
    return (x / norm, y / norm, z / norm)


def _exact(source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
    """An angle, degrees, as the shortest decimal that is its float: what the file says."""
    # In radians huge angles lose the part of a turn that they end in.
    bounds = Bounds(-360.0, 360.0, " degrees", "; leave out whole turns")
    degrees = handler.generate_schema(Annotated[Real, bounds])
    return core_schema.no_info_after_validator_function(lambda v: Fraction(repr(v)), degrees)


_IN_ORDER = rule(_order_fault)
Size = Annotated[Real, rule(size_fault)]
NotNegative = Annotated[Size, Bounds(0.0)]
Positive = Annotated[
    Size,
    Bounds(0.0),
    rule(lambda value: None if value > 0.0 else "must be above 0"),
]
Angle = Annotated[Fraction, GetPydanticSchema(_exact)]
Sizes3 = Annotated[tuple[Size, Size, Size], listed(3)]
_ENTRIES = f"numbers, {', '.join(AXIS_PAIRS)}"
Sizes6 = Annotated[tuple[Size, Size, Size, Size, Size, Size], listed(6, _ENTRIES)]
Angles = Annotated[tuple[Angle, Angle, Angle], listed(3)]
Range = Annotated[tuple[Size, Size], listed(2), _IN_ORDER]
_End = Annotated[AnyReal, rule(_end_fault)]
OpenRange = Annotated[tuple[_End, _End], listed(2), _IN_ORDER]
Label = Annotated[
    str,
    rule(
        lambda text: (
            None
            if 0 < len(text) <= LONGEST_LABEL
            else f"must be 1 to {LONGEST_LABEL} characters, not {len(text)}"
        )
    ),
    InSchema({"type": "string", "minLength": 1, "maxLength": LONGEST_LABEL}),
]
Direction = Annotated[
    tuple[Real, Real, Real],
    BeforeValidator(_axis),
    AfterValidator(_unit_vector),
    InSchema(
        {
            "anyOf": [
                {"enum": list(SIGNED_AXES)},
                {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3},
            ]
        }
    ),
]


def cos_sin(angle: Fraction) -> tuple[float, float]:
    """Cosine and sine of degrees; equal numbers are equal for multiples of 30° and 45°."""
    turns = round(angle / 90)
    rest = angle - 90 * turns
    c, s = math.cos(math.radians(rest)), math.sin(math.radians(rest))
    if abs(rest) in (30, 45):
        s = math.copysign(0.5 if abs(rest) == 30 else c, rest)
    for _ in range(turns % 4):
        c, s = -s, c
    return c, s
