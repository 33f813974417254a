"""`simulate`: fly a scenario with a module, and write time series and figures."""

from __future__ import annotations

import argparse
import sys
import time
from typing import TYPE_CHECKING

import numpy as np

from gibbs_codegen.cli import robot_argument, terminal
from gibbs_codegen.cli.terminal import Parser
from gibbs_codegen.errors import printable
from gibbs_codegen.files.shipped import shipped_names
from gibbs_codegen.flight.record.flight import Flight

if TYPE_CHECKING:
    from gibbs_codegen.flight.record.flight import Flight


# Limits that the terminal shows of those that a timing reaches.
_MOST_LIMITS = 12


def add(commands: argparse._SubParsersAction[Parser]) -> None:
    """Add the command to the parser."""
    simulate = commands.add_parser(
        "simulate",
        help="fly a scenario with a module, and write time series and figures",
    )
    robot_argument.add_module(simulate)
    simulate.add_argument(
        "--scenario",
        default="paper",
        metavar="NAME|FILE",
        help=f"the scenario to fly: {', '.join(shipped_names('scenarios'))} or a scenario file "
        "(default: paper)",
    )
    simulate.add_argument(
        "--out",
        default="flight",
        metavar="DIR",
        help="folder in which the results are written (default: flight)",
    )
    simulate.add_argument(
        "--backend",
        choices=("numpy", "c"),
        default="c",
        help="back end to compute with; c is compiled once, and replaced by numpy if that is not "
        "possible (default: c)",
    )
    simulate.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="replace an entry of the scenario, such as start.offset=[0.2,0,0]; may be repeated",
    )
    simulate.add_argument("--no-figures", action="store_true", help="write the time series only")
    simulate.add_argument(
        "--animate", choices=("gif", "mp4"), help="write an animation as well, in this format"
    )
    simulate.set_defaults(command=_simulate)


@terminal.ended_by_signals()
def _simulate(options: argparse.Namespace) -> int:
    import numpy as np

    from gibbs_codegen.files.changes import changes_of
    from gibbs_codegen.flight.figures.flight import check_results, write_results
    from gibbs_codegen.flight.scenario.file import read_scenario

    scenario = read_scenario(options.scenario, changes_of(options.set))
    check_results(options.out, options.animate or "")
    from gibbs_codegen.flight.simulation import simulate
    from gibbs_codegen.runtime.load import load

    with (
        robot_argument.found_module(options.robot, terminal.progress()) as (folder, _),
        terminal.progress_bar() as progress,
    ):
        module = load(folder, options.backend)
        start = time.perf_counter()
        flight = simulate(module, scenario, progress=progress)
        seconds = time.perf_counter() - start
        write_results(flight, options.out, not options.no_figures, options.animate or "", progress)
    print(
        f"{printable(options.out)}: {flight.robot} flew {flight.scenario!r} for "
        f"{flight.time[-1]:.4g} s, computed in {seconds:.1f} s\n"
        f"control law: {flight.law}\n"
        f"largest errors: {_errors(flight, slice(None))}, "
        f"energy balance {max(abs(flight.energy_error)):.2g} J\n"
        f"errors at the end: {_errors(flight, slice(-1, None))}"
    )
    for k, (wall, forces) in enumerate(zip(scenario.walls, flight.wall_forces.T, strict=True), 1):
        most = int(np.nan_to_num(forces).argmax())
        words = f"at most {forces[most]:.3g} N, at t = {flight.time[most]:.4g} s; "
        words += f"{forces[-1]:.3g} N at the end"
        print(f"wall {k}, on {printable(wall.frame)}: {words if forces.any() else 'not touched'}")
    if limits := reached_limits(flight):
        print(f"at their limits: {printable(limits, 400)}")
    _print_timing(flight, printable(options.out))
    if flight.stopped:
        print(f"gibbs-codegen: the flight ended early: {flight.stopped}", file=sys.stderr)
        return 1
    return 0


def _errors(flight: Flight, samples: slice) -> str:
    """The largest errors of base centre, tip and joints, with the joints that have them.

    Such as "base centre 0.02 m, tip 0.01 m, joint theta_8 0.003 rad".
    """
    found = [f"base centre {max(flight.centre_error[samples]):.2g} m"]
    if flight.has_tip:
        found.append(f"tip {max(flight.tip_error[samples]):.2g} m")
    joints, rates = flight.layout.q.joints, flight.layout.v.joints
    errors = abs(flight.errors[samples, rates]).max(axis=0)
    of = list(zip(errors, flight.coordinates[joints], flight.coordinate_units[joints], strict=True))
    for unit in sorted({unit for _, _, unit in of}):
        error, joint = max((error, joint) for error, joint, its_unit in of if its_unit == unit)
        found.append(f"joint {joint} {error:.2g} {unit}")
    return ", ".join(found)


def _print_timing(flight: Flight, folder: str) -> None:
    """Say how the desired motion was timed, and which limits it reaches."""
    if flight.timing:
        print(f"timing: {printable(flight.timing)}")
    times = flight.binding_times[:_MOST_LIMITS]
    for (begin, end), what in zip(times, flight.binding, strict=False):
        print(f"  {begin:7.3f} to {end:7.3f} s: {what}")
    if more := len(flight.binding) - len(times):
        print(f"  and {more} more: `binding` of {folder}/flight.npz has all")


# Of inputs that are named; and the share of a limit that is too little to have left it.
_MOST_NAMES = 12
_ROUND_OFF = 1e-9


def reached_limits(flight: Flight) -> str:
    """Name the inputs that were asked for their limits or more, and the one asked for the most.

    Such as "F_1, F_3 (F_1 was asked for 88 N of 14 N at t = 0.03 s)"; empty if none was. Inputs
    that their limits leave no choice, such as 0 to 0, are named only if asked for more.
    """
    low, high = flight.input_limits
    # Infinite differences are limits that there are not; NaN, values after control was lost.
    over = np.stack([low - flight.commanded_least, flight.commanded_greatest - high])
    over = np.where(np.isfinite(over), over, -np.inf)
    limits = np.where(np.isfinite(flight.input_limits), np.abs(flight.input_limits), 0.0)
    share = over / np.maximum(limits.max(axis=0), _ROUND_OFF)
    least = np.where(low == high, _ROUND_OFF, -_ROUND_OFF)
    reached = np.flatnonzero((share >= least).any(axis=(0, 1)))
    if not len(reached):
        return ""
    side, sample, place = np.unravel_index(int(share.argmax()), share.shape)
    asked = (flight.commanded_least, flight.commanded_greatest)[side][sample, place]
    numbers = asked, flight.input_limits[side, place]
    told, limit = (f"{number:.3g} {flight.input_units[place]}" for number in numbers)
    names = [flight.input_names[k] for k in reached[:_MOST_NAMES]]
    more = f" and {len(reached) - len(names)} more" if len(reached) > len(names) else ""
    past = share[side, sample, place] > _ROUND_OFF and told != limit
    words = f"was asked for {told} of {limit}" if past else f"reached {limit}"
    return (
        f"{', '.join(names)}{more} ({flight.input_names[place]} {words} "
        f"at t = {flight.time[sample]:.3g} s)"
    )
