"""Command line: the only module that prints or exits.

SymPy and all that needs it are imported by the command that needs them, so that help and refusals
come at once.
"""

from __future__ import annotations

import argparse
import gc
import io
import json
import os
import shlex
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from gibbs_codegen.errors import GibbsCodegenError, RobotFileError, UsageError
from gibbs_codegen.version import __version__

if TYPE_CHECKING:
    from gibbs_codegen.model import Progress
    from gibbs_codegen.robot import Robot

_FAMILY = "the paper's family: base arms and links as in its Table 1"


def console() -> int:
    """Entry point of the `gibbs-codegen` command: `main`, and what becomes of its output."""
    # A stream that was closed before the start is None: what is written there goes nowhere.
    nowhere = open(os.devnull, "w")  # noqa: SIM115 - it lives as long as the process
    sys.stdout, sys.stderr = sys.stdout or nowhere, sys.stderr or nowhere
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # A terminal that lacks a letter shows its code.
            stream.reconfigure(errors="backslashreplace")
    # A derivation makes millions of small objects and hardly any cycles, and the process ends soon.
    gc.disable()
    try:
        code = main()
        sys.stdout.flush()
    except OSError as error:
        if not isinstance(error, BrokenPipeError):
            print(f"gibbs-codegen: output: {error.strerror or error}", file=sys.stderr)
        # The reader has gone or its disk is full: keep Python from trying to flush to it again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    return code


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code: 0 done, 1 failed, 2 wrong use or a refused file."""
    options = argument_parser().parse_args(arguments)
    try:
        code: int = options.command(options)
    except RobotFileError as error:
        count = f"{len(error.faults)} faults" if len(error.faults) > 1 else "1 fault"
        print(f"gibbs-codegen: robot file refused, {count}:\n{error}", file=sys.stderr)
        return error.exit_code
    except GibbsCodegenError as error:
        print(f"gibbs-codegen: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("gibbs-codegen: interrupted", file=sys.stderr)
        return 130
    return code


def argument_parser() -> argparse.ArgumentParser:
    """Parser of the command line; `command` of what it returns runs the command."""
    parser = argparse.ArgumentParser(
        prog="gibbs-codegen",
        description="Derive the dynamics of an aerial manipulator and emit them as fast functions.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"gibbs_codegen {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    generate = commands.add_parser(
        "generate", help="derive a robot's equations and write its module", allow_abbrev=False
    )
    _add_robot(generate)
    generate.add_argument(
        "--target",
        action="append",
        metavar="TARGET",
        help="what to emit; may be repeated (default: every target)",
    )
    generate.add_argument(
        "--out", default="generated", metavar="DIR", help="folder of modules (default: generated)"
    )
    generate.add_argument(
        "--check",
        action="store_true",
        help="write nothing; exit 1 where the module on disk differs from what would be written",
    )
    generate.add_argument(
        "--all-parameters",
        action="store_true",
        help="keep parameters that are zero in the robot file",
    )
    generate.set_defaults(command=_generate)

    info = commands.add_parser(
        "info", help="show chains, coordinates, motors and operation counts", allow_abbrev=False
    )
    _add_robot(info)
    info.add_argument("--json", action="store_true", help="the same for machines")
    info.set_defaults(command=_info)

    new = commands.add_parser(
        "new", help="write a commented robot file to start from", allow_abbrev=False
    )
    new.add_argument("file", metavar="ROBOT.toml", help="file to write; it must not exist yet")
    new.set_defaults(command=_new)
    return parser


def _add_robot(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "robot",
        nargs="?",
        metavar="ROBOT.toml",
        help="robot file, or the name of a robot that ships with the package",
    )
    parser.add_argument(
        "--rotors", type=int, metavar="N", help=f"with --links: {_FAMILY}; 2 to 256 rotors"
    )
    parser.add_argument("--links", type=int, metavar="n", help="links of the arm, 0 to 64")


def _robot(options: argparse.Namespace) -> tuple[Robot, str]:
    """The robot that the options ask for, and the text of its file."""
    from gibbs_codegen.robot_file import read_robot

    if options.robot is not None:
        if options.rotors is not None or options.links is not None:
            raise UsageError("give a robot file, or --rotors and --links, not both")
        return read_robot(options.robot)
    if options.rotors is None or options.links is None:
        raise UsageError("give a robot file, or both --rotors and --links")
    from gibbs_codegen.family import paper_family
    from gibbs_codegen.robot_text import robot_text

    robot = paper_family(options.rotors, options.links)
    return robot, robot_text(robot)


def _generate(options: argparse.Namespace) -> int:
    robot, text = _robot(options)
    from gibbs_codegen import pipeline
    from gibbs_codegen.emit import TARGETS
    from gibbs_codegen.program import count_operations

    targets = options.target or list(TARGETS)
    if options.check:
        with _progress() as progress:
            folder, differing = pipeline.check_robot(
                robot, text, options.out, targets, options.all_parameters, progress
            )
        return _report_check(folder, differing)
    start = time.perf_counter()
    with _progress() as progress:
        model, folder = pipeline.generate_robot(
            robot, text, options.out, targets, options.all_parameters, progress
        )
    counts = count_operations(model.program.function("mass_matrix_and_residual").nodes())
    print(
        f"{folder}: {len(model.program.functions)} functions of {len(model.program.inputs['q'])} "
        f"coordinates and {len(model.program.inputs['u'])} inputs in "
        f"{time.perf_counter() - start:.1f} s; mass matrix and residual take {counts.total} "
        f"operations and {counts.sine_cosine_pairs} sine-cosine pairs"
    )
    return 0


def _report_check(folder: Path, differing: list[str]) -> int:
    if not differing:
        print(f"{folder}: up to date")
        return 0
    what = "differs from what would be written" if folder.is_dir() else "is not there yet"
    print(f"{folder}: {what}: {', '.join(differing)}", file=sys.stderr)
    return 1


def _info(options: argparse.Namespace) -> int:
    robot, _ = _robot(options)
    from gibbs_codegen.model import derive

    with _progress() as progress:
        model = derive(robot, progress=progress)
    from rich.console import Console

    from gibbs_codegen.report import print_report, report

    if options.json:
        print(json.dumps(report(model), indent=2))
    else:
        print_report(model, Console(width=None if sys.stdout.isatty() else 120, highlight=False))
    return 0


def _new(options: argparse.Namespace) -> int:
    from gibbs_codegen.family import paper_family
    from gibbs_codegen.names import name_from
    from gibbs_codegen.robot_text import robot_text
    from gibbs_codegen.write import write_new_file

    path = Path(options.file)
    name = name_from(path.stem)
    write_new_file(path, robot_text(paper_family(6, 3), name))
    command = shlex.join(["gibbs-codegen", "generate", str(path)])
    print(f"{path}: written, for a robot named {name}; edit it, then run: {command}")
    return 0


@contextmanager
def _progress() -> Iterator[Progress]:
    """A spinner that names the step at work, on a terminal; nothing in a pipe."""
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console

    with Console(stderr=True).status("starting") as status:
        yield lambda step: status.update(step)
