"""The table of a sweep: a row for each case, with what varies in it and what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.sweeps.plan import Cases
from gibbs_codegen.sweeps.store import Rows

# Columns that every table has.
FIXED = ("case", "robot", "scenario", "stopped", "failed")


def table_of(cases: Cases, measures: Sequence[str], rows: Rows) -> NDArray[Any]:
    """The table of a sweep.

    Args:
        cases: The cases.
        measures: Names of the measures.
        rows: What was measured of each case.

    Returns:
        A structured array, a row for each case.
    """
    listed = [(case.index, case.robot, case.scenario, *case.values.values()) for case in cases]
    names = ("case", "robot", "scenario", *cases.columns)
    columns = {n: _column(v) for n, v in zip(names, zip(*listed, strict=True), strict=True)}
    columns |= {name: rows["measures"][:, place] for place, name in enumerate(measures)}
    columns |= {name: rows[name] for name in ("stopped", "failed")}
    table = np.zeros(len(rows), [(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        table[name] = column
    return table


def _column(values: Sequence[Any]) -> NDArray[Any]:
    """Numbers or switches as an array of these; anything else as texts."""
    alike = all(isinstance(v, bool) for v in values) or not any(
        isinstance(v, bool | str) for v in values
    )
    return np.array(values) if alike else np.array([str(value) for value in values])
