"""Can the rotors move the base any way? Rank and conditioning of their arrangement."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gibbs_codegen.robot.model import BASE, Robot
from gibbs_codegen.robot.placement import Array
from gibbs_codegen.robot.posture import AT_ORIGIN, frames_on
from gibbs_codegen.robot.wrenches import directions

# Fewer times better is a matter of taste.
_FAR_BETTER = 3.0
# Configurations that are tried where the arrangement depends on the joints, and how far joints
# without limits move in them, rad or m.
_TRIED, _TRAVEL = 20, 1.0


@dataclass(frozen=True)
class Arrangement:
    """Rank, condition number (infinite where the rank is below 6) and what cannot be commanded.

    `missing` names the directions that no combination of thrusts can push in, about the base centre
    in the base's axes.
    """

    rank: int
    condition: float
    missing: tuple[str, ...]


def wrench_matrix(robot: Robot, joints: Sequence[float] | Array | None = None) -> Array:
    """Force, then moment (6, N), m, of each unit thrust about the base centre, in the base's axes.

    `joints` are those that move, rad or m, zero if None.
    """
    frames = frames_on(robot, AT_ORIGIN, np.zeros(len(robot.moving)) if joints is None else joints)
    drags = np.array([*robot.base.drag, *(rotor.drag for rotor in robot.thrusters)])
    moments = np.cross(frames.motors, frames.thrusts) + drags[:, np.newaxis] * frames.thrusts
    return np.concatenate([frames.thrusts, moments], axis=1).T


def arrangement(robot: Robot, joints: Sequence[float] | Array | None = None) -> Arrangement:
    """Rank and conditioning of the rotors' arrangement, in N and N m about the base centre.

    `joints` are those that move, rad or m, zero if None.
    """
    left, values, _ = np.linalg.svd(wrench_matrix(robot, joints))
    rank = int(np.sum(values > 1e-9 * values[0])) if values.any() else 0
    full = rank == len(left)
    condition = float(values[0] / values[-1]) if full else float("inf")
    return Arrangement(rank, condition, directions(left[:, rank:]))


def carried_rotors(robot: Robot) -> tuple[int, ...]:
    """Numbers, from 1, of rotors that a joint moves against the base."""
    moved = {BASE: False}
    for i, link in enumerate(robot.links, start=1):
        moved[i] = link.moves or moved[robot.parents[i - 1]]
    return tuple(k for k, rotor in enumerate(robot.thrusters, start=1) if moved[rotor.on])


def ranks_in_motion(robot: Robot) -> tuple[int, int] | None:
    """Least and greatest rank of the arrangement as the joints move, within their limits.

    They are over some configurations that are always the same; None where no joint moves a rotor.
    """
    if not carried_rotors(robot):
        return None
    limits = [robot.links[i - 1].limits for i in robot.moving]
    low = [-_TRAVEL if bounds.low is None else bounds.low for bounds in limits]
    high = [_TRAVEL if bounds.high is None else bounds.high for bounds in limits]
    shares = np.random.default_rng(0).random((_TRIED, len(limits)))
    tried = low + shares * (np.array(high) - np.array(low))
    ranks = [arrangement(robot, joints).rank for joints in tried]
    return min(ranks), max(ranks)


@dataclass(frozen=True)
class TiltHint:
    """Motors 1 … N whose tilts had better have the other sign, and the condition number then."""

    motors: tuple[int, ...]
    condition: float

    def text(self) -> str:
        """The hint in words."""
        which = f"motor {self.motors[0]}" if len(self.motors) == 1 else "motors "
        if len(self.motors) > 1:
            which += f"{', '.join(map(str, self.motors[:-1]))} and {self.motors[-1]}"
        return (
            f"with the thrust of {which} tilted to the other side (x and y of opposite sign) the "
            f"condition number would be {self.condition:.4g}; arm 1's x axis runs to the base "
            "centre, those of the others away from it"
        )


def tilt_hint(robot: Robot) -> TiltHint | None:
    """Signs of the tilts that condition the arrangement far better, if there are such.

    Tried are those with which alternating tilts go wrong: arm 1's axes point the other way round,
    and the arms may have to alternate. That is so by the paper's rule for rods only.
    """
    if not robot.base.rotors or robot.base.azimuth_deg is not None:
        return None
    now = arrangement(robot)
    every_second = set(range(2, robot.rotors + 1, 2))
    found = []
    for motors in ({1}, every_second, every_second ^ {1}):
        condition = arrangement(_mirrored(robot, motors)).condition
        found.append(TiltHint(tuple(sorted(motors)), condition))
    best = min(found, key=lambda hint: hint.condition)
    return best if best.condition * _FAR_BETTER < now.condition else None


def _mirrored(robot: Robot, motors: Collection[int]) -> Robot:
    """The robot with the thrusts of some motors tilted to the other side."""
    thrust = tuple(
        (-x, -y, z) if k in motors else (x, y, z)
        for k, (x, y, z) in enumerate(robot.base.thrust, start=1)
    )
    return replace(robot, base=replace(robot.base, thrust=thrust))
