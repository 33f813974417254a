"""Betaflight's real firmware flies the machine; and what goes over its wire."""

from __future__ import annotations

import math
import os
import re
import socket
import struct
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from filelock import FileLock
from support.betaflight import SETTINGS, configure, firmware, flying
from support.command import run
from support.kept import kept_folder, made_once
from support.pages import blocks, run_python, write_files
from support.tools import HANGING

from gibbs_codegen import load
from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.autopilots.betaflight import Betaflight, sticks_of
from gibbs_codegen.flight.autopilots.machine import Machine, Telemetry
from gibbs_codegen.flight.autopilots.session import fly
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.file import parse_robot, read_robot

Load = Callable[[str], ModuleType]
ARM = "quadrotor_arm_2link"
PAGE = "docs/start/autopilot.md"
# Legs that are longer than the arm, which hangs down.
FEET = {
    "foot_front_left": [0.3, 0.3, -0.6],
    "foot_front_right": [0.3, -0.3, -0.6],
    "foot_rear_left": [-0.3, 0.3, -0.6],
    "foot_rear_right": [-0.3, -0.3, -0.6],
}
FLOOR = {
    "kind": "plane",
    "frame": [*FEET],
    "point": [0, 0, 0],
    "normal": [0, 0, 1],
    "stiffness": 4000.0,
    "damping": 40.0,
    "friction": 0.6,
}
# When it is armed, takes off, is turned by rates, is to land, and the flight ends, s.
ARMED, OFF, TURNED, DOWN, END = 2.0, 2.5, 7.0, 13.0, 20.0
PERIOD, RATE = 2.0, 40.0
# States before the first step at 100 a second: to know its loop, for 2 s, and the last.
ANSWERED = 5 + 200 + 1
SWING = [
    {"to": math.degrees((-1.0) ** k), "duration": 0.95, "begin": TURNED - 1.0 + k} for k in range(7)
]
SWING.append({"to": 0.0, "duration": 0.9, "begin": DOWN})


@pytest.fixture(autouse=True)
def _alone(shared: Path) -> Iterator[None]:
    """The firmware's ports are always the same, so that one test has them at a time."""
    with FileLock(shared / "betaflight.lock"):
        yield


def wanted_rate(time: float) -> float:
    """The roll rate that is commanded, degrees/s: to the right, twice as long back, and again."""
    if not TURNED <= time < DOWN:
        return 0.0
    phase = (time - TURNED) % PERIOD
    return RATE if phase < PERIOD / 4 or phase >= 3 * PERIOD / 4 else -RATE


class Pilot:
    """Takes off to a height, commands rates of roll, and lands, by the sticks alone."""

    def __init__(self) -> None:
        self.seen: list[tuple[float, ...]] = []
        self.lift = 0.0

    def __call__(self, told: Telemetry) -> list[float]:
        """Roll, pitch, throttle, yaw, arming and holding of the attitude, µs."""
        time, up, climb = told.time, -told.position[2] - 0.6, -told.velocity[2]
        self.seen.append((time, math.degrees(told.gyro[0]), up))
        arming = 2000 if time > ARMED else 1000
        if time < OFF or (time > DOWN and up < 0.03):
            return [1500, 1500, 1000, 1500, arming if time < DOWN else 1000, 2000]
        height = 4.0 if time < DOWN else max(4.0 - (time - DOWN), -0.3)
        wanted = max(-0.8, min(1.5, 1.0 * (height - up)))
        self.lift += 0.01 * 0.05 * (wanted - climb)
        w, x, y, z = told.quaternion
        tilt = 1.0 - 2.0 * (x * x + y * y)
        throttle = 1000 + 1000 * (0.43 + 0.12 * (wanted - climb) + self.lift) / max(tilt, 0.5)
        if TURNED <= time < DOWN:
            return [1500 + 500 * wanted_rate(time) / 200, 1500, throttle, 1500, arming, 1000]
        yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        ahead = math.cos(yaw) * told.velocity[0] + math.sin(yaw) * told.velocity[1]
        right = -math.sin(yaw) * told.velocity[0] + math.cos(yaw) * told.velocity[1]
        lean = [500 / 60 * max(-15.0, min(15.0, 8.0 * each)) for each in (-right, -ahead)]
        return [1500 + lean[0], 1500 + lean[1], throttle, 1500, arming, 2000]


@pytest.fixture(scope="module")
def lander(_kept_folders: None) -> ModuleType:
    """The quadrotor with an arm, and feet."""
    _, text = read_robot(ARM)
    for name, place in FEET.items():
        text += f'\n[[frame]]\nname = "{name}"\non = "base"\nxyz = {place}\n'
    robot, modules = parse_robot(text), kept_folder(text)
    made = made_once(
        modules / robot.name, lambda: generate_robot(robot, text, modules, verify=False)
    )
    return load(made, backend="c")


@pytest.fixture(scope="module")
def program(pytestconfig: pytest.Config, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The firmware."""
    cache = pytestconfig.cache
    return firmware(cache.mkdir("betaflight") if cache else tmp_path_factory.mktemp("betaflight"))


@pytest.mark.slow
@pytest.mark.alone
def test_the_firmware_takes_off_holds_rates_and_lands(
    lander: ModuleType, program: Path, tmp_path: Path
) -> None:
    changes: dict[str, Any] = {
        "duration": END,
        "base": {"path": {"kind": "fixed", "position": [0, 0, 0.6]}},
        "start": {"settled": True},
        "wall": [FLOOR],
        "arm": {"moves_deg": {"upper_arm": SWING}},
        "control": {"rate": 500, "frequency": 12.0},
        "integration": {"step": 0.0005},
    }
    configure(program, tmp_path, SETTINGS)
    # Its clock is its own, and goes unevenly where the machine is busy: then it is flown again.
    for _ in range(3):
        machine, pilot = Machine(lander, read_scenario("hover", changes)), Pilot()
        with flying(program, tmp_path):
            session = fly(machine, Betaflight(machine, "127.0.0.1", 10.0, 500.0, pilot), END)
        if not session.failed:  # Else the machine was too busy for it to answer in time.
            time, rate, height = np.transpose(pilot.seen)
            wanted = np.array([wanted_rate(each) for each in time])
            # Rates take some time to change; afterwards they are held.
            before = np.array([wanted_rate(each - 0.25) for each in time])
            held = (time > TURNED + 0.25) & (time < DOWN) & (before == wanted)
            if np.abs(rate - wanted)[held].mean() < 0.05 * RATE:
                break
    else:
        if os.getloadavg()[0] > (os.cpu_count() or 1):
            pytest.skip("Betaflight's clock needs a machine that is free")
        pytest.fail("rates were not held within 5 %, or the firmware went silent")
    flight = machine.simulation.flight()
    # It has swung by an angle of 1 to either side.
    swung = flight.q[(flight.time > TURNED) & (flight.time < DOWN), 7]
    assert (swung.min(), swung.max()) == pytest.approx((-1.0, 1.0), abs=0.02)
    assert height[time < OFF] == pytest.approx(0.0, abs=0.01)
    assert height[np.argmin(np.abs(time - TURNED))] == pytest.approx(4.0, abs=0.5)
    assert height[-1] == pytest.approx(0.0, abs=0.01)
    assert machine.simulation.v == pytest.approx(np.zeros(8), abs=0.02)


@pytest.mark.slow
@pytest.mark.alone
def test_the_page_leads_from_a_urdf_to_a_hover(
    program: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    write_files(PAGE, tmp_path)
    for command in re.findall(r"^gibbs-codegen (.*)$", blocks(PAGE, "sh")[0], re.MULTILINE):
        assert run(*command.split(), cwd=tmp_path).returncode == 0
    with flying(program, tmp_path):
        run_python("docs/start/autopilot.md", slice(1))
    with flying(program, tmp_path):
        flight = run_python(PAGE, slice(1, None))["flight"]
    assert blocks(PAGE, "text")[-1] in capsys.readouterr().out
    assert flight.q[flight.time < 1.5, 2] == pytest.approx(0.35, abs=0.01)
    assert -1.0 < flight.q[-1, 0] < -0.02
    assert Path("hover", "coordinates.png").is_file()


class Patient(Betaflight):
    """It waits for motors until it knows that the loop runs, so that flights begin alike."""

    def _take(self, timeout: float) -> bool:
        return super()._take(HANGING if self._answers < 5 else timeout)


def told_and_sent(machine: Machine, motors: list[float], steps: int = 3) -> tuple[Any, ...]:
    """The last state and sticks that a stand-in for the firmware is told, which sends motors."""
    wires = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(3)]
    state, sticks, out = wires
    state.bind(("127.0.0.1", 9003))
    sticks.bind(("127.0.0.1", 9004))
    for each in wires:
        each.settimeout(HANGING)
    found: list[Any] = []

    def answer() -> None:
        for _ in range(ANSWERED + steps):
            found.append(struct.unpack("<18d", state.recv(4096)))
            out.sendto(struct.pack("<4f", *motors), ("127.0.0.1", 9002))
        found.append(struct.unpack("<d16H", sticks.recv(4096)))

    thread = threading.Thread(target=answer)
    thread.start()
    link = Patient(machine, "127.0.0.1", HANGING, 100.0, lambda told: [1501, 1502, 1503, 1504])
    session = fly(machine, link, steps / 100.0, 0.0)
    thread.join()
    for each in wires:
        each.close()
    assert not session.failed, session
    return (*found[-2:],)


@pytest.mark.parametrize(
    ("place", "rotor"),
    [
        (0, "front_right"),
        pytest.param(1, "rear_left", marks=pytest.mark.slow),
        pytest.param(2, "front_left", marks=pytest.mark.slow),
    ],
)
def test_motors_in_the_order_of_the_firmware(place: int, rotor: str, fast: Load) -> None:
    """It sends motors 2, 3, 4 and 1: at the right in front, the left behind, and across."""
    machine = Machine(fast(ARM), read_scenario("hover", {"motors": {"time_constant": 0.0}}))
    shares = [0.2] * 4
    shares[place] = 0.6
    told_and_sent(machine, shares)
    applied = machine.simulation.flight().applied[-1, :4]
    names = machine.vehicle.inputs[:4]
    assert names[int(np.argmax(applied))] == f"F_{rotor}"


def test_the_state_in_the_axes_of_the_firmware(fast: Load) -> None:
    """What its source makes of a packet: all accelerations and the rates but roll change sign."""
    machine = Machine(fast(ARM), read_scenario("hover", {}))
    turn = [math.sin(0.1), 0.0, 0.0, math.cos(0.1)]  # To the right, about forwards, by 0.2.
    machine.simulation.reset([1.0, 2.0, 3.0, *turn, 0.0, 0.0], [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0, 0])
    state, sticks = told_and_sent(machine, [0.0] * 4, 1)
    told, *rates = state[:4]
    assert told == pytest.approx(0.01 * (ANSWERED + 1))
    # Forwards, left, up: nose down and to the left are positive in the firmware.
    assert [rates[0], -rates[1], -rates[2]] == pytest.approx([0.4, 0.5, 0.6], abs=0.05)
    w, x, y, z = state[7:11]
    assert math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)) == pytest.approx(
        0.2, abs=0.02
    )
    east, north, up = state[11:14]
    assert [east, north] == pytest.approx(
        [0.1, 0.2 * math.cos(0.2) - 0.3 * math.sin(0.2)], abs=0.01
    )
    assert up == pytest.approx(0.2 * math.sin(0.2) + 0.3 * math.cos(0.2) - 0.0981, abs=0.02)
    longitude, latitude, altitude = state[14:17]
    assert longitude > 8.545594
    assert latitude > 47.397742
    assert altitude == pytest.approx(491.0, abs=0.1)
    assert sticks[1:5] == (1501, 1502, 1503, 1504)


def test_a_firmware_whose_loop_does_not_run_is_told_in_words(fast: Load) -> None:
    """Such a one still answers its first state."""
    machine = Machine(fast(ARM), read_scenario("hover", {}))
    link = Betaflight(machine, "127.0.0.1", 0.3)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        out.sendto(struct.pack("<4f", 0.0, 0.0, 0.0, 0.0), ("127.0.0.1", 9002))
    session = fly(machine, link, 1.0)
    assert session.failed
    assert "stopped after 1 motor packet(s)" in session.ended
    assert "restart it" in session.ended


def test_a_firmware_that_dies_before_the_flight(fast: Load) -> None:
    """It ends when motors have been late for the timeout, not once each state was waited for."""
    machine = Machine(fast(ARM), read_scenario("hover", {}))
    link = Patient(machine, "127.0.0.1", 0.5)

    def answer() -> None:
        for _ in range(5):
            wire.recv(4096)
            wire.sendto(struct.pack("<4f", 0.0, 0.0, 0.0, 0.0), ("127.0.0.1", 9002))

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
        wire.bind(("127.0.0.1", 9003))
        wire.settimeout(HANGING)
        thread = threading.Thread(target=answer)
        thread.start()
        session = fly(machine, link, 1.0)
        thread.join()
    assert "silent for 0.5 s" in session.ended
    assert machine.time == 0.0
    assert link._step < 20  # Of 200 states before a flight.


def test_senses_of_rotors_that_the_firmware_does_not_have_are_told(
    fast: Load, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine = Machine(fast(ARM), read_scenario("hover", {}))
    wrenches = machine.vehicle.thrust_wrenches()
    for factors, words in (
        ([1, 1, 1, 1], ""),
        ([-1, -1, -1, -1], "yaw_motors_reversed = ON"),
        ([1, 1, -1, -1], "cannot control the yaw"),
        ([0, 0, 0, 0], "cannot control the yaw"),
    ):
        turning = wrenches.copy()
        turning[5] *= factors
        monkeypatch.setattr(type(machine.vehicle), "thrust_wrenches", lambda _, x=turning: x)
        link = Betaflight(machine, "127.0.0.1")
        link.close()
        assert words in " ".join(link.notes)
        assert bool(words) == bool(link.notes)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("0,1500,1000\n1,1500", r"t\.csv:2: must have 3 numbers"),
        ("# time\ntime,roll\n", r"t\.csv:2: must be numbers .* not time,roll"),
        ("0,1500\n\n0,1600", r"t\.csv:3: its time must be after"),
        ("nan,1500", r"t\.csv:1: its time"),
        ("0,1500,nan", r"t\.csv:1: channel 2: must be a pulse width from 500 to 2500 µs, not nan"),
        ("0,0.5", r"channel 1: must be a pulse width .* not 0\.5"),
        ("0", r"1 to 16 channels, not 0"),
        ("", r"t\.csv: is empty; give lines"),
    ],
)
def test_sticks_that_cannot_be_meant(table: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        sticks_of(table, "t.csv")


def test_sticks_are_linear_between_lines(fast: Load) -> None:
    at = Machine(fast(ARM), read_scenario("hover", {})).readings()
    sticks = sticks_of("0,1000,1500\n\n2,2000,1500", "t.csv")
    assert sticks(at._replace(time=0.5)) == [1250, 1500]


@pytest.mark.slow
def test_machines_that_the_firmware_does_not_fly(fast: Load) -> None:
    hexarotor = Machine(fast("hexarotor"), read_scenario("hover", {"motors": {"limits": [0, 20]}}))
    with pytest.raises(UsageError, match=r"hexarotor: .* four rotors as an X"):
        Betaflight(hexarotor, "127.0.0.1")
    machine = Machine(fast(ARM), read_scenario("hover", {}), servos=True)
    with pytest.raises(UsageError, match=r"--joints: .* no servo outputs"):
        Betaflight(machine, "127.0.0.1")
    with pytest.raises(UsageError, match=r"control\.rate: .* more than 50"):
        Betaflight(machine, "127.0.0.1", rate=50.0)
