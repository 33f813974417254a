"""Numbers of a robot that can be computed with but are probably in another unit."""

from __future__ import annotations

import numpy as np

from gibbs_codegen.robot.model import Body, Robot, as_rigid_body
from gibbs_codegen.robot.names import link_label, rotor_label
from gibbs_codegen.robot.placement import Array
from gibbs_codegen.robot.posture import AT_ORIGIN, frames_on
from gibbs_codegen.robot.rigid_body import inertia_matrix

# Robots are slender: none fills the cube around it with water, kg/m³.
_WATER = 1000.0
# Robots have substance: film to wrap food in weighs twice as much, kg/m². An arm of 64 rods of 3 m
# and 1 kg/m weighs more, too, and all robots are a million times lighter in millimetres.
_FILM = 0.004
# Radius of gyration of a body, of the extent of the whole robot.
_LARGEST_GYRATION = 3.0
# Of propellers it is about 0.01 to 0.03 m.
LARGEST_DRAG = 0.1


def implausible(robot: Robot) -> tuple[str, ...]:
    """Warnings of what is probably grams, millimetres or degrees, with what was perhaps meant."""
    extent = _extent(robot)
    found = []
    if extent and robot.total_mass > _WATER * extent**3:
        found.append(
            f"the robot weighs {robot.total_mass:.4g} kg at a size of {extent:.3g} m, more than "
            "water in a cube of that size; masses are in kg and lengths in m"
        )
    if robot.total_mass < _FILM * extent**2:
        found.append(
            f"the robot is {extent:.4g} m long and weighs {robot.total_mass:.4g} kg; are lengths "
            "in millimetres? (they are in m)"
        )
    for name, body in _bodies(robot):
        gyration = _gyration(body)
        if extent and gyration > _LARGEST_GYRATION * extent:
            found.append(
                f"the inertia of {name} is that of its mass at {gyration:.3g} m, and the whole "
                f"robot is {extent:.3g} m long; inertias are in kg m²"
            )
    return (*found, *_drags(robot), *_limits(robot))


def _extent(robot: Robot) -> float:
    """The longest side of a box around the joints, rotors, ends and centres of mass (m)."""
    frames = frames_on(robot, AT_ORIGIN, np.zeros(len(robot.moving)))
    ends: list[Array] = [frames.centre, *frames.motors]
    for link, frame in zip(robot.links, frames.links, strict=True):
        body = as_rigid_body(link.body)
        ends += [frame.origin, frame.place(body.com), frame.point(body.length)]
    return float(np.ptp(np.array(ends), axis=0).max())


def _bodies(robot: Robot) -> list[tuple[str, Body]]:
    bodies: list[tuple[str, Body]] = [("the base", robot.base.body)] if robot.base.body else []
    bodies += [(f"base arm {k}", arm) for k, arm in enumerate(robot.base.arms, start=1)]
    return bodies + [
        (link_label(robot, i), link.body) for i, link in enumerate(robot.links, start=1)
    ]


def _gyration(body: Body) -> float:
    """Radius of gyration about the axis of the largest moment of inertia (m), 0 without mass."""
    rigid = as_rigid_body(body)
    if not rigid.mass:
        return 0.0
    largest = float(np.linalg.eigvalsh(inertia_matrix(rigid.inertia))[-1])
    return float(np.sqrt(max(largest, 0.0) / rigid.mass))


def _drags(robot: Robot) -> list[str]:
    drags = [*robot.base.drag, *(rotor.drag for rotor in robot.thrusters)]
    return [
        f"the drag of rotor {rotor_label(robot, k)} is {drag:.4g} m; it is the reaction torque per "
        "unit of thrust, and about 0.02 m for propellers"
        for k, drag in enumerate(drags, start=1)
        if abs(drag) > LARGEST_DRAG
    ]


def _limits(robot: Robot) -> list[str]:
    warnings = []
    for i in robot.moving:
        link = robot.links[i - 1]
        far = [v for v in (link.limits.low, link.limits.high) if v and abs(v) > 2.0 * np.pi]
        if link.joint == "revolute" and far:
            warnings.append(
                f"a limit of {link_label(robot, i)} is {far[0]:.4g} rad, more than a turn; "
                "limits are in rad, limits_deg in degrees"
            )
    return warnings
