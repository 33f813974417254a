"""`sweep`: fly a scenario in many variants, and say how measures are spread and what they show."""

from __future__ import annotations

import argparse
import logging
import re
import sys
import time
import tomllib
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from gibbs_codegen.cli import terminal
from gibbs_codegen.cli.terminal import Parser
from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.files.shipped import shipped_names

if TYPE_CHECKING:
    from gibbs_codegen.flight.sweeps.study import Study

# What may stand before brackets in --vary; the functions of these names in `sweeps.sampling`.
_FUNCTIONS = ("uniform", "normal", "log_uniform", "scaled", "together")
_MOST_INNER = 2
_MOST_SHOWN = 60
# What stands between commas, but for those in quotation marks and square brackets.
_PART = re.compile(r"""(?:^|,)((?:"[^"]*"|'[^']*'|\[[^\]]*\]|[^,])*)""")


def add(commands: argparse._SubParsersAction[Parser]) -> None:
    """Add the command to the parser."""
    sweep = commands.add_parser(
        "sweep",
        help="fly scenarios in many variants, and measure every flight",
    )
    _add_cases(sweep)
    sweep.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="replace an entry of the scenario in all flights, such as start.offset=[0.2,0,0]; may "
        "be repeated",
    )
    sweep.add_argument(
        "--measure",
        action="append",
        default=[],
        metavar="NAME=SERIES.STATISTIC",
        help="what is measured of a flight, such as worst=tip_error.max; may be repeated (default: "
        "worst and last errors of base centre and tip)",
    )
    sweep.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="processes that fly (default: one for each processor)",
    )
    sweep.add_argument(
        "--out",
        default="sweep",
        metavar="DIR",
        help="folder in which the results are kept; the same command goes on with what is there "
        "(default: sweep)",
    )
    sweep.add_argument("--no-figures", action="store_true", help="draw no figures")
    sweep.set_defaults(command=_sweep)


def _add_cases(sweep: Parser) -> None:
    """Add the options that say what is flown."""
    sweep.add_argument(
        "robots",
        nargs="+",
        metavar="ROBOT",
        help="a robot file, the name of a robot that ships, or a generated module, given by its "
        "folder or by its name in generated/, which comes first; of others a module is generated",
    )
    sweep.add_argument(
        "--scenario",
        action="append",
        metavar="NAME|FILE",
        help=f"a scenario to fly: {', '.join(shipped_names('scenarios'))} or a scenario file; may "
        "be repeated (default: paper)",
    )
    sweep.add_argument(
        "--vary",
        action="append",
        default=[],
        metavar="KEY=VALUES",
        help="what an entry of the scenario takes on: values with commas between them, which "
        f"cross with those of other keys, or one of {', '.join(_FUNCTIONS)} of numbers in "
        "brackets, such as uniform(0.8,1.2); may be repeated",
    )
    sweep.add_argument(
        "--samples",
        type=int,
        default=1,
        metavar="N",
        help="how many times numbers are drawn for each combination of values (default: 1)",
    )
    sweep.add_argument(
        "--seed", type=int, default=0, metavar="N", help="of what is drawn (default: 0)"
    )


@terminal.ended_by_signals()
def _sweep(options: argparse.Namespace) -> int:
    from gibbs_codegen.cli.sweep_report import print_study

    if not sys.stderr.isatty():  # Lines take the place of the bar.
        log = logging.getLogger("gibbs_codegen.flight.sweeps")
        log.setLevel(logging.INFO)
        log.addHandler(logging.StreamHandler())
    start, done = time.perf_counter(), 0.0
    with terminal.progress_bar() as bar:

        def progress(what: str, share: float) -> None:
            nonlocal done
            done = share
            bar(what, share)

        try:
            study = _flown(options, progress)
        except KeyboardInterrupt:
            told = f"interrupted when {100.0 * done:.0f} % were done, which {options.out} keeps"
            again = "the same command goes on from there"
            print(f"gibbs-codegen: {printable(told, 400)}; {again}", file=sys.stderr)
            return 130
    seconds = time.perf_counter() - start
    if not options.no_figures:
        from gibbs_codegen.flight.figures.study import write_study_figures

        write_study_figures(study, study.folder)
    print_study(study, seconds)
    return 1 if len(study.failures) == len(study.table) else 0


def _flown(options: argparse.Namespace, progress: Callable[[str, float], None]) -> Study:
    """The study that the options ask for; `progress` is as of `sweep`."""
    fixed = _pairs(options.set, "--set", "duration=5")
    parameters = _pairs(options.vary, "--vary", "motors.time_constant=0,0.01")
    if both := fixed.keys() & parameters.keys():
        raise UsageError(f"--set {printable(min(both), _MOST_SHOWN)}: --vary has this key too")
    measures = _pairs(options.measure, "--measure", "worst=tip_error.max")
    from gibbs_codegen.flight.sweeps.sweep import sweep

    return sweep(
        options.robots,
        options.scenario or ["paper"],
        {key: [_value(text)] for key, text in fixed.items()}
        | {key: varied(text, key) for key, text in parameters.items()},
        options.samples,
        options.seed,
        measures or None,
        out=options.out,
        progress=progress,
        workers=options.workers,
    )


def varied(text: str, key: str) -> Any:
    """What a key takes on, from the words of --vary: values with commas, or a function's call.

    Returns a list, or what the function of `gibbs_codegen.flight.sweeps.sampling` returns. Raises
    `UsageError`, which names the key, if the words mean nothing.
    """
    found = re.fullmatch(r"\s*(\w+)\s*\((.*)\)\s*", text, re.DOTALL)
    if found is None:
        return _values(text)
    name, inner = found.groups()
    shown = f"--vary {printable(key)}={printable(text, _MOST_SHOWN)}"
    if name not in _FUNCTIONS:
        raise UsageError(f"{shown}: {name} is not one of {', '.join(_FUNCTIONS)}")
    if inner.count("(") > _MOST_INNER:
        raise UsageError(f"{shown}: more brackets in brackets than mean anything")
    from gibbs_codegen.flight.sweeps import sampling

    arguments = [varied(inner, key)] if "(" in inner else _values(inner)
    try:
        return getattr(sampling, name)(*arguments)
    except TypeError:
        raise UsageError(
            f"{shown}: {name} takes two numbers; scaled and together also take another of "
            f"{', '.join(_FUNCTIONS)}, or a list in square brackets"
        ) from None


def _values(text: str) -> list[Any]:
    """Values of TOML with commas between them; what is not TOML is text."""
    try:
        found: list[Any] = tomllib.loads(f"values = [{text}]")["values"]
        return found
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
