"""The errors a user can meet: each says what is wrong, where, and what would be right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

# More than a person will read at a time.
_SHOWN = 50
_LONGEST = 160


def printable(text: object, most: int = _LONGEST) -> str:
    """A text of somebody else's, such as a path, as a message may hold it.

    On one line of at most `most` characters, with what a terminal would obey or hide as escapes.
    """
    plain = "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in str(text)
    )
    if len(plain) <= most:
        return plain
    end = (most - 3) // 2  # A path tells most at its end, where its name is.
    return f"{plain[: most - 3 - end]}...{plain[-end:]}"


class GibbsCodegenError(Exception):
    """Root of every error that this package raises on purpose.

    `exit_code` is what the command line returns for it: 2 for wrong use or a refused robot file,
    1 for work that was accepted and then failed.
    """

    exit_code = 2


@dataclass(frozen=True)
class Fault:
    """One thing wrong with a file: its key path, the line where it can be had, and why."""

    path: str
    message: str
    line: int | None = None

    def text(self, source: str) -> str:
        """The fault as `source:line: key: message`."""
        place = source if self.line is None else f"{source}:{self.line}"
        return f"{place}: {self.path}: {self.message}" if self.path else f"{place}: {self.message}"


class RefusedFileError(GibbsCodegenError):
    """A file that is refused; `faults` holds every reason, in the order of the file.

    `kind` says what kind of file it is.
    """

    kind = "file"

    def __init__(self, source: str, faults: Sequence[Fault]) -> None:
        self.source = source
        self.faults = tuple(faults)
        shown = printable(source)
        lines = [fault.text(shown) for fault in self.faults[:_SHOWN]]
        if len(self.faults) > _SHOWN:
            lines.append(f"{shown}: and {len(self.faults) - _SHOWN} more")
        super().__init__("\n".join(lines))


class RobotFileError(RefusedFileError):
    """A robot file that is refused."""

    kind = "robot file"


class ScenarioFileError(RefusedFileError):
    """A scenario that is refused."""

    kind = "scenario"


class SingularRobotError(GibbsCodegenError):
    """A robot whose mass matrix is singular: always, or at an arbitrary configuration.

    `joint` names the coordinate that no mass or inertia resists.
    """

    def __init__(self, robot: str, joint: str) -> None:
        self.robot = robot
        self.joint = joint
        super().__init__(
            f"{robot}: nothing resists {joint}: its acceleration is not determined; "
            "give what it moves mass or inertia about its axis"
        )


class UsageError(GibbsCodegenError):
    """A request that cannot be met as it was put: an unknown name, target or folder."""


class OutputError(GibbsCodegenError):
    """Output that could not be written: a full disk, a folder without permission."""

    exit_code = 1
