"""A flight in the viewer: its scene with paths, walls, thrusts and pushes, its panel, its page."""

from __future__ import annotations

import html
import time
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import UsageError
from gibbs_codegen.figures.appearance import PATHS
from gibbs_codegen.flight.record import extent
from gibbs_codegen.flight.record.flight import Array, Flight
from gibbs_codegen.flight.record.series import wheel_marks
from gibbs_codegen.flight.viewer import page
from gibbs_codegen.flight.viewer.machine import MachineScene, rgb, set_stage

_DESIRED, _WALL = "#555555", "#8a6d3b"
_DASHES = f"repeating-linear-gradient(90deg, {_DESIRED} 0 5px, transparent 5px 9px)"
# A robot smaller than this share of the whole flight is followed.
_SMALL = 0.7
# Points of a path, and thickness of its line, px.
_POINTS, _LINE = 600, 3.0
_SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "4", "8")
# Frames per second, and frames at most, while there is room.
_RATE, _MOST = 25.0, 1000


class FlightScene:
    """Nodes of a flight in an empty scene, with the frame of the base if `frames` is 1, else 0."""

    def __init__(self, server: Any, flight: Flight, frames: int) -> None:
        self.flight, self._scene, self._frames = flight, server.scene, frames
        self._world = server.scene.add_frame("/flight", show_axes=False)
        pushed = [name for name in flight.frames if np.any(flight.frame_wrench(name))]
        self._forces = [flight.frame_wrench(name)[:, :3] for name in pushed]
        points, arms = flight.points, len(flight.base_arm_angles_desired)
        self.machine = machine = MachineScene(
            server.scene,
            "/flight/robot",
            flight,
            flight.weight,
            flight.parents.tolist(),
            arms,
            flight.positions,
            extent.thrust_directions(flight, 0) @ flight.base_rotation[0].T,
            [points.index(name if name in points else flight.centre) for name in pushed],
            frames,
        )
        machine.thrust = extent.usual_size(flight.applied[:, : flight.rotors])
        # Pushes may be much smaller than thrusts, and are to be seen nevertheless.
        machine.force = extent.usual_size(np.linalg.norm(np.reshape(self._forces, (-1, 3)), axis=1))
        # Efforts (s, t) of the joints, then those that hold base arms.
        joints, held = flight.applied[:, flight.rotors :], flight.constraint_torques[:, :arms]
        self._efforts = np.abs(np.hstack([joints, held]))
        for unit, least in machine.least.items():
            of_unit = self._efforts[:, np.array(machine.units) == unit]
            if np.any(of_unit > least):
                machine.efforts[unit] = max(extent.usual_size(of_unit), least)
        self.paths = self._draw_paths()
        self._draw_walls()
        low, high = extent.bounds(flight)
        self._middle = 0.5 * (low + high)
        self.follows = 2.0 * machine.size < _SMALL * float(np.max(high - low))
        reach = machine.size if self.follows else 0.5 * float(np.linalg.norm(high - low))
        set_stage(server, "/flight", float(low[2]), reach)

    def show(self, sample: int) -> None:
        """Put the robot where it is at a sample."""
        flight = self.flight
        rotation, points = flight.base_rotation[sample], flight.positions[sample]
        centre = points[flight.points.index(flight.centre)]
        frames = np.tile(np.eye(4), (self._frames, 1, 1))
        frames[:, :3, :3], frames[:, :3, 3] = rotation, centre
        forces = np.array([force[sample] for force in self._forces]).reshape(-1, 3)
        self.machine.show(
            points,
            extent.thrust_directions(flight, sample) @ rotation.T,
            flight.applied[sample, : flight.rotors],
            self._efforts[sample],
            forces,
            frames,
            wheel_marks(flight, flight.q[sample]),
        )
        self._world.position = -(centre if self.follows else self._middle)

    def key(self) -> list[tuple[str, str]]:
        """Colours, as CSS has them, and in words what they mean."""
        paths = [(PATHS[name], f"path of the {name}") for name in extent.led_points(self.flight)]
        entries = [*self.machine.key(), *paths, (_DASHES, "desired paths")]
        return entries + [(_WALL, "wall")] * bool(len(self.flight.walls))

    def _draw_paths(self) -> list[Any]:
        drawn = []
        for name, led in extent.led_points(self.flight).items():
            drawn.append(self._draw_line(f"path of {name}", _segments(led.path), PATHS[name]))
            dashes = _segments(led.desired)[::2]
            if len(dashes):
                drawn.append(self._draw_line(f"desired path of {name}", dashes, _DESIRED))
        return drawn

    def _draw_line(self, name: str, segments: Array, colour: str) -> Any:
        """Draw a line of segments (p, 2, 3), m."""
        look = {"thickness": _LINE, "thickness_units": "screen"}
        return self._scene.add_line_segments(f"/flight/{name}", segments, rgb(colour), **look)

    def _draw_walls(self) -> None:
        from gibbs_codegen.flight.scenario.walls import patches  # Late, as tables take long.

        low, high = extent.bounds(self.flight)
        middle, half = 0.5 * (low + high), 0.6 * float(np.linalg.norm(high - low))
        walls = patches(self.flight.wall_kinds, self.flight.walls, middle, half)
        for number, patch in enumerate(walls, start=1):
            grid = np.arange(patch[..., 0].size).reshape(patch.shape[:2])
            near, far = (grid[:-1, :-1], grid[1:, 1:])
            sides = (np.stack([near, x, far], axis=-1) for x in (grid[1:, :-1], grid[:-1, 1:]))
            self._scene.add_mesh_simple(
                f"/flight/wall {number}",
                patch.reshape(-1, 3),
                np.concatenate([side.reshape(-1, 3) for side in sides]),
                color=rgb(_WALL),
                opacity=0.35,
                side="double",
            )


def known_samples(flight: Flight) -> NDArray[np.int_]:
    """Numbers of the samples at which the robot is somewhere: one that diverged may end nowhere.

    Raises `UsageError` if there is none.
    """
    sound: NDArray[np.int_] = np.flatnonzero(np.isfinite(flight.positions).all(axis=(1, 2)))
    if not len(sound):
        raise UsageError(f"{flight.robot}, {flight.scenario}: no sample can be drawn")
    return sound


def _segments(path: Array) -> Array:
    """A line through places (s, 3) as segments (p, 2, 3), of no more points than are needed."""
    path = path[np.isfinite(path).all(axis=1)]
    if not len(path):
        return np.zeros((0, 2, 3))
    kept = path[np.unique(np.linspace(0, len(path) - 1, _POINTS).astype(int))]
    return np.stack([kept[:-1], kept[1:]], axis=1)


class FlightPanel:
    """Controls of a flight on a server without any, and the scene that follows them.

    Raises `UsageError` if the robot is nowhere at any time.
    """

    def __init__(self, server: Any, flight: Flight) -> None:
        gui, self._flight = server.gui, flight
        self._sound = known_samples(flight)
        self._times = flight.time[self._sound]
        self._scene = FlightScene(server, flight, frames=1)
        title = html.escape(f"{flight.robot}, {flight.scenario}")
        gui.add_html(page.panel_text(f"<b>{title}</b>{page.key_list(self._scene.key())}"))
        self._plays = gui.add_checkbox("play", True)
        start, end = float(self._times[0]), float(self._times[-1])
        self._time = gui.add_slider("time, s", start, round(max(end, start + 0.01), 3), 0.01, start)
        self._speed = gui.add_dropdown("speed", _SPEEDS, initial_value="1")
        self._follow = gui.add_checkbox("follow the robot", self._scene.follows)
        machine, paths = self._scene.machine, self._scene.paths
        self._choices = [
            (gui.add_checkbox("thrusts", True), [machine.thrusts.node]),
            (gui.add_checkbox("paths", True), paths),
            (gui.add_checkbox("frame of the base", False), [machine.frames]),
        ]
        self._numbers = gui.add_html("")
        gui.main_panel.dock_right()
        self._clock, self._put, self._shown = time.monotonic(), start, (-1, False)

    def step(self) -> None:
        """Go on in time, and follow the controls."""
        now = time.monotonic()
        if self._plays.value and self._time.value == self._put:
            start, end = self._times.min(), self._times.max()
            later = self._put + float(self._speed.value) * (now - self._clock)
            self._time.value = round(float(later if later <= end else start), 3)
        self._clock, self._put = now, self._time.value
        page.follow_choices(self._choices)
        place = max(int(np.searchsorted(self._times, self._put, side="right")) - 1, 0)
        shown = int(self._sound[place]), self._follow.value
        if shown != self._shown:
            self._scene.follows = shown[1]
            self._scene.show(shown[0])
            self._numbers.content = _numbers(self._flight, shown[0])
            self._shown = shown


def _numbers(flight: Flight, sample: int) -> str:
    """Errors and the largest thrust at a sample, as HTML."""
    led = extent.led_points(flight).items()
    rows = [(f"{name} off by", 1e3 * float(point.error[sample]), "mm") for name, point in led]
    thrusts = np.abs(flight.applied[sample, : flight.rotors])
    if len(thrusts):
        rows.append(("largest thrust", float(thrusts.max()), "N"))
    return page.panel_text(page.number_table((n, f"{value:.3f}", unit) for n, value, unit in rows))


def flight_page(flight: Flight) -> page.ViewPage:
    """Record a flight, with as many frames as there is room for in less than 2 MB.

    Raises `UsageError` if viser is not installed, or the robot is nowhere at any time.
    """
    sound = known_samples(flight)
    start, end = flight.time[sound[[0, -1]]]

    def recorded(frames: int) -> page.ViewPage:
        samples = {*extent.samples_at(flight, np.linspace(start, end, frames))}
        shown = sorted(samples.intersection(sound.tolist()))
        with page.empty_server() as server:
            scene = FlightScene(server, flight, frames=0)
            scene.show(shown[0])
            recording = server.get_scene_serializer()
            for before, sample in pairwise(shown):
                recording.insert_sleep(float(flight.time[sample] - flight.time[before]))
                scene.show(sample)
            client = recording.as_html()
        return page.view_page(client, f"{flight.robot}, {flight.scenario}", scene.key())

    return page.that_fits(recorded, min(int((end - start) * _RATE) + 1, _MOST))
