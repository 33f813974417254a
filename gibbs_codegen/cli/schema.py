"""`schema`: the JSON schema of a kind of file, for editors."""

from __future__ import annotations

import argparse
import json

from gibbs_codegen.files.table import json_schema
from gibbs_codegen.flight.scenario.file import ScenarioTable
from gibbs_codegen.robot.tables import RobotTable


def run(options: argparse.Namespace) -> int:
    """Print the schema."""
    table = RobotTable if options.file == "robot" else ScenarioTable
    print(json.dumps(json_schema(table), indent=2))
    return 0
