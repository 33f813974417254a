"""What ROBOT may be in every command: a robot file, a robot that ships, or a generated module."""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from gibbs_codegen.errors import UsageError

if TYPE_CHECKING:
    from gibbs_codegen.program.model import Progress
    from gibbs_codegen.robot.model import Robot


_ROBOT = (
    "robot file, the name of a robot that ships, or a generated module: its folder, or its name "
    "in generated/"
)
_FAMILY = "the paper's family: base arms and links as in its Table 1"


def add_robot(parser: argparse.ArgumentParser) -> None:
    """Add ROBOT, or --rotors and --links, to a command that derives."""
    parser.add_argument(
        "robot",
        nargs="?",
        metavar="ROBOT",
        help=f"{_ROBOT}; of a name that is both, the robot that ships is taken",
    )
    parser.add_argument(
        "--rotors", type=int, metavar="N", help=f"with --links: {_FAMILY}; 2 to 256 rotors"
    )
    parser.add_argument("--links", type=int, metavar="n", help="links of the arm, 0 to 64")


def add_module(parser: argparse.ArgumentParser) -> None:
    """Add ROBOT to a command that runs a module."""
    parser.add_argument(
        "robot",
        metavar="ROBOT",
        help=f"{_ROBOT}; of a name that is both, the module is taken; a robot's is made for this "
        "and not kept",
    )


def chosen_robot(options: argparse.Namespace) -> tuple[Robot, str]:
    """The robot that the options ask for, and the text of its file."""
    if options.robot is not None:
        if options.rotors is not None or options.links is not None:
            raise UsageError("give ROBOT, or --rotors and --links, not both")
        return find_robot(options.robot)
    if options.rotors is None or options.links is None:
        raise UsageError("give ROBOT, or both --rotors and --links")
    from gibbs_codegen.robot.family import paper_family
    from gibbs_codegen.robot.text import robot_text

    robot = paper_family(options.rotors, options.links)
    return robot, robot_text(robot)


def find_robot(word: str) -> tuple[Robot, str]:
    """The robot that a word names, and the text of its file.

    A robot that ships comes first, then a file or the folder of a module, then a module in
    generated/. Raises `RobotFileError` for a refused file and `UsageError` where there is none, or
    where the module in generated/ may be older than a robot file of its name.
    """
    from gibbs_codegen.robot.file import read_robot, shipped_robots

    if word in shipped_robots() or os.path.isfile(word):
        return read_robot(word)
    module, file = os.path.join("generated", word), f"{word}.toml"
    if not os.path.isdir(word) and os.path.isdir(module) and os.path.isfile(file):
        raise UsageError(f"{word}: which one, the robot file {file} or the module {module}?")
    for folder in (word, os.path.join("generated", word)):
        if os.path.isfile(file := os.path.join(folder, "robot.toml")):
            return read_robot(file)
    try:
        return read_robot(word)
    except UsageError as error:
        raise UsageError(f"{error}; nor is there a module of that name in generated/") from None


@contextmanager
def found_module(
    word: str, progress: AbstractContextManager[Progress]
) -> Iterator[tuple[Path, bool]]:
    """Folder of the module that a word names, and whether it is kept.

    A folder of that path, or of that name in generated/, comes first: it is a module, or what is
    left of one. Of any other robot a module is made for the occasion. Raises as `find_robot`.
    """
    if os.path.isdir(word) or os.path.isdir(os.path.join("generated", word)):
        from gibbs_codegen.runtime.load import find_module

        yield find_module(Path(word)), True
        return
    robot, text = find_robot(word)
    from gibbs_codegen.pipeline import generate_robot  # It imports SymPy, which modules do without.

    with tempfile.TemporaryDirectory() as out:
        with progress as step:
            _, folder = generate_robot(robot, text, out, progress=step, verify=False)
        yield folder, False
