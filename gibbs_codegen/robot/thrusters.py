"""Can the motors move the base any way? Rank and conditioning of their arrangement."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.robot.model import Base, Robot
from gibbs_codegen.robot.wrenches import directions

# Fewer times better is a matter of taste.
_FAR_BETTER = 3.0


@dataclass(frozen=True)
class Arrangement:
    """Rank, condition number (infinite where the rank is below 6) and what cannot be commanded.

    `missing` names the directions that no combination of thrusts can push in, about the base centre
    in arm 1's axes.
    """

    rank: int
    condition: float
    missing: tuple[str, ...]


def arm_frame(base: Base, k: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Frame of a base arm, from the base centre O₂ in arm 1's axes.

    Args:
        base: The base.
        k: Number of the arm, from 1 to N.

    Returns:
        The axes (3, 3), a column each, and the origin (3), m.
    """
    if k == 1:
        return np.eye(3), np.array([-base.arm(1).length, 0.0, 0.0])
    angle = np.deg2rad(float(base.arm_angle_deg(k)))
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.zeros(3)


def wrench_matrix(robot: Robot) -> NDArray[np.float64]:
    """Force and moment of each unit thrust about the base centre O₂, in arm 1's axes.

    Args:
        robot: The robot, with N rotors.

    Returns:
        The matrix (6, N), force rows first; moments in m.
    """
    base = robot.base
    columns = []
    for k in range(1, robot.rotors + 1):
        turn, position = arm_frame(base, k)
        if k > 1:
            position = base.arm(k).length * turn[:, 0]
        thrust = turn @ np.array(base.thrust[k - 1])
        moment = np.cross(position, thrust) + base.drag[k - 1] * thrust
        columns.append(np.concatenate([thrust, moment]))
    return np.array(columns).T


def arrangement(robot: Robot) -> Arrangement:
    """Rank and conditioning of the motor arrangement, in N and N m about the base centre.

    Args:
        robot: The robot.

    Returns:
        The arrangement.
    """
    matrix = wrench_matrix(robot)
    left, values, _ = np.linalg.svd(matrix)
    rank = int(np.sum(values > 1e-9 * values[0])) if values[0] > 0 else 0
    full = rank == len(matrix)
    condition = float(values[0] / values[-1]) if full else float("inf")
    return Arrangement(rank, condition, directions(left[:, rank:]))


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
    and the arms may have to alternate.

    Args:
        robot: The robot.

    Returns:
        The hint, or None where no signs are far better.
    """
    rotors, now = robot.rotors, arrangement(robot)
    every_second = set(range(2, rotors + 1, 2))
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
