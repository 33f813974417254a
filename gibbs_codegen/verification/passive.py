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
        """What acts on the joints of a robot: zero for those of the base and those that are held.

        `places` are those of the joints that move among all `size`, in the order of their links.
        """
        every = np.zeros((size, len(cls._fields)))
        for place, i in zip(places, robot.moving, strict=True):
            every[place] = astuple(robot.links[i - 1].passive)
        return cls._make(every.T)

    def forces(self, q: Array, v: Array) -> Array:
        """Forces (…, size), N m and N, of dampers and springs, at q and v of all joints."""
        forces: Array = -self.damping * v - self.stiffness * (q - self.rest)
        return forces

    def sizes(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Sizes of the terms of these forces (…, size), and of the springs' energy (…), J."""
        stretch = np.abs(q) + np.abs(self.rest)
        pulling = np.abs(self.stiffness) * stretch
        return np.abs(self.damping * v) + pulling, np.sum(pulling * stretch, axis=-1)

    def energies(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Kinetic energy of what turns with joints alone, and the springs' potential, (…), J."""
        kinetic = 0.5 * np.sum(self.armature * v**2, axis=-1)
        return kinetic, 0.5 * np.sum(self.stiffness * (q - self.rest) ** 2, axis=-1)
