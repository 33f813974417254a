"""Identify a Crazyflie from its IMU and the commands of its motors.

`python -m benchmarks.identify_crazyflie FOLDER` prints what identify finds in the flights log10,
log15 and log16 of the public repository arplaboratory/data-driven-system-identification (MIT), in
the parts that its notebook takes. Mass, inertia and places of motors are the notebook's to begin
with, the curve is made up, and the torque of a motor over its thrust, which no log shows, is 6 mm.
Before that it prints moments of inertia by the notebook's method, and what changes them.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.signal import butter, sosfiltfilt

from gibbs_codegen import generate, identify, load
from gibbs_codegen.flight.logs.log import recorded_of
from gibbs_codegen.flight.logs.reading import Recorded
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.identification.recorded import cut, recordings_of

Array = np.ndarray
# Seconds of a log in which it heaves, leans, or turns its heading.
PARTS = ("log10", 8.7, 38.0), ("log15", 16.0, 50.0), ("log16", 15.2, 21.0), ("log16", 28.2, 32.0)
# The same parts of the first two in the notebook, by the clock of the log, s.
HEAVES, LEANS = ("log10", 35.0, 65.0), ("log15", 55.0, 90.0)
# Published moments of inertia about x and y, kg m²; kg; m; and time constants that are tried, s.
PUBLISHED, MASS, ARM, TIMES = (1.0286e-5, 1.1052e-5), 0.027, 0.028, np.linspace(0.001, 0.5, 100)
# What the notebook multiplies accelerations along z by, in place of 9.81 m/s².
WRITTEN = 9.18 / 9.81
ROTORS = {"m1": (1, -1, -1), "m2": (-1, -1, 1), "m3": (-1, 1, -1), "m4": (1, 1, 1)}
ROBOT = """
name = "crazyflie"
[base]
attitude = "quaternion"
mass = 0.027
inertia = [1.03e-5, 1.11e-5, 1.95e-5, 0, 0, 0]
"""
ROTOR = """
[[rotor]]
name = "{name}"
position = [{x}, {y}, 0]
drag = {drag}
command = "speed"
thrust_curve = [0, 0.04, 0.09]
command_limits = [0, 1]
time_constant = 0.05
"""
FREE = "base_inertia_??", "rotors.thrust_1", "rotors.thrust_2", "rotors.time_constant"


class Part:
    """A part of a log without gaps: commands, accelerations along z, and turns about x and y."""

    def __init__(self, log: Recorded, begin: float, end: float) -> None:
        """Take the samples from one time, s, to another."""
        stamps, felt = log.imus["base"]
        rows = (stamps > begin * 1e9) & (stamps < end * 1e9)
        self.time, self.heave = stamps[rows] * 1e-9, felt[rows, 2]
        self.turns = np.gradient(felt[rows, 3:5], self.time, axis=0)
        self.commands = np.stack([log.commands[f"speed_{m}"].values[rows] for m in ROTORS], axis=1)

    def speeds(self, lag: float, delay: float = 0.0) -> Array:
        """Speeds (s, 4) of motors that follow commands with a lag and a delay, s."""
        late = [np.interp(self.time - delay, self.time, u) for u in self.commands.T]
        speeds = np.stack(late, axis=1)
        kept = np.exp(-np.diff(self.time) / lag)
        for k, share in enumerate(kept, 1):
            speeds[k] += share * (speeds[k - 1] - speeds[k])
        return speeds


def without_gaps(log: Recorded, begin: float, end: float) -> list[Part]:
    """Parts of a log between its gaps, those above 0.35 s."""
    time = log.imus["base"].time * 1e-9
    inside = time[(time > begin) & (time < end)]
    late = np.flatnonzero(np.diff(inside) > 3e-3)
    edges = [begin, *(inside[late] + 1e-6), end], [begin, *(inside[late + 1] - 1e-6), end]
    pairs = zip(edges[1][:-1], edges[0][1:], strict=True)
    return [Part(log, a, b) for a, b in pairs if b - a > 0.35]


def heaved(part: Part, scale: float, lag: float) -> tuple[Array, float]:
    """Coefficients of the thrust curve by a lag, and the error, N, that they leave."""
    powers = np.stack([np.sum(part.speeds(lag) ** k, axis=1) for k in range(3)], axis=1)
    force = MASS * scale * part.heave
    curve = np.linalg.lstsq(powers, force, rcond=None)[0]
    return curve, float(np.sqrt(np.mean((powers @ curve - force) ** 2)))


def torques(parts: Sequence[Part], curve: Array, lag: float, delay: float = 0.0) -> list[Array]:
    """Torques (s, 2) about x and y, of each part."""
    places = ARM * np.array([[y, -x] for x, y, _ in ROTORS.values()])
    speeds = (part.speeds(lag, delay) for part in parts)
    return [np.polynomial.polynomial.polyval(speed, curve) @ places for speed in speeds]


def by_notebook(heaves: Part, leans: Sequence[Part]) -> None:
    """Print moments of inertia by the notebook's method, and by what it leaves out."""
    lag = TIMES[int(np.argmin([heaved(heaves, 1.0, x)[1] for x in TIMES]))]
    turns = np.concatenate([part.turns for part in leans])
    rows = {"published": np.array(PUBLISHED)}
    for name, scale in (("its method", WRITTEN), ("with 9.81 m/s² for its 9.18", 1.0)):
        curve = heaved(heaves, scale, lag)[0]
        torque = np.concatenate(torques(leans, curve, lag))
        rows[name] = np.sum(turns * torque, axis=0) / np.sum(turns**2, axis=0)
    rows["turns by torques"] = np.sum(torque**2, axis=0) / np.sum(turns * torque, axis=0)
    low = butter(3, (1.5, 10.0), "bandpass", fs=1.0 / np.median(np.diff(heaves.time)), output="sos")
    slow = np.concatenate([sosfiltfilt(low, part.turns, axis=0) for part in leans])

    def fitted(delays: Array) -> tuple[Array, float]:
        late = torques(leans, curve, *np.abs(delays))
        torque = np.concatenate([sosfiltfilt(low, x, axis=0) for x in late])
        inertias = np.sum(torque**2, axis=0) / np.sum(slow * torque, axis=0)
        return inertias, float(np.sum((slow - torque / inertias) ** 2) / np.sum(slow**2))

    for begin in ([lag], [lag, 0.01]):
        best = np.abs(minimize(lambda x: fitted(x)[1], begin, method="Nelder-Mead", tol=1e-4).x)
        inertias, share = fitted(best)
        words = ", ".join(
            f"{n} {1e3 * x:.1f} ms" for n, x in zip(("lag", "delay"), best, strict=False)
        )
        rows[f"up to 10 Hz, {words}, unexplained {share:.1%}"] = inertias
    print(f"lag by thrusts {lag:.4f} s; moments of inertia about x and y, kg m²")
    for name, values in rows.items():
        print(f"{name}: {values[0]:.3e}, {values[1]:.3e}")


def main(logs: Path) -> None:
    """Print the report, and the processor's time."""
    with tempfile.TemporaryDirectory() as out:
        rotors = [
            ROTOR.format(name=name, x=0.028 * x, y=0.028 * y, drag=0.006 * turn)
            for name, (x, y, turn) in ROTORS.items()
        ]
        (Path(out) / "crazyflie.toml").write_text("".join([ROBOT, *rotors]), "utf-8")
        module = load(generate(Path(out) / "crazyflie.toml", out, verify=False), backend="c")
        vehicle, parts = Vehicle(module), []
        read = {name: recorded_of(vehicle, logs / name, {}) for name, *_ in PARTS}
        (heaves,), leans = (without_gaps(read[name], *ends) for name, *ends in (HEAVES, LEANS))
        by_notebook(heaves, leans)
        for name, begin, end in PARTS:
            for log in recordings_of(vehicle, read[name], name):
                first, last = log.time.searchsorted((begin, end)).tolist()
                parts += cut(log, [slice(first, last)])
        begun = time.process_time()
        print(identify(module, parts, FREE).text())
        print(f"{time.process_time() - begun:.1f} s of the processor")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
