"""Displacements of a module's coordinates in place of changes of their entries.

A module's derivatives by q are those by a displacement in the tangent space. With attitude angles
that is a change of the entries. With a quaternion it has the linear and the angular displacement of
the base, in the base's axes, in place of the changes of seven entries.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import jax.numpy as jnp

from gibbs_codegen.interface import ARGUMENTS

_POSITION, _VECTOR, _SCALAR = slice(0, 3), slice(3, 6), slice(6, 7)
_JOINTS, _JOINTS_OF_V = slice(7, None), slice(6, None)


class Tangents:
    """Displacements for the attitude that a module has."""

    def __init__(self, module: ModuleType) -> None:
        """Take a module, with any back end."""
        self._is_quaternion = module.ATTITUDE == "quaternion"

    def has(self, argument: str) -> bool:
        """Whether an argument, as the table of functions names it, has a quaternion in it.

        Then displacements differ from changes of the entries.
        """
        return self._is_quaternion and ARGUMENTS[argument].is_coordinates

    def normalised(self, argument: str, values: Any) -> Any:
        """An argument (..., width) with a quaternion of unit length."""
        if not self.has(argument):
            return values
        quaternion = values[..., 3:7]
        squared = jnp.sum(quaternion * quaternion, axis=-1, keepdims=True)
        unit = quaternion * (jnp.sqrt(squared) * (1 / squared))  # Not finite where that is not.
        return jnp.concatenate([values[..., _POSITION], unit, values[..., _JOINTS]], axis=-1)

    def displacement(self, argument: str, values: Any, change: Any) -> Any:
        """The displacement (..., nv) that changes coordinates as given; of others the changes.

        They leave the unit length of a quaternion as it is.
        """
        if not self.has(argument):
            return change
        vector, scalar = values[..., _VECTOR], values[..., _SCALAR]
        turned = change[..., _VECTOR] * scalar - vector * change[..., _SCALAR]
        turned = 2.0 * (turned - jnp.cross(vector, change[..., _VECTOR]))
        moved = _rotated(-vector, scalar, change[..., _POSITION])
        return jnp.concatenate([moved, turned, change[..., _JOINTS]], axis=-1)

    def changes(self, coordinates: Any, displacement: Any) -> Any:
        """Changes of coordinates (..., nq), of unit quaternion, by a displacement (..., nv)."""
        if not self._is_quaternion:
            return displacement
        vector, scalar = coordinates[..., _VECTOR], coordinates[..., _SCALAR]
        half = 0.5 * displacement[..., 3:6]
        moved = _rotated(vector, scalar, displacement[..., _POSITION])
        by_vector = scalar * half + jnp.cross(vector, half)
        by_scalar = -jnp.sum(vector * half, axis=-1, keepdims=True)
        joints = displacement[..., _JOINTS_OF_V]
        return jnp.concatenate([moved, by_vector, by_scalar, joints], axis=-1)

    def turned_columns(self, matrix: Any, displacement: Any) -> Any:
        """What a symmetric second derivative lacks of the change of a first derivative.

        Displacements one after the other differ from their sum by half their commutator, that of
        SE(3), along which the first derivative acts. `matrix` and the result are (..., rows, nv);
        zero without a quaternion.
        """
        if not self._is_quaternion:
            return 0.0
        linear, angular = matrix[..., :3], matrix[..., 3:6]
        moved = -0.5 * displacement[..., None, :3]
        turned = -0.5 * displacement[..., None, 3:6]
        # A row r of a matrix times (w x) is r x w, transposed.
        by_linear = jnp.cross(turned, linear)
        by_angular = jnp.cross(moved, linear) + jnp.cross(turned, angular)
        rest = jnp.zeros_like(matrix[..., _JOINTS_OF_V])
        return jnp.concatenate([by_linear, by_angular, rest], axis=-1)


def _rotated(vector: Any, scalar: Any, point: Any) -> Any:
    """A point (..., 3) turned by a unit quaternion of vector (..., 3) and scalar (..., 1)."""
    return point + 2.0 * jnp.cross(vector, jnp.cross(vector, point) + scalar * point)
