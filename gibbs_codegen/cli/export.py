"""`export`: a robot in a format of other programs."""

from __future__ import annotations

import argparse
from pathlib import Path

from gibbs_codegen.cli import robot_argument
from gibbs_codegen.errors import printable
from gibbs_codegen.exchange.exporting import FILES, export_robot
from gibbs_codegen.files.module_writer import write_new_file


def run(options: argparse.Namespace) -> int:
    """Write the file, and print the properties that it has no place for."""
    robot, _ = robot_argument.find_robot(options.robot)
    robot_argument.warn_of_inertias(robot)
    text, notes = export_robot(robot, options.format)
    path = Path(options.out or FILES[options.format].format(robot.name))
    write_new_file(path, text, options.force)
    for note in notes:
        print(printable(note))
    print(f"{printable(path)}: written")
    return 0
