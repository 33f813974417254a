"""`import`: a robot file from a robot in URDF, xacro, MJCF or SDF, also with arms joined to it."""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.text import Text

from gibbs_codegen.cli.terminal import counted, plain_table, width
from gibbs_codegen.errors import Fault, RobotFileError, UsageError, printable
from gibbs_codegen.exchange.attaching import Attachment, is_robot_file, joined
from gibbs_codegen.exchange.importing import MOST_TOLD, ImportOptions, in_order, opening_comment
from gibbs_codegen.exchange.sources import Finding, SourceFileError
from gibbs_codegen.files.module_writer import write_new_file
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import link_label
from gibbs_codegen.robot.parts.base import ATTITUDES, as_motion, shown_motion
from gibbs_codegen.robot.parts.pose import Pose, vector
from gibbs_codegen.robot.text import robot_text

# Lines of one kind, more than a person will read at a time.
_SHOWN = 50


def run(options: argparse.Namespace) -> int:
    """Write the robot file, and print what was done."""
    attitude = options.attitude or "quaternion"
    if attitude not in ATTITUDES:
        words = f"--attitude must be one of {', '.join(ATTITUDES)}, not {printable(attitude, 40)}"
        raise UsageError(words)
    path = Path(options.file)
    rotors = None if options.rotors is None else Path(options.rotors)
    locks: dict[str, float] = {}
    for word in options.lock:
        name, equals, text = word.rpartition("=")
        if not equals:
            name, text = word, "0"
        try:
            locks[name] = float(text)
        except ValueError:
            locks[name] = math.nan
        if not abs(locks[name]) <= 1e6:
            raise UsageError(
                f"--lock {printable(word, 80)}: give JOINT or JOINT=VALUE, VALUE in rad or m"
            )
    wanted = ImportOptions(attitude, rotors, locks, snap=not options.no_snap)
    for word in options.base:
        motion = as_motion(word)
        is_link = motion is None or wanted.motion is not None
        key, value = ("base", word) if is_link else ("motion", motion)
        if getattr(wanted, key):
            raise UsageError(f"--base {printable(word, 60)}: give at most one link and one motion")
        wanted = replace(wanted, **{key: value})
    wanted = replace(wanted, friction=options.friction, command=options.command or wanted.command)
    pairs = [word.partition(":=") for word in options.arguments]
    for name, sign, value in pairs:
        if not (name and sign):
            word = printable(name + sign + value, 80)
            raise UsageError(f"{word}: after FILE come arguments of xacro as NAME:=VALUE")
    wanted = replace(wanted, arguments={name: value for name, _, value in pairs})
    arms = [_attachment(attachment) for attachment in options.attach or ()]
    if is_robot_file(path):
        _check_robot_file(path, options)
    robot, findings = joined(path, wanted, arms)
    if options.attitude and not robot.base.moves_freely:
        words = "--attitude needs a base that moves freely (--base free)"
        raise UsageError(f"{words}; the motion of this one is {shown_motion(robot.base.motion)}")
    files = " and ".join([path.name, *(arm.file.name for arm in arms)])
    text = opening_comment(files, findings) + robot_text(robot)
    _check(text, robot, findings, options)
    out = Path(options.out or f"{robot.name}.toml")
    write_new_file(out, text, options.force)
    table = plain_table("", "done", "what", "how", show_header=False)
    for kind, group in itertools.groupby(in_order(findings), key=lambda line: line.kind):
        lines = [*group]
        for line, shown in zip(lines[:_SHOWN], (kind, *[""] * _SHOWN), strict=False):
            table.add_row(
                shown, Text(printable(line.subject, 60)), Text(printable(line.detail, MOST_TOLD))
            )
        if len(lines) > _SHOWN:
            table.add_row("", f"and {len(lines) - _SHOWN} more")
    Console(width=width(), highlight=False).print(table)
    print(
        f"{printable(out)}: written, for a robot named {robot.name} with "
        f"{counted(robot.rotors, 'rotor')} and {counted(len(robot.links), 'moving link')}, "
        f"{robot.total_mass:.4g} kg"
    )
    return 0


def _attachment(options: dict[str, Any]) -> Attachment:
    """The arm that --attach and the options after it describe."""
    turns = [Fraction(repr(angle)) for angle in options.get("rpy_deg", (0.0, 0.0, 0.0))]
    pose = Pose(vector(options.get("xyz", (0.0, 0.0, 0.0))), (turns[0], turns[1], turns[2]))
    seat = options.get("on", "base")
    return Attachment(Path(options["attach"]), seat, pose, options.get("prefix", ""))


def _check_robot_file(path: Path, options: argparse.Namespace) -> None:
    """Refuse what is of other formats: a robot file has its attitude, base and rotors."""
    if not options.attach:
        raise UsageError(
            f"{printable(path)}: this is a robot file already; give --attach to attach an arm to it"
        )
    for name in ("rotors", "attitude", "lock", "base", "command", "arguments"):
        if getattr(options, name):
            word = "NAME:=VALUE" if name == "arguments" else f"--{name}"
            raise UsageError(f"{word}: {printable(path)} is a robot file; change the file itself")


def _check(
    text: str, robot: Robot, findings: Sequence[Finding], options: argparse.Namespace
) -> None:
    """Refuse what a robot file must not hold, in terms of the file that is imported.

    Raises `SourceFileError` if the text is no robot file.
    """
    try:
        parse_robot(text)
    except RobotFileError as error:  # Keys and lines of a text that nobody sees help nobody.
        root = next(line.subject for line in findings if line.kind == "base")
        named = {"base": f"link {printable(root, 60)}: "}
        links = range(len(robot.links))
        named |= {f"link[{i}]": f"link {link_label(robot, i + 1)}: " for i in links}
        file = "" if options.rotors is None else f" of {printable(options.rotors)}"
        named |= {f"rotor[{k}]": f"rotor {r.name}{file}: " for k, r in enumerate(robot.thrusters)}
        named |= {f"frame[{k}]": f"frame {f.name}: " for k, f in enumerate(robot.frames)}
        faults: list[Fault] = []
        for fault in error.faults:
            table, dot, key = fault.path.partition(".")
            words = fault.message
            if options.attach and not faults and key in ("name", "coordinate"):
                words += "; --prefix NAME_ after --attach comes before all names of an arm"
            where = named.get(table, table + dot) + key
            faults.append(Fault(where.removesuffix(": "), words))
        raise SourceFileError(options.file, faults) from None
