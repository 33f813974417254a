"""A flight live: its time and speed, what is shown, and numbers of the moment."""

from __future__ import annotations

import html
import time
from typing import Any

import numpy as np

from gibbs_codegen.simulator.record.flight import Flight
from gibbs_codegen.viewer.flight_scene import FlightScene, known_samples
from gibbs_codegen.viewer.page import key_list, panel_text

_SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "4", "8")


class FlightPanel:
    """Controls of a flight on a server without any, and the scene that follows them.

    Raises `UsageError` if the robot is nowhere at any time.
    """

    def __init__(self, server: Any, flight: Flight) -> None:
        gui, self._flight = server.gui, flight
        self._known = known_samples(flight)
        self._times = flight.time[self._known]
        self._scene = FlightScene(server, flight, frames=1)
        title = html.escape(f"{flight.robot}, {flight.scenario}")
        gui.add_html(panel_text(f"<b>{title}</b>{key_list(self._scene.key())}"))
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
        for choice, nodes in self._choices:
            for node in nodes:
                if node.visible != choice.value:
                    node.visible = choice.value
        place = max(int(np.searchsorted(self._times, self._put, side="right")) - 1, 0)
        shown = int(self._known[place]), self._follow.value
        if shown != self._shown:
            self._scene.follows = shown[1]
            self._scene.show(shown[0])
            self._numbers.content = _numbers(self._flight, shown[0])
            self._shown = shown


def _numbers(flight: Flight, sample: int) -> str:
    """Errors and the largest thrust at a sample, as HTML."""
    rows = [("base centre off by", 1e3 * flight.centre_error[sample], "mm")]
    if flight.has_tip:
        rows.append(("tip off by", 1e3 * flight.tip_error[sample], "mm"))
    thrusts = np.abs(flight.applied[sample, : flight.rotors])
    if len(thrusts):
        rows.append(("largest thrust", float(thrusts.max()), "N"))
    cells = "".join(
        f'<tr><td>{name}</td><td style="text-align: right; padding: 0 6px">{value:.3f}</td>'
        f"<td>{unit}</td></tr>"
        for name, value, unit in rows
    )
    return panel_text(f"<table>{cells}</table>")
