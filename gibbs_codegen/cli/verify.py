"""`verify`: a module against formulations that share no code with the derivation."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from gibbs_codegen.cli import robot_argument, terminal
from gibbs_codegen.cli.terminal import Parser
from gibbs_codegen.errors import printable


def add(commands: argparse._SubParsersAction[Parser]) -> None:
    """Add the command to the parser."""
    verify = commands.add_parser(
        "verify",
        help="check a module against formulations that share no code with the derivation",
        allow_abbrev=False,
    )
    robot_argument.add_module(verify)
    verify.add_argument(
        "--states", type=int, default=20, metavar="K", help="random states (default: 20)"
    )
    verify.add_argument("--seed", type=int, default=0, help="of the states (default: 0)")
    verify.add_argument(
        "--backend",
        choices=("numpy", "c"),
        action="append",
        help="what to check; may be repeated (default: both)",
    )
    verify.add_argument("--json", action="store_true", help="print JSON")
    verify.set_defaults(command=_verify)


def _verify(options: argparse.Namespace) -> int:
    with (
        terminal.ended_by_signals(),
        robot_argument.found_module(options.robot, terminal.progress()) as (folder, kept),
    ):
        return _verify_folder(options, folder, kept)


def _verify_folder(options: argparse.Namespace, folder: Path, kept: bool) -> int:
    from rich.console import Console

    from gibbs_codegen.cli.verify_report import as_data, failure_lines, print_verification
    from gibbs_codegen.verification.modules import verify

    backends = options.backend or ["numpy", "c"]
    with terminal.progress() as progress:
        found = verify(folder, options.states, options.seed, backends, progress)
    lacking = [backend for backend in options.backend or () if backend not in found.comparisons]
    passed = found.passed and not lacking
    if options.json:
        print(json.dumps(as_data(found) | {"passed": passed}, indent=2))
    else:
        print_verification(found, Console(width=terminal.width(), highlight=False, soft_wrap=False))
        name = printable(folder) if kept else f"{found.robot}, made for this and not kept"
        if passed:
            print(f"{name}: all {found.count} comparisons within their limits")
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
