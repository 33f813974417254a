"""`sitl`: fly a scenario under an autopilot, in step with it, and write time series and figures."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gibbs_codegen.cli import robot_argument, terminal
from gibbs_codegen.cli.simulate import estimation, print_events
from gibbs_codegen.errors import UsageError, cause_of, printable, require
from gibbs_codegen.files.toml import changes_of
from gibbs_codegen.flight.autopilots.ardupilot import ArduPilot
from gibbs_codegen.flight.autopilots.betaflight import (
    BETAFLIGHT_RATE,
    Betaflight,
    Sticks,
    sticks_of,
)
from gibbs_codegen.flight.autopilots.machine import Machine
from gibbs_codegen.flight.autopilots.px4 import PX4, PX4_RATE
from gibbs_codegen.flight.autopilots.session import AutopilotLink, fly
from gibbs_codegen.flight.figures.results import check_results, write_results
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.parts import functions_for
from gibbs_codegen.flight.simulation import check_scenario, uncontrolled
from gibbs_codegen.machine.filters import CALLED
from gibbs_codegen.runtime.load import load


@terminal.ended_by_signals()
def run(options: argparse.Namespace) -> int:
    """Fly until the scenario ends or somebody ends it, write the results, and report the flight."""
    if options.autopilot == "px4":  # Before a module is generated.
        require("pymavlink", "the link to PX4", "sitl")
    if not 0 <= options.instance < 1000:
        raise UsageError(f"--instance: must be from 0 to 999, not {options.instance}")
    if not 0.0 < options.timeout <= 86400.0:
        raise UsageError(f"--timeout: must be above 0 and at most a day, not {options.timeout:g} s")
    if options.sticks and options.autopilot != "betaflight":
        raise UsageError("--sticks: only --betaflight takes stick positions; leave it out")
    scenario = read_scenario(options.scenario, changes_of(options.set))
    check_results(options.out, "")

    functions = functions_for(bool(scenario.holds))
    derivatives = CALLED if scenario.control.estimate else ()
    with (
        robot_argument.found_module(
            *(options.robot, terminal.progress(), derivatives, functions),
            check=lambda robot: check_scenario(robot, uncontrolled(scenario)),
        ) as (folder, _),
        terminal.progress_bar() as progress,
    ):
        module = load(folder, options.backend)
        machine = Machine(module, scenario, options.joints == "autopilot", progress)
        link = _link(machine, options, scenario.control.rate)
        notes = list(link.notes)
        for note in notes:
            print(f"note: {note}")
        print(f"waiting for {link.name}; press Ctrl-C to end", flush=True)
        session = fly(machine, link, scenario.duration, options.speed, progress)
        # Results of an earlier flight stay where none was flown.
        flight = machine.simulation.flight() if machine.time > 0.0 else None
        if flight:
            write_results(flight, options.out, progress=progress, formats=options.format)
    if flight:
        print(
            f"{printable(options.out)}: {flight.robot} flew {flight.scenario!r} for "
            f"{flight.time[-1]:.4g} s under {link.name}, {session.pace:.3g} times real time"
        )
        if words := estimation(flight):
            print(words)
        print_events(flight, scenario.walls)
    for note in session.notes[len(notes) :]:
        print(f"note: {note}")
    if session.ended:
        words = f"the flight ended early: {session.ended}"
        print(f"gibbs-codegen: {printable(words, 400)}", file=sys.stderr)
    return int(session.failed)


def _link(machine: Machine, options: argparse.Namespace, rate: float | None) -> AutopilotLink:
    """The link to the autopilot that the options ask for; `rate` is the scenario's, Hz."""
    of = (machine.rotors, machine.joints, options.host, options.instance, options.timeout)
    if options.autopilot == "ardupilot":
        return ArduPilot(*of)
    if options.autopilot == "betaflight":
        sticks = _sticks(options.sticks) if options.sticks else None
        return Betaflight(machine, options.host, options.timeout, rate or BETAFLIGHT_RATE, sticks)
    return PX4(*of, rate or PX4_RATE)


def _sticks(path: str) -> Sticks:
    """The sticks of a table in a file; raises `UsageError` where it is none."""
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        words = (
            cause_of(error) if isinstance(error, OSError) else "is not UTF-8 text; save it as UTF-8"
        )
        raise UsageError(f"--sticks: {printable(path)}: {words}") from None
    return sticks_of(text, f"--sticks: {printable(path)}")
