"""ArduPilot's JSON interface: outputs as a packet of pulse widths, readings as a line of JSON.

ArduPilot leads: it sends numbered outputs, and waits until it receives the time
after them. It sends a packet again when no answer comes. The first packet is answered with the
start, and not flown: the second shows that ArduPilot has heard.
"""

from __future__ import annotations

import socket
import struct
import time
from collections import Counter

import numpy as np

from gibbs_codegen.flight.autopilots.machine import Outputs, Telemetry
from gibbs_codegen.flight.autopilots.session import PeerError, counted, opened

_PORT = 9002
# Packets by their length: what kind it is, steps a second, its number, and pulse widths, µs.
_KINDS = {18458: struct.Struct("<HHI16H"), 29569: struct.Struct("<HHI32H")}
_PACKETS = {packet.size: (kind, packet) for kind, packet in _KINDS.items()}
_LONGEST = 4096
# The longest pulse that any servo takes, µs.
_WIDEST = 3000.0
# What is counted.
_LOST = "of the packets of ArduPilot were lost"
_GARBAGE = "of the packets were not ArduPilot's"
_STRANGERS = "of the packets came from another program, or from one that had restarted"
_STRANGERS += ", and were ignored"


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
            head, form = _PACKETS.get(len(packet), (0, None))
            code, rate, number, *widths = form.unpack(packet) if form else (1, 0, 0, 0)
            if code != head or not rate or max(widths) > _WIDEST:
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
                        f"ArduPilot restarted (packet {number} after {self._number}); restart "
                        "this command too"
                    )
                self._odd[_LOST] += number - self._number - 1
            self._number = number
            return self._outputs(widths), 1.0 / rate

    def _outputs(self, widths: list[int]) -> Outputs:
        """Outputs of pulse widths, µs, rotors first; channels without a function are 0."""
        motors, servos = widths[: self._rotors], widths[self._rotors :][: self._joints]
        return Outputs(
            np.array([(width - 1000.0) / 1000.0 for width in motors]),
            np.array([(width - 1500.0) / 500.0 if width else np.nan for width in servos]),
        )

    def send(self, readings: Telemetry) -> None:
        """Answer the last packet."""
        # Python writes lists of numbers as JSON does.
        self._answer = (
            f'\n{{"timestamp": {readings.time}, "imu": {{"gyro": {readings.gyro.tolist()}, '
            f'"accel_body": {readings.accelerometer.tolist()}}}, '
            f'"position": {readings.position.tolist()}, "velocity": {readings.velocity.tolist()}, '
            f'"quaternion": {readings.quaternion.tolist()}}}\n'
        ).encode()
        if self._peer is not None:
            self._socket.sendto(self._answer, self._peer)

    def close(self) -> None:
        """Close the port, and tell what was odd."""
        self._socket.close()
        self.notes += counted(self._odd)
