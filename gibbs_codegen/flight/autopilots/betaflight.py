"""Betaflight's firmware as a program (SITL), over UDP: motors in, state and sticks out.

Its clock is its own. It runs as fast as the time that it was told last went beside that of the
machine, so that it keeps to the time of the flight as long as steps come evenly. To each state it
sends one packet of motors.
"""

from __future__ import annotations

import math
import socket
import struct
import time
from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.flight.autopilots.air import place_at, pressure_at
from gibbs_codegen.flight.autopilots.machine import Machine, Outputs, Telemetry
from gibbs_codegen.flight.autopilots.session import PeerError, counted, opened
from gibbs_codegen.flight.plant.vehicle import Array

# A pilot: pulse widths of up to 16 channels, µs, at what sensors tell.
Sticks = Callable[[Telemetry], Sequence[float]]

_MOTORS, _STATE, _RC = 9002, 9003, 9004
# Steps a second, if nothing else is said, and at least: it takes no time for slower ones.
BETAFLIGHT_RATE = 500.0
_LEAST_RATE = 50.0
_STATE_PACKET = struct.Struct("<18d")
_RC_PACKET = struct.Struct("<d16H")
_MOTOR_PACKET = struct.Struct("<4f")
# Rate of sticks, Hz, and how long motors may take to come, s, before the last ones hold.
_STICKS, _LATE = 100.0, 0.1
# States that are answered before its loop is known to run. It answers the first one in any case,
# also while it starts, and is not long without an answer once it has started, s.
_ANSWERS, _START = 5, 5.0
# How long the start and its sticks are sent before a flight, s: until it has calibrated its
# gyroscope, and is no more armed by the sticks of a flight before.
_HEARD = 2.0
# Pulse widths that can be meant, µs.
_WIDTHS = (500.0, 2500.0)
# Places of a packet's motors: whether each is in front, and to the left. Those of a diagonal turn
# alike, the first two counter-clockwise.
_PLACES = ((True, False), (False, True), (True, True), (False, False))
_SENSES = (-1.0, -1.0, 1.0, 1.0)
# What is counted.
_MISSED = "of the steps used the motor outputs of the step before, because the new ones came late"
_GARBAGE = "of the packets were not Betaflight's"


class Betaflight:
    """A link to Betaflight's SITL, for a quadrotor of four rotors as an X.

    Args:
        machine: What flies.
        host: Address at which motors come, and at which Betaflight takes states.
        timeout: Time without motors after which a flight ends, s.
        rate: States that are sent for each second of flight.
        sticks: Function from sensor readings to pulse widths of up to 16 channels, µs, called 100
            times a second; if None another program sends them.

    Raises:
        UsageError: For another machine, a rate that is too small, and a port in use.
    """

    name = "Betaflight"

    def __init__(
        self,
        machine: Machine,
        host: str,
        timeout: float = 30.0,
        rate: float = BETAFLIGHT_RATE,
        sticks: Sticks | None = None,
    ) -> None:
        if rate <= _LEAST_RATE:
            raise UsageError(
                f"control.rate: Betaflight needs more than {_LEAST_RATE:g} steps a second"
            )
        self._order, self.notes = _places(machine)
        self._timeout, self._rate, self._sticks = timeout, rate, sticks
        self._host, self._step = host, 0
        self._socket = opened(socket.SOCK_DGRAM, host, _MOTORS)
        self._motors: Array | None = None
        self._answers = self._silent = 0
        self._odd = Counter(dict.fromkeys((_MISSED, _GARBAGE), 0))

    def open(self, readings: Telemetry) -> None:
        """Tell the state in the start until motors answer it, and then some time more.

        Args:
            readings: Readings of the sensors at the start.

        Raises:
            PeerError: If no motors come, or no more after the first ones.
        """
        end, begin = time.monotonic() + self._timeout, 0.0
        while self._answers < _ANSWERS:
            now = time.monotonic()
            if self._answers and now > min(end, begin + _START):
                raise PeerError(
                    f"Betaflight's loop stopped after {self._answers} motor packet(s); restart "
                    "it (on a busy computer it may miss its first cycle)"
                )
            if now > end:
                raise PeerError(
                    f"no motors came to UDP port {_MOTORS} of {self._host} within "
                    f"{self._timeout:g} s; start Betaflight's SITL with the address {self._host}, "
                    "or wait longer with --timeout"
                )
            self.send(readings)
            if self._take(1.0 / self._rate):
                self._answers, begin = self._answers + 1, now
        for _ in range(round(_HEARD * self._rate)):
            self.send(readings)
            self._wait()
        if self._motors is not None and self._motors.any():
            self.notes.append(
                "Betaflight was already armed when the flight began; restart it before each flight"
            )
        self.send(readings)  # The first step takes the motors that answer this one.

    def receive(self) -> tuple[Outputs, float]:
        """Motors that answer the last state, or the last ones if they are late; time of a step."""
        if not self._wait():
            self._odd[_MISSED] += 1
        motors = np.zeros(4) if self._motors is None else self._motors
        return Outputs(motors[self._order], np.zeros(0)), 1.0 / self._rate

    def _wait(self) -> bool:
        """True if motors come in time; raises `PeerError` once none have for too long."""
        self._silent = 0 if self._take(_LATE) else self._silent + 1
        if self._silent * _LATE > self._timeout:
            raise PeerError(f"Betaflight has been silent for {self._timeout:g} s")
        return not self._silent

    def _take(self, timeout: float) -> bool:
        """Take the last motors of those that come within a time, s; whether any came."""
        has_motors = False
        self._socket.settimeout(timeout)
        try:
            while True:
                packet = self._socket.recv(4096)
                if len(packet) == _MOTOR_PACKET.size:
                    has_motors, self._motors = True, np.nan_to_num(_MOTOR_PACKET.unpack(packet))
                    self._socket.setblocking(False)
                else:
                    self._odd[_GARBAGE] += 1
        except (TimeoutError, BlockingIOError):
            return has_motors

    def send(self, readings: Telemetry) -> None:
        """Tell the state, and now and then the sticks.

        Args:
            readings: Readings of the sensors now.
        """
        now, rate = (self._step + 1) / self._rate, self._rate
        # A receiver that gets sticks before it has started never listens to them.
        is_due = self._answers == _ANSWERS and self._step % max(round(rate / _STICKS), 1) == 0
        if self._sticks is not None and is_due:
            pulses = np.clip(self._sticks(readings), *_WIDTHS).tolist()
            pulses = widths(pulses, f"sticks at t = {readings.time:.6g} s")
            channels = (*pulses, *[1000] * 16)[:16]
            self._socket.sendto(_RC_PACKET.pack(now, *channels), (self._host, _RC))
        latitude, longitude, altitude = place_at(readings.position)
        north, east, down = readings.velocity.tolist()
        force = readings.accelerometer.tolist()
        state = _STATE_PACKET.pack(
            now,
            *readings.gyro.tolist(),
            # It turns the signs of all three, to have x forwards, y to the left, z up.
            *(-force[0], force[1], force[2]),
            *readings.quaternion.tolist(),
            *(east, north, -down),
            *(longitude, latitude, altitude),
            100.0 * pressure_at(readings.altitude),
        )
        self._socket.sendto(state, (self._host, _STATE))
        self._step += 1

    def close(self) -> None:
        """Close the port, and report irregularities."""
        self._socket.close()
        self.notes += counted(self._odd)


def _places(machine: Machine) -> tuple[list[int], list[str]]:
    """For each rotor the place of its motor in Betaflight's packets; notes on them."""
    _, torques = np.split(machine.vehicle.thrust_wrenches(), 2)
    corners = [(bool(-about_y > 0.0), bool(about_x > 0.0)) for about_x, about_y, _ in torques.T]
    if machine.rotors != 4 or {*corners} != {*_PLACES}:
        raise UsageError(
            f"{machine.vehicle.name}: Betaflight's SITL flies four rotors as an X, one at each "
            "corner of the base"
        )
    if machine.joints and machine.servos:
        raise UsageError(
            "--joints: Betaflight's SITL sends no servo outputs; leave it out, and the scenario "
            "moves joints"
        )
    order = [_PLACES.index(place) for place in corners]
    senses = np.sign(torques[2]) * np.take(_SENSES, order)
    notes = []
    if np.all(senses == -1.0):
        notes.append(
            "rotors turn opposite to Betaflight's default: set yaw_motors_reversed = ON there, "
            "or the yaw rate grows without bound"
        )
    elif not np.all(senses == 1.0):
        notes.append(
            "Betaflight cannot control the yaw: rotors on one diagonal must spin one way, and "
            "the others the other way; change the signs of `drag` in the robot file"
        )
    return order, notes


def widths(channels: Sequence[float], where: str) -> list[int]:
    """Pulse widths, µs, of up to 16 channels; raises `UsageError` where they cannot be that."""
    least, most = _WIDTHS
    for k, pulse in enumerate(channels, start=1):
        if not least <= pulse <= most:
            raise UsageError(
                f"{where}: channel {k}: must be a pulse width from {least:g} to {most:g} µs, not "
                f"{pulse:g}"
            )
    if not 1 <= len(channels) <= 16:
        raise UsageError(f"{where}: must have 1 to 16 channels, not {len(channels)}")
    return [round(pulse) for pulse in channels]


def sticks_of(text: str, source: str) -> Sticks:
    """The sticks of a table, linear in between: lines of a time, s, and pulse widths, µs.

    Raises `UsageError` where it is none.
    """
    rows: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        where = f"{source}:{number}"
        try:
            rows.append([float(entry) for entry in line.split(",")])
        except ValueError:
            raise UsageError(
                f"{where}: must be numbers with commas between them, a time, s, and pulse widths, "
                f"µs, not {printable(line)}"
            ) from None
        time, *channels = rows[-1]
        widths(channels, where)
        if len(rows[-1]) != len(rows[0]):
            raise UsageError(f"{where}: must have {len(rows[0])} numbers, as the first line has")
        if not (math.isfinite(time) and (len(rows) == 1 or time > rows[-2][0])):
            raise UsageError(f"{where}: its time must be after that of the line before")
    if not rows:
        raise UsageError(f"{source}: is empty; give lines of a time, s, and pulse widths, µs")
    times, *columns = np.array(rows).T

    def sticks(readings: Telemetry) -> list[float]:
        return [float(np.interp(readings.time, times, column)) for column in columns]

    return sticks
