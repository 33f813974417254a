"""The posture in which an arm hangs at rest: least potential energy under a level base."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from gibbs_codegen.simulator.inverse_kinematics import Limits
from gibbs_codegen.simulator.vehicle import Vehicle

Array = NDArray[np.float64]

# Postures that the search starts from, besides the first.
_STARTS = 7
# Differences of energies that count as none, as a share of the largest energy.
_SAME_ENERGY = 1e-11
# Steps of the search at most, and shares of a step that are tried, each half the one before.
_STEPS = 60
_HALVINGS = 6
# Curvature of the energy, as a share of the largest, below which a motion counts as flat.
_FLATTEST = 1e-7
# Step of the differences that give the derivatives of torques, rad.
_DIFFERENCE = 1e-5
# Of what may be divided by.
_TINY = 1e-300


def hanging_posture(vehicle: Vehicle, limits: Limits) -> Array:
    """Arm coordinates (n) of least potential energy under a level base.

    Prismatic joints are at 0, and so are revolute ones that make no difference, such as one about
    the vertical; or where limits leave out 0, as near to it as they allow.
    """
    turning = vehicle.is_angle[vehicle.arm]
    low, high = limits[0][turning], limits[1][turning]
    places = np.array(vehicle.layout.joint_places)[turning]
    rest = np.zeros(len(vehicle.coordinates))
    rest[vehicle.arm] = np.clip(0.0, *limits)
    if not np.any(turning):
        return rest[vehicle.arm]

    def posture(angles: Array) -> Array:
        q = np.broadcast_to(rest, (*angles.shape[:-1], len(rest))).copy()
        q[..., places] = angles
        return q

    def energy(angles: Array) -> Array:
        return vehicle.potential_energy(posture(angles))

    def torques(angles: Array) -> Array:
        # The forces that hold the arm still are the gradient of its potential energy.
        q = posture(angles)
        return vehicle.inverse_dynamics(q, np.zeros_like(q), np.zeros_like(q))[..., places]

    # First away from 0 and from symmetry, where the energy may be at rest without being least.
    shares = qmc.Halton(len(places), scramble=False).random(_STARTS)
    ends = np.clip(-np.pi, low, high), np.clip(np.pi, low, high)
    starts = [-0.3 - 0.1 * np.arange(len(places)), *(ends[0] + shares * (ends[1] - ends[0]))]
    found = _lowest(energy, torques, np.clip(starts, low, high), low, high)
    energies = energy(found)
    least = energies.min() + _SAME_ENERGY * np.abs(energies).max()
    best = found[np.argmax(energies <= least)]
    for place, nearest in enumerate(rest[places]):
        tried = best.copy()
        tried[place] = nearest
        if energy(tried) <= least:
            best = tried
    return posture(_still(torques, best, low, high))[vehicle.arm]


def _lowest(
    energy: Callable[[Array], Array],
    torques: Callable[[Array], Array],
    angles: Array,
    low: Array,
    high: Array,
) -> Array:
    """Angles (s, n) at which the energy is least, near each of `angles` (s, n), within limits.

    Newton's method for all at once, with curvatures taken as positive, so that it leaves saddles;
    of each step the best of some shares is taken.
    """
    shares = 0.5 ** np.arange(_HALVINGS)[:, np.newaxis, np.newaxis]
    for _ in range(_STEPS):
        torque, stiffness, _ = _stiffness(torques, angles, low, high)
        curvature, axes = np.linalg.eigh(stiffness)
        curvature = np.abs(curvature)
        least = _FLATTEST * curvature.max(axis=-1, keepdims=True)
        along = np.einsum("sij,si->sj", axes, torque) / np.maximum(curvature, least + _TINY)
        along = np.clip(along, -np.pi / 2.0, np.pi / 2.0)
        step = np.einsum("sij,sj->si", axes, along)
        tried = np.clip(angles - shares * step, low, high)
        energies = energy(tried)
        best = np.argmin(energies, axis=0), np.arange(len(angles))
        gain = energy(angles) - energies[best]
        angles = np.where(gain[:, np.newaxis] > 0.0, tried[best], angles)
        if np.all(gain <= _SAME_ENERGY * np.abs(energies).max()):
            break
    return angles


def _stiffness(
    torques: Callable[[Array], Array], angles: Array, low: Array, high: Array
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Torques (…, n), their derivatives (…, n, n), and which joints are free to move (…, n).

    Torques and derivatives are 0 for the others, which gravity holds against a limit.
    """
    torque = torques(angles)
    free = ~((angles <= low) & (torque > 0.0)) & ~((angles >= high) & (torque < 0.0))
    steps = _DIFFERENCE * np.eye(angles.shape[-1])
    there = angles[..., np.newaxis, :]
    slope = (torques(there + steps) - torques(there - steps)) / (2.0 * _DIFFERENCE)
    # As second derivatives of the energy they are symmetric, but for rounding.
    slope = 0.5 * (slope + np.swapaxes(slope, -1, -2))
    both = free[..., np.newaxis] & free[..., np.newaxis, :]
    return np.where(free, torque, 0.0), np.where(both, slope, 0.0), free


def _still(torques: Callable[[Array], Array], angles: Array, low: Array, high: Array) -> Array:
    """Angles near `angles` where gravity turns no joint but against its limit, by Newton's way."""
    for _ in range(10):
        torque, stiffness, free = _stiffness(torques, angles, low, high)
        # Motions that gravity does not resist, but for rounding, are left alone.
        step = np.linalg.pinv(stiffness, rcond=_FLATTEST, hermitian=True) @ torque
        tried = np.clip(angles - step, low, high)
        if not np.linalg.norm(torques(tried)[free]) < np.linalg.norm(torque):
            break
        angles = tried
    return angles
