"""Robot files: TOML text in, a checked `Robot` out, or every fault of the file at once.

Nothing is guessed: an unknown key, a wrong type, a number that is not finite or an inertia that no
body has is refused with its key path and line. What the keys are stands in `robot/tables.py`.
"""

from __future__ import annotations

import os

from gibbs_codegen.errors import RobotFileError
from gibbs_codegen.files.shipped import shipped_names, text_of
from gibbs_codegen.files.toml import checked
from gibbs_codegen.robot.model import Robot

_FOLDER = "robots"
AnyRobot = Robot | str | os.PathLike[str]


def shipped_robots() -> tuple[str, ...]:
    """Names of the robots that ship with the package."""
    return shipped_names(_FOLDER)


def as_robot(robot: AnyRobot) -> Robot:
    """A robot, or that of a file or of a name that ships; raises as `read_robot` does."""
    return robot if isinstance(robot, Robot) else read_robot(os.fspath(robot))[0]


def read_robot(name_or_path: str) -> tuple[Robot, str]:
    """Read a robot by file path, or by the name of one that ships.

    Raises `RobotFileError` for a faulty file, and `UsageError` if there is none.

    Args:
        name_or_path: The path or name.

    Returns:
        The robot, and the text of its file.
    """
    text, source = text_of(name_or_path, _FOLDER, RobotFileError)
    return parse_robot(text, source), text


def parse_robot(text: str, source: str = "robot file") -> Robot:
    """Check a robot file's text. A refused one raises `RobotFileError` with every fault.

    Args:
        text: The file, in TOML.
        source: Name of the file for messages.

    Returns:
        The robot.
    """
    from gibbs_codegen.robot.tables import RobotTable  # Late, as it imports pydantic.

    return checked(text, source, RobotTable, RobotFileError).robot()
