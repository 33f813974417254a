"""Walls that yield: the forces by which they push frames back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.scenario.environment import Wall
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle


class Walls:
    """The walls of a flight.

    Args:
        vehicle: the robot.
        walls: the walls, w of them.
    """

    def __init__(self, vehicle: Vehicle, walls: Sequence[Wall]) -> None:
        self.walls = tuple(walls)
        self.places: NDArray[np.intp] = np.array(
            [vehicle.frames.index(wall.frame) for wall in walls], dtype=np.intp
        )
        normals = np.array([wall.normal for wall in walls], dtype=np.float64).reshape(-1, 3)
        self.normals: Array = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        points = np.array([wall.point for wall in walls], dtype=np.float64)
        self.points: Array = points.reshape(-1, 3)
        self.stiffness: Array = np.array([wall.stiffness for wall in walls], dtype=np.float64)
        self.damping: Array = np.array([wall.damping for wall in walls], dtype=np.float64)

    def add(self, wrenches: Array, poses: Array, velocities: Array) -> None:
        """Add the forces of the walls to other wrenches, which `forces` tells one by one.

        Args:
            wrenches: Wrenches (…, f, 6) on the frames, which are changed.
            poses: Poses (…, f, 4, 4) of the frames.
            velocities: Velocities (…, f, 6) of the frames: linear, then angular, world axes.
        """
        forces = self.forces(poses, velocities)[..., np.newaxis] * self.normals
        for k, place in enumerate(self.places):
            wrenches[..., place, :3] += forces[..., k, :]

    def forces(self, poses: Array, velocities: Array) -> Array:
        """The force (…, w) of each wall along its normal, N, by poses and velocities of frames."""
        behind = self.points - poses[..., :3, 3][..., self.places, :]
        depth = np.sum(self.normals * behind, axis=-1)
        speed = -np.sum(self.normals * velocities[..., self.places, :3], axis=-1)
        pushed = np.maximum(self.stiffness * depth + self.damping * speed, 0.0)
        return np.where(depth > 0.0, pushed, 0.0)

    def effective_masses(self, vehicle: Vehicle, q: Array) -> Array:
        """The masses that walls feel along their normals, of a robot that is free to move.

        Args:
            vehicle: The robot.
            q: Coordinates (…, nq).

        Returns:
            Masses (…, w), kg: 1 / (nᵀ J M⁻¹ Jᵀ n).
        """
        jacobians = vehicle.function("frame_jacobians")(q)[..., self.places, :3, :]
        across = np.einsum("wi,...wij->...wj", self.normals, jacobians)
        yielding = np.linalg.solve(vehicle.mass_matrix(q), np.swapaxes(across, -1, -2))
        masses: Array = 1.0 / np.einsum("...wj,...jw->...w", across, yielding)
        return masses
