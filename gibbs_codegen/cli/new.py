"""`new`: a commented robot file to start from."""

from __future__ import annotations

import argparse

from gibbs_codegen.cli.terminal import Parser
from gibbs_codegen.errors import printable


def add(commands: argparse._SubParsersAction[Parser]) -> None:
    """Add the command to the parser."""
    new = commands.add_parser("new", help="write a commented robot file to start from")
    new.add_argument(
        "file", metavar="ROBOT.toml", help="robot file to write, which must not exist yet"
    )
    new.add_argument(
        "--placed",
        action="store_true",
        help="place rotors and joints by positions and axes; without it the base has rods with a "
        "rotor at the end of each, and links have Denavit-Hartenberg parameters, as in the paper",
    )
    new.set_defaults(command=_new)


def _new(options: argparse.Namespace) -> int:
    import shlex
    from functools import partial
    from pathlib import Path

    from gibbs_codegen.files.module_writer import write_new_file
    from gibbs_codegen.robot.family import paper_family
    from gibbs_codegen.robot.names import name_from
    from gibbs_codegen.robot.text import placed_robot_text, robot_text

    path = Path(options.file)
    name = name_from(path.stem)
    rods = partial(robot_text, paper_family(6, 3), to_start_from=True)
    write_new_file(path, (placed_robot_text if options.placed else rods)(name))
    # What begins with a minus sign would be taken for an option.
    words = ["gibbs-codegen", "generate", *(["--"] if str(path).startswith("-") else []), str(path)]
    command = printable(shlex.join(words), 4000)
    print(f"{printable(path)}: written, for a robot named {name}; edit it, then run: {command}")
    return 0
