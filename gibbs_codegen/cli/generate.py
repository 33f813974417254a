"""`generate`: derive a robot's equations and write its module."""

from __future__ import annotations

import argparse
import sys
import time
from typing import TYPE_CHECKING

from gibbs_codegen.cli import robot_argument, terminal
from gibbs_codegen.cli.terminal import Parser
from gibbs_codegen.errors import printable

if TYPE_CHECKING:
    from pathlib import Path

    from gibbs_codegen.program.model import Derivatives
    from gibbs_codegen.robot.model import Robot

_FLAGS = {
    "--check": "write nothing, and exit with 1 if the module on disk differs from what would be "
    "written",
    "--force": "if the module's folder holds files that were not generated, or were changed since, "
    "keep it under another name instead of refusing",
    "--all-parameters": "keep parameters that are zero in the robot file, so that they can be "
    "changed at run time",
    "--no-verify": "write the module without checking its functions first",
}


def add(commands: argparse._SubParsersAction[Parser]) -> None:
    """Add the command to the parser."""
    generate = commands.add_parser(
        "generate",
        help="derive a robot's equations of motion and write its module",
    )
    robot_argument.add_robot(generate)
    generate.add_argument(
        "--target",
        action="append",
        metavar="TARGET",
        help="a target to emit: numpy, c, matlab, or acados, which needs c; "
        "may be repeated (default: numpy and c)",
    )
    generate.add_argument(
        "--out",
        default="generated",
        metavar="DIR",
        help="folder in which modules are written (default: generated)",
    )
    for flag, meaning in _FLAGS.items():
        generate.add_argument(flag, action="store_true", help=meaning)
    robot_argument.add_derivatives(generate, "emit {which}, too")
    generate.set_defaults(command=_generate)


def _generate(options: argparse.Namespace) -> int:
    robot, text = robot_argument.chosen_robot(options)
    from gibbs_codegen import pipeline
    from gibbs_codegen.program.nodes import count_operations
    from gibbs_codegen.targets.registry import DEFAULT_TARGETS

    what = robot, text, options.out, options.target or DEFAULT_TARGETS, options.all_parameters
    if options.check:
        with terminal.progress() as progress:
            found = pipeline.check_robot(*what, progress, options.derivatives)
        return _report_check(*found, options.derivatives)
    start = time.perf_counter()
    with terminal.progress() as progress:
        model, folder = pipeline.generate_robot(
            *what, progress, not options.no_verify, options.force, options.derivatives
        )
    counts = count_operations(model.program.function("mass_matrix_and_residual").nodes())
    print(
        f"{printable(folder)}: {len(model.signatures)} functions of "
        f"{len(model.program.inputs['q'])} coordinates and {len(model.program.inputs['u'])} inputs "
        f"in {time.perf_counter() - start:.1f} s; mass matrix and residual take {counts.total} "
        f"operations and {counts.sine_cosine_pairs} sine-cosine pairs"
    )
    _print_balance(robot)
    return 0


def _print_balance(robot: Robot) -> None:
    """Print how the base is balanced, and a warning if it is lopsided."""
    import textwrap

    from gibbs_codegen.robot.balance import balance_lines, lopsided

    for line in balance_lines(robot):
        print(textwrap.fill(line, terminal.width(), subsequent_indent="  "))
    if warning := lopsided(robot):
        print(f"gibbs-codegen: warning: {warning}", file=sys.stderr)


def _report_check(folder: Path, differing: list[str], asked: Derivatives) -> int:
    """Print what a check found; return the exit code.

    `differing` are the names of the files that differ, and `asked` what --derivatives asks for.
    """
    if not differing:
        print(f"{printable(folder)}: up to date")
        return 0
    from gibbs_codegen.derivation.functions import chosen_derivatives

    what = "differs from what would be written" if folder.is_dir() else "is not there yet"
    listed = printable(", ".join(differing))
    had = robot_argument.derivatives_of(str(folder)) if folder.is_dir() else ()
    other = folder.is_dir() and had != chosen_derivatives(asked)
    option = f"with --derivatives={','.join(had)}" if had else "without --derivatives"
    made = f"; it was generated {option}" if other else ""
    print(f"{printable(folder)}: {what}: {listed}{made}", file=sys.stderr)
    return 1
