"""What reward, end and observation of an environment are computed from, and those of hovering."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.rollouts.problem import Array

Flags = NDArray[np.bool_]

# How far from where it is to hover a machine may get, m, and its base may turn, rad.
_FARTHEST, _STEEPEST = 3.0, 1.4
# Weight of rates in the reward, s².
_RATES = 0.1


@dataclass(frozen=True)
class Moment:
    """Where n environments are after a decision, or at the start of an episode.

    - `time` (n): since the start of the episode, s
    - `q` (n, nq), `v` (n, nv): coordinates and velocities
    - `away` (n, nv): displacement from the coordinates that are wanted, as the module's
      `difference` tells it: m and rad, of a quaternion the rotation vector
    - `inputs` (n, nu): what is commanded, N, then N m or N of the joints
    - `thrusts` (n, rotors): what the motors give, N
    - `base_rotation`, `base_position`: where attitude and position of the base are in `away`
    """

    time: Array
    q: Array
    v: Array
    away: Array
    inputs: Array
    thrusts: Array
    base_rotation: slice
    base_position: slice


Measure = Callable[[Moment], Array]
Ending = Callable[[Moment], Flags]


def nearness(now: Moment) -> Array:
    """Reward (n) of hovering: 1 at rest where the machine is wanted, less elsewhere, above 0."""
    squares = (now.away**2).sum(axis=1) + _RATES * (now.v**2).sum(axis=1)
    reward: Array = 1.0 / (1.0 + squares)
    return reward


def gone(now: Moment) -> Flags:
    """Whether a base is 3 m away from where it is wanted, or has turned by 1.4 rad (n)."""
    far = np.linalg.norm(now.away[:, now.base_position], axis=1) > _FARTHEST
    turned = np.linalg.norm(now.away[:, now.base_rotation], axis=1) > _STEEPEST
    failed: Flags = far | turned
    return failed


def away_and_rates(now: Moment) -> Array:
    """Observation (n, 2 nv) of hovering: the displacement, and the velocities."""
    return np.concatenate([now.away, now.v], axis=1)
