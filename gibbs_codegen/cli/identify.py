"""`identify`: numbers of a robot file from logs, with a report, and a robot file that has them."""

from __future__ import annotations

import argparse

from gibbs_codegen.cli import robot_argument, terminal
from gibbs_codegen.errors import printable
from gibbs_codegen.files.toml import changes_of
from gibbs_codegen.identification.identify import check_logs, check_new, identify
from gibbs_codegen.runtime.load import load


@terminal.ended_by_signals()
def run(options: argparse.Namespace) -> int:
    """Identify the numbers, write robot file and report, and print the report."""
    names = changes_of(options.name)
    check_new(options.out)
    check_logs(options.logs)
    with (
        robot_argument.found_module(options.robot, terminal.progress()) as (folder, _),
        terminal.progress_bar() as progress,
    ):
        settings = options.free, options.prior, options.hold_out, names, options.between
        identified = identify(load(folder, "c"), options.logs, *settings, progress)
        identified.write(options.out)
    print(
        f"{identified.text()}\n{printable(options.out)}: has {identified.robot}.toml, report.html"
    )
    return 0
