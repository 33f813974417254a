"""How a robot is drawn from its points: rods between them, joints, rotors, and sizes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.figures.robot_artists import disc_radius
from gibbs_codegen.simulator.record.series import Array

Indices = NDArray[np.int_]

# Of how far a robot's points reach: the largest disc.
_LARGEST_DISC = 0.4


@dataclass(frozen=True)
class Points:
    """The points of a robot by their places in its list: base centre, N rotors, n joints, others.

    `parents` are the points that each is joined to, −1 for none; `arms` is the number of base arms
    that constraints hold, which lead to the last rotors.
    """

    parents: Sequence[int]
    centre: int
    rotors: int
    joints: int
    arms: int


@dataclass(frozen=True)
class Skeleton:
    """What is drawn of a robot.

    `rods` are numbers (r, 2) of the points that each rod joins; `joints` and `rotors` are those of
    the points that are marked as such; `loads` (r) is the number of the effort that colours each
    rod, of the n joints and then of the base arms, −1 for none. `radius` is that of a rotor's disc,
    m, and `size` how far the robot reaches from its base centre, m, to which the rest is in
    proportion.
    """

    rods: Indices
    joints: Indices
    rotors: Indices
    loads: Indices
    radius: float
    size: float


def skeleton(points: Points, positions: Array, directions: Array) -> Skeleton:
    """Rods from every point of a robot to the one that it is joined to, and what else is drawn.

    `positions` are (…, k, 3) in some postures, m, and `directions` (N, 3) unit vectors of the
    thrusts in the first of them, in the same axes.
    """
    first = points.centre + 1
    rotors = np.arange(first, first + points.rotors)
    joints = range(first + points.rotors, first + points.rotors + points.joints)
    rods = [(parent, point) for point, parent in enumerate(points.parents) if parent >= 0]
    # A link goes on from its joint; base arm k leads to rotor k, and the first one is not held.
    loads = {joint: number for number, joint in enumerate(joints)}
    held = {int(rotors[-points.arms + k]): points.joints + k for k in range(points.arms)}
    around = positions - positions[..., [points.centre], :]
    reach = float(np.nanmax(np.linalg.norm(around, axis=-1))) or 1.0
    places = positions.reshape(-1, *positions.shape[-2:])[0]
    spokes = places[rotors] - places[np.asarray(points.parents, dtype=np.int_)[rotors]]
    found = disc_radius(places[rotors], directions, np.linalg.norm(spokes, axis=1))
    radius = min(found, _LARGEST_DISC * reach)
    return Skeleton(
        np.array(rods, dtype=np.int_).reshape(-1, 2),
        np.array([points.centre, *joints], dtype=np.int_),
        rotors,
        np.array([held.get(end, loads.get(start, -1)) for start, end in rods], dtype=np.int_),
        radius,
        reach + radius,
    )
