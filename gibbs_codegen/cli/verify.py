"""`verify`: compare a module with formulations that share no code with the derivation."""

from __future__ import annotations

import argparse
import os
import sys
from typing import TYPE_CHECKING

from gibbs_codegen.cli import robot_argument, terminal
from gibbs_codegen.cli.terminal import Parser
from gibbs_codegen.errors import printable

if TYPE_CHECKING:
    from pathlib import Path

    from gibbs_codegen.verification.verify import Verification


def add(commands: argparse._SubParsersAction[Parser]) -> None:
    """Add the command to the parser."""
    verify = commands.add_parser(
        "verify",
        help="compare a module with formulations that share no code with the derivation",
    )
    robot_argument.add_module(verify)
    verify.add_argument(
        "--states",
        type=int,
        default=20,
        metavar="K",
        help="number of random states to compare at (default: 20)",
    )
    verify.add_argument("--seed", type=int, default=0, help="seed of the states (default: 0)")
    verify.add_argument(
        "--backend",
        choices=("numpy", "c"),
        action="append",
        help="a back end to verify; may be repeated (default: both)",
    )
    verify.add_argument("--json", action="store_true", help="print JSON instead of tables")
    verify.set_defaults(command=_verify)


def _verify(options: argparse.Namespace) -> int:
    with (
        terminal.ended_by_signals(),
        robot_argument.found_module(options.robot, terminal.progress()) as (folder, kept),
    ):
        return _verify_folder(options, folder, kept)


def _verify_folder(options: argparse.Namespace, folder: Path, kept: bool) -> int:
    """Verify a module, print what was found, and return the exit code.

    `kept` is whether the module stays when the command has ended.
    """
    from gibbs_codegen.cli.verify_report import as_data, failure_lines
    from gibbs_codegen.verification.modules import verify

    backends = options.backend or ["numpy", "c"]
    with terminal.progress() as progress:
        found = verify(folder, options.states, options.seed, backends, progress)
    lacking = [backend for backend in options.backend or () if backend not in found.comparisons]
    passed = found.passed and not lacking
    if options.json:
        import json

        print(json.dumps(as_data(found) | {"passed": passed}, indent=2))
    else:
        _print_found(found, passed, folder if kept else None)
    if passed:
        return 0

    lines = [f"back end {b} was asked for: {found.not_done[f'back end {b}']}" for b in lacking]
    if found.failures:
        lines.append(f"{len(found.failures)} of {found.count} comparisons failed:")
        lines += failure_lines(found)
    elif not lacking:
        lines.append("nothing could be compared")
    print(f"gibbs-codegen: {found.robot}: " + "\n".join(lines), file=sys.stderr)
    return 1


def _print_found(found: Verification, passed: bool, folder: Path | None) -> None:
    """Print the tables, and a line if all is well.

    `passed` is whether it passed, and was made of all back ends that were asked for; `folder` is
    None if the module was generated for this and is not kept.
    """
    from rich.console import Console

    from gibbs_codegen.cli.verify_report import print_verification

    width = terminal.width()
    print_verification(found, Console(width=width, highlight=False, soft_wrap=False))
    if passed:
        verdict = f": all {found.count} comparisons within their limits"
        name = found.robot
        if folder is not None:
            name = min(str(folder), os.path.relpath(folder), key=len)
        print(printable(name, max(width - len(verdict), 16)) + verdict)
        if folder is None:
            print("(the module was generated for this and is not kept)")
