"""Robot files made in Python, for design studies: the text of one for each design."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gibbs_codegen.errors import Fault, RobotFileError
from gibbs_codegen.files.module_writer import write_new_file
from gibbs_codegen.files.staging import made, writing
from gibbs_codegen.files.toml import plain_value
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.ties import TIES
from gibbs_codegen.robot.text import toml_lines


class RobotFile:
    """A robot file in the making: every method returns a new one, with more in it.

    Keys are those of robot files, as arguments: numbers, words, lists, dictionaries for tables, and
    arrays of NumPy. One that is None is left out. Nothing is checked before the file is whole.

    Args:
        name: The robot's name.
        keys: Other keys of the top table, such as `gravity`.
    """

    def __init__(self, name: str, **keys: Any) -> None:
        self._document: dict[str, Any] = {"name": name} | _present(keys)

    def base(self, **keys: Any) -> RobotFile:
        """Set keys of `[base]`; keys of earlier calls stay.

        Args:
            keys: Keys of the table.

        Returns:
            The file with it.
        """
        return self._with("base", self._document.get("base", {}) | _present(keys))

    def battery(self, **keys: Any) -> RobotFile:
        """Set keys of `[battery]`; keys of earlier calls stay.

        Args:
            keys: Keys of the table.

        Returns:
            The file with it.
        """
        return self._with("battery", self._document.get("battery", {}) | _present(keys))

    def rotor(self, **keys: Any) -> RobotFile:
        """Add a `[[rotor]]`.

        Args:
            keys: Keys of the table.

        Returns:
            The file with it.
        """
        return self._with_one_more("rotor", keys)

    def link(self, **keys: Any) -> RobotFile:
        """Add a `[[link]]`, which the one before carries, or else `parent`.

        Args:
            keys: Keys of the table.

        Returns:
            The file with it.
        """
        return self._with_one_more("link", keys)

    def wheel(self, **keys: Any) -> RobotFile:
        """Add a `[[wheel]]`.

        Args:
            keys: Keys of the table.

        Returns:
            The file with it.
        """
        return self._with_one_more("wheel", keys)

    def frame(self, **keys: Any) -> RobotFile:
        """Add a `[[frame]]`.

        Args:
            keys: Keys of the table.

        Returns:
            The file with it.
        """
        return self._with_one_more("frame", keys)

    def constraint(self, **keys: Any) -> RobotFile:
        """Add a `[[constraint]]`.

        Args:
            keys: Keys of the table.

        Returns:
            The file with it.
        """
        return self._with_one_more("constraint", keys)

    def spring(self, **keys: Any) -> RobotFile:
        """Add a `[[spring]]`.

        Args:
            keys: Keys of the table.

        Returns:
            The file with it.
        """
        return self._with_one_more("spring", keys)

    def _with_one_more(self, kind: str, keys: Mapping[str, Any]) -> RobotFile:
        return self._with(kind, [*self._document.get(kind, ()), _present(keys)])

    def _with(self, key: str, value: Any) -> RobotFile:
        changed = RobotFile("")
        changed._document = self._document | {key: value}
        return changed

    def robot(self) -> Robot:
        """Check the file.

        Returns:
            The robot that it describes.

        Raises:
            RobotFileError: With every fault, each with its key.
        """
        from gibbs_codegen.files.table import key_path, read_table  # Late: it imports pydantic.
        from gibbs_codegen.robot.tables import RobotTable

        table, faults = read_table(RobotTable, self._document)
        if table is None:
            source = str(self._document["name"])
            raise RobotFileError(source, [Fault(key_path(at), words) for at, words in faults])
        return table.robot()

    def text(self) -> str:
        """Write the file as text, checked.

        Returns:
            TOML, as `parse_robot` reads it.

        Raises:
            RobotFileError: As of `robot`.
        """
        self.robot()
        top = {k: v for k, v in self._document.items() if k not in (*_SINGLE, *_TABLES)}
        lines = toml_lines(top)
        for kind in _SINGLE:
            if kind in self._document:
                lines += ["", f"[{kind}]", *toml_lines(self._document[kind])]
        for kind in _TABLES:
            for keys in self._document.get(kind, ()):
                lines += ["", f"[[{kind}]]", *toml_lines(keys)]
        return "\n".join(lines) + "\n"

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the file, in place of another that may be there.

        Args:
            path: Path of the file, such as "designs/uav.toml"; its folder is created.

        Returns:
            The path, for `generate` and the others that take robot files.

        Raises:
            RobotFileError: As of `robot`.
            OutputError: If it cannot be written.
        """
        file, text = Path(path), self.text()
        with writing(file), made(file.parent):
            write_new_file(file, text, force=True)
        return file


_SINGLE, _TABLES = (
    ("base", "battery"),
    ("rotor", "link", "wheel", "frame", *(kind.array for kind in TIES)),
)


def _present(keys: Mapping[str, Any]) -> dict[str, Any]:
    return {key: plain_value(value) for key, value in keys.items() if value is not None}
