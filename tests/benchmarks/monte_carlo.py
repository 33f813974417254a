"""Fly the paper's flight 10 000 times with masses up to 20 % off, and measure what that takes.

`python tests/benchmarks/monte_carlo.py` prints one line of JSON: the time, s, from the first thing
that is computed to the last error of a tip, and the peak of this process's memory, MB. Flights are
of 10 s, in steps of 1 ms, by computed torque with the masses of the robot file, and with motors
that lag. `--flights` and `--threads` change how many there are.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from gibbs_codegen.runtime.load import load
from gibbs_codegen.scenario.file import read_scenario
from gibbs_codegen.simulator.many import simulate_many
from gibbs_codegen.simulator.record.flight import Flight

SHIPPED = Path(__file__).parents[2] / "generated" / "hexarotor_3link"
MASSES = ("base_arm_mass_per_length", "link2_mass_per_length", "link3_mass_per_length")
# Flights whose samples are in memory at once.
TOGETHER = 500


def worst_errors(flights: int, threads: int) -> np.ndarray:
    """Largest deviation of a coordinate from the desired one in each flight, rad or m."""
    robot = load(SHIPPED, backend="c")
    paper = read_scenario("paper", {"duration": 10.0, "motors": {"time_constant": 0.02}})
    masses = np.random.default_rng(18).uniform(0.8, 1.2, (flights, len(MASSES)))
    worst = []
    for begin in range(0, flights, TOGETHER):
        chunk = [
            replace(
                paper, plant={n: m * robot.PARAMETERS[n] for n, m in zip(MASSES, row, strict=True)}
            )
            for row in masses[begin : begin + TOGETHER]
        ]
        for flight in simulate_many(robot, chunk, threads):
            if not isinstance(flight, Flight) or flight.stopped:
                raise RuntimeError(f"a flight has failed: {flight}")
            worst.append(np.abs(flight.q - flight.q_desired).max())
    return np.array(worst)


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=int, default=10_000)
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()
    begin = time.perf_counter()
    worst = worst_errors(options.flights, options.threads)
    passed = time.perf_counter() - begin
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        json.dumps(
            {"flights": len(worst), "seconds": passed, "peak_mb": peak, "worst": worst.max()}
        )
    )


if __name__ == "__main__":
    main()
