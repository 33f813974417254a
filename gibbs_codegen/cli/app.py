"""Command line: the only module that prints or exits.

SymPy and all that needs it are imported by the command that needs them, so that help and refusals
come at once.
"""

from __future__ import annotations

import argparse
import gc
import io
import json
import os
import re
import shlex
import shutil
import signal
import sys
import textwrap
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from gibbs_codegen.errors import GibbsCodegenError, RefusedFileError, UsageError, printable
from gibbs_codegen.version import __version__

if TYPE_CHECKING:
    from gibbs_codegen.program.model import Progress
    from gibbs_codegen.robot.model import Robot

_ROBOT = (
    "robot file, the name of a robot that ships, or a generated module: its folder, or its name "
    "in generated/"
)
_FAMILY = "the paper's family: base arms and links as in its Table 1"


def console() -> int:
    """Entry point of the `gibbs-codegen` command: `main`, and what becomes of its output."""
    # A stream that was closed before the start is None: what is written there goes nowhere.
    nowhere = open(os.devnull, "w")  # noqa: SIM115 - it lives as long as the process
    sys.stdout, sys.stderr = sys.stdout or nowhere, sys.stderr or nowhere
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # A terminal that lacks a letter shows its code.
            stream.reconfigure(errors="backslashreplace")
    # A derivation makes millions of small objects and hardly any cycles, and the process ends soon.
    gc.disable()
    try:
        code = main()
        sys.stdout.flush()
    except OSError as error:
        if not isinstance(error, BrokenPipeError):
            print(f"gibbs-codegen: output: {error.strerror or error}", file=sys.stderr)
        # The reader has gone or its disk is full: keep Python from trying to flush to it again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    return code


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code: 0 done, 1 failed, 2 wrong use or a refused file."""
    parser = argument_parser()
    words = sys.argv[1:] if arguments is None else arguments
    for word in words:  # Before Python 3.13 argparse makes an empty list of such a value.
        if re.fullmatch(r"--[a-z-]+=--", word):
            parser.error(f"{word}: -- is no value; a path of that name is ./--")
    options = parser.parse_args(words)
    try:
        code: int = options.command(options)
    except RefusedFileError as error:
        count = f"{len(error.faults)} faults" if len(error.faults) > 1 else "1 fault"
        print(f"gibbs-codegen: {error.kind} refused, {count}:\n{error}", file=sys.stderr)
        return error.exit_code
    except GibbsCodegenError as error:
        print(f"gibbs-codegen: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("gibbs-codegen: interrupted", file=sys.stderr)
        return 130
    return code


class _Parser(argparse.ArgumentParser):
    """A parser that shows what it does not understand as a message may hold it."""

    def error(self, message: str) -> NoReturn:
        super().error(printable(message, 400))


def argument_parser() -> argparse.ArgumentParser:
    """Parser of the command line; `command` of what it returns runs the command."""
    parser = _Parser(
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
        "--force",
        action="store_true",
        help="where the module's folder has files that were not generated, or were changed since, "
        "keep it under another name instead of refusing",
    )
    generate.add_argument(
        "--all-parameters",
        action="store_true",
        help="keep parameters that are zero in the robot file",
    )
    generate.add_argument(
        "--no-verify",
        action="store_true",
        help="write the module without checking its functions first",
    )
    generate.set_defaults(command=_generate)

    info = commands.add_parser(
        "info", help="show chains, coordinates, motors and operation counts", allow_abbrev=False
    )
    _add_robot(info)
    info.add_argument("--json", action="store_true", help="the same for machines")
    info.set_defaults(command=_info)

    show = commands.add_parser(
        "show",
        help="print the paper's equations of one chain, as text or LaTeX",
        allow_abbrev=False,
    )
    _add_robot(show)
    show.add_argument(
        "--chain", type=int, required=True, metavar="J", help="number of the chain, 1 to N"
    )
    show.add_argument(
        "--equation",
        action="append",
        type=int,
        metavar="E",
        help="2 (Gibbs function), 5 (its partials), 6 (a link's two vectors), 15 (equations of "
        "motion) or 18 (places in the hybrid system); may be repeated (default: 15 and 18)",
    )
    show.add_argument("--format", choices=("text", "latex"), default="text", help="default: text")
    show.set_defaults(command=_show)

    _add_verify(commands)
    _add_simulate(commands)

    new = commands.add_parser(
        "new", help="write a commented robot file to start from", allow_abbrev=False
    )
    new.add_argument("file", metavar="ROBOT.toml", help="file to write; it must not exist yet")
    new.set_defaults(command=_new)
    return parser


def _add_verify(commands: argparse._SubParsersAction[_Parser]) -> None:
    verify = commands.add_parser(
        "verify",
        help="check a module against formulations that share no code with the derivation",
        allow_abbrev=False,
    )
    _add_module(verify)
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
    verify.add_argument("--json", action="store_true", help="the same for machines")
    verify.set_defaults(command=_verify)


def _add_simulate(commands: argparse._SubParsersAction[_Parser]) -> None:
    simulate = commands.add_parser(
        "simulate",
        help="fly a scenario with a generated module: time series and figures",
        allow_abbrev=False,
    )
    _add_module(simulate)
    simulate.add_argument(
        "--scenario",
        default="paper",
        metavar="NAME|FILE",
        help="paper (default), hover, line, circle, or a scenario file in TOML",
    )
    simulate.add_argument(
        "--out", default="flight", metavar="DIR", help="folder of the results (default: flight)"
    )
    simulate.add_argument(
        "--backend",
        choices=("numpy", "c"),
        default="c",
        help="c (default; compiled once, NumPy where that is not possible) or numpy",
    )
    simulate.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="replace an entry of the scenario, such as start.offset=[0.2,0,0]; may be repeated",
    )
    simulate.add_argument("--no-figures", action="store_true", help="time series only")
    simulate.add_argument("--animate", choices=("gif", "mp4"), help="write an animation too")
    simulate.set_defaults(command=_simulate)


def _add_robot(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "robot",
        nargs="?",
        metavar="ROBOT",
        help=f"{_ROBOT}; of a name that is both, the robot that ships is taken",
    )
    parser.add_argument(
        "--rotors", type=int, metavar="N", help=f"with --links: {_FAMILY}; 2 to 256 rotors"
    )
    parser.add_argument("--links", type=int, metavar="n", help="links of the arm, 0 to 64")


def _add_module(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "robot",
        metavar="ROBOT",
        help=f"{_ROBOT}; of a name that is both, the module is taken; a robot's is made for this "
        "and not kept",
    )


def _robot(options: argparse.Namespace) -> tuple[Robot, str]:
    """The robot that the options ask for, and the text of its file."""
    from gibbs_codegen.cli.robot_argument import find_robot

    if options.robot is not None:
        if options.rotors is not None or options.links is not None:
            raise UsageError("give ROBOT, or --rotors and --links, not both")
        return find_robot(options.robot)
    if options.rotors is None or options.links is None:
        raise UsageError("give ROBOT, or both --rotors and --links")
    from gibbs_codegen.robot.family import paper_family
    from gibbs_codegen.robot.text import robot_text

    robot = paper_family(options.rotors, options.links)
    return robot, robot_text(robot)


def _generate(options: argparse.Namespace) -> int:
    robot, text = _robot(options)
    from gibbs_codegen import pipeline
    from gibbs_codegen.program.nodes import count_operations
    from gibbs_codegen.targets.registry import TARGETS

    targets = options.target or list(TARGETS)
    if options.check:
        with _progress() as progress:
            folder, differing = pipeline.check_robot(
                robot, text, options.out, targets, options.all_parameters, progress
            )
        return _report_check(folder, differing)
    start = time.perf_counter()
    with _progress() as progress:
        model, folder = pipeline.generate_robot(
            robot,
            text,
            options.out,
            targets,
            options.all_parameters,
            progress,
            not options.no_verify,
            options.force,
        )
    counts = count_operations(model.program.function("mass_matrix_and_residual").nodes())
    print(
        f"{printable(folder)}: {len(model.program.functions)} functions of "
        f"{len(model.program.inputs['q'])} coordinates and {len(model.program.inputs['u'])} inputs "
        f"in {time.perf_counter() - start:.1f} s; mass matrix and residual take {counts.total} "
        f"operations and {counts.sine_cosine_pairs} sine-cosine pairs"
    )
    _print_balance(robot)
    return 0


def _print_balance(robot: Robot) -> None:
    """How the base is balanced, and a warning where it is lopsided."""
    from gibbs_codegen.robot.balance import balance, balance_lines, lopsided

    found = balance(robot)
    for line in balance_lines(found):
        print(textwrap.fill(line, _width(), subsequent_indent="  "))
    if warning := lopsided(robot, found):
        print(f"gibbs-codegen: warning: {warning}", file=sys.stderr)


def _report_check(folder: Path, differing: list[str]) -> int:
    if not differing:
        print(f"{printable(folder)}: up to date")
        return 0
    what = "differs from what would be written" if folder.is_dir() else "is not there yet"
    listed = printable(", ".join(differing))
    print(f"{printable(folder)}: {what}: {listed}", file=sys.stderr)
    return 1


def _info(options: argparse.Namespace) -> int:
    robot, _ = _robot(options)
    from gibbs_codegen.derivation.derive import derive

    with _progress() as progress:
        model = derive(robot, progress=progress)
    from rich.console import Console

    from gibbs_codegen.cli.info_report import print_report, report

    if options.json:
        print(json.dumps(report(model), indent=2))
    else:
        print_report(model, Console(width=_width(), highlight=False))
    return 0


def _show(options: argparse.Namespace) -> int:
    robot, _ = _robot(options)
    from gibbs_codegen.equations.layout import LEAST_WIDTH, MOST_WIDTH, as_latex, as_text
    from gibbs_codegen.equations.show import SHORT, chain_equation

    with _progress() as progress:
        equations = []
        for number in options.equation or SHORT:
            progress(f"equation {number}")
            equations.append(chain_equation(robot, options.chain, number))
        progress("setting the equations")
        if options.format == "latex":
            laid_out = as_latex(*equations)
        else:
            laid_out = as_text(*equations, width=min(max(_width(), LEAST_WIDTH), MOST_WIDTH))
    print(laid_out, end="")
    return 0


def _verify(options: argparse.Namespace) -> int:
    from gibbs_codegen.cli.robot_argument import found_module

    with _ended_by_signals(), found_module(options.robot, _progress()) as (folder, kept):
        return _verify_folder(options, folder, kept)


def _verify_folder(options: argparse.Namespace, folder: Path, kept: bool) -> int:
    from rich.console import Console

    from gibbs_codegen.cli.verify_report import as_data, failure_lines, print_verification
    from gibbs_codegen.verification.modules import verify

    backends = options.backend or ["numpy", "c"]
    with _progress() as progress:
        found = verify(folder, options.states, options.seed, backends, progress)
    lacking = [backend for backend in options.backend or () if backend not in found.comparisons]
    passed = found.passed and not lacking
    if options.json:
        print(json.dumps(as_data(found) | {"passed": passed}, indent=2))
    else:
        width = None if sys.stdout.isatty() else 160
        print_verification(found, Console(width=width, highlight=False, soft_wrap=False))
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


def _simulate(options: argparse.Namespace) -> int:
    with _ended_by_signals():
        return _fly(options)


def _fly(options: argparse.Namespace) -> int:
    from gibbs_codegen.figures.results import check_results, write_results
    from gibbs_codegen.scenario.file import changes_of, read_scenario

    scenario = read_scenario(options.scenario, changes_of(options.set))
    check_results(options.out, options.animate or "")
    from gibbs_codegen.cli.robot_argument import found_module
    from gibbs_codegen.runtime.load import load
    from gibbs_codegen.simulator.simulation import simulate

    with found_module(options.robot, _progress()) as (folder, _), _progress_bar() as progress:
        module = load(folder, options.backend)
        start = time.perf_counter()
        flight = simulate(module, scenario, progress)
        seconds = time.perf_counter() - start
        write_results(flight, options.out, not options.no_figures, options.animate or "", progress)
    energy = max(abs(flight.energy_error), default=0.0)
    print(
        f"{printable(options.out)}: {flight.robot} flew {flight.scenario!r} for "
        f"{flight.time[-1]:.4g} s, computed in {seconds:.1f} s\n"
        f"largest errors: base centre {max(flight.centre_error):.2g} m, "
        f"tip {max(flight.tip_error):.2g} m, energy balance {energy:.2g} J"
    )
    if flight.stopped:
        print(f"gibbs-codegen: the flight ended early: {flight.stopped}", file=sys.stderr)
        return 1
    return 0


def _new(options: argparse.Namespace) -> int:
    from gibbs_codegen.files.module_writer import write_new_file
    from gibbs_codegen.robot.family import paper_family
    from gibbs_codegen.robot.names import name_from
    from gibbs_codegen.robot.text import robot_text

    path = Path(options.file)
    name = name_from(path.stem)
    write_new_file(path, robot_text(paper_family(6, 3), name, to_start_from=True))
    # What begins with a minus sign would be taken for an option.
    words = ["gibbs-codegen", "generate", *(["--"] if str(path).startswith("-") else []), str(path)]
    command = printable(shlex.join(words), 4000)
    print(f"{printable(path)}: written, for a robot named {name}; edit it, then run: {command}")
    return 0


def _width() -> int:
    """Columns of the terminal, or those of every terminal where the output goes elsewhere."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else 80


@contextmanager
def _progress() -> Iterator[Progress]:
    """A spinner that names the step at work, on a terminal; nothing in a pipe."""
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console

    with Console(stderr=True).status("starting") as status:
        yield lambda step: status.update(step)


@contextmanager
def _progress_bar() -> Iterator[Callable[[str, float], None]]:
    """A bar for each thing that is being done, on a terminal; nothing in a pipe."""
    if not sys.stderr.isatty():
        yield lambda what, share: None
        return
    from rich.console import Console
    from rich.progress import Progress as Bars

    with Bars(console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, Any] = {}

        def show(what: str, share: float) -> None:
            if what not in tasks:
                tasks[what] = bars.add_task(what, total=1.0)
            bars.update(tasks[what], completed=share)

        yield show


@contextmanager
def _ended_by_signals() -> Iterator[None]:
    """Let signals to end unwind the work, so that it leaves nothing half-written."""

    def end(number: int, _: object) -> None:
        raise SystemExit(128 + number)

    before = {}
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            before[number] = signal.signal(number, end)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
