"""Train a policy to follow a moving target with base and arm: `python examples/train_reach.py`.

As `train_hover.py`. Each machine has a target of its own: its base swings
by up to 0.8 m, its joints by up to 0.7 rad, at 0.3 to 1.5 rad/s.
"""

from learners import train
from train_hover import MACHINES, POSTURE, START, errors, lost, observe, parts, reward

from gibbs_codegen import uniform
from gibbs_codegen.arrays import join

SWINGS = {"vx": 0.8, "vy": 0.8, "vz": 0.5, "upper_arm": 0.5, "forearm": 0.7}  # m and rad
# The scenario of a flight: its paths, m and rad/s, and moves of the arm, degrees and s.
X, Y = {"amplitude": 0.6, "frequency": 1.0}, {"amplitude": 0.5, "frequency": 1.2, "phase_deg": 90}
Z = {"amplitude": 0.3, "frequency": 0.8}
TURNS = [{"to": 30, "begin": 1, "duration": 2}, {"to": 0, "begin": 4, "duration": 2}]
PATH = {"kind": "harmonic", "x": [X], "y": [Y], "z": [Z]}
FLIGHT = {"duration": 8, "base.path": PATH, "arm.moves_deg": {"upper_arm": TURNS}, **POSTURE}


def observe_motion(now):
    """What is observed of hovering, how the target accelerates, and where it goes."""
    _, linear = now.desired_base.linear(now.v_desired, now.a_desired)
    _, joints = parts(now.a_desired, now)
    ways = [
        join(now.base.to_base(off), bent) for off, bent in (parts(x, now) for x in now.ways_ahead)
    ]
    return join(observe(now), now.base.to_base(linear) / 2.0, joints / 5.0, *ways)


if __name__ == "__main__":
    train(
        *("reach", observe_motion, reward, lost, errors),
        FLIGHT | START,
        **MACHINES,
        swings={name: uniform(-x, x) for name, x in SWINGS.items()},
        swing_rates=uniform(0.3, 1.5),
        targets={name: uniform(-0.4, 0.4) for name in ("upper_arm", "forearm")},
    )
