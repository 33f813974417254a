"""PX4 in lockstep, over MAVLink: its simulator is a server to which PX4 connects.

PX4 waits for readings before its time goes on, and answers them with outputs. Until it answers for
the first time, the machine rests in its start, and only the clock that PX4 reads runs.
"""

from __future__ import annotations

import importlib
import math
import socket
import time
from collections import Counter
from typing import Any

import numpy as np

from gibbs_codegen.flight.autopilots.air import place_at, pressure_at, temperature_at
from gibbs_codegen.flight.autopilots.machine import Outputs, Telemetry
from gibbs_codegen.flight.autopilots.session import PeerError, counted, opened
from gibbs_codegen.flight.plant.vehicle import Array

_PORT = 4560
# Readings a second, if nothing else is said.
PX4_RATE = 250.0
# Rates, Hz, of the fixes of satellites, and of the true state.
_FIXES, _STATES = 5.0, 50.0
# Time, s, without an answer, after which none is on its way.
_QUIET = 0.1
# Bits of `fields_updated`: all but the pressure of the airspeed.
_UPDATED = 0x1BFF
_GRAVITY = 9.80665
# What is counted.
_GARBAGE = "of the messages were not MAVLink"
_STRANGERS = "of the connections were refused"


class PX4:
    """A link to PX4, for a machine of some rotors and joints, as of `session.Link`.

    Readings are sent `rate` times a second. It ends after `timeout`, s, without an answer. Raises
    `UsageError` for a port in use.
    """

    name = "PX4"

    def __init__(
        self,
        rotors: int,
        joints: int,
        host: str,
        instance: int = 0,
        timeout: float = 30.0,
        rate: float = PX4_RATE,
    ) -> None:
        self._dialect: Any = importlib.import_module("pymavlink.dialects.v20.common")
        self.notes: list[str] = []
        self._rotors, self._joints, self._timeout, self._rate = rotors, joints, timeout, rate
        self._where = f"TCP port {_PORT + instance} of {host}"
        self._server = opened(socket.SOCK_STREAM, host, _PORT + instance)
        self._server.listen()
        self._peer: socket.socket | None = None
        self._mavlink: Any = self._dialect.MAVLink(self, srcSystem=1, srcComponent=200)
        self._mavlink.robust_parsing = True
        self._sending = bytearray()
        self._controls: Any = None
        # Readings that were told, which the clock goes by.
        self._step = 0
        self._odd = Counter(dict.fromkeys((_GARBAGE, _STRANGERS), 0))

    def write(self, packet: bytes) -> None:
        """Collect what MAVLink sends, until the messages of a step are complete."""
        self._sending += packet

    def open(self, readings: Telemetry) -> None:
        """Wait for PX4, and tell it readings until it answers."""
        self._server.settimeout(self._timeout)
        try:
            self._peer, _ = self._server.accept()
        except TimeoutError:
            raise PeerError(
                f"nothing connected to {self._where} within {self._timeout:g} s; start PX4 with "
                "PX4_SIM_MODEL=none_iris, or wait longer with --timeout"
            ) from None
        self._peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._server.setblocking(False)
        end = time.monotonic() + self._timeout
        while self._controls is None:
            if time.monotonic() > end:
                raise PeerError(
                    f"PX4 sent no outputs within {self._timeout:g} s; use a model with simulated "
                    "outputs, and set HIL_ACT_FUNCn or PWM_MAIN_FUNCn for each"
                )
            self.send(readings)
            self._take(1.0 / self._rate)
        # Answers to all that was told meanwhile come late; the flight is to have those to its own.
        while time.monotonic() < end and self._take(_QUIET):
            pass
        self._controls = None
        self.send(readings)

    def receive(self) -> tuple[Outputs, float]:
        """Outputs that answer the last readings, and the time of a step, s."""
        end = time.monotonic() + self._timeout
        while self._controls is None:
            self._take(end - time.monotonic())
            if self._controls is None and time.monotonic() > end:
                raise PeerError(f"PX4 has been silent for {self._timeout:g} s")
        controls = np.array(self._controls)
        self._controls = None
        servos = controls[self._rotors :][: self._joints]
        return Outputs(controls[: self._rotors], servos), 1.0 / self._rate

    def _take(self, timeout: float) -> bool:
        """Take what comes within a time, s, the last outputs above all; whether anything came."""
        if self._peer is None:
            return False
        self._peer.settimeout(max(timeout, 1e-3))
        try:
            received = self._peer.recv(65536)
        except TimeoutError:
            return False
        except OSError as error:
            raise PeerError(f"the connection to PX4 broke ({error.strerror})") from None
        if not received:
            raise PeerError("PX4 closed the connection")
        for message in self._mavlink.parse_buffer(received) or ():
            kind = message.get_type()
            if kind == "HIL_ACTUATOR_CONTROLS":
                is_armed = message.mode & self._dialect.MAV_MODE_FLAG_SAFETY_ARMED
                # Nothing is commanded before: motors rest, and servos are where they are.
                self._controls = message.controls if is_armed else [np.nan] * 16
            elif kind == "BAD_DATA":
                self._odd[_GARBAGE] += 1
        return True

    def send(self, readings: Telemetry) -> None:
        """Tell readings, and now and then a fix, the true state, and that this is here."""
        rate, step = self._rate, self._step
        now = round(1e6 * (step + 1) / rate)
        if step % max(round(rate), 1) == 0:
            self._heartbeat()
        if step % max(round(rate / _FIXES), 1) == 0:
            self._fix(now, readings)
        if step % max(round(rate / _STATES), 1) == 0:
            self._state(now, readings)
        self._sensors(now, readings)
        self._step += 1
        sending, self._sending = bytes(self._sending), bytearray()
        if self._peer is None:
            return
        self._peer.settimeout(self._timeout)
        try:
            self._peer.sendall(sending)
        except TimeoutError:
            raise PeerError(f"PX4 has received nothing for {self._timeout:g} s") from None
        except OSError as error:
            raise PeerError(f"the connection to PX4 broke ({error.strerror})") from None

    def _heartbeat(self) -> None:
        """Tell that this is here, and turn away whoever else wants to connect."""
        dialect = self._dialect
        self._mavlink.heartbeat_send(
            dialect.MAV_TYPE_GENERIC, dialect.MAV_AUTOPILOT_INVALID, 0, 0, 0
        )
        try:
            stranger, _ = self._server.accept()
        except OSError:
            return
        stranger.close()
        self._odd[_STRANGERS] += 1

    def _sensors(self, now: int, readings: Telemetry) -> None:
        """Tell HIL_SENSOR: m/s², rad/s, gauss, hPa, m, °C."""
        altitude = readings.altitude
        self._mavlink.hil_sensor_send(
            now,
            *readings.accelerometer.tolist(),
            *readings.gyro.tolist(),
            *(1e4 * readings.field).tolist(),
            pressure_at(altitude),
            0.0,
            altitude,
            temperature_at(altitude),
            _UPDATED,
        )

    def _fix(self, now: int, readings: Telemetry) -> None:
        """Tell HIL_GPS: degrees · 1e7, mm, cm, cm/s, hundredths of a degree."""
        position, velocity = readings.fix
        north, east, down = _short(100.0 * velocity)
        course = math.degrees(math.atan2(east, north)) % 360.0
        speed = round(math.hypot(north, east))
        self._mavlink.hil_gps_send(
            now,
            3,
            *_place(position),
            30,
            40,
            speed,
            north,
            east,
            down,
            round(100.0 * course) % 36000,
            12,
        )

    def _state(self, now: int, readings: Telemetry) -> None:
        """Tell HIL_STATE_QUATERNION, the truth: degrees · 1e7, mm, cm/s, thousandths of g."""
        velocity = _short(100.0 * readings.velocity)
        speed = round(math.hypot(*velocity))
        self._mavlink.hil_state_quaternion_send(
            now,
            readings.quaternion.tolist(),
            *readings.gyro.tolist(),
            *_place(readings.position),
            *velocity,
            speed,
            speed,
            *_short(1e3 / _GRAVITY * readings.accelerometer),
        )

    def close(self) -> None:
        """Close the connection, and tell what was odd."""
        for endpoint in (self._peer, self._server):
            if endpoint is not None:
                endpoint.close()
        self.notes += counted(self._odd)


def _short(values: Array) -> list[int]:
    """Whole numbers of 16 bits, the nearest ones."""
    return values.round().clip(-32768, 32767).astype(int).tolist()


def _place(position: Array) -> tuple[int, int, int]:
    """Latitude and longitude, degrees · 1e7, and altitude, mm, of a place (3) in NED, m."""
    latitude, longitude, altitude = place_at(position)
    least, most = -(2**31), 2**31 - 1
    north, east = (round(1e7 * max(min(x, 180.0), -180.0)) for x in (latitude, longitude))
    return north, east, max(min(round(1e3 * altitude), most), least)
