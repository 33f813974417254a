"""A robot live: controls for its coordinates, inputs and parameters, and what follows from them."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any

import numpy as np

from gibbs_codegen.errors import UsageError
from gibbs_codegen.simulator.record.series import Array
from gibbs_codegen.viewer.controls import Parameters, Sliders
from gibbs_codegen.viewer.machine import Machine, State, changed
from gibbs_codegen.viewer.page import key_list, panel_text
from gibbs_codegen.viewer.pattern import pattern_svg, symbol
from gibbs_codegen.viewer.robot_page import swings
from gibbs_codegen.viewer.robot_scene import RobotScene

# How far inputs without limits go, in the largest that holds the robot, and lengths, in its size.
_INPUT_ROOM, _LENGTH_ROOM = 3.0, 1.0
# Postures from which the scale of arrows and colours is taken: for each coordinate, and how far
# lengths go in them, in the robot's size.
_SWING_FRAMES, _SWING_ROOM = 4, 0.15
_PANEL_WIDTH = 360
_HOLD = (
    "Chooses the inputs of least thrust that hold the robot where it is, or do so as nearly as "
    "they can. They know no limits."
)
_PATTERN = (
    "Orange entries changed with the last move; blank ones are zero in every posture at rest. "
    "Rows are the equations of the unknowns."
)


class RobotPanel:
    """Controls of a robot on a server without any, and the scene that follows them."""

    def __init__(self, server: Any, machine: Machine) -> None:
        gui, self._machine = server.gui, machine
        self._key = gui.add_html("")
        start = machine.start()
        q = machine.coordinates(start)
        self._scene = RobotScene(server, machine, q, live=True)
        labels, limits = machine.controls(_LENGTH_ROOM * self._scene.size)
        # Arrows and colours keep their scale, so that postures can be compared.
        usual = swings(machine, start, _SWING_ROOM * self._scene.size, _SWING_FRAMES)
        self._scene.note([state for _, state in usual])
        self._key.content = panel_text(key_list(self._scene.key()))
        with gui.add_folder("Coordinates"):
            self._start, self._posture = start, Sliders(gui, labels, limits, start)
            self._back = False
            gui.add_button("Back to the first posture").on_click(self._reset)
        with gui.add_folder("Inputs"):
            self._hold = gui.add_checkbox("hold still", True, hint=_HOLD)
            u = machine.hover(q)
            self._inputs = Sliders(gui, *machine.input_controls(u, _INPUT_ROOM), u)
        with gui.add_folder("Parameters", expand_by_default=False):
            self._parameters = Parameters(gui, machine.module.PARAMETERS)
        with gui.add_folder("Show", expand_by_default=False):
            parts = self._scene.machine
            self._choices = [
                (gui.add_checkbox("thrusts", True), parts.thrusts.node),
                (gui.add_checkbox("frames", False), parts.frames),
            ]
        panel = gui.add_panel()
        with panel.add_tab("Hybrid system"):
            self._pattern, self._numbers = gui.add_html(""), gui.add_html("")
        gui.main_panel.dock_right()
        panel.dock_left()
        panel.set_width(_PANEL_WIDTH)
        self._filled = machine.pattern()
        self._state: State | None = None
        self._seen: tuple[object, ...] = ()

    def step(self) -> None:
        """Follow the controls, if they were moved."""
        for choice, node in self._choices:
            if node.visible != choice.value:
                node.visible = choice.value
        self._parameters.step()
        if self._back:
            self._back = False
            self._posture.put(self._start)
        if self._inputs.moved and self._hold.value:
            self._hold.value = False
        posture, u = self._posture.values, self._inputs.values
        seen = (*posture, self._hold.value, *u, *self._parameters.given.items())
        if seen != self._seen:
            self._follow(self._machine.coordinates(posture), u)
            values = (*posture, self._hold.value, *self._inputs.values)
            self._seen = (*values, *self._parameters.given.items())

    def _follow(self, q: Array, u: Array) -> None:
        """Show the robot in another posture q, or under other inputs u.

        These are not asked for where the robot is held.
        """
        told = []
        try:
            self._machine.give(self._parameters.given)
        except UsageError as error:
            told.append(str(error))
        if self._hold.value:
            u = self._machine.hover(q)
            self._inputs.put(u)
        told += self._machine.beyond(u)
        state = self._machine.state(q, u)
        self._scene.show(state)
        before = state if self._state is None else self._state
        lit = changed(state.system, before.system)
        names = self._machine.module.HYBRID_COORDINATES
        svg = pattern_svg(names, self._filled | lit, lit)
        self._pattern.content = panel_text(f"{svg}<p>{_PATTERN}</p>")
        self._numbers.content = numbers(self._machine, state, self._hold.value, told)
        self._state = state

    def _reset(self, _: Any) -> None:
        self._back = True


def numbers(machine: Machine, state: State, held: bool, told: Sequence[str]) -> str:
    """Tables in HTML of what is computed of a robot at rest, `held` by its inputs or not.

    `told` is what there is to say of its parameters and inputs.
    """
    vehicle = machine.vehicle
    if state.is_still:
        head = "The inputs hold the robot still."
    elif held:
        head = "No inputs hold this posture: with those nearest to it the robot accelerates."
    else:
        head = "With these inputs the robot accelerates."
    matrix, hybrid = state.conditions
    rows = [("condition of M", matrix, ""), ("condition of I_H", hybrid, "")]
    units = [f"{unit}²" for unit in vehicle.layout.v.units]
    for name, value, unit in zip(vehicle.layout.v.names, state.a, units, strict=True):
        # An entry of v has a coordinate's name where it is the rate of that coordinate.
        what = "acceleration" if name in vehicle.layout.q.names else "rate"
        rows.append((f"{what} of {symbol(name)}", value, unit))
    for name, value in zip(vehicle.constraint_names, state.held, strict=True):
        rows.append((f"constraint torque {symbol(name)}", value, "N m"))
    cells = "".join(
        f'<tr><td>{html.escape(name)}</td><td style="text-align: right; padding: 0 6px">'
        f"{_digits(value)}</td><td>{unit}</td></tr>"
        for name, value, unit in rows
    )
    words = f"<p><b>{html.escape(head)}</b></p>" + "".join(
        f"<p>{html.escape(each)}</p>" for each in told
    )
    return panel_text(f"{words}<table>{cells}</table>")


def _digits(value: float) -> str:
    """Four digits; what rounding leaves is 0, and what is singular is infinite."""
    if np.isnan(value):
        return "undetermined"
    if abs(value) > 1e12:
        return "∞" if value > 0.0 else "-∞"
    return f"{value if abs(value) > 1e-9 else 0.0:.4g}"
