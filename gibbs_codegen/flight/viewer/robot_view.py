"""A robot at rest in the viewer: its scene, the panel that moves it, and its page."""

from __future__ import annotations

import html
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.record.recording import weight_of
from gibbs_codegen.flight.record.series import Array
from gibbs_codegen.flight.viewer.controls import Parameters, Sliders
from gibbs_codegen.flight.viewer.machine import (
    Machine,
    MachineScene,
    Posture,
    State,
    changed,
    least_loads,
    set_stage,
)
from gibbs_codegen.flight.viewer.page import (
    ViewPage,
    empty_server,
    key_list,
    panel_text,
    that_fits,
    view_page,
)
from gibbs_codegen.flight.viewer.pattern import pattern_svg, symbol

# In the size of a robot: how far below it the floor is; in half its extent: what is in sight, and
# by how much more between panels.
_FLOOR, _AROUND, _BETWEEN_PANELS = 0.2, 1.25, 1.4
# Share of postures whose largest thrusts and efforts are not too large to be shown whole.
_USUAL = 0.8
# How long a coordinate moves, s, in frames; and how many frames there are at most, for all.
_SECONDS, _FRAMES, _MOST = 3.0, 60, 900
# How far angles go, rad: as far as shows what they do. Lengths, in the robot's size.
_SWING, _ROOM = 0.6, 0.15
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


class RobotScene:
    """Nodes of a robot, whose sizes are taken at coordinates q.

    Thrusts and efforts are drawn in proportion to the largest that were noted. `live` is whether
    frames are drawn when they are asked for, between panels that take room.
    """

    def __init__(self, server: Any, machine: Machine, q: Array, live: bool) -> None:
        vehicle = machine.vehicle
        self._rotors = vehicle.rotors
        self._units = np.array([*vehicle.layout.effort_units, *["N m"] * machine.arms])
        self._arms, self._largest = machine.arms, dict.fromkeys(self._units.tolist(), 0.0)
        self._thrust = 0.0
        drawn = machine.skeleton(q)
        self.size = drawn.size
        self._least = least_loads(weight_of(vehicle), drawn.size)
        self._frames = len(vehicle.frames) if live else 0
        points = vehicle.positions(q)
        low, high = points.min(axis=0), points.max(axis=0)
        world = server.scene.add_frame("/robot", show_axes=False)
        world.position = -0.5 * (low + high)
        self.machine = MachineScene(server.scene, "/robot/parts", drawn, [], self._frames)
        reach = _AROUND * (_BETWEEN_PANELS if live else 1.0)
        reach *= 0.5 * float(np.linalg.norm(high - low)) + drawn.radius
        set_stage(server, "/robot", float(low[2]) - _FLOOR * drawn.size, reach)

    def note(self, states: Sequence[State]) -> None:
        """Draw thrusts and efforts in proportion to those of states, if these are larger.

        The most extreme of the states do not count.
        """
        acting = [self._acting(state) for state in states]
        found = _usual([thrusts for thrusts, _ in acting], self._least["N"])
        self._thrust = max(self._thrust, found)
        for unit, most in self._largest.items():
            of_unit = [efforts[self._units == unit] for _, efforts in acting]
            self._largest[unit] = max(most, _usual(of_unit, self._least[unit]))

    def _acting(self, state: State) -> tuple[Array, Array]:
        """Thrusts (N), and sizes of the efforts of joints and of what holds base arms."""
        thrusts, joints = np.split(state.u, [self._rotors])
        return thrusts, np.abs(np.concatenate([joints, state.held[: self._arms]]))

    def show(self, state: State) -> None:
        """Put the robot where it is."""
        thrusts, efforts = self._acting(state)
        whole = np.array([self._largest[unit] or 1.0 for unit in self._units.tolist()])
        self.machine.show(
            Posture(
                state.points,
                state.directions,
                thrusts / (self._thrust or 1.0),
                efforts / whole,
                np.zeros((0, 3)),
                state.frames[: self._frames],
            )
        )

    def key(self) -> list[tuple[str, str]]:
        """Colours, as CSS has them, and in words what they mean."""
        return self.machine.key(self._thrust, self._largest)


def _usual(values: Sequence[Array], least: float) -> float:
    """The largest size in each state, but for the most extreme states; 0 for `least` and below."""
    largest = [float(np.max(np.abs(v), initial=0.0, where=np.isfinite(v))) for v in values]
    most = float(np.quantile(largest, _USUAL))
    return most if most > least else 0.0


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
