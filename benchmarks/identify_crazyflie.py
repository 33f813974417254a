"""Identify a Crazyflie from its IMU and the commands of its motors.

`python -m benchmarks.identify_crazyflie FOLDER` prints what identify tells of the flights log10,
log15 and log16 of the public repository arplaboratory/data-driven-system-identification (MIT), of
the parts that its notebook takes. Mass, inertia and places of motors are the notebook's to begin
with, the curve is made up, and the torque of a motor over its thrust, which no log tells, is 6 mm.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

from gibbs_codegen import generate, identify, load
from gibbs_codegen.flight.logs.log import recorded_of
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.identification.recorded import cut, recordings_of

# Seconds of a log in which it heaves, leans, or turns its heading.
PARTS = ("log10", 8.7, 38.0), ("log15", 16.0, 50.0), ("log16", 15.2, 21.0), ("log16", 28.2, 32.0)
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
        for name, begin, end in PARTS:
            for log in recordings_of(vehicle, recorded_of(vehicle, logs / name, {}), name):
                first, last = log.time.searchsorted((begin, end)).tolist()
                parts += cut(log, [slice(first, last)])
        begun = time.process_time()
        print(identify(module, parts, FREE).text())
        print(f"{time.process_time() - begun:.1f} s of the processor")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
