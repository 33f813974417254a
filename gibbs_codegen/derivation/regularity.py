"""Is every acceleration determined, and can it be computed? Asked before anything is emitted.

A massless degree of freedom is a motion that every body's inertia annihilates. Whether there is one
is found in the robot's data. It does not depend on how heavy the bodies are, so each is scaled by
its own mass: ratios that make the mass matrix ill-conditioned do no harm, and neither do those of
lengths below 1e12.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import deepcopy

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import SingularRobotError, UsageError
from gibbs_codegen.program.nodes import Program
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.model import Body, Link, Robot, Rod
from gibbs_codegen.robot.placement import Array, arm_frame, joint_frame, turn_about
from gibbs_codegen.robot.rigid_body import size_fault

Motion = tuple[str, ...]

# Smallest eigenvalue of the mass matrix with a unit diagonal: rounding leaves up to 3e-16 of a
# singular one, while a 3 m rod of 1 µm thickness still has 9e-15.
_SMALLEST = 2e-15
# A regular robot may be singular at one configuration by accident; three are not.
_CONFIGURATIONS = 3
# Of a unit motion that moves nothing rounding leaves 1e-14; what is above this is inertia, be it
# the spin of a rod that is 1e11 times longer than thick.
_NOTHING = 1e-12
# Principal moments that are zero but for the rounding of the matrix they were computed from.
_NO_MOMENT = 1e-15
# Shares below this in a motion of unit shares are rounding; those that are real are geometry.
_NO_SHARE = 1e-7
_LINEAR, _ANGULAR, _JOINTS = slice(0, 3), slice(3, 6), 6


def check_massless_motions(robot: Robot, defaults: Mapping[str, float]) -> None:
    """Raise `SingularRobotError`, with all massless motions, from a robot's data alone.

    Raises `UsageError` for a parameter of a size that cannot be computed with. `defaults` are
    values of the parameters by name.
    """
    for name, value in defaults.items():
        if fault := size_fault(value):
            raise UsageError(f"{robot.name}: {name} {fault}")
    if motions := massless_motions(robot):
        raise SingularRobotError(robot.name, motions)


def check_conditioning(robot: Robot, mass_matrix: Program, defaults: Mapping[str, float]) -> None:
    """Raise `SingularRobotError` if M is singular to the accuracy of double precision.

    It names the coordinate that most of the motion of least inertia is made of.
    """
    found = []
    size = len(mass_matrix.inputs["v"])
    for number in range(_CONFIGURATIONS):
        q = _configuration(len(mass_matrix.inputs["q"]), number)
        values = mass_matrix.evaluate("mass_matrix", defaults, {"q": q})
        least, coordinate = _least_inertia(np.array(values[0]).reshape(size, size))
        if least >= _SMALLEST:
            return
        found.append((least, coordinate))
    largest = Description(robot).coordinate_text(max(found)[1])
    raise SingularRobotError(robot.name, [(largest,)], ill_conditioned=True)


def check_range(robot: Robot, program: Program, defaults: Mapping[str, float]) -> None:
    """Raise `UsageError` where emitted functions would overflow with the robot's own parameters.

    It names the parameters that are the furthest from 1.
    """
    arguments = {
        "q": _configuration(len(program.inputs["q"]), 0),
        "v": [0.0] * len(program.inputs["v"]),
        "u": [0.0] * len(program.inputs["u"]),
    }
    try:
        values = [
            *program.prepared(defaults).values(),
            *program.evaluate("forward_dynamics", defaults, arguments)[0],
        ]
        good = all(map(math.isfinite, values))
    except (ZeroDivisionError, OverflowError):
        good = False
    if good:
        return
    sizes = {name: abs(math.log10(abs(value))) for name, value in defaults.items() if value}
    furthest = sorted(sizes, key=sizes.__getitem__, reverse=True)[:2]
    shown = " and ".join(f"{name} = {defaults[name]:g}" for name in furthest)
    raise UsageError(
        f"{robot.name}: its accelerations overflow, or are lost in rounding, with {shown}; "
        "bring masses and lengths nearer to each other"
    )


def _configuration(size: int, number: int) -> list[float]:
    return [0.3 + 0.7 * math.sin(1.7 * i + 0.9 * number) for i in range(size)]


def _least_inertia(matrix: NDArray[np.float64]) -> tuple[float, int]:
    """Smallest eigenvalue of a mass matrix with a unit diagonal; the coordinate it is most of."""
    diagonal = np.diag(matrix)
    if (diagonal <= 0).any():
        return 0.0, int(np.argmin(diagonal))
    unit = np.sqrt(diagonal)
    eigenvalues, vectors = np.linalg.eigh(matrix / np.outer(unit, unit))
    return float(eigenvalues[0]), int(np.argmax(np.abs(vectors[:, 0])))


def massless_motions(robot: Robot) -> list[Motion]:
    """Motions that move no mass, whatever the configuration; empty for a robot as it should be.

    Each is the coordinates that must move together, outermost joint first. No coordinate can be
    left out of a motion without its moving mass.
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
    description = Description(robot)
    q, joints = description.layout.q, description.layout.v.joint_places
    names = [description.coordinate_text(joints[k - _JOINTS]) for k in motion if k >= _JOINTS]
    if any(3 <= k < _JOINTS for k in motion):  # The origin only follows when the base turns.
        return (*names, f"the attitude ({', '.join(q.names[q.attitude])})")
    if any(k < 3 for k in motion):
        return (*names, f"the position ({', '.join(q.names[q.position])})")
    return tuple(names)


def _momenta(robot: Robot, number: int) -> tuple[Array, Array]:
    """Momenta of all bodies over their own masses, for unit rates, and lengths of their roundings.

    Columns are the base centre's velocity, the base's angular velocity, and the joints' rates, at
    an arbitrary configuration of the joints. The lengths are what rounding is relative to.
    """
    joints = len(robot.moving)
    swarm, base = _Swarm(_JOINTS + joints), _Place(_JOINTS + joints)
    for k in range(1, robot.base.rotors + 1):
        axes, start = arm_frame(robot.base, k)
        swarm.add(robot.base.arm(k), base.turned(axes), start)
    if robot.base.body:
        swarm.add(robot.base.body, base)
    positions = dict(zip(robot.moving, _configuration(joints, number), strict=True))
    columns = {i: column for column, i in enumerate(robot.moving, start=_JOINTS)}
    scale = _longest(robot)
    places = [base]
    for i, (link, parent) in enumerate(zip(robot.links, robot.parents, strict=True), start=1):
        axes, step = joint_frame(robot, i)
        place = places[parent].stepped(step).turned(axes)
        if i in columns:
            place = place.moved(link, columns[i], positions[i], scale)
        places.append(place)
        swarm.add(link.body, place)
    # A row for each joint with armature, which resists it whatever it carries.
    resisted = [columns[i] for i in columns if robot.links[i - 1].passive.armature > 0.0]
    return np.vstack([*swarm.momenta, np.eye(_JOINTS + joints)[resisted]]), swarm.levers


def _longest(robot: Robot) -> float:
    """The longest length of a robot, or 1 where it is a point."""
    rods = [robot.base.arm(k).length for k in range(1, robot.base.rotors + 1)]
    steps = [float(np.linalg.norm(joint_frame(robot, i + 1)[1])) for i in range(len(robot.links))]
    return max([*rods, *steps, *(link.body.length for link in robot.links)], default=0.0) or 1.0


class _Place:
    """A body's frame: what unit rates make of its origin, and the way that leads there.

    `twists` are the origin's velocity and the angular velocity for unit rates, `attitude` the
    frame's axes in the base's.
    """

    def __init__(self, coordinates: int) -> None:
        self.twists = np.zeros((6, coordinates))
        self.twists[:, :_JOINTS] = np.eye(6)
        self.way = np.zeros(coordinates)
        self.attitude = np.eye(3)

    @property
    def turning(self) -> NDArray[np.bool_]:
        """Which coordinates turn the body."""
        return np.linalg.norm(self.twists[_ANGULAR], axis=0) > 0.5

    def stepped(self, step: Array) -> _Place:
        """Another point of the same body, a step away in its own axes."""
        place, step = deepcopy(self), self.attitude @ step
        place.twists[_LINEAR] += np.cross(self.twists[_ANGULAR].T, step).T
        place.way += self.turning * np.linalg.norm(step)
        return place

    def turned(self, axes: Array) -> _Place:
        """The same place in other axes of the body."""
        place = deepcopy(self)
        place.attitude = self.attitude @ axes
        return place

    def moved(self, link: Link, column: int, position: float, scale: float) -> _Place:
        """The link's frame, which a joint turns (rad) or slides (in shares of `scale`) here."""
        axis = np.array(link.axis)
        if link.joint == "prismatic":
            place = self.stepped(axis * (position * scale))
            place.twists[_LINEAR, column] = self.attitude @ axis
            return place
        place = self.turned(turn_about(axis, position))
        place.twists[_ANGULAR, column] = self.attitude @ axis
        return place


class _Swarm:
    """Bodies by themselves: their momenta, and the lengths that these are made of."""

    def __init__(self, coordinates: int) -> None:
        self.momenta: list[Array] = []
        self._turning = np.zeros(coordinates, bool)
        self._reach = np.zeros(coordinates)

    @property
    def levers(self) -> Array:
        """Lengths that momenta are made of; of translations 1."""
        return np.where(self._turning, self._reach, 1.0)

    def add(self, body: Body, place: _Place, start: Array | float = 0.0) -> None:
        """Add linear and angular momentum of a body, from `start` in the base's axes (m).

        Masses are taken out, and of the moments of inertia the roots: what is left are lengths.
        """
        mass, com, inertia = _central(body)
        arm = start + place.attitude @ com
        moments, axes = np.linalg.eigh(inertia)
        radii = np.sqrt(np.where(moments < _NO_MOMENT * moments[-1], 0.0, moments))
        spins = (place.attitude @ axes).T @ place.twists[_ANGULAR]
        self.momenta.append(radii[:, None] * spins)
        self._turning |= place.turning
        if mass > 0.0:
            levers = np.cross(place.twists[_ANGULAR].T, arm).T
            self.momenta.append(place.twists[_LINEAR] + levers)
            reach = place.turning * (place.way + np.linalg.norm(arm) + radii[-1])
            self._reach = np.maximum(self._reach, reach)


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
