"""Can the motors move the base any way? Rank and conditioning of their arrangement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.robot import Robot

_DIRECTIONS = ("force along x", "force along y", "force along z")
_MOMENTS = ("moment about x", "moment about y", "moment about z")


@dataclass(frozen=True)
class Arrangement:
    """Rank, condition number (infinite where the rank is below 6) and what cannot be commanded.

    `missing` holds a unit wrench about the base centre, in arm 1's axes, for every direction that
    no combination of thrusts can push in.
    """

    rank: int
    condition: float
    missing: tuple[tuple[float, ...], ...]

    def missing_texts(self) -> list[str]:
        """The missing directions in words, by their leading components."""
        texts = []
        for wrench in self.missing:
            parts = [
                f"{value:+.3g} {name}"
                for value, name in zip(wrench, _DIRECTIONS + _MOMENTS, strict=True)
                if abs(value) > 1e-9
            ]
            texts.append(", ".join(parts))
        return texts


def wrench_matrix(robot: Robot) -> NDArray[np.float64]:
    """Force and moment about the base centre O₂ of each unit thrust, in arm 1's frame: 6×N."""
    base = robot.base
    columns = []
    for k in range(1, robot.rotors + 1):
        angle = 0.0 if k == 1 else np.deg2rad(float(base.arm_angle_deg(k)))
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        reach = -base.arm(k).length if k == 1 else base.arm(k).length
        position = turn @ np.array([reach, 0.0, 0.0])
        thrust = turn @ np.array(base.thrust[k - 1])
        moment = np.cross(position, thrust) + base.drag[k - 1] * thrust
        columns.append(np.concatenate([thrust, moment]))
    return np.array(columns).T


def arrangement(robot: Robot) -> Arrangement:
    """Rank and conditioning of the motor arrangement, in N and N m about the base centre."""
    matrix = wrench_matrix(robot)
    left, values, _ = np.linalg.svd(matrix)
    rank = int(np.sum(values > 1e-9 * values[0])) if values[0] > 0 else 0
    full = rank == len(matrix)
    condition = float(values[0] / values[-1]) if full else float("inf")
    missing = tuple(
        tuple(float(x) for x in _oriented(left[:, i])) for i in range(rank, len(matrix))
    )
    return Arrangement(rank, condition, missing)


def _oriented(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """The vector with its largest entry positive and what is rounding set to zero."""
    rounded: NDArray[np.float64] = np.where(np.abs(vector) < 1e-12, 0.0, vector)
    return rounded if rounded[np.argmax(np.abs(rounded))] > 0 else -rounded
