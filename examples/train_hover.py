"""Train a policy to hover with its arm held: `python examples/train_hover.py --seconds 60`.

Of errors, rates and thrusts it makes thrusts and torques. By gradients that go back through the
equations of motion, or with `--method ppo`.
"""

import numpy as np
from learners import train

from gibbs_codegen import uniform
from gibbs_codegen.arrays import constant, dot, join, square_root

UP, AHEAD = constant([0.0, 0.0, 1.0]), constant([1.0, 0.0, 0.0])
AWAY = {"vx": 0.8, "vy": 0.8, "vz": 0.8, "wx": 0.5, "wy": 0.5, "wz": 0.5}
AWAY |= {"upper_arm": 0.6, "forearm": 0.6}  # m and rad
POSTURE = {"arm.posture_deg": {"upper_arm": 17.2, "forearm": -17.2}}  # 0.3 rad
START = {"start": {"offset": [0.5, -0.4, 0.3], "turn_deg": [10, -15, 20]}}
MIDDLE, RANGE = np.array([[6, 6, 6, 6, 0, 0], [5.5, 5.5, 5.5, 5.5, 3, 2]])  # N and N m
MACHINES = {
    "hover": [0, 0, 0, 0, 0, 0, 1, 0.3, -0.3],
    "offsets": {name: uniform(-x, x) for name, x in AWAY.items()},
    "limits": (MIDDLE - RANGE, MIDDLE + RANGE),
}


def length(x, least=0.0):
    """Length of a vector, rounded off below `least`."""
    return square_root(dot(x, x) + least * least)


def parts(x, now):
    """What of errors or their rates is along axes of the world, and of joints."""
    return now.base.travels(x), x[now.robot.layout.v.joints]


def tip_off(now):
    """The way from the tip to where it is when all is as desired."""
    tip, wanted = (now.robot.frame_poses(q)[-1] for q in (now.q, now.q_desired))
    return join(*(wanted[k][3] - tip[k][3] for k in range(3)))


def observe(now):
    """What the policy is told, in the axes of the base."""
    (off, joints), (drift, rates) = (parts(x, now) for x in now.errors)
    off, drift, up = map(now.base.to_base, (off, drift, UP))
    near = off / length(off, 0.1), joints / length(joints, 0.1)  # small errors stand out
    turn = up, now.base.to_world(AHEAD), now.base.turns(now.v) / 4.0
    return join(off, drift, 2.0 * joints, rates / 4.0, *near, *turn, now.actuators / 7.0 - 1.0)


def costs(now):
    """What is off, of which lengths have slopes where errors are small, and what moves."""
    (off, joints), (drift, rates) = (parts(x, now) for x in now.errors)
    spin, ahead, up = now.base.turns(now.v), now.base.to_world(AHEAD), now.base.to_world(UP)
    turned = ahead[1] * ahead[1] + (1.0 - ahead[0]) + (1.0 - up[2])
    squares = (off, 1.0), (joints, 1.0), (drift, 0.05), (rates, 0.02), (spin, 0.01)
    near = 2.0 * length(off, 0.02) + length(joints, 0.02)
    return near + 0.2 * turned + sum(weight * dot(x, x) for x, weight in squares)


def reward(now, u):
    """Negative: the tip counts beside what is off."""
    return -costs(now) - 2.0 * length(tip_off(now), 0.02)


def errors(now):
    """What is judged: base and tip (6)."""
    return join(parts(now.errors[0], now)[0], tip_off(now))


def lost(now):
    """Above 0 where the base is 3 m from where it must be."""
    return length(parts(now.errors[0], now)[0]) - 3.0


if __name__ == "__main__":
    flight = {"duration": 8} | POSTURE | START
    train("hover", observe, reward, lost, errors, flight, **MACHINES)
