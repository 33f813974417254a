"""Robots, scenarios and entries of a sweep, read once from the words for them."""

from __future__ import annotations

import hashlib
import os
import re
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from gibbs_codegen.errors import ScenarioFileError, UsageError, cause_of, printable
from gibbs_codegen.files.shipped import text_of
from gibbs_codegen.files.table import Table, default_at, read_table
from gibbs_codegen.files.toml import checked, merged, nested, plain_value
from gibbs_codegen.flight.desired.trajectory import Progress
from gibbs_codegen.flight.plant.vehicle import RobotData, Vehicle
from gibbs_codegen.flight.record.series import StrPath as StrPath
from gibbs_codegen.flight.scenario.file import (
    AnyScenario,
    ScenarioTable,
    parse_scenario,
    read_scenario,
)
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.runtime.c_library import announced
from gibbs_codegen.runtime.load import find_module, load, robot_file
from gibbs_codegen.version import __version__

if TYPE_CHECKING:
    from gibbs_codegen.robot.model import Robot

Step = str | int

_KEY = re.compile(r"[^.\[\]\s]+(\.[^.\[\]\s]+|\[\d+\])*")


def steps_of(key: str) -> tuple[Step, ...]:
    """The way to an entry: names of tables, and places in lists, from 0.

    `start.offset[2]` is ("start", "offset", 2). Raises `UsageError` for what is no key.
    """
    if not _KEY.fullmatch(key):
        raise UsageError(f"{printable(key)}: not a key, such as motors.time_constant")
    matches = re.findall(r"\[(\d+)\]|([^.\[\]]+)", key)
    return tuple(int(place) if place else name for place, name in matches)


def entry(whole: Any, key: str) -> Any:
    """The entry at a key of tables, lists and numbers, or None.

    They may be plain, of pydantic or dataclasses.
    """
    value = whole
    for step in steps_of(key):
        if isinstance(step, int):
            is_list = isinstance(value, Sequence) and not isinstance(value, str)
            value = value[step] if is_list and step < len(value) else None
        elif isinstance(value, Mapping):
            value = value.get(step)
        elif isinstance(value, Table):
            value = default_at(value, step)
        else:
            value = getattr(value, step, None)
    return value


def with_places_filled(says: Callable[[str], Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Values by keys as `simulate --set` takes them: of a list, all of it, with the values in it.

    `says` tells what the scenario has at a key. Raises `UsageError` if a list has no such place.
    """
    filled: dict[str, Any] = {}
    for key, value in values.items():
        name, bracket, _ = key.partition("[")
        if not bracket:
            filled[key] = value
            continue
        if name not in filled:
            filled[name] = plain_value(says(name))
        place, *outer = reversed(steps_of(key)[len(steps_of(name)) :])
        inner: Any = filled[name]
        try:
            for step in reversed(outer):
                inner = inner[step]
            inner[place] = value
        except (IndexError, KeyError, TypeError):
            raise UsageError(
                f"{printable(key)}: the scenario has no such entry; add it there first"
            ) from None
    return filled


def replacement(value: Any, changes: Mapping[str, Any], key: str = "") -> Any:
    """A dataclass, or a mapping, with other values, in tables, of some of its fields.

    `key` is where it stands, for messages. Raises `UsageError` if there is no such field.
    """
    if isinstance(value, Mapping):
        return {**value, **changes}
    field_names = {field.name for field in fields(value)} if is_dataclass(value) else set()
    new: dict[str, Any] = {}
    for name, change in changes.items():
        place = f"{key}{name}"
        if name not in field_names:
            raise UsageError(
                f"{printable(place)}: a Scenario has no such field; give a scenario file or its "
                "name to vary entries of the file"
            )
        before = getattr(value, name)
        if isinstance(change, Mapping):
            new[name] = replacement(before, change, f"{place}.")
        else:
            new[name] = tuple(change) if isinstance(before, tuple) else change
    return replace(value, **new)


@dataclass(frozen=True)
class RobotSource:
    """A robot: the word for it, its module's folder, and of the module digest and parameters."""

    word: str
    folder: Path
    digest: str
    parameters: Mapping[str, float]
    has_tip: bool


@dataclass(frozen=True)
class ScenarioSource:
    """A scenario: the word for it, and the text of its file, or the scenario itself.

    It goes to the processes that fly, which read the text once for all of their flights.
    """

    word: str
    text: str = ""
    scenario: Scenario | None = None

    @cached_property
    def _document(self) -> dict[str, Any]:
        return tomllib.loads(self.text)

    @cached_property
    def _table(self) -> ScenarioTable:
        """The file as it is, checked."""
        return checked(self.text, self.word, ScenarioTable, ScenarioFileError)

    def __reduce__(self) -> tuple[Any, ...]:
        # The parsed text stays here.
        return ScenarioSource, (self.word, self.text, self.scenario)

    def says(self, key: str) -> Any:
        """The entry at a key, or its default; None if there is nothing."""
        if self.scenario is not None:
            return entry(self.scenario, key)
        stated = entry(self._document, key)
        return entry(self._table, key) if stated is None else stated

    def knows(self, key: str) -> bool:
        """True if a key is one of the scenario, rather than a parameter of a robot."""
        return "." in key or hasattr(self.scenario or self._table, key.partition("[")[0])

    def changed(self, changes: Mapping[str, Any]) -> Scenario:
        """The scenario with other values of some entries, by keys without places in lists.

        Raises `UsageError` if values mean nothing, and `ScenarioFileError` with every fault.
        """
        tables = nested(changes)
        if self.scenario is not None:
            return replacement(self.scenario, tables)
        # A refused scenario is read again from the text, which has the lines of faults.
        table, _ = read_table(ScenarioTable, merged(self._document, tables))
        return table.scenario() if table else parse_scenario(self.text, self.word, tables)


def scenario_source(scenario: AnyScenario) -> ScenarioSource:
    """The source of a scenario, given as such, by the name of one that ships, or by a file.

    Raises `UsageError` if there is no such file, and `ScenarioFileError` with every fault of it.
    """
    if isinstance(scenario, Scenario | Mapping):
        read = read_scenario(scenario)
        return ScenarioSource(read.name, scenario=read)
    word = os.fspath(scenario)
    text, _ = text_of(word, "scenarios", ScenarioFileError)
    parse_scenario(text, word)
    return ScenarioSource(word, text)


def robot_data(robot: StrPath, read: Callable[[str], tuple[Robot, str]] | None = None) -> RobotData:
    """The data of a robot for flights, as of `robot_source`, before it has a module.

    `read` reads robot files. Raises as `robot_source` does.
    """
    word = os.fspath(robot)
    if os.path.isdir(word) or os.path.isdir(os.path.join("generated", word)):
        return Vehicle(load(find_module(Path(word))))
    from gibbs_codegen.robot.balance import carried_rotors, wheel_wrenches, wrench_matrix
    from gibbs_codegen.robot.description import Description
    from gibbs_codegen.robot.file import read_robot

    source, _ = (read or read_robot)(word)
    module, described = ModuleType(source.name), Description(source)
    vars(module).update(NAME=source.name, ATTITUDE=source.kind)
    vars(module).update(**described.lists(), **described.constants)
    if carried_rotors(source):
        return RobotData(module)
    rotors = np.kron(np.eye(2), source.base.pose.matrix) @ wrench_matrix(source)
    return RobotData(module, np.column_stack([rotors, wheel_wrenches(source)]))


def robot_source(
    robot: StrPath,
    modules: Path,
    progress: Progress,
    derivatives: Sequence[str] = (),
    functions: Sequence[str] | None = None,
) -> RobotSource:
    """The source of a robot of a sweep; its C is compiled.

    `robot` is a folder of a module or its name in `generated/`, which come first, the name of a
    robot that ships, or a robot file. Of these a module is generated where there is none, with
    some `derivatives` and `functions`, or those by default, in a folder of its digest in `modules`.
    Raises `UsageError` if there is no such robot, and `RobotFileError` with every fault of the
    file.
    """
    word = os.fspath(robot)
    if os.path.isdir(word) or os.path.isdir(os.path.join("generated", word)):
        folder = find_module(Path(word))
    else:
        from gibbs_codegen.robot.file import read_robot

        read, text = read_robot(word)
        asked = [__version__, *derivatives, *(functions or ()), text]
        digest = hashlib.sha256("\n".join(asked).encode()).hexdigest()
        out = modules / digest[:16]
        if not (out / read.name / "MANIFEST").is_file():
            from gibbs_codegen.pipeline import generate_robot  # Late, as it imports SymPy.

            progress(f"generating {read.name}", 0.0)
            generate_robot(
                read, text, out, verify=False, derivatives=derivatives, functions=functions
            )
        folder = (out / read.name).resolve()
    module, digests = load(folder, "c"), hashlib.sha256()
    try:
        for path in sorted(filter(Path.is_file, folder.iterdir())):
            content = hashlib.sha256(path.read_bytes()).digest()
            digests.update(f"{path.name}\n".encode() + content)
    except OSError as error:
        raise UsageError(f"{printable(folder)}: cannot be read: {cause_of(error)}") from None
    has_tip = "tip" in module.POINTS
    return RobotSource(word, folder, digests.hexdigest(), module.PARAMETERS, has_tip)


@contextmanager
def flown_module(word: str, functions: Sequence[str]) -> Iterator[tuple[ModuleType, str | None]]:
    """The module of a robot with the law that leads it, generated in a folder that goes afterwards.

    `word` is a robot file, the name of a robot that ships, or the folder of a module. The functions
    are those by default and others. Without such a law there is None, and derivatives instead.
    Raises as `generate` does.
    """
    # Late, as it imports SymPy.
    from gibbs_codegen.pipeline import closed_loops, generate_robot, tracking_law
    from gibbs_codegen.robot.file import read_robot

    read, text = read_robot(robot_file(word))
    if closed_loops(read):
        raise UsageError(
            f"{read.name}: its joints form loops, which such a page does not hold closed; fly it "
            "with simulate, and look at the flight with view"
        )
    law = tracking_law(read)
    laws, derivatives = ((law,), ()) if law else ((), ("forward_dynamics_derivatives",))
    with tempfile.TemporaryDirectory() as out:
        with announced(f"{read.name}: deriving its equations"):
            _, folder = generate_robot(
                *(read, text, out),
                verify=False,
                derivatives=derivatives,
                functions=("default", *functions),
                laws=laws,
            )
        yield load(folder), law
