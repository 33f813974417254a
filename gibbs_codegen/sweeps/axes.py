"""Keys of a sweep made out for one robot and scenario: which entries they set, and to what."""

from __future__ import annotations

import difflib
import fnmatch
import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.sweeps.entries import steps_of
from gibbs_codegen.sweeps.sampling import Varied
from gibbs_codegen.sweeps.sources import RobotSource, ScenarioSource

# Tables of the scenario file whose keys are parameters of the robot's module.
_OF_PARAMETERS = ("parameters", "plant")


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
        """What the column says of a level or a draw: what is set, or the factor of several."""
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
    parameters: Mapping[str, Varied], robot: RobotSource, scenario: ScenarioSource
) -> list[Axis]:
    """What the keys of a sweep vary of one robot and scenario, by keys and the robot's parameters.

    A bare name, or pattern, of parameters of the module stands for those of the table [parameters].
    Raises `UsageError` if a key names no parameter of the robot, or nothing is known that a factor
    could be one of, or two keys are for one entry.
    """
    found: list[Axis] = []
    of_target: dict[str, str] = {}
    for key, varied in parameters.items():
        columns = _entries_of(key, robot)
        if varied.together:
            columns = {key: [target for targets in columns.values() for target in targets]}
        for column, targets in columns.items():
            bases = [_base(key, robot, scenario) for key in targets if varied.relative]
            found.append(Axis(column, tuple(targets), tuple(bases), varied))
            _refuse_twice(of_target, targets, key)
            of_target |= dict.fromkeys(targets, key)
    return found


def _refuse_twice(of_target: Mapping[str, str], targets: Sequence[str], key: str) -> None:
    """Refuse a key for an entry that another key is for, or that is in one, or that one is in.

    `of_target` has the keys so far, by those of their entries in full.
    """
    for new, (old, other) in itertools.product(targets, of_target.items()):
        short, long = sorted((new, old), key=len)
        if long.startswith(short) and long[len(short) :][:1] in ("", ".", "["):
            raise UsageError(
                f"{printable(other)} and {printable(key)} both set {printable(long)}; let one of "
                "them do so"
            )


def _entries_of(key: str, robot: RobotSource) -> dict[str, list[str]]:
    """The entries that a key stands for, each in a list, by their columns in the table."""
    table, dot, name = key.partition(".")
    if not dot and (key in robot.parameters or "*" in key):
        table, name = "parameters", key
    if table not in _OF_PARAMETERS or not name:
        steps_of(key)  # Refuses what is no key.
        return {key: [key]}
    head = key.removesuffix(name)
    return {head + each: [f"{table}.{each}"] for each in _matching(name, robot)}


def _base(key: str, robot: RobotSource, scenario: ScenarioSource) -> float:
    """What a factor of an entry, by its key in full, is a factor of.

    It is what the scenario says; of a parameter else what the controller has, or the robot. Raises
    `UsageError` if nothing is known.
    """
    table, _, name = key.partition(".")
    found = scenario.says(key)
    if found is None and table in _OF_PARAMETERS:
        found = scenario.says(f"parameters.{name}")
        found = robot.parameters[name] if found is None else found
    if isinstance(found, bool) or not isinstance(found, float | int):
        raise UsageError(
            f"{printable(key)}: the scenario {scenario.word} has no number there that scaled() "
            "could be a factor of; give the values themselves"
        )
    return float(found)


def _matching(name: str, robot: RobotSource) -> list[str]:
    """Parameters of a robot that match a name, in which * stands for anything.

    Raises `UsageError` if there is none.
    """
    known = list(robot.parameters)
    if found := fnmatch.filter(known, name) if "*" in name else [n for n in known if n == name]:
        return found
    near = difflib.get_close_matches(name[:80], known, n=3)
    hint = f"did you mean {' or '.join(near)}?" if near else f"they are {', '.join(known)}"
    raise UsageError(
        f"{printable(name)}: no such parameter of {robot.word}; {printable(hint, 600)}"
    )
