"""A robot as the flat list of bodies every peer is given, so that all compute the same model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from support.pinocchio_oracle import Oracle

from gibbs_codegen.robot.model import Robot

Array = np.ndarray

ATTITUDE_AND_POSITION = 6


@dataclass(frozen=True)
class Body:
    """A body that turns about its z axis; at angle zero `turn` and `step` place it in its parent.

    `com` in m and `inertia` about it, in kg m², are in the body's own axes. The first body of a
    tree is the base, which six coordinates move instead.
    """

    turn: Array
    step: Array
    mass: float
    com: Array
    inertia: Array

    @property
    def moment(self) -> Array:
        """First moment of mass about the body's origin."""
        return self.mass * self.com

    @property
    def inertia_about_origin(self) -> Array:
        """Inertia about the body's origin."""
        return self.inertia + shifted(self.mass, self.com)


@dataclass(frozen=True)
class Tree:
    """Base and arm of a robot, from the base outwards, under gravity along −Z."""

    bodies: tuple[Body, ...]
    gravity: float

    @property
    def joints(self) -> int:
        """Number of arm joints."""
        return len(self.bodies) - 1

    @property
    def coordinates(self) -> int:
        """Number of coordinates: attitude, joints, position."""
        return ATTITUDE_AND_POSITION + self.joints

    def numbers(self) -> Array:
        """All bodies as one row of 25 numbers each."""
        rows = [
            np.concatenate([b.turn.ravel(), b.step, [b.mass], b.com, b.inertia.ravel()])
            for b in self.bodies
        ]
        return np.array(rows)


def shifted(mass: float, lever: Array) -> Array:
    """Inertia of a point mass at `lever`."""
    return mass * (lever @ lever * np.eye(3) - np.outer(lever, lever))


def without_dust(values: Array) -> Array:
    """Values with whole numbers made exact, so that zeros and ones are structural."""
    whole = np.round(values)
    scale = max(1.0, np.abs(values).max(initial=0.0))
    return np.where(np.abs(values - whole) < 1e-14 * scale, whole + 0.0, values)


def tree_of(robot: Robot) -> Tree:
    """Tree of a robot with attitude x-y-z, its origin at the base's centre and revolute joints."""
    model = Oracle(robot, rigid_base=True).model
    if robot.base.attitude != "xyz" or robot.base.origin != "centre":
        raise ValueError("the peers measure position at the centre and attitude as x-y-z")
    if any(link.joint != "revolute" for link in robot.links):
        raise ValueError("the peers have revolute joints only")
    bodies = tuple(
        Body(
            without_dust(model.jointPlacements[i].rotation),
            without_dust(model.jointPlacements[i].translation),
            model.inertias[i].mass,
            without_dust(model.inertias[i].lever),
            without_dust(model.inertias[i].inertia),
        )
        for i in range(ATTITUDE_AND_POSITION, model.njoints)
    )
    return Tree(bodies, robot.gravity)
