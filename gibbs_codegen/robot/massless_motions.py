"""Motions that nothing resists, found in the robot's data before anything is derived.

Such a motion is one that every body's inertia annihilates. Whether there is one does not depend on
how heavy the bodies are, so each is scaled by its own mass: ratios that drown what is small in the
mass matrix do no harm here, and neither do those of lengths below 1e12.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.robot.coordinates import coordinate_text
from gibbs_codegen.robot.layout import ATTITUDE, POSITION, layout_of
from gibbs_codegen.robot.model import Body, Link, Robot, Rod

Array = NDArray[np.float64]
Motion = tuple[str, ...]

# Of a unit motion that moves nothing rounding leaves 1e-14; what is above this is inertia, be it
# the spin of a rod that is 1e11 times longer than thick.
_NOTHING = 1e-12
# Principal moments that are zero but for the rounding of the matrix they were computed from.
_NO_MOMENT = 1e-15
# Shares below this in a motion of unit shares are rounding; those that are real are geometry.
_NO_SHARE = 1e-7
# A configuration may be singular by accident; three are not.
_CONFIGURATIONS = 3
_LINEAR, _ANGULAR, _JOINTS = slice(0, 3), slice(3, 6), 6


def undetermined_motions(robot: Robot) -> list[Motion]:
    """Motions that move no mass, whatever the configuration; empty for a machine as it should be.

    Each is given by the coordinates that must move together, outermost joint first. No coordinate
    can be left out of a motion without its moving mass.
    """
    found = [_null_motions(*_momenta(robot, number)) for number in range(_CONFIGURATIONS)]
    fewest = min(found, key=len)
    return list(dict.fromkeys(_named(robot, motion) for motion in fewest))


def _null_motions(momenta: Array, levers: Array) -> list[list[int]]:
    """Smallest sets of dependent columns, each by its last column that those before depend on."""
    independent: list[int] = []
    units: list[Array] = []
    directions = np.zeros((0, len(momenta)))
    motions = []
    for k, (column, lever) in enumerate(zip(momenta.T, levers, strict=True)):
        size = float(np.linalg.norm(column))
        rest = column
        for _ in range(2):
            rest = rest - directions.T @ (directions @ rest)
        left = float(np.linalg.norm(rest))
        if left > _NOTHING * lever:
            independent.append(k)
            units.append(column / size)
            directions = np.vstack([directions, rest / left])
        elif size <= _NOTHING * lever:
            motions.append([k])
        else:
            shares = np.linalg.lstsq(np.transpose(units), column / size, rcond=None)[0]
            pairs = zip(independent, np.abs(shares), strict=True)
            motions.append([k, *(i for i, share in reversed(list(pairs)) if share > _NO_SHARE)])
    return motions


def _named(robot: Robot, motion: list[int]) -> Motion:
    """Names of the coordinates of a motion of the base's twist and the joints."""
    joints = layout_of(robot).joint_places
    names = [coordinate_text(robot, joints[k - _JOINTS]) for k in motion if k >= _JOINTS]
    if any(3 <= k < _JOINTS for k in motion):  # The origin only follows when the base turns.
        return (*names, f"the attitude ({', '.join(ATTITUDE)})")
    if any(k < 3 for k in motion):
        return (*names, f"the position ({', '.join(POSITION)})")
    return tuple(names)


def _momenta(robot: Robot, number: int) -> tuple[Array, Array]:
    """Momenta of all bodies, each by its own mass, for unit rates: a column a coordinate.

    Columns are the base centre's velocity, the base's angular velocity, and the joints' rates, at
    an arbitrary configuration of the joints. With them go the lengths that rounding is relative to.
    """
    swarm = _Swarm(_JOINTS + len(robot.links))
    length = robot.base.arm(1).length
    for k in range(1, robot.rotors + 1):
        turn = np.eye(3) if k == 1 else _turn(2, robot.base.arm_angle_deg(k))
        # Arm 1 is given from its motor, the others from the centre.
        start = np.array([-length if k == 1 else 0.0, 0.0, 0.0])
        swarm.add(robot.base.arm(k), turn, start)
    scale = max([length, *(_reach(link) for link in robot.links)]) or 1.0
    attitude = np.eye(3)
    for i, (link, a) in enumerate(zip(robot.links, _offsets(robot), strict=True)):
        position = 0.3 + 0.7 * np.sin(1.7 * i + 0.9 * number)
        swarm.step(attitude[:, 0] * a)
        attitude = attitude @ _turn(0, link.alpha_deg) @ _turn(2, link.theta_deg)
        axis = attitude[:, 2]
        swarm.step(axis * link.d)
        column = _JOINTS + i
        if link.joint == "prismatic":
            swarm.step(axis * (position * scale))
            swarm.twists[_LINEAR, column] = axis
        else:
            attitude = attitude @ _turn(2, float(np.rad2deg(position)))
            swarm.twists[_ANGULAR, column] = axis
        swarm.add(link.body, attitude, np.zeros(3))
    return np.vstack(swarm.momenta), swarm.levers


class _Swarm:
    """Bodies by themselves: momenta so far, and what unit rates make of the point reached."""

    def __init__(self, coordinates: int) -> None:
        self.momenta: list[Array] = []
        self.twists = np.zeros((6, coordinates))
        self.twists[:, :_JOINTS] = np.eye(6)
        self._way = np.zeros(coordinates)
        self._reach = np.zeros(coordinates)

    @property
    def levers(self) -> Array:
        """Lengths that momenta are made of; of translations 1."""
        return np.where(self._turning, self._reach, 1.0)

    def step(self, step: Array) -> None:
        """Go on to another point of the same body."""
        self.twists[_LINEAR] += np.cross(self.twists[_ANGULAR].T, step).T
        self._way += self._turning * np.linalg.norm(step)

    def add(self, body: Body, attitude: Array, start: Array) -> None:
        """Add linear and angular momentum of a body whose own frame begins at `start` from here.

        Masses are taken out, and of the moments of inertia the roots: what is left are lengths.
        """
        mass, com, inertia = _central(body)
        arm = start + attitude @ com
        moments, axes = np.linalg.eigh(inertia)
        radii = np.sqrt(np.where(moments < _NO_MOMENT * moments[-1], 0.0, moments))
        self.momenta.append(radii[:, None] * (attitude @ axes).T @ self.twists[_ANGULAR])
        if mass > 0.0:
            self.momenta.append(self.twists[_LINEAR] + np.cross(self.twists[_ANGULAR].T, arm).T)
            reach = self._turning * (self._way + np.linalg.norm(arm) + radii[-1])
            self._reach = np.maximum(self._reach, reach)

    @property
    def _turning(self) -> NDArray[np.bool_]:
        """Which coordinates turn what is reached."""
        turning: NDArray[np.bool_] = np.linalg.norm(self.twists[_ANGULAR], axis=0) > 0.5
        return turning


def _central(body: Body) -> tuple[float, Array, Array]:
    """Mass, centre of mass, and inertia about it per unit of mass."""
    mass = body.total_mass
    per_mass = 1.0 / mass if mass > 0.0 else 1.0
    if isinstance(body, Rod):
        thin = body.length**2 / 12.0 if mass > 0.0 else 0.0
        section = np.diag(body.section_inertia) * per_mass
        return mass, np.array([body.length / 2, 0.0, 0.0]), section + np.diag([0.0, thin, thin])
    xx, yy, zz, xy, xz, yz = body.inertia
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) * per_mass
    return mass, np.array(body.com), matrix


def _offsets(robot: Robot) -> Iterator[float]:
    """Denavit–Hartenberg a of each link."""
    before = 0.0
    for link in robot.links:
        yield before if link.a is None else link.a
        before = link.body.length


def _reach(link: Link) -> float:
    return max(link.body.length, abs(link.a or 0.0), abs(link.d))


def _turn(axis: int, degrees: Fraction | float) -> Array:
    """Rotation about a coordinate axis."""
    angle = float(np.deg2rad(float(degrees)))
    c, s = np.cos(angle), np.sin(angle)
    p, q = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[p, p], turn[p, q], turn[q, p], turn[q, q] = c, -s, s, c
    return turn
