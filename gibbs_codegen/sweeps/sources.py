"""Robots and scenarios of a sweep: what the words for them mean, read once."""

from __future__ import annotations

import hashlib
import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gibbs_codegen.errors import ScenarioFileError, UsageError, cause_of, printable
from gibbs_codegen.files.changes import merged
from gibbs_codegen.files.shipped import text_of
from gibbs_codegen.scenario.file import parse_scenario
from gibbs_codegen.scenario.scenario import Scenario
from gibbs_codegen.simulator.desired.trajectory import Progress
from gibbs_codegen.sweeps.entries import entry, nested, replaced
from gibbs_codegen.version import __version__

if TYPE_CHECKING:
    from gibbs_codegen.scenario.tables import ScenarioTable

StrPath = str | os.PathLike[str]


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
    given: Scenario | None = None

    @cached_property
    def _document(self) -> dict[str, Any]:
        return tomllib.loads(self.text)

    @cached_property
    def _table(self) -> ScenarioTable:
        """The file as it is, checked."""
        from gibbs_codegen.files.toml import checked
        from gibbs_codegen.scenario.tables import ScenarioTable

        return checked(self.text, self.word, ScenarioTable, ScenarioFileError)

    @cached_property
    def plain(self) -> Scenario:
        """The scenario without changes."""
        return self.given or parse_scenario(self.text, self.word)

    def __reduce__(self) -> tuple[Any, ...]:
        # What has been made of the text stays here.
        return ScenarioSource, (self.word, self.text, self.given)

    def says(self, key: str) -> Any:
        """What stands at a key, or what it is by default; None if there is nothing."""
        if self.given is not None:
            return entry(self.given, key)
        found = entry(self._document, key)
        return entry(self._table, key) if found is None else found

    def changed(self, changes: Mapping[str, Any]) -> Scenario:
        """The scenario with other values of some entries, by keys without places in lists.

        Raises `UsageError` if values mean nothing, and `ScenarioFileError` with every fault.
        """
        tables = nested(changes)
        if self.given is not None:
            scenario: Scenario = replaced(self.given, tables)
            return scenario
        from gibbs_codegen.scenario.tables import ScenarioTable

        # What is refused is read again from the text, which has the lines of faults.
        table, _ = ScenarioTable.read(merged(self._document, tables))
        return table.scenario() if table else parse_scenario(self.text, self.word, tables)


def scenario_source(scenario: Scenario | StrPath) -> ScenarioSource:
    """What is known of a scenario, given as such, by the name of one that ships, or by a file.

    Raises `UsageError` if there is no such file, and `ScenarioFileError` with every fault of it.
    """
    if isinstance(scenario, Scenario):
        return ScenarioSource(scenario.name, given=scenario)
    word = os.fspath(scenario)
    text, _ = text_of(word, "scenarios", ScenarioFileError)
    parse_scenario(text, word)
    return ScenarioSource(word, text)


def robot_source(robot: StrPath, modules: Path, progress: Progress) -> RobotSource:
    """What is known of a robot of a sweep; its C is compiled.

    `robot` is a folder of a module or its name in `generated/`, which come first, the name of a
    robot that ships, or a robot file. Of these a module is generated where there is none, in a
    folder of its digest in `modules`. Raises `UsageError` if there is no such robot, and
    `RobotFileError` with every fault of the file.
    """
    from gibbs_codegen.runtime.load import find_module, load

    word = os.fspath(robot)
    if os.path.isdir(word) or os.path.isdir(os.path.join("generated", word)):
        folder = find_module(Path(word))
    else:
        folder = _generated(word, modules, progress)
    module = load(folder, "c")
    return RobotSource(word, folder, _digest_of(folder), module.PARAMETERS, "tip" in module.POINTS)


def _generated(word: str, modules: Path, progress: Progress) -> Path:
    """Folder of the module of a robot file, or of a robot that ships, generated if need be."""
    from gibbs_codegen.robot.file import read_robot

    read, text = read_robot(word)
    digest = hashlib.sha256(f"{__version__}\n{text}".encode()).hexdigest()
    out = modules / digest[:16]
    if not (out / read.name / "MANIFEST").is_file():
        from gibbs_codegen.pipeline import generate_robot  # Late, as it imports SymPy.

        progress(f"generating {read.name}", 0.0)
        generate_robot(read, text, out, verify=False)
    return (out / read.name).resolve()


def _digest_of(folder: Path) -> str:
    """A digest of the files of a module, in hexadecimal digits."""
    digest = hashlib.sha256()
    try:
        for path in sorted(folder.iterdir()):
            if path.is_file():
                digest.update(
                    f"{path.name}\n".encode() + hashlib.sha256(path.read_bytes()).digest()
                )
    except OSError as error:
        raise UsageError(f"{printable(folder)}: cannot be read: {cause_of(error)}") from None
    return digest.hexdigest()
