"""Fly the paper's flight 10 000 times with masses up to 20 % off, and measure what that takes.

`python benchmarks/monte_carlo.py` prints one line of JSON: the time, s, from the first thing
that is computed to the last error of a tip, and the peak of this process's memory, MB. Flights are
of 10 s, in steps of 2 ms, by computed torque with the masses of the robot file, and with motors
that lag. With masses that it does not know, the law loses control of some of the machines, the more
the longer the lag is; how many flights ended early is printed too, and the worst error is of the
others. `--flights`, `--threads`, `--lag` (s) and `--step` (s) change what is flown.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from gibbs_codegen.flight.many import simulate_many
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.runtime.load import load

SHIPPED = Path(__file__).parents[1] / "generated" / "hexarotor_3link"
MASSES = ("base_arm_mass_per_length", "link2_mass_per_length", "link3_mass_per_length")
# Flights whose samples are in memory at once.
TOGETHER = 500


def worst_errors(flights: int, threads: int, lag: float, step: float) -> np.ndarray:
    """Largest deviation of a coordinate in each flight, rad or m; NaN of those that end early."""
    robot = load(SHIPPED, backend="c")
    paper = read_scenario(
        "paper",
        {
            "duration": 10,
            "motors": {"time_constant": lag},
            "integration": {"method": "rk4", "step": step},
        },
    )
    masses = np.random.default_rng(18).uniform(0.8, 1.2, (flights, len(MASSES)))
    worst = []
    for begin in range(0, flights, TOGETHER):
        chunk = [
            replace(
                paper, plant={n: m * robot.PARAMETERS[n] for n, m in zip(MASSES, row, strict=True)}
            )
            for row in masses[begin : begin + TOGETHER]
        ]
        desired = None  # The same in all flights.
        for flight in simulate_many(robot, chunk, threads):
            if not isinstance(flight, Flight):
                raise flight
            if flight.stopped:
                worst.append(np.nan)
                continue
            desired = flight.q_desired if desired is None else desired
            worst.append(np.abs(flight.q - desired).max())
    return np.array(worst)


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=int, default=10_000)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--lag", type=float, default=0.005)
    parser.add_argument("--step", type=float, default=2e-3)
    options = parser.parse_args()
    begin = time.perf_counter()
    worst = worst_errors(options.flights, options.threads, options.lag, options.step)
    passed = time.perf_counter() - begin
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    figures = {"seconds": passed, "peak_mb": peak, "ended_early": int(np.isnan(worst).sum())}
    print(json.dumps({"flights": len(worst), **figures, "worst": float(np.nanmax(worst))}))


if __name__ == "__main__":
    main()
