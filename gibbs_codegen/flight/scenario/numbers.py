"""Numbers, vectors and lines of text as tables of a scenario file hold them."""

from __future__ import annotations

import sys
from typing import Annotated

from pydantic import BeforeValidator

from gibbs_codegen.errors import UsageError
from gibbs_codegen.files.table import Bounds, fault, listed, shown

LEAST = 1e-9  # of what has to be greater than zero
_MOST = 1e12  # of any number: no unit makes one so large of what flies


def _sized(value: object) -> object:
    if isinstance(value, int | float) and _MOST < abs(value) <= sys.float_info.max:
        raise fault(f"must be at most {_MOST:g} in size, not {shown(value)}")
    return value


Number = Annotated[float, BeforeValidator(_sized)]
NotNegative = Annotated[Number, Bounds(0.0)]
Positive = Annotated[Number, Bounds(LEAST)]
Vector = Annotated[tuple[Number, Number, Number], listed(3)]


def require(right: bool, otherwise: str) -> None:
    """Raise `UsageError` for values that mean nothing."""
    if not right:
        raise UsageError(otherwise)
