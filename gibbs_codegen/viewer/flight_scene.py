"""A flight as a scene: the robot at some time, its paths, walls, thrusts and what pushes it."""

from __future__ import annotations

from typing import Any

import numpy as np

from gibbs_codegen.figures.robot_drawing import bounds, rotor_radius, thrust_directions
from gibbs_codegen.figures.scene import VIEW, seen_from
from gibbs_codegen.figures.style import COLOURS
from gibbs_codegen.scenario.paths import plane
from gibbs_codegen.simulator.record.flight import Array, Flight
from gibbs_codegen.viewer.batch import rgb
from gibbs_codegen.viewer.machine_scene import (
    FORCE,
    LOADED,
    RELAXED,
    THRUST,
    MachineScene,
    Skeleton,
)

_CENTRE, _TIP, _DESIRED, _WALL = COLOURS[0], COLOURS[1], "#555555", "#8a6d3b"
_DASHES = f"repeating-linear-gradient(90deg, {_DESIRED} 0 5px, transparent 5px 9px)"
# Share of thrusts and of torques that are not too large to be shown at full length and colour.
_USUAL = 0.95
# Length of the arrow of such a thrust, as a share of the robot's size.
_ARROW = 0.3
# A robot smaller than this share of the whole flight is followed.
_SMALL = 0.7
# Points of a path, and thickness of its line, px.
_POINTS, _LINE = 600, 3.0
# Angle of view of the camera, rad.
_FIELD_OF_VIEW = 0.8
# How near the camera is, in distances at which all that is around would be seen from any side.
_CLOSE = 0.8


class FlightScene:
    """Nodes of a flight.

    Args:
        server: viser's server, whose scene is empty.
        flight: the flight.
    """

    def __init__(self, server: Any, flight: Flight) -> None:
        self.flight, self._scene = flight, server.scene
        self._skeleton = skeleton_of(flight)
        self._world = server.scene.add_frame("/flight", show_axes=False)
        frames = [name for name in flight.frames if np.any(flight.frame_wrench(name))]
        self._pushes = [(_place(flight, name), flight.frame_wrench(name)) for name in frames]
        self.machine = MachineScene(server.scene, "/flight/robot", self._skeleton, len(frames))
        self._torques = np.abs(_torques(flight))
        self.largest_torque = _usual(self._torques)
        self._length = _ARROW * self._skeleton.size
        self._thrust = _usual(flight.applied[:, : flight.rotors])
        self._draw_paths()
        self._draw_walls()
        low, high = bounds(flight)
        reach = self._skeleton.size
        self.follows = 2.0 * reach < _SMALL * float(np.max(high - low))
        _set_floor(server.scene, low)
        _set_camera(server, reach if self.follows else float(np.linalg.norm(high - low)) / 2.0)
        self._middle = 0.5 * (low + high)

    def show(self, sample: int) -> None:
        """Put the robot where it is at a sample.

        Args:
            sample: Number of the sample of the flight.
        """
        flight = self.flight
        points = flight.positions[sample]
        along = thrust_directions(flight, sample) @ flight.base_rotation[sample].T
        self.machine.place(points, along)
        self.machine.load(self._torques[sample] / (self.largest_torque or 1.0))
        share = np.clip(flight.applied[sample, : flight.rotors] / (self._thrust or 1.0), -1.5, 1.5)
        seats = points[self._skeleton.rotors]
        tips = seats + self._length * share[:, np.newaxis] * along
        self.machine.push(np.stack([seats, tips], axis=1), self._pushed(sample))
        centre = points[flight.points.index(flight.centre)]
        self._world.position = -(centre if self.follows else self._middle)

    def key(self) -> list[tuple[str, str]]:
        """What colours mean.

        Returns:
            Colours, as CSS has them, and words.
        """
        entries = [(THRUST, f"thrust, {self._thrust:.3g} N as long as {self._length:.2g} m")]
        if self.largest_torque:
            shades = f"linear-gradient(90deg, {RELAXED}, {LOADED})"
            entries.append((shades, f"torque at a joint, 0 to {self.largest_torque:.3g} N m"))
        if self._pushes:
            entries.append((FORCE, "other forces on the robot"))
        entries.append((_CENTRE, "path of the base centre"))
        if self._has_arm:
            entries.append((_TIP, "path of the tip"))
        entries.append((_DASHES, "desired paths"))
        return entries + [(_WALL, "wall")] * bool(len(self.flight.walls))

    @property
    def _has_arm(self) -> bool:
        return self.flight.has_tip and bool(self.flight.layout.q.joint_places)

    def _pushed(self, sample: int) -> Array:
        """Starts and tips (f, 2, 3) of the arrows of forces that are no thrusts."""
        arrows = np.zeros((len(self._pushes), 2, 3))
        for arrow, (point, wrench) in zip(arrows, self._pushes, strict=True):
            arrow[:] = self.flight.positions[sample, point]
            arrow[1] += self._length / (self._thrust or 1.0) * wrench[sample, :3]
        return arrows

    def _draw_paths(self) -> None:
        flight = self.flight
        paths = [("centre", flight.point(flight.centre), flight.centre_desired, _CENTRE)]
        if self._has_arm:
            paths.append(("tip", flight.point("tip"), flight.tip_desired, _TIP))
        for name, actual, desired, colour in paths:
            self._draw_line(f"{name} path", _segments(actual), colour)
            self._draw_line(f"desired {name} path", _segments(desired)[::2], _DESIRED)

    def _draw_line(self, name: str, segments: Array, colour: str) -> None:
        """Draw a line.

        Args:
            name: Name of its node.
            segments: Its segments (p, 2, 3), m.
            colour: Its colour, #rrggbb.
        """
        self._scene.add_line_segments(
            f"/flight/{name}", segments, rgb(colour), thickness=_LINE, thickness_units="screen"
        )

    def _draw_walls(self) -> None:
        low, high = bounds(self.flight)
        half = 0.6 * float(np.linalg.norm(high - low))
        for number, wall in enumerate(self.flight.walls):
            point, normal = wall[:3], wall[3:]
            across = half * np.array(plane(normal))
            middle = 0.5 * (low + high)
            foot = middle - normal * ((middle - point) @ normal) / (normal @ normal)
            corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) @ across + foot
            self._scene.add_mesh_simple(
                f"/flight/wall {number + 1}",
                corners,
                np.array([[0, 1, 2], [0, 2, 3]]),
                color=rgb(_WALL),
                opacity=0.35,
                side="double",
            )


def skeleton_of(flight: Flight) -> Skeleton:
    """How the robot of a flight is drawn.

    Args:
        flight: The flight.

    Returns:
        Rods from every point to the one that it is joined to, and what marks the points.
    """
    points = flight.points
    first = points.index(flight.centre) + 1
    joints = range(first + flight.rotors, first + flight.rotors + len(flight.layout.q.joint_places))
    rods = [(parent, point) for point, parent in enumerate(flight.parents.tolist()) if parent >= 0]
    held = len(joints) + np.arange(len(flight.base_arm_angles_desired))
    loads = {joint: number for number, joint in enumerate(joints)}
    around = flight.positions - flight.point(flight.centre)[:, np.newaxis]
    arms = {first + 1 + number: int(load) for number, load in enumerate(held)}
    return Skeleton(
        np.array(rods, dtype=np.int_).reshape(-1, 2),
        np.array([first - 1, *joints], dtype=np.int_),
        np.arange(first, first + flight.rotors),
        np.array([arms.get(end, loads.get(start, -1)) for start, end in rods], dtype=np.int_),
        rotor_radius(flight),
        float(np.nanmax(np.linalg.norm(around, axis=-1))),
    )


def _torques(flight: Flight) -> Array:
    """Torques (s, t) of the joints, then those that hold base arms."""
    arms = len(flight.base_arm_angles_desired)
    return np.hstack([flight.applied[:, flight.rotors :], flight.constraint_torques[:, :arms]])


def _usual(values: Array) -> float:
    """What most of the absolute values do not exceed."""
    known = np.abs(values[np.isfinite(values)])
    return float(np.quantile(known, _USUAL)) if len(known) else 0.0


def _segments(path: Array) -> Array:
    """A line through places (s, 3) as segments (p, 2, 3), of no more points than are needed."""
    path = path[np.isfinite(path).all(axis=1)]
    kept = path[np.unique(np.linspace(0, len(path) - 1, _POINTS).astype(int))]
    return np.stack([kept[:-1], kept[1:]], axis=1)


def _place(flight: Flight, frame: str) -> int:
    """Number of the point at which a frame is."""
    return flight.points.index(frame if frame in flight.points else flight.centre)


def _set_floor(scene: Any, low: Array) -> None:
    scene.add_grid(
        "/flight/floor",
        infinite_grid=True,
        cell_size=1.0,
        cell_color=(225, 225, 225),
        section_size=5.0,
        section_color=(200, 200, 200),
        fade_distance=60.0,
        position=(0.0, 0.0, float(low[2])),
    )


def _set_camera(server: Any, reach: float) -> None:
    camera = server.initial_camera
    camera.fov = _FIELD_OF_VIEW
    camera.look_at = (0.0, 0.0, 0.0)
    camera.position = seen_from(VIEW)[2] * _CLOSE * reach / np.tan(0.5 * _FIELD_OF_VIEW)
