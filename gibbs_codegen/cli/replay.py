"""`replay`: a log of ROS 2 or PX4 as a flight."""

from __future__ import annotations

import argparse

from gibbs_codegen.cli import robot_argument, terminal
from gibbs_codegen.cli.simulate import estimation
from gibbs_codegen.errors import printable
from gibbs_codegen.files.toml import changes_of
from gibbs_codegen.flight.figures.results import check_results, write_results
from gibbs_codegen.flight.logs.log import read_log, require_log
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.machine.filters import CALLED
from gibbs_codegen.runtime.load import load


@terminal.ended_by_signals()
def run(options: argparse.Namespace) -> int:
    """Write the results, and print the contents of the log."""
    names = changes_of(options.name)
    check_results(options.out)
    require_log(options.log)
    scenario = None if options.estimate is None else read_scenario(options.estimate)
    derivatives = CALLED if scenario else ()
    with (
        robot_argument.found_module(options.robot, terminal.progress(), derivatives) as (folder, _),
        terminal.progress_bar() as progress,
    ):
        module = load(folder, "c" if scenario else "numpy")
        request = options.log, names, options.rate, options.cutoff, scenario
        flight = read_log(module, *request)
        write_results(flight, options.out, progress=progress, formats=options.format)
    samples = f"{len(flight.time)} samples of {flight.time[-1]:.4g} s"
    print(f"{printable(options.out)}: {flight.robot}, {samples}, by {flight.scenario}")
    if scenario:
        print(estimation(flight))
    return 0
