"""Command line: the only module that prints or exits.

SymPy and all that needs it are imported by the command that needs them, so that help and refusals
come at once.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
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

_FAMILY = "the paper's family: base arms and links as in its Table 1"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code: 0 done, 1 failed, 2 wrong use or a refused file."""
    parser = _parser()
    options = parser.parse_args(arguments)
    # A derivation makes millions of small objects and hardly any cycles; a command ends soon.
    gc.disable()
    try:
        code: int = options.command(options)
        sys.stdout.flush()
    except RobotFileError as error:
        count = f"{len(error.faults)} faults" if len(error.faults) > 1 else "1 fault"
        print(f"gibbs-codegen: robot file refused, {count}:\n{error}", file=sys.stderr)
        return error.exit_code
    except GibbsCodegenError as error:
        print(f"gibbs-codegen: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("gibbs-codegen: interrupted; nothing was changed", file=sys.stderr)
        return 130
    except OSError as error:
        if not isinstance(error, BrokenPipeError):
            print(f"gibbs-codegen: {error.strerror or error}", file=sys.stderr)
        # The reader has gone or its disk is full: keep Python from trying to flush to it again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    return code


def _parser() -> argparse.ArgumentParser:
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
    parser.add_argument("--rotors", type=int, metavar="N", help=f"with --links: {_FAMILY}")
    parser.add_argument("--links", type=int, metavar="n", help="number of links of the arm")


def _robot_text(options: argparse.Namespace) -> tuple[str, str]:
    """Text of the robot file that the options ask for, and what to call it in messages."""
    from gibbs_codegen.robot_file import read_robot

    if options.robot is not None:
        if options.rotors is not None or options.links is not None:
            raise UsageError("give a robot file, or --rotors and --links, not both")
        return read_robot(options.robot)[1], options.robot
    if options.rotors is None or options.links is None:
        raise UsageError("give a robot file, or both --rotors and --links")
    from gibbs_codegen.family import paper_family
    from gibbs_codegen.robot_text import robot_text

    robot = paper_family(options.rotors, options.links)
    return robot_text(robot), f"--rotors {options.rotors} --links {options.links}"


def _generate(options: argparse.Namespace) -> int:
    text, source = _robot_text(options)
    from gibbs_codegen import pipeline
    from gibbs_codegen.emit import TARGETS

    targets = options.target or list(TARGETS)
    start = time.perf_counter()
    with _progress() as progress:
        if options.check:
            folder, differing = pipeline.check(
                text, Path(options.out), targets, options.all_parameters, progress, source
            )
        else:
            model, folder = pipeline.generate(
                text, Path(options.out), targets, options.all_parameters, progress, source
            )
    if options.check:
        if differing:
            print(
                f"{folder}: differs from what would be written: {', '.join(differing)}",
                file=sys.stderr,
            )
            return 1
        print(f"{folder}: up to date")
        return 0
    from gibbs_codegen.program import count_operations

    nodes = model.program.function("mass_matrix_and_residual").nodes()
    counts = count_operations(nodes)
    print(
        f"{folder}: {len(model.program.functions)} functions of {len(model.program.inputs['q'])} "
        f"coordinates and {len(model.program.inputs['u'])} inputs in "
        f"{time.perf_counter() - start:.1f} s; mass matrix and residual take {counts.total} "
        f"operations and {counts.sine_cosine_pairs} sine-cosine pairs"
    )
    return 0


def _info(options: argparse.Namespace) -> int:
    text, source = _robot_text(options)
    from gibbs_codegen.model import derive
    from gibbs_codegen.robot_file import parse_robot

    with _progress() as progress:
        model = derive(parse_robot(text, source), progress=progress)
    from rich.console import Console

    from gibbs_codegen.report import print_report, report

    if options.json:
        print(json.dumps(report(model), indent=2))
    else:
        print_report(model, Console(width=None if sys.stdout.isatty() else 120, highlight=False))
    return 0


def _new(options: argparse.Namespace) -> int:
    from gibbs_codegen.family import paper_family
    from gibbs_codegen.names import name_fault
    from gibbs_codegen.robot_text import robot_text
    from gibbs_codegen.write import write_new_file

    path = Path(options.file)
    robot = paper_family(6, 3)
    name = robot.name if name_fault(path.stem) else path.stem
    write_new_file(path, robot_text(robot, name))
    print(f"{path}: written; edit it, then run: gibbs-codegen generate {path}")
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
