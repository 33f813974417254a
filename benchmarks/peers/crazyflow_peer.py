"""crazyflow, timed step by step on request; runs in an environment of its own, without ours.

A line on the standard input names an integrator; the answer is the time of a step of one world, s.
Worlds are quadrotors whose rotors follow a commanded speed, with no controller: dynamics from first
principles, in single precision, as JAX compiles them.
"""

import os
import sys
import time

# What libraries say goes elsewhere, so that only answers are on the standard output.
answers = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)

import jax  # noqa: E402
from crazyflow.control import Control  # noqa: E402
from crazyflow.dynamics import Dynamics  # noqa: E402
from crazyflow.sim import Sim  # noqa: E402

WORLDS, STEPS, RATE = 16384, 100, 500


def simulation(integrator: str) -> Sim:
    """Worlds that have taken their first steps, after which everything is compiled."""
    made = Sim(
        n_worlds=WORLDS,
        control=Control.rotor_vel,
        dynamics=Dynamics.first_principles,
        integrator=integrator,
        freq=RATE,
    )
    timed(made)
    return made


def timed(made: Sim) -> float:
    """Time of a step of one world, s."""
    begin = time.perf_counter()
    made.step(STEPS)
    jax.block_until_ready(made.data.states.pos)
    return (time.perf_counter() - begin) / (WORLDS * STEPS)


def main() -> None:
    """Answer until the input ends."""
    made: dict[str, Sim] = {}
    for line in sys.stdin:
        name = line.strip()
        if name not in made:
            made[name] = simulation(name)
        print(timed(made[name]), file=answers, flush=True)


if __name__ == "__main__":
    main()
