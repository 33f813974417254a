"""`import`: a robot file from a robot in URDF, xacro or MJCF."""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from gibbs_codegen.cli.terminal import Parser
from gibbs_codegen.errors import Fault, RobotFileError, UsageError, printable

if TYPE_CHECKING:
    from gibbs_codegen.exchange.source import Told
    from gibbs_codegen.robot.model import Robot

# Lines of one kind, more than a person will read at a time.
_SHOWN = 50
_OPTIONS = {
    "--rotors": (
        "ROTORS",
        "file that says where the rotors are, in place of those found: [[rotor]] tables in TOML "
        "as in a robot file, `on` a link of FILE; or a platform of eagle_mpc in YAML",
    ),
    "--attitude": (
        "WORD",
        "what describes the attitude of the base: quaternion (default), or a sequence of angles "
        "such as xyz",
    ),
    "--base": ("LINK", "link that is to be the flying base (default: the root of FILE)"),
    "--out": ("ROBOT.toml", "robot file to write (default: the robot's name and .toml)"),
}


def add(commands: argparse._SubParsersAction[Parser]) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "import", help="write a robot file from a robot in URDF, xacro or MJCF"
    )
    parser.add_argument(
        "file",
        metavar="FILE",
        help="a .urdf, .xacro or .xml file; xacro needs the extra xacro, and MJCF the extra mujoco",
    )
    for option, (metavar, meaning) in _OPTIONS.items():
        parser.add_argument(option, metavar=metavar, help=meaning)
    parser.add_argument(
        "--lock",
        action="append",
        default=[],
        metavar="JOINT[=VALUE]",
        help="hold a joint fast, at 0 or at VALUE in rad or m; may be repeated",
    )
    parser.add_argument(
        "--no-snap",
        action="store_true",
        help="keep angles as they are, even within 2e-5 rad of a multiple of 15 degrees, and "
        "numbers that are rounding",
    )
    parser.add_argument("--force", action="store_true", help="replace ROBOT.toml if it exists")
    parser.set_defaults(command=_import)


def _import(options: argparse.Namespace) -> int:
    from pathlib import Path

    from gibbs_codegen.exchange.importing import ImportOptions, import_robot, opening_comment
    from gibbs_codegen.files.module_writer import write_new_file
    from gibbs_codegen.robot.model import ATTITUDES
    from gibbs_codegen.robot.text import robot_text

    attitude = options.attitude or "quaternion"
    if attitude not in ATTITUDES:
        words = f"--attitude must be one of {', '.join(ATTITUDES)}, not {printable(attitude, 40)}"
        raise UsageError(words)
    path = Path(options.file)
    asked = ImportOptions(
        attitude,
        None if options.rotors is None else Path(options.rotors),
        _locked(options.lock),
        options.base,
        not options.no_snap,
    )
    robot, told = import_robot(path, asked)
    text = opening_comment(path.name, told) + robot_text(robot)
    _check(text, robot, told, options)
    out = Path(options.out or f"{robot.name}.toml")
    write_new_file(out, text, options.force)
    _print_report(told)
    print(
        f"{printable(out)}: written, for a robot named {robot.name} with {robot.rotors} rotors and "
        f"{len(robot.links)} moving links, {robot.total_mass:.4g} kg"
    )
    return 0


def _check(text: str, robot: Robot, told: Sequence[Told], options: argparse.Namespace) -> None:
    """Refuse what a robot file must not hold, in terms of the file that is imported.

    Raises `SourceFileError` if the text is no robot file.
    """
    from gibbs_codegen.exchange.source import SourceFileError
    from gibbs_codegen.robot.file import parse_robot

    try:
        parse_robot(text)
    except RobotFileError as error:  # Keys and lines of a text that nobody sees help nobody.
        root = next(line.subject for line in told if line.kind == "base")
        named = {"base": f"link {printable(root, 60)}: "}
        named |= {f"link[{i}]": f"link {link.name}: " for i, link in enumerate(robot.links)}
        given = "" if options.rotors is None else f" of {printable(options.rotors)}"
        named |= {f"rotor[{k}]": f"rotor {r.name}{given}: " for k, r in enumerate(robot.thrusters)}
        named |= {f"frame[{k}]": f"frame {f.name}: " for k, f in enumerate(robot.frames)}
        faults = []
        for fault in error.faults:
            table, dot, key = fault.path.partition(".")
            faults.append(Fault(named.get(table, table + dot) + key, fault.message))
        raise SourceFileError(options.file, faults) from None


def _locked(words: Sequence[str]) -> dict[str, float]:
    """Where joints are to be locked, by name."""
    values = {}
    for word in words:
        name, equals, text = word.rpartition("=")
        if not equals:
            name, text = word, "0"
        try:
            values[name] = float(text)
        except ValueError:
            values[name] = math.nan
        if not abs(values[name]) <= 1e6:
            raise UsageError(
                f"--lock {printable(word, 80)}: give JOINT or JOINT=VALUE, VALUE in rad or m"
            )
    return values


def _print_report(told: Sequence[Told]) -> None:
    """Print what was done as a table."""
    from rich.console import Console
    from rich.text import Text

    from gibbs_codegen.cli.terminal import plain_table, width
    from gibbs_codegen.exchange.importing import in_order

    table = plain_table("", "done", "what", "how", show_header=False)
    for kind, found in itertools.groupby(in_order(told), key=lambda line: line.kind):
        lines = [*found]
        for line, shown in zip(lines[:_SHOWN], (kind, *[""] * _SHOWN), strict=False):
            table.add_row(shown, Text(printable(line.subject, 60)), Text(printable(line.detail)))
        if len(lines) > _SHOWN:
            table.add_row("", f"and {len(lines) - _SHOWN} more")
    Console(width=width(), highlight=False).print(table)
