"""Reachable wrenches of a robot that hovers in a posture."""

from __future__ import annotations

import os
from collections.abc import Mapping
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.analysis.arguments import vehicle_of
from gibbs_codegen.flight.analysis.trim import trim
from gibbs_codegen.robot.reach import CENTRE_OF_MASS, ReachableWrenches, about


def reachable_wrenches(
    robot: ModuleType | str | os.PathLike[str],
    posture: Mapping[str, float] | None = None,
    *,
    posture_deg: Mapping[str, float] | None = None,
    q: ArrayLike | None = None,
    frame: str | None = None,
    limits: ArrayLike | None = None,
    parameters: Mapping[str, float] | None = None,
) -> ReachableWrenches:
    """The wrenches that the rotors of a robot that hovers can produce within their limits.

    Args:
        robot: A generated module, or the name or path of one, which is loaded.
        posture, posture_deg, q: As of `trim`, which finds how the robot hovers.
        frame: The frame about whose origin wrenches are; about the centre of mass if None.
        limits: As of `trim`; every rotor must have both, here or in the robot file.
        parameters: Parameters of the module's `prepare`.

    Returns:
        The wrenches.

    Raises:
        UsageError: The robot cannot hover, has no such frame, no rotors, or rotors without limits.
    """
    vehicle = vehicle_of(robot, parameters)
    if not vehicle.rotors:
        raise UsageError(
            f"{vehicle.name} has no rotors, so it reaches no wrenches; add rotors to the robot file"
        )
    place = None if frame is None else vehicle.frame_place(frame, "frame")
    hovering_trim = trim(
        vehicle.module,
        posture,
        posture_deg=posture_deg,
        q=q,
        limits=limits,
        parameters=parameters,
    )
    thrusts = hovering_trim.limits[:, : vehicle.rotors]
    if not np.isfinite(thrusts).all():
        raise UsageError(
            f"{vehicle.name}: some rotor has no limits of thrust; give limits=(least, most), N"
        )
    if place is None:
        point = vehicle.centre_of_mass(hovering_trim.q)
    else:
        point = vehicle.frame_poses(hovering_trim.q)[place, :3, 3]
    centre = vehicle.positions(hovering_trim.q)[vehicle.points.index(vehicle.centre)]
    away = vehicle.base_rotation(hovering_trim.q).T @ (point - centre)
    columns = about(vehicle.thrust_wrenches(hovering_trim.q), away)
    hovering = hovering_trim.u[: vehicle.rotors]
    return ReachableWrenches(vehicle.name, frame or CENTRE_OF_MASS, columns, thrusts, hovering)
