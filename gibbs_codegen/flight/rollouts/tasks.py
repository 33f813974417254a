"""Tasks of environments: what is observed and rewarded, and when an episode is lost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.flight.plant.vehicle import Flags
from gibbs_codegen.runtime.rollouts import Array

# How far from where it is to hover a machine may get, m, and its base may turn, rad.
_FARTHEST, _STEEPEST = 3.0, 1.4
# Weights in rewards: of rates, s², and of the posture beside the tip; and of its error, 1/m².
_RATES, _POSTURE, _TIP = 0.1, 0.1, 10.0


@dataclass(frozen=True)
class Moment:
    """The state of n environments after a decision, or at the start of an episode.

    - `time` (n): since the start of the episode, s; `begun` (n): whether it has just begun
    - `q` (n, nq), `v` (n, nv): coordinates and velocities
    - `target` (n, nq), `target_v` (n, nv): coordinates that are wanted, and velocities of a machine
      that follows them
    - `away` (n, nd): displacement from there, as `difference` of the module tells it, of a base
      that drives with that to its left after that ahead: m and rad, of a quaternion the rotation
      vector
    - `inputs` (n, nu): what is commanded, N, then N m or N of the joints; or commands of motors and
      servos, where the robot file describes actuators; with an inner loop the action (n, na)
    - `thrusts` (n, rotors): what the motors give, N
    - `x` (n, nx): states of the actuators that the robot file describes, if they have any
    - `tip_away` (n, 3): the tip less that of the target, m, world axes
    - `touch` (n, 3): the force of walls on the tip, N, world axes, 0 without; `force` (n): how hard
      it is to be, N
    - `data`: whatever users keep there
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
    x: Array | None = None
    target: Array = field(default_factory=lambda: np.zeros(0))
    target_v: Array = field(default_factory=lambda: np.zeros(0))
    touch: Array = field(default_factory=lambda: np.zeros(3))
    force: Array = field(default_factory=lambda: np.zeros(1))
    data: dict[str, Any] = field(default_factory=dict)
    tip_pose: Callable[[Array], Array] | None = None

    @cached_property
    def tip_away(self) -> NDArray[Any]:
        """The tip less that of the target (n, 3), 0 of a robot without one."""
        if self.tip_pose is None:
            return np.zeros((len(self.q), 3))
        found, wanted = (self.tip_pose(q)[:, :3, 3] for q in (self.q, self.target))
        return np.asarray(found - wanted)

    @property
    def begun(self) -> Flags:
        """True (n) for episodes that have just begun."""
        return self.time == 0.0


Measure = Callable[[Moment], Array]
Ending = Callable[[Moment], Flags]


def _squares(x: Array) -> Array:
    total: Array = (x**2).sum(axis=1)
    return total


def nearness(now: Moment) -> Array:
    """Reward (n) of hovering: 1 at rest where the machine is wanted, less elsewhere, above 0."""
    return 1.0 / (1.0 + _squares(now.away) + _RATES * _squares(now.v))


def is_lost(now: Moment) -> Flags:
    """True (n) for a base that is 3 m from its desired place, or has turned by 1.4 rad."""
    far = np.linalg.norm(now.away[:, now.base_position], axis=1) > _FARTHEST
    turned = np.linalg.norm(now.away[:, now.base_rotation], axis=1) > _STEEPEST
    return far | turned


def away_and_rates(now: Moment) -> Array:
    """Observation (n, nd + nv) of hovering: the displacement, and the velocities."""
    return np.concatenate([now.away, now.v], axis=1)


def _following(now: Moment) -> Array:
    return 1.0 / (1.0 + _squares(now.away) + _RATES * _squares(now.v - now.target_v))


def _with_target_rates(now: Moment) -> Array:
    return np.concatenate([now.away, now.v, now.target_v], axis=1)


def _reaching(now: Moment) -> Array:
    off = _TIP * _squares(now.tip_away) + _POSTURE * _squares(now.away)
    return 1.0 / (1.0 + off + _RATES * _squares(now.v))


def _with_tip(now: Moment) -> Array:
    return np.concatenate([now.away, now.v, now.tip_away], axis=1)


def _pushing(now: Moment) -> Array:
    missing = np.linalg.norm(now.touch, axis=1) / now.force - 1.0
    off = missing**2 + _POSTURE * _squares(now.away) + _RATES * _squares(now.v)
    return 1.0 / (1.0 + off)


def _with_touch(now: Moment) -> Array:
    return np.concatenate([now.away, now.v, now.touch, now.force[:, np.newaxis]], axis=1)


@dataclass(frozen=True)
class Task:
    """A reward and an observation, and how far targets are from `hover`, and swing, m and rad.

    `needs` says what environments of it must have: a "tip" of the robot, "walls".
    """

    reward: Measure
    observe: Measure
    spread: float = 0.0
    swing: float = 0.0
    needs: tuple[str, ...] = ()


TASKS = {
    "hover": Task(nearness, away_and_rates),
    "reach": Task(_reaching, _with_tip, spread=0.5, needs=("tip",)),
    "track": Task(_following, _with_target_rates, swing=0.5),
    "push": Task(_pushing, _with_touch, needs=("tip", "walls")),
}
