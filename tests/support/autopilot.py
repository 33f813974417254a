"""Stand-ins for autopilots, which speak their protocols from the other side.

They are written from what the protocols say: ArduPilot's JSON interface by its documentation, PX4's
by the messages of pymavlink's own dialect. None of the package's code is used, frames and all.
"""

from __future__ import annotations

import json
import math
import socket
import struct
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

# Of quadrotor_arm_2link, by its rotors in the order of its file: places of motors seen from above,
# forwards and to the right, m, and 1 for propellers that turn counter-clockwise.
PLACES = ((0.191, -0.191), (-0.191, -0.191), (-0.191, 0.191), (0.191, 0.191))
TURNING = (-1, 1, -1, 1)
HOVER = 2.48 * 9.81 / 56.0
# How often a packet is sent before there is no simulator: for ten minutes.
_TRIES = 1200


@dataclass
class Sensed:
    """What a stand-in knows, in axes forwards, right, down of the body, and north, east, down."""

    time: float
    gyro: Sequence[float]
    accelerometer: Sequence[float]
    position: Sequence[float]
    velocity: Sequence[float]
    quaternion: Sequence[float]


def angles(quaternion: Sequence[float]) -> tuple[float, float, float]:
    """Roll, pitch and yaw of a quaternion, its real part first."""
    w, x, y, z = quaternion
    return (
        math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x)))),
        math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )


def mixed(lift: float, roll: float, pitch: float, yaw: float) -> list[float]:
    """Shares of motors: roll is to the right, pitch lifts the front, yaw is to the right."""
    shares = []
    for (forwards, right), turning in zip(PLACES, TURNING, strict=True):
        left, front = math.copysign(1.0, -right), math.copysign(1.0, forwards)
        shares.append(max(0.0, min(1.0, lift + left * roll + front * pitch + turning * yaw)))
    return shares


class Pilot:
    """Holds a place, north, east and down, m, and a heading, rad, by cascaded loops."""

    def __init__(self, place: Sequence[float], heading: float = 0.5 * math.pi) -> None:
        self.place, self.heading, self.trim = place, heading, [0.0, 0.0]

    def __call__(self, sensed: Sensed) -> list[float]:
        """Shares of the motors, 0 to 1."""
        off = [wanted - x for wanted, x in zip(self.place, sensed.position, strict=True)]
        north, east, down = (1.0 * e - 1.7 * v for e, v in zip(off, sensed.velocity, strict=True))
        roll, pitch, yaw = angles(sensed.quaternion)
        ahead = math.cos(yaw) * north + math.sin(yaw) * east
        right = -math.sin(yaw) * north + math.cos(yaw) * east
        turn = (self.heading - yaw + math.pi) % (2.0 * math.pi) - math.pi
        wanted = (right / 9.81, -ahead / 9.81, turn)
        p, q, r = (
            4.0 * (w - x) - rate
            for w, x, rate in zip(wanted, (roll, pitch, 0.0), sensed.gyro, strict=True)
        )
        # What keeps the machine level while its centre of mass is beside that of its rotors.
        self.trim = [x + 0.004 * 5.0 * off for x, off in zip(self.trim, (p, q), strict=True)]
        p, q = p + self.trim[0], q + self.trim[1]
        lift = HOVER * (1.0 - down / 9.81) / (math.cos(roll) * math.cos(pitch))
        return mixed(lift, 0.05 * p, 0.05 * q, 0.4 * r)


def fly_as_ardupilot(
    address: tuple[str, int],
    pilot: Callable[[Sensed], Sequence[float]],
    steps: int,
    rate: int = 250,
    channels: int = 16,
    servos: Sequence[float] = (),
) -> list[Sensed]:
    """Send outputs, and take what comes back, so many times; `servos` are in µs.

    A packet is sent again after half a second. That of number 0 is answered with the start. It ends
    early where the simulator has ended.
    """
    seen: list[Sensed] = []
    shares: Sequence[float] = (0.0,) * 4
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        port.settimeout(0.5)
        port.connect(address)
        for number in range(steps + 1):
            widths = [round(1000.0 + 1000.0 * share) for share in shares]
            widths = [*widths, *(int(width) for width in servos)]
            widths += [0] * (channels - len(widths))
            magic = {16: 18458, 32: 29569}[channels]
            packet = struct.pack(f"<HHI{channels}H", magic, rate, number, *widths)
            for _ in range(_TRIES):
                try:
                    port.send(packet)
                    told: dict[str, Any] = json.loads(port.recv(4096))
                    # Packets that were sent again are answered again.
                    while seen and told["timestamp"] <= seen[-1].time:
                        told = json.loads(port.recv(4096))
                    break
                except TimeoutError:
                    continue
                except ConnectionRefusedError:
                    if seen:
                        return seen
                    time.sleep(0.5)
            else:
                raise TimeoutError("no answer")
            imu = told["imu"]
            of = ("position", "velocity", "quaternion")
            found = (told["timestamp"], imu["gyro"], imu["accel_body"], *map(told.get, of))
            seen.append(Sensed(*found))
            shares = pilot(seen[-1])
    return seen


def fly_as_px4(
    address: tuple[str, int],
    pilot: Callable[[Sensed], Sequence[float]],
    steps: int,
    servos: Sequence[float] = (),
    late: int = 3,
    watch: Callable[[Any], None] = lambda message: None,
) -> list[Any]:
    """Answer at most so many readings with outputs, and return all messages that came.

    It begins to answer after `late` readings; `watch` is told every message. What it flies by are
    the readings of the inertial sensor and, now and then, the state.
    """
    from pymavlink.dialects.v20 import common

    found: list[Any] = []
    with (
        suppress(ConnectionError),  # The simulator goes first.
        socket.create_connection(address) as wire,
        wire.makefile("wb", buffering=0) as out,
    ):
        wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sender = common.MAVLink(out, srcSystem=1)
        reader = common.MAVLink(None)
        sensed = Sensed(0.0, (0.0,) * 3, (0.0,) * 3, (0.0,) * 3, (0.0,) * 3, (1.0, 0.0, 0.0, 0.0))
        shares: Sequence[float] = (0.0,) * 4
        answered = readings = 0
        while answered <= steps:
            received = wire.recv(65536)
            if not received:
                break
            for message in reader.parse_buffer(received) or ():
                found.append(message)
                watch(message)
                kind = message.get_type()
                if kind == "HIL_STATE_QUATERNION":
                    north = (message.lat * 1e-7 - 47.397742) * math.pi / 180.0 * 6378137.0
                    cosine = math.cos(math.radians(47.397742))
                    east = (message.lon * 1e-7 - 8.545594) * math.pi / 180.0 * 6378137.0 * cosine
                    sensed.position = (north, east, 488.0 - 1e-3 * message.alt)
                    velocity = (message.vx, message.vy, message.vz)
                    sensed.velocity = tuple(0.01 * each for each in velocity)
                    sensed.quaternion = message.attitude_quaternion
                if kind != "HIL_SENSOR":
                    continue
                readings += 1
                sensed.time = 1e-6 * message.time_usec
                sensed.gyro = (message.xgyro, message.ygyro, message.zgyro)
                # The first answer ends the wait for it, and is not flown.
                if readings > late and answered <= steps:
                    shares = pilot(sensed)
                    controls = [*shares, *servos]
                    controls += [0.0] * (16 - len(controls))
                    sender.hil_actuator_controls_send(message.time_usec, controls, 128 | 1, 1)
                    answered += 1
    return found


if __name__ == "__main__":  # By itself: its kind, the port, and how many steps.
    flying = {"px4": fly_as_px4, "ardupilot": fly_as_ardupilot}[sys.argv[1]]
    flying(("127.0.0.1", int(sys.argv[2])), Pilot((0.4, -0.3, -2.2)), int(sys.argv[3]))
