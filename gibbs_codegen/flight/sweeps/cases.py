"""The cases of a sweep: the values of its keys, and each case, made when it is asked for.

Cases are numbered through robots, then scenarios, then combinations of listed values, then samples.
A sample has the same numbers in all combinations, scenarios and robots: what differs between them
is then due to them alone.

Numbers are drawn together, from the scrambled sequence of Sobol: its points fill the space of all
keys evenly, with errors of averages that fall faster than those of independent draws; and unlike a
Latin hypercube it can be gone on with, so that more samples keep those that are there.
"""

from __future__ import annotations

import bisect
import difflib
import fnmatch
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, overload

import numpy as np

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.flight.distributions import Varied
from gibbs_codegen.flight.sweeps import sources
from gibbs_codegen.flight.vectors import Array

# Points of Sobol's sequence lie on multiples of 2^-30, 0 among them, where a normal distribution
# has no number: they are moved by half of that.
_HALF_STEP = 2.0**-31
# Tables of the scenario file whose keys are parameters of the robot's module.
NUMBERS = ("parameters", "plant")


def shares(samples: int, keys: int, seed: int) -> Array:
    """Points (samples, keys) of Sobol's sequence, above 0 and below 1, scrambled by the seed.

    The first points do not depend on how many there are.
    """
    if keys == 0:
        return np.zeros((samples, 0))
    from scipy.stats import qmc  # Late, as SciPy takes long to import.

    sequence = qmc.Sobol(keys, seed=np.random.default_rng(seed))
    points: Array = sequence.random_base2(math.ceil(math.log2(max(samples, 2))))
    return points[:samples] + _HALF_STEP


def noise_seed(seed: int, sample: int) -> int:
    """The seed, 0 to 2^63 − 1, of what is random in a flight itself.

    It comes from the sweep's seed and the sample's number.
    """
    return int(np.random.SeedSequence((seed, sample)).generate_state(1, np.uint64)[0] >> 1)


@dataclass(frozen=True)
class Axis:
    """One thing that varies: a column of the table, and the entries that it sets.

    `targets` are the keys of the entries in full, of which relative values are factors of `bases`.
    """

    column: str
    targets: tuple[str, ...]
    bases: tuple[float, ...]
    varied: Varied

    def shown(self, value: Any) -> Any:
        """The column's entry for a level or a draw: the value, or the factor of several."""
        if isinstance(value, list | tuple | Mapping):  # A cell holds a number or a text.
            return json.dumps(value)
        relative = self.varied.relative and len(self.targets) == 1
        return value * self.bases[0] if relative else value

    def entries(self, value: Any) -> dict[str, Any]:
        """Values of entries by key that a level, or a number that was drawn, sets."""
        if not self.varied.relative:
            return dict.fromkeys(self.targets, value)
        return {key: value * base for key, base in zip(self.targets, self.bases, strict=True)}


def axes_of(
    parameters: Mapping[str, Varied], robot: sources.RobotSource, scenario: sources.ScenarioSource
) -> list[Axis]:
    """Axes of a sweep for one robot and scenario, from the keys and the robot's parameters.

    A bare name, or pattern, of parameters of the module stands for those of the table [parameters].
    Raises `UsageError` if a key names no parameter of the robot, or nothing is known that a factor
    could be one of, or two keys are for one entry.
    """
    axes: list[Axis] = []
    of_target: dict[str, str] = {}
    for key, varied in parameters.items():
        columns = _entries_of(key, robot)
        if varied.together:
            columns = {key: [target for targets in columns.values() for target in targets]}
        for column, targets in columns.items():
            bases = [_base(key, robot, scenario) for key in targets if varied.relative]
            axes.append(Axis(column, tuple(targets), tuple(bases), varied))
            # No entry may be one that another key is for, or be in one, or have one in it.
            for new, (old, other) in itertools.product(targets, of_target.items()):
                short, long = sorted((new, old), key=len)
                if long.startswith(short) and long[len(short) :][:1] in ("", ".", "["):
                    raise UsageError(
                        f"{printable(other)} and {printable(key)} both set {printable(long)}; "
                        "leave one of them out"
                    )
            of_target |= dict.fromkeys(targets, key)
    return axes


def _entries_of(key: str, robot: sources.RobotSource) -> dict[str, list[str]]:
    """The entries that a key stands for, each in a list, by their columns in the table."""
    table, dot, name = key.partition(".")
    if not dot and (key in robot.parameters or "*" in key):
        table, name = "parameters", key
    if table not in NUMBERS or not name:
        sources.steps_of(key)  # Refuses what is no key.
        return {key: [key]}
    head = key.removesuffix(name)
    return {head + parameter: [f"{table}.{parameter}"] for parameter in _matching(name, robot)}


def _base(key: str, robot: sources.RobotSource, scenario: sources.ScenarioSource) -> float:
    """The value that a factor multiplies at an entry, by its key in full.

    It is what the scenario says; of a parameter else what the controller has, or the robot. Raises
    `UsageError` if nothing is known.
    """
    table, _, name = key.partition(".")
    entry = scenario.says(key)
    if entry is None and table in NUMBERS:
        entry = scenario.says(f"parameters.{name}")
        entry = robot.parameters[name] if entry is None else entry
    if isinstance(entry, bool) or not isinstance(entry, float | int):
        raise UsageError(
            f"{printable(key)}: the scenario {scenario.word} has no number there to scale; give "
            "the values themselves"
        )
    return float(entry)


def _matching(name: str, robot: sources.RobotSource) -> list[str]:
    """Parameters of a robot that match a name, in which * stands for anything.

    Raises `UsageError` if there is none.
    """
    names = list(robot.parameters)
    if matches := fnmatch.filter(names, name) if "*" in name else [n for n in names if n == name]:
        return matches
    near = difflib.get_close_matches(name[:80], names, n=3)
    hint = f"did you mean {' or '.join(near)}?" if near else f"they are {', '.join(names)}"
    raise UsageError(
        f"{printable(name)}: no such parameter of {robot.word}; {printable(hint, 600)}"
    )


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

    robot: sources.RobotSource
    scenario: sources.ScenarioSource
    axes: tuple[Axis, ...]
    samples: int
    # By column, what is drawn for each sample.
    drawn: Mapping[str, Array]
    # The sweep's seed where the scenario has noise that is drawn too.
    seed: int | None

    def __len__(self) -> int:
        """The number of cases."""
        return self.samples * math.prod(len(axis.varied.levels) or 1 for axis in self.axes)

    def ends(self, axis: Axis) -> Sequence[Any]:
        """The values of a list, or the ends of a distribution, if it has none of what is drawn."""
        if (draw := axis.varied.draw) is None:
            return axis.varied.levels
        drawn = self.drawn[axis.column]
        return (drawn.min(), drawn.max()) if draw.kind == "normal" else (draw.first, draw.second)

    def chosen(self, place: int) -> tuple[dict[str, Any], dict[str, Any]]:
        """The case at a place: values by column, and entries by key."""
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
        return columns, sources.with_places_filled(self.scenario.says, entries)


class Cases(Sequence[Case]):
    """The cases of all blocks, one after the other."""

    def __init__(self, blocks: Sequence[Block]) -> None:
        self.blocks = tuple(blocks)
        # The first case of each block, and the number of all.
        self.begins = list(itertools.accumulate(map(len, blocks), initial=0))
        self.columns = tuple(dict.fromkeys(axis.column for b in blocks for axis in b.axes))

    def __len__(self) -> int:
        """The number of cases."""
        return self.begins[-1]

    @overload
    def __getitem__(self, index: int) -> Case: ...
    @overload
    def __getitem__(self, index: slice) -> list[Case]: ...

    def __getitem__(self, index: int | slice) -> Case | list[Case]:
        """The case of a number, or those of a slice."""
        if isinstance(index, slice):
            return [self[number_of_case] for number_of_case in range(*index.indices(len(self)))]
        number = index + len(self) if index < 0 else index
        if not 0 <= number < len(self):
            raise IndexError(f"there are {len(self)} cases")
        place = bisect.bisect_right(self.begins, number) - 1
        block = self.blocks[place]
        columns, entries = block.chosen(number - self.begins[place])
        values = {name: columns.get(name, math.nan) for name in self.columns}
        return Case(number, block.robot.word, block.scenario.word, values, entries)


def cases_of(
    robots: Sequence[sources.RobotSource],
    scenarios: Sequence[sources.ScenarioSource],
    parameters: Mapping[str, Varied],
    samples: int,
    seed: int,
) -> Cases:
    """The cases of a sweep: robots and scenarios cross with the values of each key.

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
