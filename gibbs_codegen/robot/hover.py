"""Thrusts with which a robot hovers, in plain numbers, and what its rotors can carry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gibbs_codegen.robot.mass_properties import base_properties, rounded, whole_properties
from gibbs_codegen.robot.model import Robot, as_rigid_body
from gibbs_codegen.robot.placement import Array, mounted_rotors
from gibbs_codegen.robot.posture import AT_ORIGIN, frames_on
from gibbs_codegen.robot.thrusters import wrench_matrix


@dataclass(frozen=True)
class Hover:
    """Thrusts in N of least norm that carry the robot, level and at rest; None where none do.

    Where none do although some carry the weight, `moment` (N m, about the base centre, in the
    base's axes) is what these leave at least. `margin` is how many times its weight the robot may
    have before a rotor meets its limits, None where they are not all given or do not let it hover
    at any weight, or where it was not asked for. `beyond` are the numbers of the rotors whose
    limits the thrusts of least norm break.
    """

    thrusts: tuple[float, ...] | None
    margin: float | None
    beyond: tuple[int, ...]
    moment: tuple[float, ...] | None = None


def hangs(robot: Robot) -> bool:
    """Whether hovering is taken with the arm's centre of mass beneath the base centre.

    So it is for the paper's form of file, whose joints at zero stretch the arm out sideways.
    Otherwise all joints are at zero.
    """
    return bool(robot.base.rotors)


def hover(robot: Robot, margin: bool = True) -> Hover:
    """Hovering of a robot; for its margin SciPy is imported."""
    needed, matrix = _weight(robot), wrench_matrix(robot)
    size = float(np.abs(needed).max())
    thrusts = np.linalg.lstsq(matrix, needed, rcond=1e-9)[0]
    if not robot.rotors or np.abs(matrix @ thrusts - needed).max() > 1e-9 * size:
        return Hover(None, None, (), _moment_left(matrix, needed) if robot.rotors else None)
    found = tuple(map(float, rounded(thrusts, size)))
    limits = [rotor.limits for rotor in robot.thrusters]
    beyond = [
        k
        for k, (thrust, bounds) in enumerate(zip(found, limits, strict=False), start=1)
        if bounds and not bounds[0] <= thrust <= bounds[1]
    ]
    given = [bounds for bounds in limits if bounds]
    limited = margin and size and len(given) == robot.rotors
    return Hover(found, _margin(matrix, needed, given) if limited else None, tuple(beyond))


def holding_efforts(robot: Robot, thrusts: Sequence[float]) -> list[float]:
    """Torques (N m), forces (N) that hold joints at zero, the base level, under thrusts (N)."""
    links = frames_on(robot, AT_ORIGIN, np.zeros(len(robot.moving))).links
    acting = np.zeros((len(robot.links) + 1, 6))  # On each body, about the base centre.
    for rotor, unit, thrust in zip(
        mounted_rotors(robot), wrench_matrix(robot).T, thrusts, strict=True
    ):
        acting[rotor.on] += thrust * unit
    for i in range(len(robot.links), 0, -1):
        body = as_rigid_body(robot.links[i - 1].body)
        weight = np.array([0.0, 0.0, -robot.gravity * body.mass])
        acting[i] += *weight, *np.cross(links[i - 1].place(body.com), weight)
        acting[robot.parents[i - 1]] += acting[i]
    efforts = []
    for i in robot.moving:
        link, frame, (force, moment) = robot.links[i - 1], links[i - 1], np.split(acting[i], 2)
        turns = link.joint == "revolute"
        along = moment - np.cross(frame.origin, force) if turns else force
        efforts.append(-link.passive.stiffness * link.passive.rest - along @ frame.axes @ link.axis)
    size = robot.gravity * robot.total_mass
    return list(map(float, rounded(np.array(efforts), size)))


def _weight(robot: Robot) -> Array:
    """Wrench (6) about the base centre that holds the robot, level, in the base's axes."""
    held = base_properties(robot) if hangs(robot) else whole_properties(robot)
    x, y, _ = held.mass * np.array(held.com)
    weight: Array = robot.gravity * np.array([0.0, 0.0, robot.total_mass, y, -x, 0.0])
    return weight


def _moment_left(matrix: Array, needed: Array) -> tuple[float, ...] | None:
    """The least moment (3), N m, that thrusts leave which carry the weight; None where none do.

    `matrix` (6, N) has wrenches of unit thrusts, `needed` (6) is that of hovering.
    """
    forces, moments = matrix[:3], matrix[3:]
    _, values, right = np.linalg.svd(forces)
    idle = right[int(np.sum(values > 1e-9 * values[0])) :].T
    thrusts = np.linalg.lstsq(forces, needed[:3], rcond=1e-9)[0]
    if np.abs(forces @ thrusts - needed[:3]).max() > 1e-9 * np.abs(needed).max():
        return None
    left = needed[3:] - moments @ thrusts
    left -= moments @ idle @ np.linalg.lstsq(moments @ idle, left, rcond=1e-9)[0]
    return tuple(map(float, rounded(left, float(np.abs(needed).max()))))


def _margin(matrix: Array, needed: Array, limits: list[tuple[float, float]]) -> float | None:
    """How many times a wrench (6) the rotors can produce within limits, N; None for no multiple.

    `matrix` (6, N) has wrenches of unit thrusts.
    """
    from scipy.optimize import linprog  # It takes longer to import than all else here.

    size = np.abs(needed).max()
    balanced = np.column_stack([matrix, -needed / size])
    most = np.append(np.zeros(len(limits)), -1.0)
    found = linprog(most, A_eq=balanced, b_eq=np.zeros(6), bounds=[*limits, (0.0, None)])
    return float(found.x[-1] / size) if found.success else None
