"""The parts of a robot as nodes of a scene: rods, joints, rotors, arrows of forces, frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gibbs_codegen.figures.scene import VIEW, seen_from
from gibbs_codegen.figures.style import COLOURS
from gibbs_codegen.simulator.record.series import Array
from gibbs_codegen.viewer.batch import Batch, Bytes, rgb, turned_to
from gibbs_codegen.viewer.skeleton import Skeleton

# Colours of rotors, thrusts and other forces; of rods without an effort, and with the largest.
ROTOR, THRUST, FORCE = COLOURS[4], COLOURS[7], COLOURS[2]
RELAXED, LOADED = "#8d99a6", "#d00000"
_JOINT_COLOUR = "#262626"
# Of the size of a robot: radii of rods, joints and arrows, lengths of arrows and of axes; of the
# radius of a rotor: its thickness.
_ROD, _JOINT, _ARROW, _LENGTH, _AXES, _DISC = 0.008, 0.014, 0.012, 0.3, 0.08, 0.06
# Of the robot's weight, and for torques times its size: what rounding and control leave is less.
_NOISE = 1e-6
# How much longer than others an arrow may be.
_LONGEST = 1.5
# About the share of a robot's size to which places in a file are rounded.
_GRAIN = 2.0**-12
_UP = np.array([[0.0, 0.0, 1.0]])
# Angle of view of the camera, rad; and how near it is, in distances from which all would be seen.
_FIELD_OF_VIEW, _CLOSE = 0.8, 0.8


@dataclass(frozen=True)
class Posture:
    """Where a robot is, and what acts on it.

    - `points` (k, 3): positions in the world, m
    - `directions` (N, 3): unit vectors of the thrusts in the world
    - `thrusts` (N), `efforts` (t): shares of what is drawn at full length or colour
    - `forces` (f, 3): other forces in the world, in what is drawn at full length
    - `frames` (p, 4, 4): poses in the world of frames that are drawn
    """

    points: Array
    directions: Array
    thrusts: Array
    efforts: Array
    forces: Array
    frames: Array


class MachineScene:
    """Nodes of a robot, under a root node, which are put wherever its points are.

    `pushed` are numbers of the points at which other forces act than thrusts; so many frames are
    drawn.
    """

    def __init__(
        self, scene: Any, root: str, skeleton: Skeleton, pushed: list[int], frames: int
    ) -> None:
        self._skeleton, self._pushed = skeleton, pushed
        grain = _GRAIN * 2.0 ** np.floor(np.log2(skeleton.size))

        def batch(name: str, shape: str, count: int, colour: str, **look: Any) -> Batch:
            return Batch(scene, f"{root}/{name}", shape, count, colour, grain, **look)

        rotors = len(skeleton.rotors)
        self._rods = batch("rods", "rod", len(skeleton.rods), RELAXED)
        self._joints = batch("joints", "ball", len(skeleton.joints), _JOINT_COLOUR)
        self._rotors = batch("rotors", "rod", rotors, ROTOR, opacity=0.6, cast_shadow=False)
        self.thrusts = batch("thrusts", "arrow", rotors, THRUST, cast_shadow=False)
        self.forces = batch("forces", "arrow", len(pushed), FORCE, cast_shadow=False)
        self.frames = scene.add_batched_axes(
            f"{root}/frames",
            np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1)),
            np.zeros((frames, 3)),
            axes_length=_AXES * skeleton.size,
            axes_radius=0.05 * _AXES * skeleton.size,
            visible=False,
        )

    def show(self, posture: Posture) -> None:
        """Put everything where the robot is."""
        skeleton, size, points = self._skeleton, self._skeleton.size, posture.points
        self._rods.span(points[skeleton.rods[:, 0]], points[skeleton.rods[:, 1]], _ROD * size)
        shares = np.append(np.nan_to_num(posture.efforts), 0.0)[skeleton.loads]
        self._rods.colour(mixed(np.where(skeleton.loads < 0, 0.0, shares)))
        joints = points[skeleton.joints]
        upright = turned_to(np.repeat(_UP, len(joints), axis=0))
        self._joints.put(joints, upright, np.full_like(joints, _JOINT * size))
        seats, along = points[skeleton.rotors], posture.directions
        flat = skeleton.radius * np.array([1.0, 1.0, _DISC])
        lower = seats - 0.5 * flat[2] * along
        self._rotors.put(lower, turned_to(along), np.tile(flat, (len(seats), 1)))
        lengths = np.clip(np.nan_to_num(posture.thrusts), -_LONGEST, _LONGEST)[:, np.newaxis]
        self.thrusts.span(seats, seats + _LENGTH * size * lengths * along, _ARROW * size)
        struck = points[self._pushed]
        self.forces.span(struck, struck + _LENGTH * size * posture.forces, _ARROW * size)
        if len(posture.frames):
            turns = Rotation.from_matrix(posture.frames[:, :3, :3]).as_quat()
            self.frames.batched_wxyzs = np.roll(turns, 1, axis=1).astype(np.float32)
            self.frames.batched_positions = posture.frames[:, :3, 3].astype(np.float32)

    def key(self, thrust: float, efforts: dict[str, float]) -> list[tuple[str, str]]:
        """Colours of a robot, as CSS has them, and in words what they mean.

        An arrow has full length for a `thrust`, N, and full colour for the effort of each unit.
        """
        long = _LENGTH * self._skeleton.size
        entries = [(THRUST, f"thrust, {thrust:.3g} N is {long:.2g} m long")] if thrust else []
        shades = f"linear-gradient(90deg, {RELAXED}, {LOADED})"
        words = {"N m": "torque", "N": "force"}
        return entries + [
            (shades, f"{words[unit]} at a joint, 0 to {most:.3g} {unit}")
            for unit, most in efforts.items()
            if most
        ]

    def force_key(self, force: float) -> tuple[str, str]:
        """Colour, as CSS has it, and meaning of other forces' arrows; full length is `force`, N."""
        long = _LENGTH * self._skeleton.size
        return FORCE, f"other forces on the robot, {force:.3g} N is {long:.2g} m long"


def set_stage(server: Any, root: str, floor: float, reach: float) -> None:
    """Draw a floor at a height, m, and look at the origin.

    `reach`, m, is how far from the origin there is something to be seen.
    """
    # One, two or five times a power of ten: several cells, and not too many, are in sight.
    power = 10.0 ** np.floor(np.log10(reach))
    cell = 0.1 * power * max(step for step in (1.0, 2.0, 5.0) if step * power <= reach)
    server.scene.add_grid(
        f"{root}/floor",
        infinite_grid=True,
        cell_size=cell,
        cell_color=(225, 225, 225),
        section_size=5.0 * cell,
        section_color=(200, 200, 200),
        fade_distance=12.0 * reach,
        position=(0.0, 0.0, floor),
    )
    camera = server.initial_camera
    camera.fov = _FIELD_OF_VIEW
    camera.look_at = (0.0, 0.0, 0.0)
    camera.position = seen_from(VIEW)[2] * _CLOSE * reach / np.tan(0.5 * _FIELD_OF_VIEW)


def least_loads(weight: float, size: float) -> dict[str, float]:
    """Forces (N) and torques (N m), by unit, that nothing but noise is below; 0 if unknown."""
    force = _NOISE * float(np.nan_to_num(weight))
    return {"N": force, "N m": force * size}


def mixed(shares: Array) -> Bytes:
    """Red, green and blue (n, 3), 0 to 255, of rods by shares (n) of the largest effort.

    More than 1 counts as 1.
    """
    ends = np.array([rgb(RELAXED), rgb(LOADED)], dtype=np.float64)
    share = np.clip(shares, 0.0, 1.0)[:, np.newaxis]
    colours: Bytes = np.round(ends[0] + share * (ends[1] - ends[0])).astype(np.uint8)
    return colours
