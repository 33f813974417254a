"""Is every acceleration determined, and can it be computed? Asked before anything is emitted.

A massless degree of freedom is a motion that every body's inertia annihilates. Whether there is one
is found in the robot's data. It does not depend on how heavy the bodies are, so each is scaled by
its own mass: ratios that make the mass matrix ill-conditioned do no harm, and neither do those of
lengths below 1e12.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from gibbs_codegen.errors import SingularRobotError, UsageError
from gibbs_codegen.program.nodes import ScalarProgram
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.body import as_rigid_body, inertia_matrix
from gibbs_codegen.robot.parts.numbers import BASE, size_fault
from gibbs_codegen.robot.placement import joint_pose
from gibbs_codegen.robot.posture import AT_ORIGIN, base_bodies, frames_on
from gibbs_codegen.robot.rotations import Array

Motion = tuple[str, ...]

# Smallest eigenvalue of the mass matrix with a unit diagonal: rounding leaves up to 3e-16 of a
# singular one, while a 3 m rod of 1 µm thickness still has 9e-15.
_SMALLEST = 2e-15
# A regular robot may be singular at one configuration by accident; three are not.
_CONFIGURATIONS = 3
# Rounding leaves 1e-14 of a unit motion that moves nothing; values above this are inertia, be it
# the spin of a rod that is 1e11 times longer than thick.
_NOTHING = 1e-12
# Principal moments that are zero but for the rounding of the matrix they were computed from.
_NO_MOMENT = 1e-15
# Shares below this in a motion of unit shares are rounding; those that are real are geometry.
_NO_SHARE = 1e-7
_JOINTS = 6


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


def check_conditioning(
    robot: Robot, mass_matrix: ScalarProgram, defaults: Mapping[str, float]
) -> None:
    """Raise `SingularRobotError` if M is singular to the accuracy of double precision.

    It names the coordinate that most of the motion of least inertia is made of.
    """
    weakest = []
    size = len(mass_matrix.inputs["v"])
    for number in range(_CONFIGURATIONS):
        q = _configuration(len(mass_matrix.inputs["q"]), number)
        values = mass_matrix.evaluate("mass_matrix", defaults, {"q": q})
        matrix = np.array(values[0]).reshape(size, size)
        diagonal = np.diag(matrix)
        if (diagonal <= 0).any():
            weakest.append((0.0, int(np.argmin(diagonal))))
            continue
        unit = np.sqrt(diagonal)
        eigenvalues, vectors = np.linalg.eigh(matrix / np.outer(unit, unit))
        if eigenvalues[0] >= _SMALLEST:
            return
        weakest.append((float(eigenvalues[0]), int(np.argmax(np.abs(vectors[:, 0])))))
    largest = Description(robot).coordinate_text(max(weakest)[1])
    raise SingularRobotError(robot.name, [(largest,)], ill_conditioned=True)


def check_range(robot: Robot, program: ScalarProgram, defaults: Mapping[str, float]) -> None:
    """Raise `UsageError` where emitted functions would overflow with the robot's own parameters.

    It names the parameters that are the furthest from 1.
    """
    arguments = {
        "q": _configuration(len(program.inputs["q"]), 0),
        "v": [0.0] * len(program.inputs["v"]),
        "u": [0.0] * len(program.inputs["u"]),
    }
    try:
        values = [*program.prepared(defaults).values()]
        if "forward_dynamics" in (function.name for function in program.functions):
            values += program.evaluate("forward_dynamics", defaults, arguments)[0]
        good = all(map(math.isfinite, values))
    except (ZeroDivisionError, OverflowError):
        good = False
    if good:
        return
    sizes = {name: abs(math.log10(abs(value))) for name, value in defaults.items() if value}
    furthest = sorted(sizes, key=sizes.__getitem__, reverse=True)[:2]
    shown = " and ".join(f"{name} = {defaults[name]:g}" for name in furthest)
    raise UsageError(
        f"{robot.name}: accelerations overflow or vanish in rounding, with {shown}; give masses "
        "and lengths of more similar size"
    )


def _configuration(size: int, number: int) -> list[float]:
    return [0.3 + 0.7 * math.sin(1.7 * i + 0.9 * number) for i in range(size)]


def massless_motions(robot: Robot) -> list[Motion]:
    """Motions that move no mass, whatever the configuration; empty for a robot as it should be.

    Each is the coordinates that must move together, outermost joint first. No coordinate can be
    left out of a motion without its moving mass. A base that does not move freely is not looked at
    here, but by its mass matrix: what turns it depends on its pose. Nor are joints that gears move.
    """
    if not robot.base.moves_freely or robot.is_geared:
        return []
    fewest = min((_null_motions(*_momenta(robot, k)) for k in range(_CONFIGURATIONS)), key=len)
    description = Description(robot)
    q, joints = description.layout.q, description.layout.v.joint_places
    named: dict[Motion, None] = {}
    for motion in fewest:
        names = [description.coordinate_text(joints[k - _JOINTS]) for k in motion if k >= _JOINTS]
        if any(3 <= k < _JOINTS for k in motion):  # The origin only follows when the base turns.
            names.append(f"the attitude ({', '.join(q.names[q.attitude])})")
        elif any(k < 3 for k in motion):
            names.append(f"the position ({', '.join(q.names[q.position])})")
        named[tuple(names)] = None
    return list(named)


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


def _momenta(robot: Robot, number: int) -> tuple[Array, Array]:
    """Momenta of all bodies over their own masses, for unit rates, and lengths of their roundings.

    Columns are the base centre's velocity, the base's angular velocity, and the joints' rates, at
    an arbitrary configuration of the joints. Masses are taken out, and of the moments of inertia
    the roots: what is left are lengths.
    """
    base, moving = robot.base, robot.moving
    size = _JOINTS + len(moving)
    lengths = [base.arm(k).length for k in range(1, base.rotors + 1)]
    for i, link in enumerate(robot.links, start=1):
        lengths += [float(np.linalg.norm(joint_pose(robot, i).xyz)), link.body.length]
    shares = np.array(_configuration(len(moving), number))
    slides = np.array([robot.links[i - 1].joint == "prismatic" for i in moving], bool)
    positions = shares * np.where(slides, max(lengths, default=0.0) or 1.0, 1.0)
    frames = frames_on(robot, AT_ORIGIN, positions)
    # The way to the frame of each body; the axis of each column, with a point on it or nothing.
    ways, turns = [0.0], [(*np.zeros((3, 3, size)),)]
    linear, angular, _ = turns[BASE]
    linear[:, :3] = angular[:, 3:_JOINTS] = np.eye(3)
    for i, (link, frame, parent) in enumerate(
        zip(robot.links, frames.links, robot.parents, strict=True), start=1
    ):
        before = frames.links[parent - 1] if parent != BASE else frames.base
        ways.append(ways[parent] + float(np.linalg.norm(frame.origin - before.origin)))
        linear, angular, points = (part.copy() for part in turns[parent])
        if i in moving:
            column, axis = _JOINTS + moving.index(i), frame.axes @ np.array(link.axis)
            (linear if link.joint == "prismatic" else angular)[:, column] = axis
            points[:, column] = frame.origin
        turns.append((linear, angular, points))
    bodies = [(arm, frame, BASE) for arm, frame in base_bodies(robot, frames)]
    bodies += [(link.body, frames.links[i], i + 1) for i, link in enumerate(robot.links)]
    momenta, turning, levers = [], np.zeros(size, bool), np.zeros(size)
    for carrier, frame, number in bodies:
        body, (linear, angular, points) = as_rigid_body(carrier), turns[number]
        moments, axes = np.linalg.eigh(inertia_matrix(body.inertia) / (body.mass or 1.0))
        radii = np.sqrt(np.where(moments < _NO_MOMENT * moments[-1], 0.0, moments))
        momenta.append(radii[:, None] * ((frame.axes @ axes).T @ angular))
        turned = np.linalg.norm(angular, axis=0) > 0.5
        turning |= turned
        if body.mass > 0.0:
            place = frame.place(body.com)
            arms = place[:, None] - points
            momenta.append(linear + np.cross(angular, arms, axis=0))
            reach = ways[number] + np.linalg.norm(place - frames.centre) + radii[-1]
            levers = np.maximum(levers, turned * reach)
    # A row for each joint with armature or a rotor, which resist it whatever it carries.
    links = [robot.links[i - 1] for i in moving]
    rotors = [x.passive.armature or (x.motor and x.motor.gear_ratio) for x in links]
    resisted = [_JOINTS + k for k, rotor in enumerate(rotors) if rotor]
    return np.vstack([*momenta, np.eye(size)[resisted]]), np.where(turning, levers, 1.0)
