"""ArduPilot's JSON interface: outputs as a packet of pulse widths, readings as a line of JSON.

ArduPilot leads: it sends outputs with a number that counts up, and waits until it is told the time
after them. It sends a packet again when no answer comes. The first packet is answered with the
start, and not flown: the second shows that ArduPilot has heard.
"""

from __future__ import annotations

import json
import socket
import struct
import time
from collections import Counter

import numpy as np

from gibbs_codegen.flight.autopilots.machine import Outputs, Telemetry
from gibbs_codegen.flight.autopilots.session import PeerError, counted, opened
from gibbs_codegen.flight.plant.vehicle import Array

_PORT = 9002
# Head of a packet: what kind it is, steps a second, and its number; then as many pulse widths, µs.
_HEAD = struct.Struct("<HHI")
_CHANNELS = {18458: 16, 29569: 32}
_LONGEST = 4096
# The longest pulse that any servo takes, µs.
_WIDEST = 3000.0
# What is counted.
_LOST = "of the packets of ArduPilot were lost"
_GARBAGE = "of the packets were not ArduPilot's"
_STRANGERS = "of the packets came from elsewhere, from another program or one that had begun anew"
_STRANGERS += ", and were left aside"


class ArduPilot:
    """A link to ArduPilot, for a machine of some rotors and joints, as of `session.Link`.

    It ends after `timeout`, s, without a packet. Raises `UsageError` for a port in use.
    """

    name = "ArduPilot"

    def __init__(
        self, rotors: int, joints: int, host: str, instance: int = 0, timeout: float = 30.0
    ) -> None:
        self.notes: list[str] = []
        self._rotors, self._joints, self._timeout = rotors, joints, timeout
        self._socket = opened(socket.SOCK_DGRAM, host, _PORT + 10 * instance)
        self._where = f"UDP port {_PORT + 10 * instance} of {host}"
        self._peer: tuple[str, int] | None = None
        self._number: int | None = None
        # Numbers of packets that were answered, by who sent them, before one is known as ArduPilot.
        self._answered: dict[tuple[str, int], list[int]] = {}
        self._answer = b""
        self._odd = Counter(dict.fromkeys((_LOST, _GARBAGE, _STRANGERS), 0))

    def open(self, readings: Telemetry) -> None:
        """Keep the first answer: ArduPilot speaks first."""
        self.send(readings)

    def receive(self) -> tuple[Outputs, float]:
        """Outputs of the next packet, and the time of a step, s."""
        end = time.monotonic() + self._timeout
        while True:
            # Packets from elsewhere do not prolong it.
            self._socket.settimeout(max(end - time.monotonic(), 1e-3))
            try:
                packet, peer = self._socket.recvfrom(_LONGEST)
            except TimeoutError:
                kind = "no packet came" if self._peer is None else "no more packets came"
                raise PeerError(
                    f"{kind} to {self._where} within {self._timeout:g} s; start ArduPilot with "
                    "--model JSON:127.0.0.1, or wait longer with --timeout"
                ) from None
            if self._peer not in (None, peer):
                self._odd[_STRANGERS] += 1
                continue
            head = _HEAD.unpack_from(packet) if len(packet) >= _HEAD.size else (0, 0, 0)
            kind, rate, number = head
            count = _CHANNELS.get(kind, 0)
            whole = count and rate and len(packet) == _HEAD.size + 2 * count
            widths = np.frombuffer(packet, "<u2", count, _HEAD.size) if whole else np.inf
            if np.max(widths) > _WIDEST:
                self._odd[_GARBAGE] += 1
                continue
            # Other programs send packets as well: only ArduPilot counts on when it is answered.
            if self._peer is None:
                before = self._answered.setdefault(peer, [])
                if before[-1:] != [number - 1]:
                    before.append(number)
                    self._socket.sendto(self._answer, peer)
                    continue
                self._peer = peer
                self._odd[_STRANGERS] += sum(map(len, self._answered.values())) - len(before)
            if number == self._number:  # The answer was lost, or came late.
                self._socket.sendto(self._answer, peer)
                continue
            if self._number is not None:
                if number < self._number:
                    raise PeerError(
                        "ArduPilot began anew, with packet "
                        f"{number} after {self._number}; start this again as well"
                    )
                self._odd[_LOST] += number - self._number - 1
            self._number = number
            return self._outputs(np.asarray(widths, np.float64)), 1.0 / rate

    def _outputs(self, widths: Array) -> Outputs:
        """Outputs of pulse widths (c), µs, rotors first; channels without a function are 0."""
        motors, servos = widths[: self._rotors], widths[self._rotors :][: self._joints]
        return Outputs(
            (motors - 1000.0) / 1000.0, np.where(servos, (servos - 1500.0) / 500.0, np.nan)
        )

    def send(self, readings: Telemetry) -> None:
        """Answer the last packet."""
        packet = {
            "timestamp": readings.time,
            "imu": {
                "gyro": readings.gyro.tolist(),
                "accel_body": readings.accelerometer.tolist(),
            },
            "position": readings.position.tolist(),
            "velocity": readings.velocity.tolist(),
            "quaternion": readings.quaternion.tolist(),
        }
        self._answer = f"\n{json.dumps(packet)}\n".encode()
        if self._peer is not None:
            self._socket.sendto(self._answer, self._peer)

    def close(self) -> None:
        """Close the port, and tell what was odd."""
        self._socket.close()
        self.notes += counted(self._odd)
