"""`sweep`: fly a scenario in many variants, and say how measures are spread and what they show."""

from __future__ import annotations

import argparse
import logging
import re
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Sequence
from math import isnan
from typing import Any

from rich.console import Console
from rich.text import Text

from gibbs_codegen.cli import terminal
from gibbs_codegen.cli.arguments import DISTRIBUTIONS
from gibbs_codegen.cli.robot_argument import usual_scenario
from gibbs_codegen.cli.terminal import plain_table
from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.flight import distributions
from gibbs_codegen.flight.figures.study import write_study_figures
from gibbs_codegen.flight.sweeps.study import Study
from gibbs_codegen.flight.sweeps.sweep import sweep

_MOST_INNER = 2
_MOST_SHOWN = 60
# Text between commas, except commas in quotation marks and square brackets.
_PART = re.compile(r"""(?:^|,)((?:"[^"]*"|'[^']*'|\[[^\]]*\]|[^,])*)""")
# The numbers of worst flights and of keys that explain most, for a measure; of reasons shown.
_WORST, _MOST_KEYS, _MOST_REASONS = 3, 3, 5
# The least share that is shown.
_LEAST = 0.02


@terminal.ended_by_signals()
def run(options: argparse.Namespace) -> int:
    """Fly the study, draw its figures, and print what it shows."""
    if not sys.stderr.isatty():  # Lines take the place of the bar.
        log = logging.getLogger("gibbs_codegen.flight.sweeps")
        log.setLevel(logging.INFO)
        log.addHandler(logging.StreamHandler())
    fixed = _pairs(options.set, "--set", "duration=5")
    parameters = _pairs(options.vary, "--vary", "motors.time_constant=0,0.01")
    if both := fixed.keys() & parameters.keys():
        raise UsageError(f"--set {printable(min(both), _MOST_SHOWN)}: --vary has this key too")
    measures = _pairs(options.measure, "--measure", "worst=tip_error.max")
    start, done = time.perf_counter(), 0.0
    with terminal.progress_bar() as bar:

        def progress(stage: str, share: float) -> None:
            nonlocal done
            done = share
            bar(stage, share)

        try:
            study = sweep(
                options.robots,
                options.scenario or [usual_scenario(options.robots[0])],
                {key: [_value(text)] for key, text in fixed.items()}
                | {key: varied(text, key) for key, text in parameters.items()},
                options.samples,
                options.seed,
                measures or None,
                out=options.out,
                progress=progress,
                workers=options.workers,
            )
        except KeyboardInterrupt:
            state = f"interrupted with {100.0 * done:.0f} % done; {options.out} keeps them"
            again = "repeat the command to continue"
            print(f"gibbs-codegen: {printable(state, 400)}; {again}", file=sys.stderr)
            return 130
    seconds = time.perf_counter() - start
    write_study_figures(study, study.folder, options.format)
    print_study(study, seconds)
    return 1 if len(study.failures) == len(study.table) else 0


def varied(text: str, key: str) -> Any:
    """The values of a key by the words of --vary: values with commas, or a function's call.

    Returns a list, or what the function of `gibbs_codegen.flight.distributions` returns. Raises
    `UsageError`, which names the key, if the words mean nothing.
    """
    call = re.fullmatch(r"\s*(\w+)\s*\((.*)\)\s*", text, re.DOTALL)
    if call is None:
        return _values(text)
    name, inner = call.groups()
    shown = f"--vary {printable(key)}={printable(text, _MOST_SHOWN)}"
    if name not in DISTRIBUTIONS:
        raise UsageError(f"{shown}: {name} is not one of {', '.join(DISTRIBUTIONS)}")
    if inner.count("(") > _MOST_INNER:
        raise UsageError(f"{shown}: too many nested brackets")
    arguments = [varied(inner, key)] if "(" in inner else _values(inner)
    try:
        return getattr(distributions, name)(*arguments)
    except TypeError:
        raise UsageError(
            f"{shown}: {name} takes two numbers; scaled and together also take another of "
            f"{', '.join(DISTRIBUTIONS)}, or a list in square brackets"
        ) from None


def _values(text: str) -> list[Any]:
    """Values of TOML with commas between them; anything else is text."""
    try:
        return tomllib.loads(f"values = [{text}]")["values"]
    except (ValueError, RecursionError):
        return [_value(part.strip()) for part in _PART.findall(text)]


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        pass
    try:
        return float(text)  # TOML takes no .9
    except ValueError:
        return text


def _pairs(entries: Sequence[str], option: str, example: str) -> dict[str, str]:
    """Texts by the names before their equals sign, of an option that may be repeated.

    Later entries prevail. Raises `UsageError` if one is not like `example`.
    """
    pairs = {}
    for entry in entries:
        name, _, value = entry.partition("=")
        if not name.strip() or not value.strip():
            shown = printable(entry, _MOST_SHOWN)
            raise UsageError(f"{option} {shown}: must be such as {example}")
        pairs[name.strip()] = value
    return pairs


def print_study(study: Study, seconds: float) -> None:
    """Print how measures are spread, what they depend on, the worst flights, and what failed."""
    console = Console(width=terminal.width(), highlight=False)
    early, failed, unmeasured = map(len, (study.stopped, study.failures, study.unmeasured))
    print(
        f"{printable(study.folder)}: {len(study.table)} cases in {seconds:.1f} s: "
        f"{len(study.whole)} flights to the end, {early} ended early, {failed} failed"
        + (f"; {unmeasured} flights have no value of some measure" if unmeasured else "")
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
    commands: dict[int, str] = {}
    print("\nworst flights")
    for measure in study.measures:
        worst = study.worst(measure, _WORST)
        shown = [
            f"case {flight.case} ({flight.value:.4g}{', ended early' if flight.stopped else ''})"
            for flight in worst
        ]
        print(f"  {printable(measure)}: {', '.join(shown) or 'none'}")
        commands |= {flight.case: flight.command for flight in worst[:1]}
    for case, command in commands.items():
        print(f"case {case} again:\n  {command}")


def _print_reasons(outcome: str, study: Study, column: str) -> None:
    """Print the reasons of a column, the most frequent first, each with a case that has it.

    `outcome` is how the flights ended.
    """
    rows = study.table[study.table[column] != ""]
    # Times and amounts are others in every flight.
    kinds = [re.sub(r"\d[\d.]*(e[-+]?\d+)?", "…", str(reason)) for reason in rows[column]]
    frequent = Counter(kinds).most_common()
    for kind, count in frequent[:_MOST_REASONS]:
        first = rows[kinds.index(kind)]
        print(f"  {outcome}, {count}, as case {first['case']}: {printable(first[column], 300)}")
        if column != "unmeasured":  # A command that flies it again does not measure it.
            print(f"    {study.command(first['case'])}")
    if more := frequent[_MOST_REASONS:]:
        print(f"  {outcome}, {sum(count for _, count in more)} for other reasons; see table.csv")


def _print_sensitivities(study: Study, console: Console) -> None:
    """Print what each measure depends on most, where anything can be said of it."""
    table = plain_table("what keys explain", "", "alone", "with others", "correlation")
    for measure in study.measures:
        telling = [  # What explains something, and more than chance might.
            row
            for row in study.sensitivity(measure)
            if row.alone > max(row.alone_error, _LEAST) or row.joint > max(row.joint_error, _LEAST)
        ]
        for number, row in enumerate(telling[:_MOST_KEYS]):
            if number == 0:
                table.add_row(Text(printable(measure)))  # Text: brackets in names are no markup.
            shares = (_share(row.alone, row.alone_error), _share(row.joint, row.joint_error))
            correlation = "" if isnan(row.correlation) else f"{row.correlation:+.2f}"
            table.add_row(Text(f"  {printable(row.key)}"), *shares, correlation)
    if table.row_count:
        console.print()
        console.print(table)


def _share(share: float, error: float) -> str:
    return "" if isnan(share) else f"{share:.2f} ± {error:.2f}"
