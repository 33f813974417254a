"""`schema`: the JSON schema of a kind of file, for editors."""

from __future__ import annotations

import argparse

from gibbs_codegen.cli.terminal import Parser


def add(commands: argparse._SubParsersAction[Parser]) -> None:
    """Add the command to the parser."""
    schema = commands.add_parser(
        "schema",
        help="print the JSON schema of robot or scenario files, with which editors complete keys",
    )
    schema.add_argument(
        "file", choices=("robot", "scenario"), help="kind of file that the schema is for"
    )
    schema.set_defaults(command=_schema)


def _schema(options: argparse.Namespace) -> int:
    # Late, so that help is fast.
    import json

    from gibbs_codegen.flight.scenario.file import ScenarioTable
    from gibbs_codegen.robot.tables import RobotTable

    table = RobotTable if options.file == "robot" else ScenarioTable
    print(json.dumps(table.json_schema(), indent=2))
    return 0
