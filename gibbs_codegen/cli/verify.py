"""`verify`: compare a module with formulations that share no code with the derivation."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import textwrap
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from rich.console import Console
from rich.text import Text

from gibbs_codegen.cli import robot_argument, terminal
from gibbs_codegen.cli.terminal import plain_table
from gibbs_codegen.errors import printable
from gibbs_codegen.verification.comparison import Comparison, failure_text, shown
from gibbs_codegen.verification.modules import verify
from gibbs_codegen.verification.verify import Verification

# Longer, a list of failures is not read.
_MOST_FAILURES = 12


def run(options: argparse.Namespace) -> int:
    """Verify the module, and print what was found."""
    module = robot_argument.found_module(options.robot, terminal.progress())
    with terminal.ended_by_signals(), module as (folder, is_kept):
        with terminal.progress("checking the functions of the module") as progress:
            backends = options.backend or ["numpy", "c"]
            checked = verify(folder, options.states, options.seed, backends, progress)
        lacking = [b for b in options.backend or () if b not in checked.comparisons]
        passed = checked.passed and not lacking
        if options.json:
            print(json.dumps(as_data(checked) | {"passed": passed}, indent=2))
        else:
            width = terminal.width()
            print_verification(checked, Console(width=width, highlight=False, soft_wrap=False))
            if passed:
                name = min(str(folder), os.path.relpath(folder), key=len)
                verdict = f": all {checked.count} comparisons within their limits"
                shortened = printable(
                    name if is_kept else checked.robot, max(width - len(verdict), 16)
                )
                print(shortened + verdict)
            if passed and not is_kept:
                print("(the module was generated for this check and is not kept)")
    if passed:
        return 0
    lines = [f"back end {b} was asked for: {checked.not_done[f'back end {b}']}" for b in lacking]
    if checked.failures:
        lines.append(f"{len(checked.failures)} of {checked.count} comparisons failed:")
        lines += failure_lines(checked)
    elif not lacking:
        lines.append("nothing could be compared")
    print(f"gibbs-codegen: {checked.robot}: " + "\n".join(lines), file=sys.stderr)
    return 1


def as_data(verification: Verification) -> dict[str, Any]:
    """Everything that `verify` found in values that JSON can hold; what is not a number is null."""
    return {
        "robot": verification.robot,
        "seed": verification.seed,
        "passed": verification.passed,
        "comparisons": verification.count,
        "failures": len(verification.failures),
        "not_done": verification.not_done,
        "backends": {
            backend: [
                asdict(c)
                | {"error": c.error if math.isfinite(c.error) else None}
                | {"passed": c.passed}
                for c in comparisons
            ]
            for backend, comparisons in verification.comparisons.items()
        },
    }


def print_verification(verification: Verification, console: Console) -> None:
    """Print the largest errors: for each back end functions by formulations, then the rest."""
    for backend, comparisons in verification.comparisons.items():
        columns: Columns = {}
        for comparison in comparisons:
            columns.setdefault(comparison.against, {})[comparison.what] = comparison
        # Columns of their own for what many functions are compared with; the rest in lines.
        wide = {
            against: rows
            for against, rows in columns.items()
            if len(rows) > 6 and any(c.states for c in rows.values())
        }
        others = [c for c in comparisons if c.against not in wide]
        title = f"{backend}: largest relative error of each function against what a column names"
        for some in _fitting(wide, console.width):
            table = plain_table(title, padding=(0, 2, 0, 0))
            table.add_column("function", no_wrap=True, vertical="bottom")
            for against in some:
                table.add_column(
                    _heading(against), justify="right", no_wrap=True, vertical="bottom"
                )
            functions = list(dict.fromkeys(what for rows in some.values() for what in rows))
            for function in functions:
                table.add_row(function, *(_cell(rows.get(function)) for rows in some.values()))
            limits = [f"{max(c.limit for c in rows.values()):.2g}" for rows in some.values()]
            counts = [str(max(c.states for c in rows.values())) for rows in some.values()]
            table.add_row("limit", *limits, style="dim")
            table.add_row("states", *counts, style="dim")
            console.print(table)
            console.print()
            title = f"{backend}: against what further columns name"
        if others:
            table = plain_table(f"{backend}: other comparisons")
            table.add_column("what", no_wrap=True)
            table.add_column("against", overflow="fold")
            for column in ("states", "error", "limit"):
                table.add_column(column, justify="right")
            for c in others:
                limit = "exact" if c.limit == 0.0 else shown(c)[1]
                states = str(c.states) if c.states else "-"
                table.add_row(Text(c.what), Text(c.against), states, _cell(c), limit)
                if c.fault:
                    table.add_row("", Text(c.fault, style="red"))
            console.print(table)
            console.print()
    for what, reason in verification.not_done.items():
        console.print(Text(f"{what}: not compared: {reason}"))


def failure_lines(verification: Verification) -> list[str]:
    """A line for each comparison that failed, the worst first; the last counts those left out."""
    failures = sorted(verification.failures, key=lambda f: -f[1].error)
    lines = [f"{backend}: {failure_text(c)}" for backend, c in failures[:_MOST_FAILURES]]
    if len(failures) > _MOST_FAILURES:
        lines.append(f"and {len(failures) - _MOST_FAILURES} more")
    return lines


Columns = dict[str, dict[str, Comparison]]


def _fitting(columns: Columns, width: int) -> Iterator[Columns]:
    """The columns shared among tables that are no wider than the terminal, one column at least."""
    functions = {what for rows in columns.values() for what in rows}
    room = width - max(map(len, functions), default=0)
    some: Columns = {}
    left = room
    for against, rows in columns.items():
        cells = [_cell(comparison).plain for comparison in rows.values()]
        needed = 2 + max(map(len, [*_heading(against).split("\n"), *cells]))
        if some and needed > left:
            yield some
            some, left = {}, room
        some[against] = rows
        left -= needed
    if some:
        yield some


def _heading(against: str) -> str:
    """A heading in short lines."""
    return textwrap.fill(against, 12, break_long_words=False)


def _cell(comparison: Comparison | None) -> Text:
    if comparison is None:
        return Text("-", style="dim")
    if comparison.passed:
        return Text(f"{comparison.error:.1e}" if comparison.error else "0")
    error, limit = shown(comparison)
    number = f"{error} > {limit}" if math.isfinite(comparison.error) else ""
    # The word too, for a pipe has no colours.
    return Text(f"FAILS {number}".strip(), style="bold red")
