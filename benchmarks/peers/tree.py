"""A robot as the flat list of bodies every peer is given, so that all compute the same model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from peers.contender import Ordered
from support.pinocchio_oracle import Oracle

from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.numbers import Vector3
from gibbs_codegen.robot.parts.pose import HERE

Array = np.ndarray

# Velocities of a base that moves, and of them those of its attitude.
BASE_VELOCITIES = 6
ATTITUDE = 3

ROOTS = ("fixed", "quaternion", "xyz")


@dataclass(frozen=True)
class Body:
    """A body that turns about its z axis; at angle zero `turn` and `step` place it in its parent.

    `parent` is the parent's index. `com` in m and `inertia` about it, in kg m², are in the body's
    own axes. The first body of a tree is the base, which six coordinates move instead, or none.
    """

    parent: int
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
    """Base and links of a robot, each body after its parent, under gravity along −Z.

    `root` is one of `ROOTS`: on a quaternion the base's velocities are those of a free-flyer, in
    its own frame; on "xyz" they are the rates of the attitude and of the position.
    """

    bodies: tuple[Body, ...]
    gravity: float
    root: str

    @property
    def joints(self) -> int:
        """Number of joints after the base."""
        return len(self.bodies) - 1

    @property
    def velocities(self) -> int:
        """Number of velocities, and of forces."""
        return self.base_velocities + self.joints

    @property
    def base_velocities(self) -> int:
        """Number of the base's velocities."""
        return 0 if self.root == "fixed" else BASE_VELOCITIES

    @property
    def layout(self) -> Ordered:
        """Position and attitude, or free-flyer, then the joints."""
        size = self.velocities
        if self.root != "xyz":
            return Ordered(tuple(range(size)), tuple(range(size + (self.root == "quaternion"))))
        position_first = (*range(size - 3, size), *range(size - 3))
        return Ordered(position_first, position_first)

    def row(self, body: int) -> int:
        """Place of the joint of a body among the project's velocities."""
        return (ATTITUDE if self.root == "xyz" else self.base_velocities) - 1 + body

    def path(self, body: int) -> list[int]:
        """Bodies from this one in to the base, which is left out."""
        path = []
        while body:
            path.append(body)
            body = self.bodies[body].parent
        return path

    def numbers(self) -> Array:
        """All bodies as one row of 26 numbers each."""
        rows = [
            [b.parent, *b.turn.ravel(), *b.step, b.mass, *b.com, *b.inertia.ravel()]
            for b in self.bodies
        ]
        return np.array(rows, float)


def shifted(mass: float, lever: Array) -> Array:
    """Inertia of a point mass at `lever`."""
    return mass * (lever @ lever * np.eye(3) - np.outer(lever, lever))


def without_dust(values: Array) -> Array:
    """Values with whole numbers made exact, so that zeros and ones are structural."""
    whole = np.round(values)
    scale = max(1.0, np.abs(values).max(initial=0.0))
    return np.where(np.abs(values - whole) < 1e-14 * scale, whole + 0.0, values)


def tree_of(robot: Robot) -> Tree:
    """Tree of a robot with revolute joints on a root of `ROOTS`, about the base's centre."""
    oracle = Oracle(robot, rigid_base=True)
    if robot.base.kind not in ROOTS or robot.base.origin == "motor1" or robot.base.pose != HERE:
        raise ValueError(f"the peers have bases {', '.join(ROOTS)}, not at a motor or a pose")
    if any(robot.links[i - 1].joint != "revolute" for i in robot.moving):
        raise ValueError("the peers have revolute joints only")
    tree = Tree(tuple(_bodies(oracle)), robot.gravity, robot.base.kind)
    if tuple(np.argsort(oracle.order)) != tree.layout.order:
        raise ValueError("the peers take all links of an arm before those of the next")
    return tree


def _bodies(oracle: Oracle) -> Iterator[Body]:
    """The bodies of Pinocchio's model, each turned so that its joint's axis is z."""
    model, root = oracle.model, oracle.root
    links = oracle.robot.links
    axes = [_z_onto(links[i - 1].axis) for i in oracle.robot.moving]
    axes = dict(enumerate([np.eye(3), *axes], start=root))
    for i in range(root, model.njoints):
        parent, placement, inertia = model.parents[i], model.jointPlacements[i], model.inertias[i]
        turn, step = np.eye(3), np.zeros(3)
        if i > root:
            turn = axes[parent].T @ placement.rotation @ axes[i]
            step = axes[parent].T @ placement.translation
        yield Body(
            max(parent - root, 0),
            without_dust(turn),
            without_dust(step),
            inertia.mass,
            without_dust(axes[i].T @ inertia.lever),
            without_dust(axes[i].T @ inertia.inertia @ axes[i]),
        )


def _z_onto(axis: Vector3) -> Array:
    """A rotation that takes z to an axis."""
    return pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), np.array(axis)).matrix()
