"""Tasks of environments: what is observed and rewarded, and when an episode is lost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
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
    - `tip_away` (n, 3): how far the tip is from where it is at the target, m, world axes
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
    x: Array | None
    target: Array
    target_v: Array
    touch: Array
    force: Array
    data: dict[str, Any]
    tip_pose: Callable[[Array], Array] | None

    @cached_property
    def tip_away(self) -> NDArray[Any]:
        """How far the tip (n, 3) is from where it is at the target, 0 of a robot without one."""
        if self.tip_pose is None:
            return np.zeros((len(self.q), 3))
        tip, target = (self.tip_pose(q)[:, :3, 3] for q in (self.q, self.target))
        return np.asarray(tip - target)

    @property
    def begun(self) -> Flags:
        """True (n) for episodes that have just begun."""
        return self.time == 0.0


Values = Callable[[Moment], Array]
Ending = Callable[[Moment], Flags]


def _squares(x: Array) -> Array:
    return np.asarray((x**2).sum(axis=1))


def _worth(off: Array, rates: Array) -> Array:
    """Rewards (n), 1 of what is not off (n) at all and has no rates (n, nv), above 0."""
    return 1.0 / (1.0 + off + _RATES * _squares(rates))


def is_lost(now: Moment) -> Flags:
    """True (n) for a base that is 3 m from its desired place, or has turned by 1.4 rad."""
    far = np.linalg.norm(now.away[:, now.base_position], axis=1) > _FARTHEST
    turned = np.linalg.norm(now.away[:, now.base_rotation], axis=1) > _STEEPEST
    return far | turned


def _hovering(now: Moment) -> Array:
    return _worth(_squares(now.away), now.v)


def _following(now: Moment) -> Array:
    return _worth(_squares(now.away), now.v - now.target_v)


def _reaching(now: Moment) -> Array:
    return _worth(_TIP * _squares(now.tip_away) + _POSTURE * _squares(now.away), now.v)


def _pushing(now: Moment) -> Array:
    missing = np.linalg.norm(now.touch, axis=1) / now.force - 1.0
    return _worth(missing**2 + _POSTURE * _squares(now.away), now.v)


@dataclass(frozen=True)
class Task:
    """A reward, what is `seen` beside `away` and `v`, how far targets are, and swing, m and rad.

    `needs` says what environments of it must have: a "tip" of the robot, "walls".
    """

    reward: Values
    seen: tuple[str, ...] = ()
    spread: float = 0.0
    swing: float = 0.0
    needs: tuple[str, ...] = ()

    def observe(self, now: Moment) -> Array:
        """Observations (n, m)."""
        return np.column_stack([now.away, now.v, *(getattr(now, name) for name in self.seen)])


TASKS = {
    "hover": Task(_hovering),
    "reach": Task(_reaching, ("tip_away",), spread=0.5, needs=("tip",)),
    "track": Task(_following, ("target_v",), swing=0.5),
    "push": Task(_pushing, ("touch", "force"), needs=("tip", "walls")),
}
