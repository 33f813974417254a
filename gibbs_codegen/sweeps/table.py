"""The table of a sweep: a row for each case, with what varies in it and what was measured."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.sweeps.plan import Cases
from gibbs_codegen.sweeps.store import REASONS, Rows

# Columns that every table has.
FIXED = ("case", "robot", "scenario", *REASONS)


def table_of(cases: Cases, measures: Sequence[str], rows: Rows) -> NDArray[Any]:
    """The table of a sweep: a structured array with a row for each case."""
    blocks, sizes = cases.blocks, [len(block) for block in cases.blocks]
    columns: dict[str, NDArray[Any]] = {
        "case": np.arange(len(cases)),
        "robot": np.repeat([block.robot.word for block in blocks], sizes),
        "scenario": np.repeat([block.scenario.word for block in blocks], sizes),
    }
    own = [block.columns() for block in blocks]
    for name in cases.columns:
        parts = [each.get(name, [math.nan] * n) for each, n in zip(own, sizes, strict=True)]
        columns[name] = _column(parts)
    columns |= {name: rows["measures"][:, place] for place, name in enumerate(measures)}
    columns |= {name: rows[name] for name in REASONS}
    table = np.zeros(len(rows), [(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        table[name] = column
    return table


def _column(parts: Sequence[Sequence[Any] | NDArray[Any]]) -> NDArray[Any]:
    """Numbers or switches as an array of these; a mixture, or anything else, as texts."""
    arrays = [np.asarray(part) for part in parts]
    kinds = {"number" if array.dtype.kind in "iuf" else array.dtype.kind for array in arrays}
    if kinds == {"number"} or kinds == {"b"}:
        return np.concatenate(arrays)
    return np.array([str(value) for part in parts for value in part])
