"""What `sweep` says of a study on a terminal."""

from __future__ import annotations

import re
from collections import Counter
from math import isnan

from rich.console import Console
from rich.text import Text

from gibbs_codegen.cli import terminal
from gibbs_codegen.cli.terminal import plain_table
from gibbs_codegen.errors import printable
from gibbs_codegen.flight.sweeps.sensitivity import Sensitivity
from gibbs_codegen.flight.sweeps.study import Study

# Of a measure, the worst flights and the keys that explain most; reasons that are told.
_WORST, _MOST_KEYS, _MOST_REASONS = 3, 3, 5
# The least share that is told.
_LEAST = 0.02


def print_study(study: Study, seconds: float) -> None:
    """Print how measures are spread, what they depend on, the worst flights, and what failed."""
    console = Console(width=terminal.width(), highlight=False)
    early, failed, unmeasured = map(len, (study.stopped, study.failures, study.unmeasured))
    print(
        f"{printable(study.folder)}: {len(study.table)} cases in {seconds:.1f} s: "
        f"{len(study.whole)} flights to the end, {early} ended early, {failed} failed"
        + (f"; of {unmeasured} flights a measure could not be taken" if unmeasured else "")
    )
    _print_reasons("ended early", study, "stopped")
    _print_reasons("failed", study, "failed")
    _print_reasons("not measured", study, "unmeasured")
    if not len(study.whole):
        return
    table = plain_table("flights to the end", "", "least", "5 %", "median", "95 %", "greatest")
    for spread in study.summary():
        numbers = (f"{value:.4g}" for value in spread[2:])
        table.add_row(Text(printable(spread.measure)), *numbers)
    console.print()
    console.print(table)
    _print_sensitivities(study, console)
    _print_worst(study)


def _print_worst(study: Study) -> None:
    """Print the worst flights of each measure, and what flies the worst of all again."""
    commands: dict[int, str] = {}
    print("\nworst flights")
    for measure in study.measures:
        worst = study.worst(measure, _WORST)
        shown = [
            f"case {each.case} ({each.value:.4g}{', ended early' if each.stopped else ''})"
            for each in worst
        ]
        print(f"  {printable(measure)}: {', '.join(shown) or 'none'}")
        commands |= {each.case: each.command for each in worst[:1]}
    for case, command in commands.items():
        print(f"case {case} again:\n  {command}")


def _print_reasons(what: str, study: Study, column: str) -> None:
    """Print the reasons of a column, the most frequent first, each with a case that has it.

    `what` is what became of the flights.
    """
    rows = study.table[study.table[column] != ""]
    # Times and amounts are others in every flight.
    kinds = [re.sub(r"\d[\d.]*(e[-+]?\d+)?", "…", str(reason)) for reason in rows[column]]
    frequent = Counter(kinds).most_common()
    for kind, count in frequent[:_MOST_REASONS]:
        first = rows[kinds.index(kind)]
        print(f"  {what}, {count}, as case {first['case']}: {printable(first[column], 300)}")
        if column != "unmeasured":  # A command that flies it again does not measure it.
            print(f"    {study.command(first['case'])}")
    if more := frequent[_MOST_REASONS:]:
        print(f"  {what}, {sum(count for _, count in more)} for other reasons, which table.csv has")


def _print_sensitivities(study: Study, console: Console) -> None:
    """Print what each measure depends on most, where anything can be said of it."""
    table = plain_table("what keys explain", "", "alone", "with others", "correlation")
    for measure in study.measures:
        found = [each for each in study.sensitivity(measure) if _is_seen(each)]
        for number, each in enumerate(found[:_MOST_KEYS]):
            if number == 0:
                table.add_row(Text(printable(measure)))  # Text: brackets in names are no markup.
            shares = (_share(each.alone, each.alone_error), _share(each.joint, each.joint_error))
            correlation = "" if isnan(each.correlation) else f"{each.correlation:+.2f}"
            table.add_row(Text(f"  {printable(each.key)}"), *shares, correlation)
    if table.row_count:
        console.print()
        console.print(table)


def _is_seen(each: Sensitivity) -> bool:
    """Whether a key explains something, and more than chance might."""
    return each.alone > max(each.alone_error, _LEAST) or each.joint > max(each.joint_error, _LEAST)


def _share(share: float, error: float) -> str:
    return "" if isnan(share) else f"{share:.2f} ± {error:.2f}"
