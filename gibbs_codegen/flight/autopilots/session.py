"""The loop of a flight under an autopilot: outputs in, a step, readings out, in step with it.

What is flown depends on what the autopilot sends alone, never on when: only how fast the loop goes
is by the clock of the machine that it runs on.
"""

from __future__ import annotations

import errno
import socket
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from gibbs_codegen.errors import GibbsCodegenError, UsageError, cause_of
from gibbs_codegen.flight.autopilots.machine import Machine, Outputs, Telemetry
from gibbs_codegen.flight.plant.sensors import SAME

# A note is on flights below this share of the speed asked for.
_SLOW = 0.95


class PeerError(GibbsCodegenError):
    """An autopilot that is not there, has gone, or does what cannot be followed."""

    exit_code = 1


class AutopilotLink(Protocol):
    """The messages to and from an autopilot; `name` is its own, `notes` are for the user."""

    name: str
    notes: list[str]

    def open(self, readings: Telemetry) -> None:
        """Wait until the autopilot is there, with the machine at rest in its start."""

    def receive(self) -> tuple[Outputs, float]:
        """Wait for outputs, and for how long they are to be flown, s.

        Raises `PeerError` where none come, or none that can be.
        """

    def send(self, readings: Telemetry) -> None:
        """Tell the autopilot what its sensors would."""

    def close(self) -> None:
        """Let the autopilot go."""


@dataclass
class Session:
    """The outcome of a flight: the reason for an early end, "" for none, and the speed of the run.

    `failed` tells whether it was meant to go on; `pace` is in seconds of flight for each second.
    """

    ended: str = ""
    failed: bool = False
    pace: float = 0.0
    notes: list[str] = field(default_factory=list)


def fly(
    machine: Machine,
    link: AutopilotLink,
    duration: float,
    speed: float = 1.0,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> Session:
    """Fly a machine under an autopilot, until the time is over or somebody ends it.

    Args:
        machine: What flies.
        link: The link to the autopilot, which is closed at the end.
        duration: How long, s.
        speed: Seconds that are flown in a second at most; 0 for as many as can be.
        progress: Called with the name of the work and the share done.

    Returns:
        What became of the flight, whose record is `machine.simulation.flight()`.
    """
    session = Session()
    begin = last = time.perf_counter()
    try:
        progress(f"waiting for {link.name}", 0.0)
        link.open(machine.readings())
        begin = time.perf_counter()
        while machine.time < duration - SAME:
            outputs, step = link.receive()
            machine.fly(outputs, min(step, duration - machine.time))
            last = time.perf_counter()
            if machine.simulation.stopped:
                session.ended, session.failed = machine.simulation.stopped, True
                break
            if speed > 0.0:
                ahead = begin + machine.time / speed - time.perf_counter()
                if ahead > 0.0:
                    time.sleep(ahead)
            link.send(machine.readings())
            progress("flying", machine.time / duration)
    except GibbsCodegenError as error:  # What was flown is kept.
        session.ended, session.failed = f"at t = {machine.time:.6g} s {error}", True
    except KeyboardInterrupt:
        session.ended = f"Ctrl-C ended it at t = {machine.time:.6g} s"
    finally:
        link.close()
    session.pace = machine.time / max(last - begin, SAME)
    session.notes = list(link.notes)
    if 0.0 < session.pace < _SLOW * speed:
        session.notes.append(
            f"flown at {session.pace:.3g} times real time, not {speed:g}: this machine or the "
            f"autopilot is slower"
        )
    return session


def counted(odd: Mapping[str, int]) -> list[str]:
    """Notes of what was counted, in words, if there was any."""
    return [f"{count} {event}" for event, count in odd.items() if count]


def opened(kind: socket.SocketKind, host: str, port: int) -> socket.socket:
    """A socket that is bound to a port; raises `UsageError` where that cannot be had."""
    made = socket.socket(socket.AF_INET, kind)
    try:
        if kind == socket.SOCK_STREAM:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind((host, port))
    except OSError as error:
        made.close()
        advice = "give an address of this machine as --host"
        if error.errno == errno.EADDRINUSE:
            advice = "another flight or simulator uses it; end that, or give another --instance"
        raise UsageError(f"port {port} of {host}: {cause_of(error)}; {advice}") from None
    return made
