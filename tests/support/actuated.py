"""A robot with every kind of actuator, and one of each unit."""

from __future__ import annotations

from dataclasses import fields, replace
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.interface.actuators import ACTUATOR_DERIVATIVES, ACTUATOR_PARAMETERS
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.rotor import AIR_KEYS, Rotor

TEXT = """
name = "actuated"

[base]
attitude = "quaternion"
mass     = 1.5
com      = [0, 0, -0.01]
inertia  = [0.0145, 0.0145, 0.0262, 0, 0, 0]

[battery]
voltage    = [13.2, 14.8, 15.2, 16.8]
resistance = 0.02
capacity   = 5.0
auxiliary  = 4.0

[[rotor]]  # by throttle, with the factor of PX4, and air
name                = "front_left"
position            = [0.2, 0.2, 0.02]
drag                = 0.016
command             = "throttle"
full_speed          = 900
max_thrust          = 9
thrust_model_factor = 0.7
time_constants      = [0.03, 0.05]
hub_drag            = 1e-4
inflow              = 2e-4
disc_radius         = 0.12
ground_effect       = true

[[rotor]]  # by speed, with a curve that falls first
name           = "rear_left"
position       = [-0.2, 0.2, 0.02]
drag           = -0.016
command        = "speed"
thrust_curve   = [0.01, -2e-4, 1.2e-5]
command_limits = [100, 900]
time_constant  = 0.03

[[rotor]]  # by speed, at once
name            = "rear_right"
position        = [-0.2, -0.2, 0.02]
drag            = 0.016
command         = "speed"
thrust_constant = 1e-5
command_limits  = [0, 950]

[[rotor]]  # by thrust
name          = "front_right"
position      = [0.2, -0.2, 0.02]
drag          = -0.016
limits        = [0, 9]
time_constant = 0.02

[[link]]
name       = "upper"
xyz        = [0, 0, -0.06]
axis       = "-y"
mass       = 0.2
com        = [0, 0, -0.09]
inertia    = [8e-4, 8e-4, 6e-5, 0, 0, 0]
effort     = 4
limits_deg = [-100, 100]
servo      = { stiffness = 30, damping = 0.4, rate = 6, delay = 0.02, backlash = 0.01 }
friction   = { coulomb = 0.02, static = 0.03 }

[[link]]
name    = "slider"
xyz     = [0, 0, -0.18]
axis    = "z"
joint   = "prismatic"
mass    = 0.1
com     = [0, 0, -0.04]
inertia = [1e-4, 1e-4, 4e-5, 0, 0, 0]
servo   = { stiffness = 400, damping = 8, torque = 20, delay = 0.03 }

[[link]]
name     = "wrist"
xyz      = [0, 0, -0.08]
axis     = "y"
mass     = 0.05
com      = [0, 0, -0.03]
inertia  = [4e-5, 4e-5, 2e-5, 0, 0, 0]
effort   = 1
friction = { coulomb = 0.005, velocity = 0.2 }

[[frame]]
name = "tip"
on   = "wrist"
xyz  = [0, 0, -0.06]
"""

# All derivatives of the functions of actuators.
# Keys of rotors to which the air does nothing but bear their thrust.
NO_AIR: dict[str, Any] = {x.name: x.default for x in fields(Rotor) if x.name in AIR_KEYS}
DERIVATIVES = tuple(row.name for row in (*ACTUATOR_DERIVATIVES, *ACTUATOR_PARAMETERS))


def actuated() -> Robot:
    """The robot."""
    return parse_robot(TEXT)


def by_rates() -> Robot:
    """The robot with servos that are commanded rates, one of which lags."""
    held = (
        "servo      = { stiffness = 30, damping = 0.4, rate = 6, delay = 0.02, backlash = 0.01 }",
        "servo   = { stiffness = 400, damping = 8, torque = 20, delay = 0.03 }",
    )
    lagging, at_once = (
        'servo = { command = "rate", damping = 0.4, rate = 6, delay = 0.02 }',
        'servo = { command = "rate", damping = 80, torque = 20 }',
    )
    text = TEXT.replace(held[0], lagging).replace(held[1], at_once)
    return replace(parse_robot(text), name="by_rates")


def at_once() -> Robot:
    """The robot without lag, delays and battery."""
    robot = actuated()
    thrusters = tuple(
        replace(rotor, time_constant=None, time_constants=None) for rotor in robot.thrusters
    )
    links = tuple(
        x if x.servo is None else replace(x, servo=replace(x.servo, delay=0.0, rate=None))
        for x in robot.links
    )
    return replace(robot, name="at_once", thrusters=thrusters, links=links, battery=None)


def air(
    module: ModuleType, q: NDArray[np.float64], v: NDArray[np.float64], speed: float, thrust: float
) -> NDArray[np.float64]:
    """Wrenches (f, 6) on the frames of what the air does to rotor front_left."""
    drag, inflow, radius = 1e-4, 2e-4, 0.12
    hub = module.FRAMES.index("hub_front_left")
    pose, moved = module.frame_poses(q)[hub], module.frame_velocities(q, v)[hub, :3]
    up = pose[:3, 2]
    along = (moved @ up) * up
    height = max(pose[2, 3], radius / 2)
    gain = 1.0 / (1.0 - (radius / (4.0 * height)) ** 2) - 1.0
    wrenches = np.zeros((len(module.FRAMES), 6))
    wrenches[hub, :3] = gain * thrust * up - speed * (drag * (moved - along) + inflow * along)
    return wrenches
