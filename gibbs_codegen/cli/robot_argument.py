"""ROBOT of every command: a robot file, a robot that ships, or a generated module."""

from __future__ import annotations

import argparse
import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from gibbs_codegen.errors import UsageError, near

if TYPE_CHECKING:
    from gibbs_codegen.flight.plant.vehicle import RobotData
    from gibbs_codegen.program.model import Progress
    from gibbs_codegen.robot.model import Robot


def chosen_robot(options: argparse.Namespace) -> tuple[Robot, str]:
    """The robot that the options ask for, and the text of its file.

    The robot is derived anew, so NAME.toml and a robot that ships go before a module. It warns of
    inertias that the file lets pass. Raises `UsageError` if the options ask for no robot, or for
    two.
    """
    if options.robot is not None:
        if options.rotors is not None or options.links is not None:
            raise UsageError("give ROBOT, or --rotors and --links, not both")
        from gibbs_codegen.robot.file import read_robot, shipped_robots

        word, file = options.robot, f"{options.robot}.toml"
        if not os.path.exists(word) and (os.path.isfile(file) or word in shipped_robots()):
            robot, text = read_robot(file if os.path.isfile(file) else word)
        else:
            robot, text = find_robot(word)
        warn_of_inertias(robot)
        return robot, text
    if options.rotors is None or options.links is None:
        raise UsageError("give ROBOT, or both --rotors and --links")
    from gibbs_codegen.robot.family import paper_family
    from gibbs_codegen.robot.text import robot_text

    robot = paper_family(options.rotors, options.links)
    return robot, robot_text(robot)


def warn_of_inertias(robot: Robot) -> None:
    """Warn of inertias that no body has and that the robot's file lets pass."""
    if robot.allow_impossible_inertia:
        from gibbs_codegen.robot.balance import impossible_inertias

        for warning in impossible_inertias(robot):
            print(f"gibbs-codegen: warning: {warning}", file=sys.stderr)


def find_robot(word: str) -> tuple[Robot, str]:
    """The robot that a word names, and the text of its file.

    A file of that path comes first, then a module, NAME.toml, and a robot that ships. Raises
    `RobotFileError` if the file is rejected, and `UsageError` if there is no such robot.
    """
    from gibbs_codegen.robot.file import read_robot
    from gibbs_codegen.runtime.load import modules_made, robot_file

    try:
        return read_robot(robot_file(word))
    except UsageError as error:
        names = [*modules_made(), *(name for name in os.listdir() if name.endswith(".toml"))]
        message = f"{error}; nor is there a module of that name in generated/{near(word, names)}"
        raise UsageError(message) from None


def functions_of(word: str | None) -> tuple[str, ...]:
    """Names of a module's functions; none where the word names none, as of `find_robot`."""
    from gibbs_codegen.runtime.load import robot_file

    if word is None or (file := robot_file(word)) == word:
        return ()
    try:
        text = Path(file).with_name("numpy_module.py").read_text("utf-8")
    except (OSError, UnicodeDecodeError):
        return ()
    # The source is searched: running the module would take longer, and could run anything.
    listed = re.search(r"^FUNCTIONS = \((.*?)^\)", text, re.M | re.S)
    return tuple(re.findall(r'"(\w+)"', listed[1])) if listed else ()


def usual_scenario(word: str) -> str:
    """The scenario of the robot of a word, as of `find_robot`, where none is chosen."""
    from gibbs_codegen.flight.sweeps.sources import robot_data

    robot = robot_data(word, find_robot)
    return "paper" if robot.rotors and robot.layout.moves_freely else "hold"


@contextmanager
def found_module(
    word: str,
    progress: AbstractContextManager[Progress],
    derivatives: Sequence[str] = (),
    functions: Sequence[str] | None = None,
    check: Callable[[RobotData], None] | None = None,
    keep_zeros: bool = False,
) -> Iterator[tuple[Path, bool]]:
    """The folder of the module that a word, as of `find_robot`, names, and whether it is kept.

    A folder of that path, or of that name in generated/, comes first: it is a module, or what is
    left of one. For any other robot a module is generated, with some `derivatives` and `functions`,
    or those by default, with parameters that are zero too if `keep_zeros`, its steps shown by
    `progress`, and removed on leaving. Errors are those of `find_robot`, and of `check`, which
    comes first.
    """
    if check is not None:
        from gibbs_codegen.flight.sweeps.sources import robot_data

        check(robot_data(word, find_robot))
    if os.path.isdir(word) or os.path.isdir(os.path.join("generated", word)):
        from gibbs_codegen.runtime.load import find_module

        yield find_module(Path(word)), True
        return
    robot, text = find_robot(word)
    from gibbs_codegen.pipeline import generate_robot  # It imports SymPy, which modules do without.

    with tempfile.TemporaryDirectory() as out:
        with progress as step:
            _, folder = generate_robot(
                *(robot, text, out),
                progress=step,
                verify=False,
                derivatives=derivatives,
                functions=functions,
                keep_zeros=keep_zeros,
            )
        yield folder, False
