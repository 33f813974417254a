"""Flights under stand-ins for autopilots: what goes over the wire, and what goes wrong there."""

from __future__ import annotations

import hashlib
import json
import os
import re
import signal
import socket
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from support.autopilot import Pilot, Sensed, fly_as_ardupilot, fly_as_px4
from support.command import run
from support.tools import HANGING

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.autopilots.ardupilot import ArduPilot
from gibbs_codegen.flight.autopilots.machine import Machine
from gibbs_codegen.flight.autopilots.px4 import PX4
from gibbs_codegen.flight.autopilots.session import Session, fly
from gibbs_codegen.flight.record.flight import read_flight
from gibbs_codegen.flight.scenario.file import read_scenario

Load = Callable[[str], ModuleType]
ARM = "quadrotor_arm_2link"
HOST = "127.0.0.1"
# Instances of this worker's tests; others run side by side.
_WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
NUMBERS = iter(range(100 + 200 * _WORKER, 300 + 200 * _WORKER))
PLACE = (0.4, -0.3, -2.2)
SWING = {"moves_deg": {"upper_arm": [{"to": 40.0, "duration": 1.0, "begin": 0.5}]}}


@contextmanager
def beside(what: Callable[[], Any]) -> Iterator[list[Any]]:
    """Run something beside, and have what it returns, or raises, after it has ended."""
    found: list[Any] = []

    def run_it() -> None:
        try:
            found.append(what())
        except OSError as error:
            found.append(error)

    thread = threading.Thread(target=run_it)
    thread.start()
    try:
        yield found
    finally:
        thread.join(HANGING)
        assert not thread.is_alive()


def machine(load: Load, **changes: Any) -> Machine:
    return Machine(load(ARM), read_scenario("hover", {"duration": 5} | changes))


def link(kind: type[ArduPilot | PX4], timeout: float = HANGING) -> tuple[Any, tuple[str, int]]:
    """A link, and the address at which it is."""
    number = next(NUMBERS)
    port = 4560 + number if issubclass(kind, PX4) else 9002 + 10 * number
    return kind(4, 2, HOST, number, timeout), (HOST, port)


class Patient(PX4):
    """It waits for each answer, so that flights begin alike on machines that are busy."""

    def _take(self, timeout: float) -> bool:
        return super()._take(timeout if self._controls is not None else HANGING)


def flown(
    load: Load, kind: type[PX4], late: int, steps: int = 1000, **changes: Any
) -> tuple[Machine, list[Any], Session]:
    """A flight under a stand-in for PX4 that leaves the first readings without an answer."""
    made, address = link(kind)
    found = machine(load, **changes)
    # How many readings it answers before it flies depends on how busy the machine is.
    with beside(lambda: fly_as_px4(address, Pilot(PLACE), 10 * steps, late=late)) as told:
        session = fly(found, made, steps / 250, 0.0)
    return found, told[0], session


@pytest.mark.slow
def test_a_stand_in_flies_to_a_place_and_two_flights_are_the_same(fast: Load) -> None:
    digests = []
    for _ in range(2):
        found, _, session = flown(fast, Patient, 0, arm=SWING)
        assert (session.ended, session.failed, session.notes) == ("", False, [])
        q = found.simulation.q
        # East and north of the world are to be 0.3 m less and 0.4 m more, while the arm swings.
        assert q[:3] == pytest.approx([-0.3, 0.4, 2.2], abs=0.25)
        assert np.degrees(q[7:]) == pytest.approx([40.0, 0.0], abs=1.0)
        flight = found.simulation.flight()
        digests.append(hashlib.sha256(flight.q.tobytes() + flight.applied.tobytes()).digest())
    assert digests[0] == digests[1]


def test_ardupilot_is_told_the_time_after_its_outputs_and_has_32_channels(fast: Load) -> None:
    made, address = link(ArduPilot)
    found = machine(fast)
    with beside(lambda: fly_as_ardupilot(address, Pilot(PLACE), 20, 400, 32)) as told:
        session = fly(found, made, 0.05, 0.0)
    assert not session.failed
    assert [each.time for each in told[0]] == pytest.approx(np.arange(21) / 400)


def test_channels_of_ardupilot_move_motors_and_joints(fast: Load) -> None:
    scenario = read_scenario("hover", {"duration": 5, "control": {"frequency": 15.0}})
    found = Machine(fast(ARM), scenario, servos=True)
    made, address = link(ArduPilot)

    def hold(seen: Sensed) -> list[float]:
        return [0.43] * 4

    with beside(lambda: fly_as_ardupilot(address, hold, 250, 250, 16, (1750, 0))):
        fly(found, made, 1.0, 0.0)
    assert np.degrees(found.simulation.q[7:]) == pytest.approx([50.0, 0.0], abs=0.5)
    assert found.simulation.flight().applied[-1, :4] == pytest.approx(0.43 * 14.0)


def test_px4_has_its_messages_at_their_rates_and_its_clock_runs(fast: Load) -> None:
    found, messages, _ = flown(fast, PX4, 3, 500)
    by_kind: dict[str, list[Any]] = {}
    for message in messages:
        by_kind.setdefault(message.get_type(), []).append(message)
    counts = {kind: len(each) for kind, each in by_kind.items()}
    assert set(counts) == {"HEARTBEAT", "HIL_SENSOR", "HIL_GPS", "HIL_STATE_QUATERNION"}
    times = np.array([each.time_usec for each in by_kind["HIL_SENSOR"]])
    assert np.all(np.diff(times) == 4000)
    # Until the first outputs it rests in its start, and only the clock runs.
    assert len(times) >= 504
    assert counts["HIL_GPS"] == pytest.approx(0.02 * len(times), abs=1)
    assert counts["HIL_STATE_QUATERNION"] == pytest.approx(0.2 * len(times), abs=1)
    first, fix = by_kind["HIL_SENSOR"][0], by_kind["HIL_GPS"][0]
    # Held 2 m above the origin, which is 488 m above the sea, its x to the east.
    assert fix.lat == 473977420
    assert fix.lon == 85455940
    assert fix.alt == 490000
    assert first.pressure_alt == pytest.approx(490.0)
    assert first.abs_pressure == pytest.approx(
        1013.25 * (1 - 2.25577e-5 * 490.0) ** 5.2559, rel=1e-4
    )
    field = (0.48 * np.cos(np.radians(64)), np.radians(3.0), 0.48 * np.sin(np.radians(64)))
    north, east = field[0] * np.cos(field[1]), field[0] * np.sin(field[1])
    assert (first.xmag, first.ymag, first.zmag) == pytest.approx((east, -north, field[2]), abs=1e-6)
    assert found.time == pytest.approx(2.0)


@pytest.mark.parametrize("kind", [ArduPilot, PX4])
def test_an_autopilot_that_does_not_come(kind: type[ArduPilot | PX4], fast: Load) -> None:
    made, _ = link(kind, 0.1)
    session = fly(machine(fast), made, 1.0)
    assert session.failed
    assert "within 0.1 s; start" in session.ended
    assert "--timeout" in session.ended


@pytest.mark.parametrize("kind", [ArduPilot, PX4])
def test_a_port_in_use(kind: type[ArduPilot | PX4]) -> None:
    made, (_, port) = link(kind)
    try:
        with pytest.raises(UsageError, match=rf"port {port} of .* in use; .* --instance"):
            kind(4, 2, HOST, port - 4560 if kind is PX4 else (port - 9002) // 10)
    finally:
        made.close()


def test_an_autopilot_that_falls_silent(fast: Load) -> None:
    made, address = link(ArduPilot, 2.0)
    found = machine(fast)
    with beside(lambda: fly_as_ardupilot(address, Pilot(PLACE), 10)):
        session = fly(found, made, 1.0, 0.0)
    assert session.failed
    assert "no more packets came" in session.ended


@pytest.mark.parametrize(
    ("silent", "words"),
    # What it has not read when it goes is a broken connection to the system.
    [(False, "PX4 closed|connection to PX4 broke"), (True, "PX4 has been silent")],
)
def test_px4_goes_or_falls_silent(silent: bool, words: str, fast: Load) -> None:
    made, address = link(PX4)
    flown = threading.Event()

    def come() -> None:
        fly_as_px4(address, Pilot(PLACE), 10, watch=stay if silent else lambda message: None)

    def stay(message: Any) -> None:
        if message.get_type() == "HIL_SENSOR":
            made._timeout = 0.3  # Once it flies: a busy machine takes long to begin.
            if message.time_usec >= 13 * 4000:
                flown.wait(HANGING)  # The connection stays until the other side has given up.

    with beside(come):
        try:
            session = fly(machine(fast), made, 1.0, 0.0)
        finally:
            flown.set()
    assert session.failed
    assert re.search(words, session.ended)


def test_packets_that_are_lost_repeated_foreign_or_garbage(fast: Load) -> None:
    made, address = link(ArduPilot)
    found = machine(fast)

    def talk() -> list[float]:
        own, other = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        times = []
        with own, other:
            own.settimeout(HANGING)
            for _ in range(2):  # Well formed, and first; but its number does not count on.
                other.sendto(struct.pack("<HHI16H", 18458, 100, 7, *[1900] * 16), address)
            for number in (1, 2, 2, 5):
                packet = struct.pack("<HHI16H", 18458, 100, number, *[1400] * 16)
                own.sendto(packet, address)
                times.append(json.loads(own.recv(4096))["timestamp"])
                other.sendto(packet, address)
                own.sendto(b"hello", address)
                own.sendto(packet[:-1], address)
            own.sendto(struct.pack("<HHI16H", 18458, 100, 6, *[60000] * 16), address)
            own.sendto(struct.pack("<HHI16H", 18458, 100, 1, *[1400] * 16), address)
        return times

    with beside(talk) as times:
        session = fly(found, made, 1.0, 0.0)
    assert times[0] == pytest.approx([0.0, 0.01, 0.01, 0.02])
    assert "ArduPilot restarted (packet 1 after 5); restart this command too" in session.ended
    assert session.notes == [
        "2 of the packets of ArduPilot were lost",
        "9 of the packets were not ArduPilot's",
        "6 of the packets came from another program, or from one that had restarted, "
        "and were ignored",
    ]


@pytest.mark.slow
def test_a_second_client_and_garbage_do_not_disturb_px4(fast: Load) -> None:
    made, address = link(PX4)
    found, others = machine(fast), []

    def disturb(message: Any) -> None:
        if message.get_type() == "HIL_SENSOR" and message.time_usec == 100 * 4000:
            others.append(socket.create_connection(address))

    with beside(lambda: fly_as_px4(address, Pilot(PLACE), 3000, watch=disturb)):
        session = fly(found, made, 1.2, 0.0)
    with others[0] as other:
        other.settimeout(HANGING)
        assert other.recv(100) == b""
    assert (session.ended, session.notes) == (
        "",
        ["1 of the connections were refused"],
    )


def test_the_flight_ends_in_words_when_it_cannot_go_on(fast: Load) -> None:
    """Attitude angles have a singularity."""
    number = next(NUMBERS)
    made = ArduPilot(6, 0, HOST, number, HANGING)
    scenario = read_scenario("hover", {"duration": 5, "motors": {"limits": [0, 20]}})
    found = Machine(fast("hexarotor"), scenario)
    v = np.zeros(6)
    v[found.vehicle.layout.middle_angle] = 3.0
    found.simulation.reset(None, v)
    none, address = [0.0] * 6, (HOST, 9002 + 10 * number)
    with beside(lambda: fly_as_ardupilot(address, lambda seen: none, 250)):
        session = fly(found, made, 1.0, 0.0)
    assert session.failed
    assert "the attitude reaches the singularity" in session.ended


def test_the_command_writes_what_simulate_writes(shipped: Load, tmp_path: Path) -> None:
    folder = str(Path(shipped(ARM).__file__ or "").parent)
    number = next(NUMBERS)
    words = ["sitl", folder, "--ardupilot", "--instance", str(number), "--speed", "0"]
    words += ["--set", "duration=0.2", "--no-figures", "--out", "flown"]
    with beside(lambda: fly_as_ardupilot((HOST, 9002 + 10 * number), Pilot(PLACE), 50)):
        done = run(*words, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert f"flown: {ARM} flew 'hover' for 0.2 s under ArduPilot, " in done.stdout
    assert read_flight(tmp_path / "flown" / "flight.npz").time[-1] == pytest.approx(0.2)


@pytest.mark.slow
def test_ctrl_c_ends_the_flight_and_its_record_is_written(shipped: Load, tmp_path: Path) -> None:
    folder = str(Path(shipped(ARM).__file__ or "").parent)
    number, pilot = next(NUMBERS), Pilot(PLACE)

    def fly_and_end() -> None:
        fly_as_ardupilot((HOST, 9002 + 10 * number), pilot, 50)
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)

    words = ["sitl", folder, "--ardupilot", "--instance", str(number), "--speed", "0"]
    # What runs in the background of a shell ignores it.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with beside(fly_and_end):
            done = run(*words, "--no-figures", "--out", "flown", cwd=tmp_path)
    finally:
        signal.signal(signal.SIGINT, before)
    assert done.returncode == 0, done.stderr
    assert done.stderr.endswith("Ctrl-C ended it at t = 0.2 s\n")
    assert read_flight(tmp_path / "flown" / "flight.npz").time[-1] == pytest.approx(0.2)
