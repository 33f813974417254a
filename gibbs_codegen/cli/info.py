"""`info`: a robot's base, chains, coordinates, motors and operation counts."""

from __future__ import annotations

import argparse

from gibbs_codegen.cli import robot_argument, terminal
from gibbs_codegen.cli.terminal import Parser


def add(commands: argparse._SubParsersAction[Parser]) -> None:
    """Add the command to the parser."""
    info = commands.add_parser(
        "info",
        help="show a robot's base, chains, coordinates, motors and operation counts",
    )
    robot_argument.add_robot(info)
    info.add_argument("--json", action="store_true", help="print JSON instead of tables")
    robot_argument.add_derivatives(
        info, "count the operations of {which}, too; of a module, those that it has are counted"
    )
    info.set_defaults(command=_info)


def _info(options: argparse.Namespace) -> int:
    import json

    robot, _ = robot_argument.chosen_robot(options)
    from gibbs_codegen.derivation.derive import derive

    derivatives = options.derivatives or robot_argument.derivatives_of(options.robot)
    with terminal.progress() as progress:
        model = derive(robot, progress=progress, derivatives=derivatives)

    from rich.console import Console

    from gibbs_codegen.cli.info_report import print_report, report

    if options.json:
        print(json.dumps(report(model), indent=2))
    else:
        print_report(model, Console(width=terminal.width(elsewhere=100), highlight=False))
    return 0
