"""A robot as one page, on which it moves one coordinate after the other."""

from __future__ import annotations

from functools import partial

import numpy as np

from gibbs_codegen.simulator.record.series import Array
from gibbs_codegen.viewer.machine import Machine, State
from gibbs_codegen.viewer.page import ViewPage, that_fits, view_page
from gibbs_codegen.viewer.robot_scene import RobotScene
from gibbs_codegen.viewer.server import empty_server

# How long a coordinate moves, s, in frames; and how many frames there are at most, for all.
_SECONDS, _FRAMES, _MOST = 3.0, 60, 900
# How far angles go, rad: as far as shows what they do. Lengths, in the robot's size.
_SWING, _ROOM = 0.6, 0.15


def robot_page(machine: Machine) -> ViewPage:
    """Record a robot as its attitude and its joints move, held still in each posture.

    The page is less than 2 MB. Raises `UsageError` if viser is not installed.
    """
    return that_fits(
        partial(_recorded, machine), min(_FRAMES, _MOST // (3 + machine.vehicle.joints))
    )


def _recorded(machine: Machine, frames_each: int) -> ViewPage:
    """The page with some frames for each coordinate."""
    start = machine.start()
    with empty_server() as server:
        scene = RobotScene(server, machine, machine.coordinates(start), live=False)
        name = server.scene.add_label("/name", "", position=(0.0, 0.0, 0.6 * scene.size))
        frames = swings(machine, start, _ROOM * scene.size, frames_each)
        scene.note([state for _, state in frames])
        name.text = frames[0][0]
        scene.show(frames[0][1])
        recording = server.get_scene_serializer()
        for label, state in frames[1:]:
            recording.insert_sleep(_SECONDS / frames_each)
            name.text = label
            scene.show(state)
        client = recording.as_html()
    return view_page(client, f"{machine.vehicle.name}, one coordinate at a time", scene.key())


def swings(machine: Machine, start: Array, room: float, count: int) -> list[tuple[str, State]]:
    """Frames in which attitude and joints move one after the other.

    `start` is as of `Machine.start`; `room`, m, is how far lengths without limits go; each gets
    `count` frames, at least 2. Says what moves in each, and the robot, with the inputs that hold
    it.
    """
    moved = 3 + machine.vehicle.joints
    waves = np.sin(np.linspace(0.0, 2.0 * np.pi, count))
    labels, ends = machine.controls(room)
    low, high = np.clip(ends, start - _SWING, start + _SWING) - start
    frames = []
    for place in range(moved):
        for wave in waves:
            controls = start.copy()
            controls[place] += abs(wave) * (high if wave > 0.0 else low)[place]
            q = machine.coordinates(controls)
            frames.append((labels[place], machine.state(q, machine.hover(q))))
    return frames
