"""Wrenches (f, 6) on a robot's frames by what acts besides its inputs, as array programs.

A wrench is the force, N, and the torque about the frame's origin, N m, in world axes. Frames are
given by their numbers. `flight.plant.environment` says more on each.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import (
    Node,
    absolute,
    clip,
    constant,
    cosine,
    cross,
    dot,
    join,
    maximum,
    reshaped,
    solve,
    square_root,
    zeros,
)

# The least thrust, N, whose root tells the speed of a rotor: the root has no slope at 0.
_LEAST_THRUST = 1e-6
# The least speed of blades' tips, m/s, by which an advance ratio is taken.
_LEAST_TIP_SPEED = 1e-6


def wind_velocity(time: Node, steady: Node, gusts: Node) -> Node:
    """Velocity (3) of the wind, m/s, with gusts (g, 5) that rise and fall as 1 - cos.

    Each has begin and duration, s, and half of the greatest velocity (3).
    """
    velocity = steady
    for k in range(gusts.shape[0]):
        gust = gusts[k]
        share = clip((time - gust[0]) / gust[1], 0.0, 1.0)
        velocity = velocity + (1.0 - cosine(2.0 * math.pi * share)) * gust[2:]
    return velocity


def drag(coefficients: Node, wind: Node, velocities: Node) -> Node:
    """Wrenches (f, 6) of drag with coefficients (f, 6), on frames that have velocities (f, 6)."""
    return coefficients * (reshaped(join(wind, zeros(3)), (1, 6)) - velocities)


def spin_torque(axis: Node, momentum: Node, thrust: Node, pose: Node, velocity: Node) -> Node:
    """Gyroscopic torque (3) of a rotor with a thrust, N, about `axis` (3) of a frame.

    `momentum` is its angular momentum by the square root of the thrust; a thrust the other way is
    that of a rotor that turns the other way.
    """
    size = momentum * thrust / square_root(maximum(absolute(thrust), _LEAST_THRUST))
    return cross(size * (rotation_of(pose) @ axis), velocity[3:])


def air_on_rotors(
    robot: Functions, moving: tuple[Node, Node], speeds: Node, u: Node, wind: Node
) -> list[tuple[int, Node]]:
    """Wrenches (6) of the air on hubs of rotors, besides thrusts in still air, by their frames.

    `moving` are poses (f, 4, 4) and velocities (f, 6) of the frames, `speeds` (N) of the rotors,
    rad/s, with inputs u.
    """
    poses, velocities = moving
    parts = []
    for rotor, frame, air in robot.air:
        turning, moved = (speeds[rotor], u[rotor]), (poses[frame], velocities[frame][:3] - wind)
        parts.append((frame, join(_force_on_rotor(air, turning, *moved), zeros(3))))
    return parts


def _force_on_rotor(
    air: Sequence[float], turning: tuple[Node, Node], pose: Node, moved: Node
) -> Node:
    """Force (3), N, of the air on the hub of a rotor that moves against it, m/s.

    `air` has the direction (3) in the axes of the hub, drag and inflow, kg, lift, kg/m, radius, m,
    1 for ground effect, and pairs of advance ratio and factor of the thrust; `turning` are speed,
    rad/s, and thrust, N. The ground is at a height of 0, and the hub no lower than half a radius
    (Cheeseman and Bennett, 1955).
    """
    drag, inflow, lift, radius, has_ground, *pairs = air[3:]
    speed, thrust = absolute(turning[0]), turning[1]  # Whichever way it turns, air resists.
    columns = [(air[k], join(*(pose[i][k] for i in range(3)))) for k in range(3) if air[k]]
    axis = sum((share * column for share, column in columns[1:]), columns[0][0] * columns[0][1])
    along = dot(axis, moved)
    # Drag across the axis is that along all of the motion, less what is along the axis.
    pushed = (drag - inflow) * speed * along
    if lift:
        pushed = pushed + lift * (dot(moved, moved) - along * along)
    factor = None
    if pairs:
        tips = maximum(speed * radius, _LEAST_TIP_SPEED)
        factor = _between(along / tips, pairs[::2], pairs[1::2])
    if has_ground:
        share = 0.25 * radius / maximum(origin_of(pose)[2], 0.5 * radius)
        factor = (constant(1.0) if factor is None else factor) / (1.0 - share * share)
    if factor is not None:
        pushed = pushed + (factor - 1.0) * thrust
    return pushed * axis - drag * speed * moved


def _between(x: Node, places: Sequence[float], values: Sequence[float]) -> Node:
    """Linear interpolation between values at rising places, and beyond them the end value."""
    value = constant(values[0])
    for k in range(len(places) - 1):
        slope = (values[k + 1] - values[k]) / (places[k + 1] - places[k])
        value = value + slope * (clip(x, places[k], places[k + 1]) - places[k])
    return value


def payload_forces(
    robot: Functions,
    motion: tuple[Node, Node, Node],
    wrenches: Node,
    frames: Sequence[int],
    masses: Node,
    gravity: Node,
) -> list[Node]:
    """Forces (3 each) of payloads on their frames, of states q, v and inputs u in `motion`.

    `wrenches` (f, 6) are all others, `masses` (p), kg, of which 0 is no payload, and `gravity` (3),
    m/s². The forces f of all solve (1 + m J M⁻¹ Jᵀ) f = m (g - c - J a), where a is the
    acceleration without them, J the Jacobian of the frames and c their bias acceleration. Columns
    of M⁻¹ Jᵀ are accelerations by unit forces, of functions that have derivatives.
    """
    q, v, u = motion
    size, units = 3 * len(frames), list[Node]()

    def along(a: Node) -> Node:
        velocities = robot.frame_velocities(q, a)
        return join(*(velocities[frame][:3] for frame in frames))

    still = q, zeros(robot.space.velocities), zeros(robot.inputs)
    pushes = np.zeros((1 + size, robot.frames, 6))
    for k, (frame, axis) in enumerate(itertools.product(frames, range(3))):
        pushes[1 + k, frame, axis] = 1.0
    resting, *pushed = (
        robot.forward_dynamics_with_wrenches(*still, constant(push)) for push in pushes
    )
    for a in pushed:
        yielding = along(a - resting)
        units.append(reshaped(yielding, (1, size)))
    bias = robot.frame_bias_accelerations(q, v)
    drift = along(robot.forward_dynamics_with_wrenches(q, v, u, wrenches))
    drift = drift + join(*(bias[frame][:3] for frame in frames))
    weights = join(*(masses[k] * constant(np.ones(3)) for k in range(len(frames))))
    matrix = constant(np.eye(size)) + reshaped(weights, (size, 1)) * join(*units).transposed
    forces = solve(matrix, weights * (join(*[gravity] * len(frames)) - drift))
    return [forces[3 * k : 3 * k + 3] for k in range(len(frames))]


def on_frames(parts: Sequence[tuple[int, Node]], frames: int) -> Node:
    """Wrenches (f, 6) of which each part (6) acts on the frame of a number."""
    rows = [zeros(6)] * frames
    for frame, wrench in parts:
        rows[frame] = rows[frame] + wrench
    return join(*(reshaped(row, (1, 6)) for row in rows))


def origin_of(pose: Node) -> Node:
    """Position (3) of a frame with a pose (4, 4)."""
    return join(*(pose[i][3] for i in range(3)))


def rotation_of(pose: Node) -> Node:
    """Rotation (3, 3) of a frame with a pose (4, 4)."""
    return join(*(reshaped(pose[i][:3], (1, 3)) for i in range(3)))
