"""The cases of a sweep: one flight each, with what makes it differ from the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Case:
    """One flight of a sweep, by its number from 0; robot and scenario are as `sweep` got them.

    `values` are what varies, by the keys that `sweep` was given: the columns of the table.
    `changes` replace entries of the scenario file, by their keys in full
    (`plant.link1_mass_per_length`), as `simulate --set` takes them.
    """

    index: int
    robot: str
    scenario: str
    values: Mapping[str, Any]
    changes: Mapping[str, Any] = field(default_factory=dict)
