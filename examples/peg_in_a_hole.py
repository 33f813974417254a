"""A ball at the tip of an arm goes into a hole, although its path is 7 mm off.

The law yields, so the ball feels less than 1 N from the sides of the hole, which has 1 mm of play.
"""

import numpy as np

from gibbs_codegen import generate, load, read_scenario, simulate

drone = load(generate("hextilt_flying_arm_5", "modules"), backend="c")
joints = drone.COORDINATES[7:]
tip, depth, half, radius = np.array([0.0002, 0.0119, 1.7074]), 0.06, 0.0095, 0.009
x, y, top = tip + np.array([-0.006, 0.004, -0.039])  # the hole, 3 cm below the ball


def block(dx, dy, size, z):
    """A box beside the hole, or below it."""
    place = [x + dx * (half + 0.05), y + dy * (half + 0.05), z]
    shape = {"kind": "box", "frame": "tip", "centre": place, "size": size, "ball_radius": radius}
    return shape | {"stiffness": 1000, "damping": 20, "dissipation": 1, "friction": 0.2}


walls = [block(side, 0, [0.1, 0.3, depth], top - depth / 2) for side in (-1, 1)]
walls += [block(0, side, [2 * half, 0.1, depth], top - depth / 2) for side in (-1, 1)]
walls += [block(0, 0, [0.3, 0.3, 0.1], top - depth - 0.05)]
yielding = {"stiffness": [20, 20, 200], "damping": [20, 20, 60]}
path = {"kind": "line", "start": [0, 0, 2], "end": [0, 0, 1.91], "begin": 1, "duration": 6}
control = {"law": "impedance", "impedance": yielding, "frequency": 10, "attitude_frequency": 40}
control["joints"] = {j: {"frequency": 40} for j in joints}
scenario = read_scenario(
    "hover",
    {
        "duration": 9,
        "base.path": path,
        "arm.posture_deg": {joints[0]: 0},
        "control": control,
        "motors.time_constant": 0.02,
        "wall": walls,
        "integration": {"method": "rk4"},
    },
)
flight = simulate(drone, scenario)
deep = top + radius - flight.point("tip")[-1, 2]
sideways = np.abs(flight.frame_wrench("tip")[:, :2])
print(f"{1e3 * deep:.0f} mm deep, with at most {sideways.max():.2f} N from the sides")
