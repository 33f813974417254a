"""The parts of a robot as nodes of a scene: rods, joints, rotors, thrusts and other forces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.figures.style import COLOURS
from gibbs_codegen.simulator.record.series import Array
from gibbs_codegen.viewer.batch import Batch, Bytes, rgb, turned_to

Indices = NDArray[np.int_]

# Colours of rotors, thrusts and other forces; of rods without a torque, and with the largest.
ROTOR, THRUST, FORCE = COLOURS[4], COLOURS[7], COLOURS[2]
RELAXED, LOADED = "#8d99a6", "#d00000"
_JOINT_COLOUR = "#262626"
# Of the size of a robot: radii of rods, joints and arrows; of the radius of a rotor: its thickness.
_ROD, _JOINT, _ARROW, _DISC = 0.007, 0.012, 0.01, 0.06
# About the share of a robot's size to which places in a file are rounded.
_GRAIN = 2.0**-12
_UP = np.array([[0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class Skeleton:
    """How the points of a robot are drawn.

    `rods` are numbers (r, 2) of the points that each rod joins; `joints` and `rotors` are those of
    the points that are marked as such; `loads` (r) is the number of the torque that colours each
    rod, −1 for none; `radius` is that of a rotor's disc, m, and `size` how far the robot reaches
    from its base centre, m, to which all else is in proportion.
    """

    rods: Indices
    joints: Indices
    rotors: Indices
    loads: Indices
    radius: float
    size: float


class MachineScene:
    """Nodes of a robot, which are put wherever its points are.

    Args:
        scene: viser's scene.
        root: name of the node that they are under.
        skeleton: what is drawn.
        forces: how many arrows there are for forces that are no thrusts.
    """

    def __init__(self, scene: Any, root: str, skeleton: Skeleton, forces: int) -> None:
        self._skeleton = skeleton
        grain = _GRAIN * 2.0 ** np.floor(np.log2(skeleton.size))

        def batch(name: str, shape: str, count: int, colour: str, **look: Any) -> Batch:
            return Batch(scene, f"{root}/{name}", shape, count, colour, grain, **look)

        rotors = len(skeleton.rotors)
        self._rods = batch("rods", "rod", len(skeleton.rods), RELAXED)
        self._joints = batch("joints", "ball", len(skeleton.joints), _JOINT_COLOUR)
        self._rotors = batch("rotors", "rod", rotors, ROTOR, opacity=0.6, cast_shadow=False)
        self.thrusts = batch("thrusts", "arrow", rotors, THRUST, cast_shadow=False)
        self.forces = batch("forces", "arrow", forces, FORCE, cast_shadow=False)

    def place(self, points: Array, directions: Array) -> None:
        """Put rods, joints and rotors where the robot is.

        Args:
            points: Positions (k, 3) of its points in the world, m.
            directions: Unit vectors (N, 3) of the thrusts in the world.
        """
        skeleton, size = self._skeleton, self._skeleton.size
        starts, ends = points[skeleton.rods[:, 0]], points[skeleton.rods[:, 1]]
        self._rods.span(starts, ends, _ROD * size)
        joints = points[skeleton.joints]
        self._joints.put(
            joints, turned_to(_UP[[0] * len(joints)]), np.full_like(joints, _JOINT * size)
        )
        seats = points[skeleton.rotors] - 0.5 * _DISC * skeleton.radius * directions
        flat = skeleton.radius * np.array([1.0, 1.0, _DISC])
        self._rotors.put(seats, turned_to(directions), np.tile(flat, (len(seats), 1)))

    def load(self, torques: Array) -> None:
        """Colour the rods by what their joints hold.

        Args:
            torques: Share (t) of the largest that each of the torques is, 0 to 1.
        """
        loads = self._skeleton.loads
        shares = np.where(loads < 0, 0.0, np.append(np.nan_to_num(torques), 0.0)[loads])
        self._rods.colour(mixed(shares))

    def push(self, thrusts: Array, forces: Array) -> None:
        """Draw thrusts and other forces as arrows.

        Args:
            thrusts: Starts and tips (N, 2, 3) of the arrows of the thrusts, m.
            forces: Those of the other forces (f, 2, 3), m.
        """
        width = _ARROW * self._skeleton.size
        self.thrusts.span(thrusts[:, 0], thrusts[:, 1], width)
        self.forces.span(forces[:, 0], forces[:, 1], width)


def mixed(shares: Array) -> Bytes:
    """Colours of rods.

    Args:
        shares: How much of the largest torque each has (n), 0 to 1; more counts as 1.

    Returns:
        Red, green and blue (n, 3), 0 to 255.
    """
    ends = np.array([rgb(RELAXED), rgb(LOADED)], dtype=np.float64)
    share = np.clip(shares, 0.0, 1.0)[:, np.newaxis]
    colours: Bytes = np.round(ends[0] + share * (ends[1] - ends[0])).astype(np.uint8)
    return colours
