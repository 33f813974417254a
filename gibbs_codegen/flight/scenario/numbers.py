"""Numbers, vectors and limits as scenarios have them, in a file or in Python."""

from __future__ import annotations

import math
import re
import sys
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, ValidationInfo, WithJsonSchema, WrapValidator
from pydantic import ValidatorFunctionWrapHandler as Handler

from gibbs_codegen.files import table

LEAST = 1e-9  # of what has to be greater than zero
_MOST = 1e12  # of any number: no unit makes one so large of what flies
_MOST_NAMES = 20
# Names that entries of COORDINATES can have.
_JOINT_NAME = "[A-Za-z0-9_]{1,200}"


def _sized(value: object) -> object:
    value = table.to_python(value)
    if isinstance(value, int | float) and _MOST < abs(value) <= sys.float_info.max:
        raise table.fault(f"must be at most {_MOST:g} in size, not {table.shown(value)}")
    return value


def _in_radians(value: Any, number: Handler, info: ValidationInfo) -> Any:
    if info.context is not None:
        return math.radians(number(value))
    number(math.degrees(value) if isinstance(value, float | int) else value)
    return float(value)


def _joint_name(name: str) -> str:
    if re.fullmatch(_JOINT_NAME, name):
        return name
    raise table.fault(
        "must be the name of a joint, that of its coordinate, such as theta_7", table.IN_NAME
    )


def _names(value: object) -> str | tuple[str, ...]:
    value = table.to_python(value)
    if isinstance(value, str):
        return value
    if not isinstance(value, list):
        raise table.fault(f"must be a name, or a list of names, not {table.kind_of(value)}")
    for name in table.at_most(value, _MOST_NAMES, "names"):
        if not isinstance(name, str):
            raise table.fault(f"must be a list of names, not of {table.kind_of(name)}")
    if not value or len(set(value)) < len(value):
        raise table.fault("must have at least one name, each once")
    return tuple(value)


Number = Annotated[table.Real, BeforeValidator(_sized)]
# Or inf, which a file can hold, too.
Endless = Annotated[
    table.AnyReal,
    BeforeValidator(_sized),
    table.needed(lambda number: not math.isnan(number), "must be a number, not nan"),
]
NotNegative = Annotated[Number, table.Bounds(0.0)]
Positive = Annotated[Number, table.Bounds(LEAST)]
# Metadata of an angle in rad that a file gives in degrees, under a key that ends in _deg.
IN_DEGREES = WrapValidator(_in_radians)
Angle = Annotated[Number, IN_DEGREES]
Vector = Annotated[tuple[Number, Number, Number], table.listed(3)]
# Along the world's axes.
Positives = Annotated[tuple[Positive, Positive, Positive], table.listed(3)]
Angles = Annotated[tuple[Angle, Angle, Angle], table.listed(3)]
Direction = Annotated[
    Vector,
    table.needed(
        lambda vector: math.hypot(*vector) >= LEAST,
        "a direction of length zero; give at least one entry that is not 0",
    ),
]
# One name, or several that differ.
Names = Annotated[str | tuple[str, ...], BeforeValidator(_names)]
JointName = Annotated[
    str,
    AfterValidator(_joint_name),
    WithJsonSchema({"type": "string", "pattern": f"^{_JOINT_NAME}$"}),
]
