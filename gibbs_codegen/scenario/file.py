"""Scenario files: TOML text in, a checked `Scenario` out, or every fault of the file at once.

What the keys are stands in `scenario/tables.py`, and of paths in `scenario/path_tables.py`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gibbs_codegen.errors import Fault, ScenarioFileError
from gibbs_codegen.files.changes import nested
from gibbs_codegen.files.shipped import shipped_names, text_of
from gibbs_codegen.files.toml import checked
from gibbs_codegen.files.toml_depth import TOO_DEEP
from gibbs_codegen.scenario.scenario import Scenario

_FOLDER = "scenarios"


def shipped_scenarios() -> tuple[str, ...]:
    """Names of the scenarios that ship with the package."""
    return shipped_names(_FOLDER)


def read_scenario(name_or_path: str, changes: Mapping[str, Any] | None = None) -> Scenario:
    """Read a scenario by file path, or by the name of one that ships.

    Refused files raise `ScenarioFileError`, and where there is none `UsageError` is raised.

    Args:
        name_or_path: The path or name.
        changes: What replaces entries of the file, in its own form:
            `{"start": {"offset": [0.2, 0, 0]}}`, or `{"start.offset": [0.2, 0, 0]}`; None removes
            an entry.

    Returns:
        The scenario.
    """
    text, source = text_of(name_or_path, _FOLDER, ScenarioFileError)
    return parse_scenario(text, source, changes)


def parse_scenario(
    text: str, source: str = "scenario", changes: Mapping[str, Any] | None = None
) -> Scenario:
    """Check a scenario file's text, with changes as of `read_scenario`.

    Raises `ScenarioFileError` with every fault found; `source` is the file's name in messages.
    """
    from gibbs_codegen.scenario.tables import ScenarioTable  # Late, as it imports pydantic.

    try:
        changes = nested(changes or {})
        return checked(text, source, ScenarioTable, ScenarioFileError, changes).scenario()
    except RecursionError:
        raise ScenarioFileError(source, [Fault("", TOO_DEEP)]) from None
