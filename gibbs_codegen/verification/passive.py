"""What acts on joints by itself, added to what a formulation of the bodies alone gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple
from typing import NamedTuple

import numpy as np

from gibbs_codegen.robot.model import Robot
from gibbs_codegen.verification.vectors import Array


class PassiveJoints(NamedTuple):
    """What acts on all joints by themselves, (size,) each: as `robot.model.Passive` has it."""

    damping: Array
    armature: Array
    stiffness: Array
    rest: Array

    @classmethod
    def of(cls, robot: Robot, size: int, places: Sequence[int]) -> PassiveJoints:
        """What acts on the joints of a robot.

        Args:
            robot: The robot.
            size: Number of all joints.
            places: Among them, places of those that move, in the order of their links.

        Returns:
            Zero for the joints of the base and for those that are held.
        """
        every = np.zeros((size, len(cls._fields)))
        for place, i in zip(places, robot.moving, strict=True):
            every[place] = astuple(robot.links[i - 1].passive)
        return cls._make(every.T)

    def forces(self, q: Array, v: Array) -> Array:
        """Forces of dampers and springs.

        Args:
            q, v: Coordinates and rates of all joints in rad and m, (…, size).

        Returns:
            In N m and N, (…, size).
        """
        forces: Array = -self.damping * v - self.stiffness * (q - self.rest)
        return forces

    def sizes(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Sizes of the terms of these forces, and of the springs' energy.

        Args:
            q, v: Coordinates and rates of all joints in rad and m, (…, size).

        Returns:
            Forces in N m and N, (…, size), and energy in J, (…).
        """
        stretch = np.abs(q) + np.abs(self.rest)
        pulling = np.abs(self.stiffness) * stretch
        return np.abs(self.damping * v) + pulling, np.sum(pulling * stretch, axis=-1)

    def energies(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Kinetic energy of what turns with the joints alone, and potential energy of the springs.

        Args:
            q, v: Coordinates and rates of all joints in rad and m, (…, size).

        Returns:
            Both in J, (…).
        """
        kinetic = 0.5 * np.sum(self.armature * v**2, axis=-1)
        return kinetic, 0.5 * np.sum(self.stiffness * (q - self.rest) ** 2, axis=-1)
