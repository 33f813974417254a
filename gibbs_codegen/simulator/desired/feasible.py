"""Motions that a base can fly whose rotors push along one axis.

Such a base leans where it is to accelerate. Its thrust axis is turned from where the scenario's
attitude has it, by the shortest way, to where the motion needs it: so the heading is kept, and tilt
is what physics asks for. Without an arm, and with the centre of mass at the base centre, the axis
is that of acceleration and gravity (differential flatness); in general `collocation` finds it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gibbs_codegen.errors import UsageError
from gibbs_codegen.scenario.attitude import SingularAttitudeError, Turning
from gibbs_codegen.scenario.orientation import (
    Orientation,
    cross_derivatives,
    turning_of,
    unit_derivatives,
)
from gibbs_codegen.scenario.paths import Path, plane
from gibbs_codegen.simulator.desired.base_trajectory import base_motion
from gibbs_codegen.simulator.desired.collocation import STENCIL, Grid, nearest_motion
from gibbs_codegen.simulator.desired.knots import bounded_path, check_none
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle
from gibbs_codegen.simulator.reference import Motion

# Share of the largest singular value that rounding may make of zero.
_RANK = 1e-9
# Share of gravity that thrust must at least make, and cosine of the greatest angle between the
# thrust axis and that of the scenario's attitude.
_LEAST_THRUST, _OPPOSITE = 0.05, -0.985
# Speeds, rates and so on that count as rest.
_REST = 1e-9


def thrust_axis(vehicle: Vehicle, q: Array) -> Array | None:
    """The axis along which rotors push, if they command a force along it and three moments.

    Args:
        vehicle: The robot.
        q: Configurations (s, nq).

    Returns:
        Unit vectors (s, 3) in the base's frame; None if the rotors command other wrenches.
    """
    if not vehicle.rotors:
        return None
    wrenches = vehicle.thrust_wrenches(q)
    forces = wrenches[..., :3, :]
    ranks = [
        np.sum(values > _RANK * values.max(axis=-1, keepdims=True), axis=-1)
        for values in (np.linalg.svd(each, compute_uv=False) for each in (wrenches, forces))
    ]
    if np.any(ranks[0] != 4) or np.any(ranks[1] != 1):
        return None
    total = np.sum(forces, axis=-1)
    return total / np.linalg.norm(total, axis=-1, keepdims=True)


class Leaning:
    """The base on a path, leaning by thrust axes that are to be found.

    Args:
        vehicle: the robot.
        joints: motion of the joints at knots, the base's coordinates at zero.
        axis: thrust axes (s, 3) in the base's frame.
        centre: position, velocity and acceleration of the base centre (s, ≥ 3, 3).
        wanted: attitude that the scenario has.
    """

    def __init__(
        self, vehicle: Vehicle, joints: Motion, axis: Array, centre: Array, wanted: Turning
    ) -> None:
        self.vehicle, self.joints, self.centre = vehicle, joints, centre
        time = joints.time
        self.grid = Grid(len(time), (time[-1] - time[0]) / (len(time) - 1))
        spin, spin_rate = _skew(wanted.velocity), _skew(wanted.acceleration)
        turn = wanted.rotation
        self._wanted = turn, spin @ turn, (spin_rate + spin @ spin) @ turn
        own = axis, self.grid.rate @ axis, self.grid.growth @ axis
        first, second, third = (self._wanted[k] for k in range(3))
        self.upright = (
            _times(first, own[0]),
            _times(second, own[0]) + _times(first, own[1]),
            _times(third, own[0]) + 2.0 * _times(second, own[1]) + _times(first, own[2]),
        )
        self._sides = np.stack([np.stack(plane(tuple(each))) for each in axis])
        self.weight = float(np.linalg.norm(self._force(vehicle.neutral, 0.0)))
        self.gravity = self.weight / (float(self._force(vehicle.neutral, 1.0)[2]) - self.weight)

    def _force(self, q: Array, upwards: float) -> Array:
        """Force (3) on the level base that accelerates upwards, m/s², N."""
        v, a = np.zeros((2, self.vehicle.layout.v.size))
        a[self.vehicle.layout.v.position.stop - 1] = upwards
        return self.vehicle.base_wrench(q, self.vehicle.inverse_dynamics(q, v, a))[:3]

    def motion(self, axes: tuple[Array, Array, Array], shift: tuple[Array, Array, Array]) -> Motion:
        """The motion with thrust axes and shifts.

        Args:
            axes: Thrust axes and their first two derivatives (s, 3), world axes.
            shift: What is added to position, velocity and acceleration of the base centre (s, 3).

        Returns:
            The motion at the knots.
        """
        centre = self.centre[:, :3] + np.stack(shift, axis=1)
        swing = _swing(self.upright, unit_derivatives(*axes))
        first, second, third = swing
        turn, rate, growth = self._wanted
        turning = turning_of(
            first @ turn,
            second @ turn + first @ rate,
            third @ turn + 2.0 * second @ rate + first @ growth,
        )
        motion = base_motion(self.vehicle, self.joints.time, centre, turning)
        places, rates = self.vehicle.arm, self.vehicle.arm_rates
        motion.q[:, places] = self.joints.q[:, places]
        motion.v[:, rates], motion.a[:, rates] = self.joints.v[:, rates], self.joints.a[:, rates]
        return motion

    def lateral(self, axis: Array, rate: Array, growth: Array, push: Array) -> Array:
        """Lateral force (s, 2) on the base, as a share of the weight, as `LateralForce` has it."""
        still = np.zeros_like(push)
        motion = self.motion((axis, rate, growth), (still, still, push))
        force = self.vehicle.inverse_dynamics(motion.q, motion.v, motion.a)
        wrench = self.vehicle.base_wrench(motion.q, force)[:, :3]
        return _times(self._sides, wrench) / self.weight

    def at_rest(self) -> np.ndarray:
        """Which knots (s) are held: the first and the last ones, where the machine rests there."""
        rates = [self._wanted[1].reshape(self.grid.count, -1), self.centre[:, 1], self.centre[:, 2]]
        rates += [self.joints.v, self.joints.a]
        still = np.all(np.abs(np.concatenate(rates, axis=1)) < _REST, axis=1)
        held = np.zeros(self.grid.count, dtype=bool)
        held[:STENCIL], held[-STENCIL:] = still[0], still[-1]
        return held


def feasible_motion(
    vehicle: Vehicle,
    joints: Motion,
    path: Path,
    orientation: Orientation,
    progress: Callable[[float], None] = lambda share: None,
) -> Motion:
    """The motion nearest to a path that an underactuated base can fly.

    Args:
        vehicle: A robot whose rotors push along one axis of its base.
        joints: Motion of the joints at knots.
        path: Path of the base centre.
        orientation: The attitude that the base has but for its tilt.
        progress: Is told the share that is done, 0 to 1.

    Returns:
        The motion at the knots.

    Raises:
        UsageError: With the time, where thrust would have to vanish or to point against the
            scenario's attitude, and where the attitude is singular.
    """
    time = joints.time
    centre = bounded_path(time, path, "path of the base")
    axis = thrust_axis(vehicle, joints.q)
    if axis is None:
        raise UsageError(f"{vehicle.name}: rotors must push along one axis of the base")
    leaning = Leaning(vehicle, joints, axis, centre, orientation(path, time, vehicle.arm_angles()))
    needed = centre[:, 2] + np.array([0.0, 0.0, leaning.gravity])
    size = np.linalg.norm(needed, axis=-1)
    _check_thrust(time, size < _LEAST_THRUST * leaning.gravity)
    flat = needed / size[:, np.newaxis]
    _check_lean(time, flat, leaning.upright[0])
    try:
        axes, shift = nearest_motion(
            leaning.lateral, flat, leaning.grid, leaning.gravity, leaning.at_rest()
        )
    except SingularAttitudeError as error:
        message = f"at t = {time[error.place]:.6g} s {error}"
        raise SingularAttitudeError(message, error.place) from None
    rate, growth = leaning.grid.rate, leaning.grid.growth
    return leaning.motion((axes, rate @ axes, growth @ axes), (shift, rate @ shift, growth @ shift))


def _check_thrust(time: Array, fails: np.ndarray) -> None:
    check_none(time, fails, "the path of the base is next to free fall, so no thrust holds the tilt")


def _check_lean(time: Array, axis: Array, upright: Array) -> None:
    """Refuse thrust against the scenario's attitude.

    Args:
        time: Times (s), s.
        axis: Thrust axes (s, 3) that the path needs.
        upright: Thrust axes (s, 3) of the scenario's attitude.

    Raises:
        UsageError: With the first time.
    """
    against = np.sum(axis * upright, axis=-1) < _OPPOSITE
    if np.any(against):
        raise UsageError(
            f"at t = {time[against][0]:.6g} s the path of the base needs thrust against the one "
            "that the attitude of the scenario has; choose a gentler path, or let the attitude "
            'turn with it (kind = "turn")'
        )


def _swing(
    begin: tuple[Array, Array, Array], end: tuple[Array, Array, Array]
) -> tuple[Array, Array, Array]:
    """The shortest rotation from a unit vector to another, with its first two derivatives.

    Args:
        begin, end: The vectors and their derivatives (s, 3).

    Returns:
        The rotation and its derivatives (s, 3, 3).
    """
    about = cross_derivatives(begin, end)
    cosine = _products(begin, end)
    below = 1.0 + cosine[0]
    shares = (
        1.0 / below,
        -cosine[1] / below**2,
        2.0 * cosine[1] ** 2 / below**3 - cosine[2] / below**2,
    )
    outer = tuple(
        sum(
            weight * about[i][..., :, np.newaxis] * about[k - i][..., np.newaxis, :]
            for i, weight in enumerate(_BINOMIAL[k])
        )
        for k in range(3)
    )
    return tuple(  # type: ignore[return-value]
        cosine[k][..., np.newaxis, np.newaxis] * np.eye(3)
        + _skew(about[k])
        + sum(
            weight * shares[i][..., np.newaxis, np.newaxis] * outer[k - i]
            for i, weight in enumerate(_BINOMIAL[k])
        )
        for k in range(3)
    )


_BINOMIAL = ((1,), (1, 1), (1, 2, 1))


def _products(a: tuple[Array, Array, Array], b: tuple[Array, Array, Array]) -> list[Array]:
    """Of a · b: the product and its first two derivatives (s)."""
    return [
        sum(weight * np.sum(a[i] * b[k - i], axis=-1) for i, weight in enumerate(_BINOMIAL[k]))
        for k in range(3)
    ]


def _skew(vector: Array) -> Array:
    """Matrices (…, 3, 3) of cross products with vectors (…, 3)."""
    return np.cross(np.eye(3), vector[..., np.newaxis, :])


def _times(matrix: Array, vector: Array) -> Array:
    product: Array = (matrix @ vector[..., np.newaxis])[..., 0]
    return product
