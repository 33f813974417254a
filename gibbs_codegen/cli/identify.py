"""`identify`: numbers of a robot file from logs, with a report, and a robot file that has them.

With `--design` a scenario whose motion will tell them.
"""

from __future__ import annotations

import argparse
import math
import shlex
import sys

from gibbs_codegen.cli import robot_argument, terminal
from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.files.staging import check_new
from gibbs_codegen.files.toml import changes_of
from gibbs_codegen.flight.plant.vehicle import RobotData
from gibbs_codegen.identification.design import Design, design
from gibbs_codegen.identification.identify import Identified, check_given, identify
from gibbs_codegen.identification.unknowns import PRIOR, Unknowns
from gibbs_codegen.runtime.load import load


@terminal.ended_by_signals()
def run(options: argparse.Namespace) -> int:
    """Identify the numbers, write robot file and report, and print the report; or design."""
    names, place = changes_of(options.name), options.design or options.out or "identified"
    check_new(place)
    between = options.between or (0.0, math.inf)
    check_given(options.logs, options.hold_out, between)
    prior = {"*": PRIOR} | dict(options.prior)
    if bool(options.logs) == bool(options.design):
        raise UsageError("give LOG, or --design FILE for a motion to fly, and not both")
    others = ("scenario", "room") if options.logs else ("out", "hold_out", "between", "name")
    if given := [f"--{key.replace('_', '-')}" for key in others if vars(options)[key]]:
        kind = "LOG" if options.logs else "--design"
        raise UsageError(f"{', '.join(given)}: does not go with {kind}; leave out one of them")
    # What a load changes, and places of frames, may be 0 in the file.
    zero = any(pattern.startswith(("payload.", "frame_")) for pattern in options.free)

    def check(robot: RobotData) -> None:
        """Raise `UsageError` for names that the robot does not have, before it is derived."""
        if not hasattr(robot.module, "PARAMETERS"):
            from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
            from gibbs_codegen.symbolic.tape import Tape

            source, _ = robot_argument.find_robot(options.robot)
            symbols = SymbolicRobot.of(source, Tape(), zero)  # With those of actuators.
            vars(robot.module).update(PARAMETERS=symbols.parameters.defaults)
        Unknowns(robot.module, options.free, prior)

    found = robot_argument.found_module(
        options.robot, terminal.progress(), check=check, keep_zeros=zero
    )
    with found as (folder, _), terminal.progress_bar() as progress:
        module, free = load(folder, "c"), options.free
        if options.design:
            limits = options.scenario, options.room or 1.0
            made: Design | Identified = design(module, free, *limits, prior, progress=progress)
            words = ["gibbs-codegen", "simulate", options.robot, "--scenario", str(place)]
            has, whole = f"fly it with `{printable(shlex.join(words), 4000)}`", True
        else:
            settings = free, prior, options.hold_out, names, between
            made = identify(module, options.logs, *settings, progress)
            whole = bool(made.robot_file)
            has = f"has {module.NAME}.toml, report.html" if whole else "has report.html alone"
        made.write(place)
    print(f"{made.text()}\n{printable(place)}: {has}")
    if not whole:
        fault = made.text().splitlines()[0]
        print(f"{fault}; the report begins with what to do", file=sys.stderr)
    return int(not whole)
