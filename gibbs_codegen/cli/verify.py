"""`verify`: compare a module with formulations that share no code with the derivation."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from dataclasses import asdict
from typing import Any

from gibbs_codegen.cli import robot_argument, terminal
from gibbs_codegen.errors import printable
from gibbs_codegen.verification.comparison import Comparison, failure_text, shown
from gibbs_codegen.verification.modules import verify
from gibbs_codegen.verification.verify import Verification

# The least number of comparisons with one thing that has a line of its own.
_FEWEST = 7
# Longer, a list of failures is not read.
_MOST_FAILURES = 12


def run(options: argparse.Namespace) -> int:
    """Verify the module, and print what was found."""
    module = robot_argument.found_module(options.robot, terminal.progress())
    with terminal.ended_by_signals(), module as (folder, is_kept):
        with terminal.progress("checking the functions of the module") as progress:
            backends = options.backend or ["numpy", "c"]
            start = time.monotonic()
            checked = verify(folder, options.states, options.seed, backends, progress)
            seconds = time.monotonic() - start
        lacking = [b for b in options.backend or () if b not in checked.comparisons]
        passed = checked.passed and not lacking
        if options.json:
            print(json.dumps(as_data(checked) | {"passed": passed}, indent=2))
        else:
            lines = summary(checked)
            if options.rows:
                found = checked.comparisons.items()
                lines = [f"{x}: {failure_text(row)}" for x, rows in found for row in rows]
            print("\n".join(lines))
            for what, reason in checked.not_done.items():
                print(f"{what}: not compared: {reason}")
            if passed:
                name = min(str(folder), os.path.relpath(folder), key=len)
                verdict = f": all {checked.count} comparisons within their limits, {seconds:.0f} s"
                print(printable(name if is_kept else checked.robot, 80) + verdict)
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
                | {"error": c.error if math.isfinite(c.error) else None, "passed": c.passed}
                for c in comparisons
            ]
            for backend, comparisons in verification.comparisons.items()
        },
    }


def summary(verification: Verification) -> list[str]:
    """A line for each thing that is compared with: of its results the one nearest to its limit."""
    kinds: dict[str, list[Comparison]] = {}
    for rows in verification.comparisons.values():
        for comparison in rows:
            kinds.setdefault(comparison.against, []).append(comparison)
    if few := [kind for kind, rows in kinds.items() if len(rows) < _FEWEST]:
        kinds["others"] = [comparison for kind in few for comparison in kinds.pop(kind)]
    width = max(map(len, kinds), default=0)
    lines = [f"{'compared with':{width}}  results  states  worst error    limit"]
    for kind, rows in kinds.items():
        worst = max(rows, key=lambda x: (not x.passed, x.error / (x.limit or 1.0)))
        error, limit = shown(worst)
        words = f"{limit if worst.limit else 'equal':>7}{'' if worst.passed else '  FAILS'}"
        states = max(x.states for x in rows) or "-"
        lines.append(f"{kind:{width}}  {len(rows):7}  {states:>6}  {error:>11}  {words}")
    return [*lines, "Errors are shares of the terms of which a result is the sum."]


def failure_lines(verification: Verification) -> list[str]:
    """A line for each comparison that failed, the worst first; the last counts those left out."""
    failures = sorted(verification.failures, key=lambda f: -f[1].error)
    lines = [f"{backend}: {failure_text(c)}" for backend, c in failures[:_MOST_FAILURES]]
    if len(failures) > _MOST_FAILURES:
        lines.append(f"and {len(failures) - _MOST_FAILURES} more")
    return lines
