"""All cases of a sweep, each of which is made when it is asked for.

Cases are numbered through robots, then scenarios, then combinations of listed values, then samples.
A sample has the same numbers in all combinations, scenarios and robots: what differs between them
is then due to them alone.
"""

from __future__ import annotations

import bisect
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.flight.sweeps.sampling import Array, Axis, Varied, axes_of, noise_seed, shares
from gibbs_codegen.flight.sweeps.sources import RobotSource, ScenarioSource, with_places_filled

_NOISE = "sensors.seed"


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


@dataclass(frozen=True)
class Block:
    """Cases of one robot and scenario: those of all combinations and samples."""

    robot: RobotSource
    scenario: ScenarioSource
    axes: tuple[Axis, ...]
    samples: int
    # By column, what is drawn for each sample.
    drawn: Mapping[str, Array]
    # The sweep's seed where the scenario has noise that is drawn too.
    seed: int | None

    def __len__(self) -> int:
        """How many cases there are."""
        return self.samples * math.prod(len(axis.varied.levels) or 1 for axis in self.axes)

    def columns(self) -> dict[str, Sequence[Any] | NDArray[Any]]:
        """What each of its cases has of its own, by column."""
        combination, sample = np.divmod(np.arange(len(self)), self.samples)
        found: dict[str, Sequence[Any] | NDArray[Any]] = {}
        for axis in reversed(self.axes):
            if axis.varied.draw is None:
                combination, level = np.divmod(combination, len(axis.varied.levels))
                shown = [axis.shown(value) for value in axis.varied.levels]
                found[axis.column] = [shown[each] for each in level.tolist()]
            else:
                found[axis.column] = axis.shown(self.drawn[axis.column])[sample]
        return found

    def chosen(self, place: int) -> tuple[dict[str, Any], dict[str, Any]]:
        """What the case at such a place has of its own: values by column, and entries by key."""
        combination, sample = divmod(place, self.samples)
        columns: dict[str, Any] = {}
        entries: dict[str, Any] = {}
        for axis in reversed(self.axes):  # The last listed key changes fastest.
            if axis.varied.draw is None:
                combination, level = divmod(combination, len(axis.varied.levels))
                value = axis.varied.levels[level]
            else:
                value = float(self.drawn[axis.column][sample])
            columns[axis.column] = axis.shown(value)
            entries = {**axis.entries(value), **entries}
        if self.seed is not None and _NOISE not in entries:
            entries[_NOISE] = noise_seed(self.seed, sample)
        return columns, with_places_filled(self.scenario.says, entries)


class Cases(Sequence[Case]):
    """The cases of all blocks, one after the other."""

    def __init__(self, blocks: Sequence[Block]) -> None:
        self.blocks = tuple(blocks)
        # The first case of each block, and the number of all.
        self.begins = list(itertools.accumulate(map(len, blocks), initial=0))
        self.columns = tuple(dict.fromkeys(axis.column for b in blocks for axis in b.axes))

    def __len__(self) -> int:
        """How many cases there are."""
        return self.begins[-1]

    @overload
    def __getitem__(self, index: int) -> Case: ...
    @overload
    def __getitem__(self, index: slice) -> list[Case]: ...

    def __getitem__(self, index: int | slice) -> Case | list[Case]:
        """The case of a number, or those of a slice."""
        if isinstance(index, slice):
            return [self[each] for each in range(*index.indices(len(self)))]
        number = index + len(self) if index < 0 else index
        if not 0 <= number < len(self):
            raise IndexError(f"there are {len(self)} cases")
        place = bisect.bisect_right(self.begins, number) - 1
        block = self.blocks[place]
        columns, entries = block.chosen(number - self.begins[place])
        values = {name: columns.get(name, math.nan) for name in self.columns}
        return Case(number, block.robot.word, block.scenario.word, values, entries)


def cases_of(
    robots: Sequence[RobotSource],
    scenarios: Sequence[ScenarioSource],
    parameters: Mapping[str, Varied],
    samples: int,
    seed: int,
) -> Cases:
    """The cases of a sweep: robots and scenarios cross with what each key takes on.

    Numbers are drawn `samples` times. Raises `UsageError` if a key means nothing.
    """
    pairs = list(itertools.product(robots, scenarios))
    axes = [axes_of(parameters, robot, scenario) for robot, scenario in pairs]
    drawn = dict.fromkeys(a.column for some in axes for a in some if a.varied.draw)
    points = shares(samples, len(drawn), seed)
    of_column = dict(zip(drawn, np.transpose(points), strict=True))
    sensed = any(key.startswith("sensors.") for key in parameters)
    noisy = [sensed or s.says("sensors") is not None for s in scenarios] * len(robots)
    blocks = []
    for (robot, scenario), some, noise in zip(pairs, axes, noisy, strict=True):
        numbers = {a.column: a.varied.draw.at(of_column[a.column]) for a in some if a.varied.draw}
        noise_of = seed if noise else None
        blocks.append(Block(robot, scenario, tuple(some), samples, numbers, noise_of))
    return Cases(blocks)
