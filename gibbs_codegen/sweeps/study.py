"""A study: the table of what a sweep gave, and what can be asked of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from gibbs_codegen.sweeps.cases import Case


@dataclass(frozen=True)
class Study:
    """What a sweep gave: a row for each case.

    Attributes:
        folder: where it is kept.
        cases: the flights, in the order of the rows.
        table: a structured array with the columns `case`, `robot` and `scenario`, one for each key
            that varies, one for each measure, `stopped`, which says why a flight ended early, and
            `failed`, which says why there is none. Measures of a flight that failed are NaN.
    """

    folder: Path
    cases: Sequence[Case]
    table: NDArray[Any]
