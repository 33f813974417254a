"""`simulate`: fly a scenario with a module, and write time series and figures."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence

import numpy as np

from gibbs_codegen.cli import robot_argument, terminal
from gibbs_codegen.errors import printable
from gibbs_codegen.files.toml import changes_of
from gibbs_codegen.flight.figures.results import check_results, drawing_beside, write_results
from gibbs_codegen.flight.record.extent import led_points
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.parts import PREDICTIVE, Control, Impedance, functions_for
from gibbs_codegen.flight.scenario.walls import Wall
from gibbs_codegen.machine.filters import CALLED
from gibbs_codegen.runtime.c_library import seconds_waited
from gibbs_codegen.runtime.load import load
from gibbs_codegen.runtime.predictive import DERIVATIVES, UNDER_WRENCHES

# Limits that the terminal shows of those that a timing reaches.
_MOST_LIMITS = 12
# Impacts that it shows.
_MOST_IMPACTS = 3
# The most inputs that are named; the share of a limit that is too little to have left it.
_MOST_NAMES = 12
_ROUND_OFF = 1e-9
# Share of a wanted force from which on it counts as reached.
_REACHED = 0.9
# Compiling that is not worth a word, s.
_SHORT = 0.2
# How far joints may be beyond their limits, rad or m, by errors of integration.
_INTEGRATION = 1e-5


@terminal.ended_by_signals()
def run(options: argparse.Namespace) -> int:
    """Fly the scenario, write the results, and print what is to be said of the flight."""
    chosen = options.scenario or robot_argument.usual_scenario(options.robot)
    scenario = read_scenario(chosen, changes_of(options.set))
    check_results(options.out, options.animate or "")
    # Late: refusals appear at once.
    from gibbs_codegen.flight.simulation import check_scenario, simulate

    control = scenario.control
    plans = control.law == PREDICTIVE
    planned = (*DERIVATIVES, *UNDER_WRENCHES) if plans else ()
    derivatives = (*planned, *(CALLED if control.estimate else ()))
    functions = functions_for(bool(scenario.holds), [control.law])
    with (
        robot_argument.found_module(
            *(options.robot, terminal.progress(), derivatives, functions),
            check=lambda robot: check_scenario(robot, scenario),
        ) as (folder, _),
        drawing_beside(options.format) as workers,
        terminal.progress_bar() as progress,
    ):
        start = time.perf_counter()
        robot = folder if options.backend == "c" else load(folder, options.backend)
        flight = simulate(robot, scenario, progress=progress)
        compiled = seconds_waited(start)
        flown = time.perf_counter() - start - compiled
        written = options.out, True, options.animate or "", progress, options.format, workers
        write_results(flight, *written)
    moved, noun = ("flew", "flight") if flight.rotors else ("moved by", "motion")
    print(
        f"{printable(options.out)}: {flight.robot} {moved} {flight.scenario!r} for "
        f"{flight.time[-1]:.4g} s, computed in {flown:.1f} s"
        + (f", after {compiled:.1f} s of compiling\n" if compiled > _SHORT else "\n")
        + f"control law: {flight.law}\n"
        f"largest errors: {_errors(flight, slice(None))}, "
        f"energy balance {max(abs(flight.energy_error)):.2g} J\n"
        f"errors at the end: {_errors(flight, slice(-1, None))}"
    )
    for line in (_attitude(flight), _battery(flight), _outside(flight), estimation(flight)):
        print(line, end="\n" if line else "")
    print_events(flight, scenario.walls)
    if unreached := _unreached(flight, scenario.control):
        print(f"note: {unreached}")
    if flight.timing:
        print(f"timing: {printable(flight.timing)}")
    times = flight.binding_times[:_MOST_LIMITS]
    for (begin, end), limit in zip(times, flight.binding, strict=False):
        print(f"  {begin:7.3f} to {end:7.3f} s: {limit}")
    if more := len(flight.binding) - len(times):
        print(f"  and {more} more: see `binding` in {printable(options.out)}/flight.npz")
    if flight.stopped:
        print(f"gibbs-codegen: the {noun} ended early: {flight.stopped}", file=sys.stderr)
        return 1
    return 0


def print_events(flight: Flight, walls: Sequence[Wall]) -> None:
    """Print what walls felt, what collided, and what reached its limits, of a flight."""
    for k, (wall, forces) in enumerate(zip(walls, flight.wall_forces.T, strict=True), start=1):
        # NaN, after control was lost, is not the greatest.
        most = max(range(len(forces)), key=lambda sample: (forces[sample] >= 0.0, forces[sample]))
        words = f"at most {forces[most]:.3g} N, at t = {flight.time[most]:.4g} s; "
        words += f"{forces[-1]:.3g} N at the end"
        on = printable(", ".join(wall.frames))
        print(f"wall {k}, on {on}: {words if forces.any() else 'not touched'}")
    impacts = flight.impact_summaries
    for words in (*flight.hold_summaries, *impacts[:_MOST_IMPACTS]):
        print(printable(words, 400))
    if more := len(impacts[_MOST_IMPACTS:]):
        print(f"and {more} more impacts: see `impacts` of the flight")
    if collisions := collisions_of(flight):
        print(f"collisions: {printable(collisions, 400)}")
    if limits := reached_limits(flight):
        print(f"at their limits: {printable(limits, 400)}")
    if joints := joints_beyond(flight):
        print(f"beyond their limits: {printable(joints, 400)}")
    for note in flight.notes:
        print(f"note: {note}")


def _unreached(flight: Flight, control: Control) -> str:
    """That a frame never felt the force with which it was to push; "" where it did, or need not."""
    push, frame = control.force, (control.impedance or Impedance()).frame
    if push is None or flight.time[-1] < push.begin + push.rise:
        return ""
    during = (flight.time >= push.begin) & (flight.time <= push.end)
    felt = np.linalg.norm(flight.frame_wrench(frame)[during, :3], axis=1)
    most = np.fmax.reduce(felt, initial=0.0)  # What is not a number, is so after control was lost.
    if most >= _REACHED * push.value:
        return ""
    return (
        f"{printable(frame)} should push with {push.value:.3g} N but reaches at most {most:.3g} N; "
        "move its path nearer to the wall, or fly longer"
    )


def _errors(flight: Flight, samples: slice) -> str:
    """The largest errors of what is led and of joints, with the joints that have them.

    Such as "base centre 0.02 m, tip 0.01 m, joint theta_8 0.003 rad".
    """
    led = led_points(flight).items()
    clauses = [f"{name} {max(point.error[samples]):.2g} m" for name, point in led]
    joints, rates = flight.layout.q.joints, flight.layout.v.joints
    errors = abs(flight.errors[samples, rates]).max(axis=0)
    named = zip(errors, flight.coordinates[joints], flight.coordinate_units[joints], strict=True)
    driven = np.any(flight.input_limits[:, flight.rotors :][:, : len(errors)], axis=0).tolist()
    # A joint that nothing drives follows no motion.
    of = [joint for joint, has_effort in zip(named, driven, strict=True) if has_effort]
    for unit in sorted({unit for _, _, unit in of}):
        error, joint = max((error, joint) for error, joint, its_unit in of if its_unit == unit)
        clauses.append(f"joint {joint} {error:.2g} {unit}")
    return ", ".join(clauses)


def _attitude(flight: Flight) -> str:
    """Ranges of roll, pitch and yaw, degrees; "" where the base does not turn."""
    if not flight.layout.angle_axes and not flight.layout.is_quaternion:
        return ""
    angles = np.degrees(np.unwrap(flight.roll_pitch_yaw, axis=0)).round(2) + 0.0
    ends = zip(("roll", "pitch", "yaw"), angles.min(axis=0), angles.max(axis=0), strict=True)
    return "attitude: " + ", ".join(f"{n} {a:.3g} to {b:.3g}°" for n, a, b in ends)


def _battery(flight: Flight) -> str:
    """The battery's charge and power in a flight, and a full one's endurance; "" without one."""
    if not flight.battery.shape[1]:
        return ""
    (voltage, current), charge = flight.battery.T, flight.actuators[[0, -1], -1]
    used = charge[0] - charge[1]
    lasts = f"{flight.time[-1] / used / 60.0:.3g} min" if used > 0.0 else "for ever"
    return (
        f"battery: {100.0 * charge[0]:.4g} to {100.0 * charge[1]:.4g} %, at least "
        f"{voltage.min():.4g} V, at most {current.max():.4g} A and {max(voltage * current):.4g} "
        f"W; a full battery lasts {lasts} at this power"
    )


def estimation(flight: Flight) -> str:
    """How far estimates were off, and whether a filter knew so; "" of a flight without them."""
    off, layout = flight.estimate_errors, flight.layout
    if not off.size:
        return ""
    spread = flight.estimate_deviations[:, : off.shape[1]]
    units = np.array([*(unit for _, unit in layout.displacements), *layout.v.units])
    sizes = [f"{np.sqrt(np.mean(off[:, units == x] ** 2)):.2g} {x}" for x in dict.fromkeys(units)]
    inside = np.mean(np.abs(off) <= 2.0 * spread)
    pairs = zip(flight.innovation_names, flight.innovations.T, strict=True)
    innovations = [f"{name} {np.mean(x[x >= 0.0]):.2g}" for name, x in pairs if np.any(x >= 0.0)]
    words = f"; mean squared innovations (1 expected): {', '.join(innovations)}"
    return (
        f"estimates are off by {', '.join(sizes)} (RMS), {100.0 * inside:.3g} % by at most two "
        f"deviations{words if innovations else ''}"
    )


def _outside(flight: Flight) -> str:
    """The greatest force from outside on each frame, of wind, payloads, pushes and walls."""
    sizes = np.linalg.norm(flight.frame_wrenches[:, :, :3], axis=2).max(axis=0, initial=0.0)
    forces = [f"{n} {x:.3g} N" for n, x in zip(flight.frames, sizes, strict=False) if x > 0.0]
    return f"from outside, at most: {printable(', '.join(forces), 400)}" if forces else ""


def collisions_of(flight: Flight) -> str:
    """Say where links go through discs of rotors, or one of both behind walls, and when farthest.

    Such as "a link is 0.02 m behind wall 1 at t = 3 s"; empty if none does.
    """
    rotors = zip(flight.input_names, flight.rotor_distances.T, strict=False)
    distances = [("link", f"inside the rim of {name}", values) for name, values in rotors]
    either = "link or rotor" if np.any(flight.disc_radii) else "link"
    walls = enumerate(flight.wall_distances.T, 1)
    distances += [(either, f"behind wall {k}", values) for k, values in walls]
    clauses = []
    for subject, where, values in distances:
        finite = np.where(np.isnan(values), np.inf, values)
        sample = int(finite.argmin())
        if finite[sample] < 0.0:
            far, time = -finite[sample], flight.time[sample]
            clauses.append(f"a {subject} is {far:.3g} m {where} at t = {time:.3g} s")
    return "; ".join(clauses)


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
    scale = limits.max(axis=0)  # A joint that nothing drives has 0.
    share = over / np.where(scale > 0.0, scale, np.fmax(flight.weight, 1.0))
    least = np.where(low == high, _ROUND_OFF, -_ROUND_OFF)
    reached = np.flatnonzero((share >= least).any(axis=(0, 1)))
    if not len(reached):
        return ""
    side, sample, place = np.unravel_index(int(share.argmax()), share.shape)
    commanded = (flight.commanded_least, flight.commanded_greatest)[side][sample, place]
    numbers = commanded, flight.input_limits[side, place]
    command, limit = (f"{number + 0.0:.3g} {flight.input_units[place]}" for number in numbers)
    names = [flight.input_names[k] for k in reached[:_MOST_NAMES]]
    more = f" and {len(reached) - len(names)} more" if len(reached) > len(names) else ""
    past = share[side, sample, place] > _ROUND_OFF and command != limit
    words = f"was asked for {command} of {limit}" if past else f"reached {limit}"
    return (
        f"{', '.join(names)}{more} ({flight.input_names[place]} {words} "
        f"at t = {flight.time[sample]:.3g} s)"
    )


def joints_beyond(flight: Flight) -> str:
    """Name each joint that left its limits, with how far it went, and when.

    Such as "theta_8 came to 1.4 rad, beyond 1.2 rad, at t = 0.3 s"; empty if none did.
    """
    clauses = []
    joints = flight.layout.q.joints
    named = zip(flight.coordinates[joints], flight.coordinate_units[joints], strict=True)
    for (name, unit), (low, high), q in zip(
        named, flight.joint_limits.T, flight.q[:, joints].T, strict=False
    ):
        over = np.stack([low - q, q - high])
        over = np.where(np.isfinite(over), over, -np.inf)  # As above.
        side, sample = np.unravel_index(int(over.argmax()), over.shape)
        value, limit = (f"{number:.3g} {unit}" for number in (q[sample], (low, high)[side]))
        if over[side, sample] > _INTEGRATION and value != limit:
            at = f"at t = {flight.time[sample]:.3g} s"
            clauses.append(f"{name} came to {value}, beyond {limit}, {at}")
    return "; ".join(clauses)
