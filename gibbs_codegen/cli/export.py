"""`export`: a robot in URDF or MJCF, for other programs."""

from __future__ import annotations

import argparse

from gibbs_codegen.cli import robot_argument
from gibbs_codegen.cli.terminal import Parser
from gibbs_codegen.errors import printable


def add(commands: argparse._SubParsersAction[Parser]) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser("export", help="write a robot in URDF or MJCF")
    parser.add_argument("robot", metavar="ROBOT", help=robot_argument.ROBOT_THAT_DERIVES)
    parser.add_argument(
        "--format", choices=("urdf", "mjcf"), required=True, help="format of the file"
    )
    parser.add_argument(
        "--out", metavar="FILE", help="file to write (default: the robot's name and .urdf or .xml)"
    )
    parser.add_argument("--force", action="store_true", help="replace FILE if it exists")
    parser.set_defaults(command=_export)


def _export(options: argparse.Namespace) -> int:
    from pathlib import Path

    from gibbs_codegen.exchange.exporting import ENDINGS, export_robot
    from gibbs_codegen.files.module_writer import write_new_file

    robot, _ = robot_argument.find_robot(options.robot)
    robot_argument.warn_of_inertias(robot)
    text, told = export_robot(robot, options.format)
    path = Path(options.out or f"{robot.name}{ENDINGS[options.format]}")
    write_new_file(path, text, options.force)
    for line in told:
        print(printable(line))
    print(f"{printable(path)}: written")
    return 0
