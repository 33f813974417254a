"""A robot at rest in the viewer: its scene, the panel that moves it, and its page."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.record.series import Array, wheel_marks
from gibbs_codegen.flight.vectors import Flags
from gibbs_codegen.flight.viewer import page
from gibbs_codegen.flight.viewer.machine import DrawnMachine, MachineScene, Rest, changed, set_stage

# In the size of a robot: how far below it the floor is; in half its extent: what is in sight, and
# by how much more between panels.
_FLOOR, _AROUND, _BETWEEN_PANELS = 0.2, 1.25, 1.4
# Share of postures whose largest thrusts and efforts are not too large to be shown whole.
_USUAL = 0.8
# How long a coordinate moves, s, in frames; and how many frames there are at most, for all.
_SECONDS, _FRAMES, _MOST = 3.0, 60, 900
# The swing of angles, rad, and of lengths, in the robot's size, that shows their effect.
_SWING, _ROOM = 0.6, 0.15
# How far inputs without limits go, in the largest that holds the robot, and lengths, in its size.
_INPUT_ROOM, _LENGTH_ROOM = 3.0, 1.0
# Postures from which the scale of arrows and colours is taken: for each coordinate, and how far
# lengths go in them, in the robot's size.
_SWING_FRAMES, _SWING_ROOM = 4, 0.15
_PANEL_WIDTH = 360
_HOLD = (
    "Chooses the inputs of least thrust that hold the robot still, or nearly so. Limits are not "
    "considered."
)
_PATTERN = (
    "Orange entries changed with the last move; blank ones are zero in every posture at rest. "
    "Rows are equations, columns unknowns."
)
_FILLED, _LIT, _LINE = "#9fb3c8", "#e69f00", "#cccccc"
_GRID = 'stroke="white" stroke-width="0.08"'
# In cells: what labels of rows take, the gap between arrays, and what heads take above.
_LABEL, _GAP, _HEAD = 6.0, 1.0, 1.6
# Letters of a name that are shown.
_LONGEST = 9
_SUBSCRIPTS = str.maketrans("m0123456789", "₋₀₁₂₃₄₅₆₇₈₉")
# Steps that a slider has at least.
_STEPS = 200
_NOTHING = 1e-9


class RobotScene:
    """Nodes of a robot, whose sizes are taken at coordinates q.

    Thrusts and efforts are drawn in proportion to the largest that were noted. `live` is whether
    frames are drawn when they are asked for, between panels that take room.
    """

    def __init__(self, server: Any, machine: DrawnMachine, q: Array, live: bool) -> None:
        vehicle = machine.vehicle
        self._vehicle, self._rotors, self._arms = vehicle, vehicle.rotors, machine.arms
        self._frames = len(vehicle.frames) if live else 0
        points = vehicle.positions(q)
        low, high = points.min(axis=0), points.max(axis=0)
        world = server.scene.add_frame("/robot", show_axes=False)
        world.position = -0.5 * (low + high)
        self.machine = MachineScene(
            server.scene,
            "/robot/parts",
            vehicle,
            vehicle.weight,
            machine.parents,
            machine.arms,
            points,
            machine.directions(q),
            [],
            self._frames,
        )
        reach = _AROUND * (_BETWEEN_PANELS if live else 1.0)
        reach *= 0.5 * float(np.linalg.norm(high - low)) + self.machine.radius
        flies = vehicle.rotors > 0 or vehicle.layout.moves_freely
        set_stage(server, "/robot", float(low[2]) - flies * _FLOOR * self.machine.size, reach)

    def note(self, states: Sequence[Rest]) -> None:
        """Draw thrusts and efforts in proportion to those of states, if these are larger.

        The most extreme of the states do not count.
        """
        drawn, acting = self.machine, [self._acting(state) for state in states]
        usual = _usual([thrusts for thrusts, _ in acting], drawn.least["N"])
        drawn.thrust = max(drawn.thrust, usual)
        for unit, most in drawn.efforts.items():
            of_unit = [efforts[np.array(drawn.units) == unit] for _, efforts in acting]
            drawn.efforts[unit] = max(most, _usual(of_unit, drawn.least[unit]))

    def _acting(self, state: Rest) -> tuple[Array, Array]:
        """Thrusts (N), and sizes of the efforts of joints and of what holds base arms."""
        thrusts, joints = np.split(state.u, [self._rotors])
        return thrusts, np.abs(np.concatenate([joints, state.constraint_torques[: self._arms]]))

    def show(self, state: Rest) -> None:
        """Put the robot where it is."""
        frames = state.frames[: self._frames]
        where = state.points, state.directions
        marks = wheel_marks(self._vehicle, state.q)
        self.machine.show(*where, *self._acting(state), np.zeros((0, 3)), frames, marks)


def _usual(values: Sequence[Array], least: float) -> float:
    """The largest size in each state, but for the most extreme states; 0 for `least` and below."""
    largest = [float(np.max(np.abs(v), initial=0.0, where=np.isfinite(v))) for v in values]
    most = float(np.quantile(largest, _USUAL))
    return most if most > least else 0.0


def robot_page(machine: DrawnMachine) -> page.ViewPage:
    """Record a robot as what moves of it does, one after the other, held still in each posture.

    The page is less than 2 MB. Raises `UsageError` if viser is not installed.
    """
    start, title = machine.start(), f"{machine.vehicle.name}, one coordinate at a time"

    def recorded(frames_each: int) -> page.ViewPage:
        with page.empty_server() as server:
            scene = RobotScene(server, machine, machine.coordinates(start), live=False)
            size = scene.machine.size
            name = server.scene.add_label("/name", "", position=(0.0, 0.0, 0.6 * size))
            frames = swings(machine, start, _ROOM * size, frames_each)
            scene.note([state for _, state in frames])
            name.text = frames[0][0]
            scene.show(frames[0][1])
            recording = server.get_scene_serializer()
            for label, state in frames[1:]:
                recording.insert_sleep(_SECONDS / frames_each)
                name.text = label
                scene.show(state)
            client = recording.as_html()
        return page.view_page(client, title, scene.machine.key())

    return page.that_fits(recorded, min(_FRAMES, _MOST // machine.swinging))


def swings(machine: DrawnMachine, start: Array, room: float, count: int) -> list[tuple[str, Rest]]:
    """Frames in which attitude and joints, or all that moves, move one after the other.

    `start` is as of `DrawnMachine.start`; `room`, m, is how far lengths without limits go; each
    gets `count` frames, at least 2. Says what moves in each, and the robot, with the inputs that
    hold it.
    """
    waves = np.sin(np.linspace(0.0, 2.0 * np.pi, count))
    labels, ends = machine.controls(room)
    low, high = np.clip(ends, start - _SWING, start + _SWING) - start
    frames = []
    for place in range(machine.swinging):
        for wave in waves:
            controls = start.copy()
            controls[place] += abs(wave) * (high if wave > 0.0 else low)[place]
            q = machine.coordinates(controls)
            frames.append((labels[place], machine.state(q, machine.hover(q))))
    return frames


class RobotPanel:
    """Controls of a robot on a server without any, and the scene that follows them."""

    def __init__(self, server: Any, machine: DrawnMachine) -> None:
        gui, self._machine = server.gui, machine
        self._key = gui.add_html("")
        start = machine.start()
        q = machine.coordinates(start)
        self._scene = RobotScene(server, machine, q, live=True)
        labels, limits = machine.controls(_LENGTH_ROOM * self._scene.machine.size)
        # Arrows and colours keep their scale, so that postures can be compared.
        usual = swings(machine, start, _SWING_ROOM * self._scene.machine.size, _SWING_FRAMES)
        self._scene.note([state for _, state in usual])
        self._key.content = page.panel_text(page.key_list(self._scene.machine.key()))
        with gui.add_folder("Coordinates"):
            self._start, self._posture = start, Sliders(gui, labels, limits, start)
            self._back = False
            gui.add_button("Back to the first posture").on_click(self._reset)
        with gui.add_folder("Inputs"):
            self._hold = gui.add_checkbox("hold still", True, hint=_HOLD)
            u = machine.hover(q)
            self._inputs = Sliders(gui, *machine.input_controls(u, _INPUT_ROOM), u)
        with gui.add_folder("Parameters", expand_by_default=False):
            self._parameters = ParameterFields(gui, machine.module.PARAMETERS)
        with gui.add_folder("Show", expand_by_default=False):
            parts = self._scene.machine
            self._choices = [(gui.add_checkbox("frames", False), [parts.frames])]
            if machine.vehicle.rotors:
                self._choices.append((gui.add_checkbox("thrusts", True), [parts.thrusts.node]))
        panel = gui.add_panel()
        with panel.add_tab("Hybrid system"):
            self._pattern, self._numbers = gui.add_html(""), gui.add_html("")
        gui.main_panel.dock_right()
        panel.dock_left()
        panel.set_width(_PANEL_WIDTH)
        self._filled = machine.pattern()
        self._state: Rest | None = None
        self._seen: tuple[object, ...] = ()

    def step(self) -> None:
        """Follow the controls, if they were moved."""
        page.follow_choices(self._choices)
        self._parameters.step()
        if self._back:
            self._back = False
            self._posture.put(self._start)
        if self._inputs.moved and self._hold.value:
            self._hold.value = False
        posture, u = self._posture.values, self._inputs.values
        seen = (*posture, self._hold.value, *u, *self._parameters.changed_values.items())
        if seen == self._seen:
            return
        remarks, q = [], self._machine.coordinates(posture)
        try:
            self._machine.set_parameters(self._parameters.changed_values)
        except UsageError as error:
            remarks.append(str(error))
        if self._hold.value:  # Inputs are not asked for where the robot is held.
            u = self._machine.hover(q)
            self._inputs.put(u)
        remarks += self._machine.beyond(u)
        state = self._machine.state(q, u)
        self._scene.show(state)
        before = state if self._state is None else self._state
        lit = changed(state.system, before.system)
        names = self._machine.module.HYBRID_COORDINATES
        svg = pattern_svg(names, self._filled | lit, lit)
        self._pattern.content = page.panel_text(f"{svg}<p>{_PATTERN}</p>")
        self._numbers.content = numbers(self._machine, state, self._hold.value, remarks)
        self._state = state
        values = (*posture, self._hold.value, *self._inputs.values)
        self._seen = (*values, *self._parameters.changed_values.items())

    def _reset(self, _: Any) -> None:
        self._back = True


def numbers(machine: DrawnMachine, state: Rest, is_held: bool, remarks: Sequence[str]) -> str:
    """Tables in HTML of what is computed of a robot at rest, `is_held` by its inputs or not.

    `remarks` is what there is to say of its parameters and inputs.
    """
    vehicle = machine.vehicle
    if state.is_still:
        head = "The inputs hold the robot still."
    elif is_held:
        head = "No inputs hold this posture: with those nearest to it the robot accelerates."
    else:
        head = "With these inputs the robot accelerates."
    matrix, hybrid = state.conditions
    rows = [("condition of M", matrix, ""), ("condition of I_H", hybrid, "")]
    units = [f"{unit}²" for unit in vehicle.layout.v.units]
    for name, value, unit in zip(vehicle.layout.v.names, state.a, units, strict=True):
        # An entry of v has a coordinate's name where it is the rate of that coordinate.
        quantity = "acceleration" if name in vehicle.layout.q.names else "rate"
        rows.append((f"{quantity} of {symbol(name)}", value, unit))
    for name, value in zip(vehicle.constraint_names, state.constraint_torques, strict=True):
        rows.append((f"constraint torque {symbol(name)}", value, "N m"))
    table = page.number_table((name, _digits(value), unit) for name, value, unit in rows)
    words = f"<p><b>{html.escape(head)}</b></p>" + "".join(
        f"<p>{html.escape(remark)}</p>" for remark in remarks
    )
    return page.panel_text(f"{words}{table}")


def _digits(value: float) -> str:
    """Four digits; what rounding leaves is 0, and what is singular is infinite."""
    if np.isnan(value):
        return "undetermined"
    if abs(value) > 1e12:
        return "∞" if value > 0.0 else "-∞"
    return f"{value if abs(value) > 1e-9 else 0.0:.4g}"


def pattern_svg(names: Sequence[str], filled: Flags, lit: Flags) -> str:
    """I_H, R_H and B_H beside each other, a cell for each entry, as SVG as wide as there is room.

    `names` are of the m unknowns, which label the rows; `filled` tells of entries (m, m + 1 + nu)
    whether they are not zero in every posture; `lit` which are lit.
    """
    rows, columns = filled.shape
    symbols = map(symbol, names)
    shown = [name if len(name) <= _LONGEST else f"{name[: _LONGEST - 1]}…" for name in symbols]
    lefts = _LABEL + np.arange(columns) + _GAP * (np.arange(columns) >= rows)
    lefts += _GAP * (np.arange(columns) > rows)
    parts = [
        f'<path d="{_cells(filled & ~lit, lefts)}" fill="{_FILLED}" {_GRID}/>',
        f'<path class="lit" d="{_cells(lit, lefts)}" fill="{_LIT}" {_GRID}/>',
    ]
    for title, first, after in (("I", 0, rows), ("R", rows, rows + 1), ("B", rows + 1, columns)):
        if first == after:
            continue
        left, width = lefts[first], after - first
        parts.append(
            f'<rect x="{left}" y="{_HEAD}" width="{width}" height="{rows}" fill="none" '
            f'stroke="{_LINE}" stroke-width="0.1"/>'
            f'<text x="{left + width / 2}" y="{_HEAD - 0.5}" text-anchor="middle" '
            f'font-size="1.2" font-style="italic">{title}'
            f'<tspan dy="0.25" font-size="0.9">H</tspan></text>'
        )
    parts += [
        f'<text x="{_LABEL - 0.4}" y="{_HEAD + row + 0.8}" text-anchor="end" '
        f'font-size="1.05">{html.escape(name)}</text>'
        for row, name in enumerate(shown)
    ]
    size = f"0 0 {lefts[-1] + 1.2} {_HEAD + rows + 0.2}"
    return (
        f'<svg viewBox="{size}" width="100%" role="img" aria-label="Pattern of the hybrid system" '
        f'font-family="sans-serif" fill="#222">{"".join(parts)}</svg>'
    )


def symbol(name: str) -> str:
    """A name of a coordinate or torque with letters as the paper has them.

    Such as θ₋₁ for theta_m1, τ′₂ for tau_prime_2; other names are as they are.
    """
    match = re.fullmatch(r"(theta|tau|tau_prime|F)_(m?\d+)", name)
    if not match:
        return name
    letters = {"theta": "θ", "tau": "τ", "tau_prime": "τ′", "F": "F"}
    return letters[match[1]] + match[2].translate(_SUBSCRIPTS)


def _cells(chosen: Flags, lefts: NDArray[np.float64]) -> str:
    """Squares at entries, as a path."""
    places = zip(*np.nonzero(chosen), strict=True)
    return "".join(f"M{lefts[column]:g} {_HEAD + row:g}h1v1h-1z" for row, column in places)


class Sliders:
    """A folder of sliders, one for each of some numbers.

    `limits` are least and greatest values (2, n), which those to begin with, `start` (n), may
    exceed.
    """

    def __init__(self, gui: Any, labels: Sequence[str], limits: Array, start: Array) -> None:
        ends = zip(labels, *limits, start, strict=True)
        self._sliders = [_slider(gui, label, low, high, value) for label, low, high, value in ends]
        self._exact, self._set = start, self._read()

    @property
    def values(self) -> Array:
        """The numbers (n), in the order of the labels: exactly those that were put, until moved."""
        read = self._read()
        return np.where(read == self._set, self._exact, read)

    @property
    def moved(self) -> bool:
        """True if somebody has moved one since they were made or put somewhere."""
        return not np.array_equal(self._read(), self._set)

    def put(self, values: Array) -> None:
        """Put the sliders at values (n), which may be beyond their ends."""
        for slider, value in zip(self._sliders, values, strict=True):
            # A share of a newton that rounding leaves is none.
            slider.value = rounded(value) if abs(value) > _NOTHING else 0.0
        self._exact, self._set = values, self._read()

    def _read(self) -> Array:
        return np.array([slider.value for slider in self._sliders], dtype=np.float64)


class ParameterFields:
    """A choice of one of many parameters, with defaults by name, and a slider for it."""

    def __init__(self, gui: Any, defaults: Mapping[str, float]) -> None:
        self._defaults = dict(defaults)
        self.changed_values: dict[str, float] = {}
        self._name = next(iter(self._defaults))
        self._choice = gui.add_dropdown("parameter", list(self._defaults))
        self._slider = _slider(gui, "value, SI", *self._ends(), self._defaults[self._name])
        self._back = False
        button = gui.add_button("All parameters back to the robot file's")
        button.on_click(self._reset)

    def step(self) -> None:
        """Follow the controls."""
        if self._back:
            self._back, self.changed_values = False, {}
            self._slider.value = rounded(self._defaults[self._name])
        elif self._choice.value != self._name:
            self._name = self._choice.value
            self._slider.min, self._slider.max = map(rounded, self._ends())
            self._slider.step = _step(*self._ends())
            self._slider.value = rounded(self._value)
        elif self._slider.value != rounded(self._value):
            self.changed_values = self.changed_values | {self._name: float(self._slider.value)}

    @property
    def _value(self) -> float:
        return self.changed_values.get(self._name, self._defaults[self._name])

    def _ends(self) -> tuple[float, float]:
        """From nothing to twice the default; a parameter that is 0 goes both ways."""
        default = self._defaults[self._name]
        if default == 0.0:
            return -1.0, 1.0
        return min(0.0, 2.0 * default), max(0.0, 2.0 * default)

    def _reset(self, _: Any) -> None:
        self._back = True


def _slider(gui: Any, label: str, low: float, high: float, value: float) -> Any:
    """Add a slider to viser's GUI; its value may be beyond the ends."""
    low, high = rounded(low), rounded(high)
    # Between equal ends there is nothing to move.
    still = low == high
    start = float(np.clip(rounded(value), low, high))
    slider = gui.add_slider(label, low, high, _step(low, high), start, disabled=still)
    slider.value = rounded(value)
    return slider


def rounded(value: float) -> float:
    """A number with four digits, for which there is room beside a slider."""
    return float(f"{value:.4g}")


def _step(low: float, high: float) -> float:
    """A power of ten of which there are many between two ends; any number between equal ones."""
    return float(10.0 ** np.floor(np.log10((high - low) / _STEPS))) if low < high else 1.0
