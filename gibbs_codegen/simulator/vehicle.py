"""A generated module as the simulator sees it: its functions with their constants, and its layout.

This is all that the simulator knows of a robot; either back end serves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gibbs_codegen.errors import UsageError
from gibbs_codegen.interface import DATA, FUNCTIONS
from gibbs_codegen.robot.layout import QUATERNION, Layout
from gibbs_codegen.scenario.attitude import rate_matrix, rotation_matrix

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Vehicle:
    """A generated module with the constants of some parameters.

    The functions are the module's own, by the same names.

    Args:
        module: a generated module, of either back end.
        parameters: parameters of the module's `prepare`; those left out keep their defaults.

    Raises:
        UsageError: for a module of an older version, and for parameters that `prepare` rejects.
    """

    def __init__(self, module: ModuleType, parameters: Mapping[str, float] | None = None) -> None:
        if missing := [name for name in (*DATA, *FUNCTIONS) if not hasattr(module, name)]:
            raise UsageError(
                f"{module.NAME}: has no {', '.join(missing)}: generate it again, with this version"
            )
        if module.ATTITUDE == QUATERNION:
            raise UsageError(
                f"{module.NAME}: its attitude is a quaternion, which cannot be simulated yet; give "
                'base.attitude as a sequence of angles, such as "xyz", and generate it again'
            )
        try:
            self.constants: Any = module.prepare(dict(parameters)) if parameters else None
        except (ValueError, TypeError) as error:
            raise UsageError(f"{module.NAME}: parameters: {error}") from None
        self.module = module
        self.name: str = module.NAME
        self.attitude: str = module.ATTITUDE
        self.coordinates: tuple[str, ...] = module.COORDINATES
        constrained = (len(module.HYBRID_COORDINATES) - len(module.VELOCITIES)) // 2
        units = module.COORDINATE_UNITS
        self.layout = Layout.listed(self.attitude, self.coordinates, units, constrained)
        # By coordinate (nq): an angle, in rad, rather than a length, in m.
        self.is_angle: Flags = np.array([unit == "rad" for unit in self.layout.q.units])
        self.inputs: tuple[str, ...] = module.INPUTS
        self.points: tuple[str, ...] = module.POINTS
        self.arm = self.layout.q.joints
        self.joints = len(self.joint_names)
        self.rotors = len(self.inputs) - self.joints
        self.forward_dynamics = self._bound("forward_dynamics")
        self.inverse_dynamics = self._bound("inverse_dynamics")
        self.mass_matrix = self._bound("mass_matrix")
        self.input_matrix = self._bound("input_matrix")
        self.constraint_torques = self._bound("constraint_torques")
        self.positions = self._bound("positions")
        self.tip_pose = self._bound("tip_pose")
        self.tip_jacobian = self._bound("tip_jacobian")
        self.tip_bias_acceleration = self._bound("tip_bias_acceleration")
        self.kinetic_energy = self._bound("kinetic_energy")
        self.potential_energy = self._bound("potential_energy")

    def _bound(self, name: str) -> Callable[..., Array]:
        function: Callable[..., Array] = getattr(self.module, name)
        return function if self.constants is None else partial(function, constants=self.constants)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the arm's coordinates, from the base outwards."""
        return self.coordinates[self.arm]

    def base_rotation(self, q: ArrayLike) -> Array:
        """Rotation of the base.

        Args:
            q: Coordinates (…, nq).

        Returns:
            R (…, 3, 3), from the frame of arm 1 to the world.
        """
        return rotation_matrix(self.attitude, np.asarray(q)[..., self.layout.q.attitude])

    def centre_offset(self, q: ArrayLike) -> Array:
        """Vector from the point whose position is x, y, z to the base centre.

        Args:
            q: Coordinates (…, nq).

        Returns:
            The vector (…, 3), world axes, m.
        """
        at_origin = np.array(q, dtype=np.float64)
        at_origin[..., self.layout.q.position] = 0.0
        return self.positions(at_origin)[..., self.points.index("O2"), :]

    def arm_angles(self) -> Array:
        """Angles (N), rad, of the base arms against arm 1, in the order of the rotors.

        Arm 1 points at the centre, the others away from it; so 0 for both arm 1 and the arm across.
        """
        angles = -np.pi + 2.0 * np.pi * np.arange(self.rotors) / self.rotors
        angles[0] = 0.0
        return angles

    def base_wrench(self, q: Array, generalised_force: Array) -> Array:
        """The wrench on the base that a generalised force amounts to.

        The inverse of ψ = Jᵀw for the rows of attitude and position (eq. 13).

        Args:
            q: Coordinates (…, nq).
            generalised_force: Generalised force (…, nq).

        Returns:
            Force, N, and torque about the base centre, N m, (…, 6) in arm 1's frame.
        """
        attitude = self.layout.q.attitude
        world_force = generalised_force[..., self.layout.q.position]
        turn = np.swapaxes(rate_matrix(self.attitude, q[..., attitude]), -1, -2)
        torque = np.linalg.solve(turn, generalised_force[..., attitude, np.newaxis])[..., 0]
        torque = torque - np.cross(self.centre_offset(q), world_force)
        world = np.stack([world_force, torque], axis=-2)
        wrench = world @ self.base_rotation(q)
        return wrench.reshape(*wrench.shape[:-2], 6)

    def thrust_wrenches(self) -> Array:
        """Wrench on the base (6, N) of a unit thrust of each rotor: force, torque about the centre.

        It is in arm 1's frame, and the same at every configuration.
        """
        level = np.zeros(len(self.coordinates))
        columns = self.input_matrix(level)[:, : self.rotors]
        wrenches: Array = self.base_wrench(np.zeros_like(columns.T), columns.T).T
        return wrenches
