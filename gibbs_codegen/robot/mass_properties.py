"""Mass, centre of mass and inertia of bodies together, in plain numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.robot.model import Body, Robot, as_rigid_body
from gibbs_codegen.robot.placement import Array
from gibbs_codegen.robot.posture import AT_ORIGIN, Frame, RobotFrames, frames_on
from gibbs_codegen.robot.rigid_body import inertia_matrix

_ROUNDING = 1e-12


@dataclass(frozen=True)
class MassProperties:
    """Mass (kg), centre of mass (m) and inertia about it (kg m²), from the base centre.

    In the base's axes; `inertia` holds xx, yy, zz, xy, xz, yz (xy = −∫ xy dm).
    """

    mass: float
    com: tuple[float, ...]
    inertia: tuple[float, ...]


def base_properties(robot: Robot) -> MassProperties:
    """Mass properties of the base: its central body and its rods."""
    return _together(_base_bodies(robot, frames_on(robot, AT_ORIGIN, _at_zero(robot))))


def whole_properties(robot: Robot, joints: Sequence[float] | Array | None = None) -> MassProperties:
    """Mass properties of the whole robot, with moving joints at rad or m, at zero if None."""
    frames = frames_on(robot, AT_ORIGIN, _at_zero(robot) if joints is None else joints)
    links = zip((link.body for link in robot.links), frames.links, strict=True)
    return _together([*_base_bodies(robot, frames), *links])


def _at_zero(robot: Robot) -> Array:
    return np.zeros(len(robot.moving))


def _base_bodies(robot: Robot, frames: RobotFrames) -> list[tuple[Body, Frame]]:
    base = robot.base
    rods = [(base.arm(k), frame) for k, frame in enumerate(frames.rods, start=1)]
    return [*rods, *([(base.body, frames.base)] if base.body else [])]


def _together(bodies: Iterable[tuple[Body, Frame]]) -> MassProperties:
    """Mass properties of bodies, each in its frame."""
    mass, moment, second, size = 0.0, np.zeros(3), np.zeros((3, 3)), 0.0
    for given, frame in bodies:
        body = as_rigid_body(given)
        place = frame.place(body.com)
        mass += body.mass
        moment += body.mass * place
        turned = frame.axes @ inertia_matrix(body.inertia) @ frame.axes.T
        second += turned + body.mass * _about_origin(place)
        size = max(size, body.length, float(np.abs(place).max()))
    com: Array = moment / mass if mass else moment
    inertia = second - mass * _about_origin(com)
    entries = rounded(inertia, float(np.abs(second).max()))[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    com = rounded(com, size)
    return MassProperties(mass, tuple(map(float, com)), tuple(map(float, entries)))


def _about_origin(place: Array) -> Array:
    """Inertia of a unit of mass at a place about the origin."""
    matrix: Array = place @ place * np.eye(3) - np.outer(place, place)
    return matrix


def rounded(values: NDArray[np.floating[Any]], size: float) -> Array:
    """Values with zeros for what is rounding, of sums of what is about as large as `size`."""
    clean: Array = np.where(np.abs(values) <= _ROUNDING * size, 0.0, values)
    return clean
