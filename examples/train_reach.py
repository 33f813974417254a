"""Train a policy to follow a moving target with base and arm: `python examples/train_reach.py`.

As `train_hover.py`. Each machine has a target of its own: its base swings
by up to 0.8 m, its joints by up to 0.7 rad, at 0.3 to 1.5 rad/s.
"""

from learners import train
from train_hover import MACHINES, costs, errors, lost, observe, parts

from gibbs_codegen import uniform
from gibbs_codegen.arrays import join

SWINGS = {"vx": 0.8, "vy": 0.8, "vz": 0.5, "upper_arm": 0.5, "forearm": 0.7}  # m and rad


def observe_motion(now):
    """What is observed of hovering, and how the target accelerates."""
    _, linear = now.desired_base.linear(now.v_desired, now.a_desired)
    _, joints = parts(now.a_desired, now)
    return join(observe(now), now.base.to_base(linear) / 2.0, joints / 5.0)


if __name__ == "__main__":
    train(
        *("reach", observe_motion, lambda now, u: -costs(now), lost, errors),
        **MACHINES,
        swings={name: uniform(-x, x) for name, x in SWINGS.items()},
        swing_rates=uniform(0.3, 1.5),
        targets={name: uniform(-0.4, 0.4) for name in ("upper_arm", "forearm")},
    )
