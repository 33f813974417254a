"""Curves over the time of a flight, and reachable wrenches: lines, names at their ends, legends."""

from __future__ import annotations

import itertools
import re
import string
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import NDArray

from gibbs_codegen.errors import UsageError
from gibbs_codegen.figures.appearance import COLOURS, DARK
from gibbs_codegen.figures.scene import fit, set_scene
from gibbs_codegen.figures.style import COLUMN, FULL, lay_out, new_figure, place_panels, style
from gibbs_codegen.flight.plant.kinematics import kinematics_of
from gibbs_codegen.flight.record.extent import thrust_directions
from gibbs_codegen.flight.record.flight import Array, Flight
from gibbs_codegen.flight.vectors import Flags, roll_pitch_yaw
from gibbs_codegen.robot.reach import Polytope, ReachableWrenches

# Curves on a logarithmic axis end here, in m, rad or J: what is below is roundoff. Axes reach at
# least so many times as far.
LOG_FLOOR, _LEAST_REACH = 1e-12, 1e3

SOLID: dict[str, Any] = {"linewidth": 1.7, "solid_capstyle": "butt"}
DASHED: dict[str, Any] = {"linewidth": 0.8, "color": DARK, "dashes": (4, 3)}
# What varies less than this, in the unit of its axis, is drawn as constant; in degrees, less than
# anybody could see.
ROUND_OFF, _ROUND_OFF_DEGREES = 1e-3, 0.1
# The least range of linear axes, as a share of the sum of their ends.
_LEAST_RANGE = 0.1
# The least range of a charge, which falls slowly and is never more than full.
_LEAST_RANGE_OF_CHARGE = 1e-3
# The longest name beside curves.
_LONGEST_NAME = 14
# A legend's share of a figure's width; names at the ends of curves and numbers take the rest.
_KEY_WIDTH = 0.65
_MOST_COLUMNS = 4
# Curves whose ranges differ by more are not in one panel.
_RATIO = 5.0
# Changes of constrained angles, rad, where they were integrated and drift.
_DRIFT = 1e-8
# Points of a base with arms that x, y, z may be of; else they are of the frame of the base.
_ORIGINS = {"O1": "$O_1$", "O2": "$O_2$"}
# Shares of a thrust along the base normal: of rotors that are called vertical at least this.
_VERTICAL = 0.5
BAND: dict[str, Any] = {"alpha": 0.3, "linewidth": 0}
# A share of a panel's range: nobody sees what leaves the range of the samples by less.
_SEEN = 0.005
_SPAN: dict[str, Any] = {"color": "0.92", "zorder": 0, "linewidth": 0}
_HELD: dict[str, Any] = {"facecolor": "none", "edgecolor": "0.8", "hatch": "////", "linewidth": 0}
_SHARE: dict[str, Any] = {"color": "0.45", "linewidth": 0.9, "linestyle": (0, (1, 1.2))}
# Dashes of limits that only some inputs in a panel have, pt.
_DASH = 5.0
_LIMIT: dict[str, Any] = {"color": "#b00000", "linewidth": 0.8, "linestyle": "-."}
_INSIDE, _MARGIN = COLOURS[0], COLOURS[1]
# Share of the set's extent within which a vertex is on a facet; share of the longest side that a
# flat scene has across.
_ON_FACET, _DEPTH = 1e-6, 0.4


class Curves(NamedTuple):
    """Curves of axes over time: `values` (s, k), dashed `reference` (s, k), names and colours."""

    label: str
    names: list[str]
    values: Array
    reference: Array | None = None
    colours: Sequence[str] = COLOURS


def plot(axes: Axes, flight: Flight, curves: Curves) -> None:
    """Draw values as coloured lines with their names at the end, the reference dashed over them."""
    for column, name in enumerate(curves.names):
        values, colour = curves.values[:, column], curves.colours[column % len(curves.colours)]
        plot_line(axes, flight, values, color=colour, **SOLID)
        if curves.reference is not None:
            plot_line(axes, flight, curves.reference[:, column], zorder=3, **DASHED)
        # A flight that stopped because it diverged may end in what is not a number.
        finite = values[np.isfinite(values)]
        if not name:
            continue
        axes.annotate(
            name,
            xy=(flight.time[-1], finite[-1] if len(finite) else 0.0),
            xytext=(14.0, 0.0),
            textcoords="offset points",
            color=colour,
            verticalalignment="center",
            annotation_clip=False,
        )
    label_axes(axes, curves.label)


def plot_lines(axes: Axes, flight: Flight, label: str, series: Mapping[str, Array]) -> None:
    """Draw series (s) by their names, without a legend."""
    for (name, values), colour in zip(series.items(), COLOURS, strict=False):
        plot_line(axes, flight, values, label=name, color=colour, linewidth=1.0)
    label_axes(axes, label)


def plot_logarithms(axes: Axes, flight: Flight, label: str, series: Mapping[str, Array]) -> None:
    """As `plot_lines`, on a logarithmic axis."""
    axes.set_yscale("log")
    raised = {name: np.maximum(values, LOG_FLOOR) for name, values in series.items()}
    plot_lines(axes, flight, label, raised)
    low, high = axes.get_ylim()
    if low < 10.0 * LOG_FLOOR:
        axes.set_ylim(0.5 * LOG_FLOOR, max(high, _LEAST_REACH * LOG_FLOOR))
        axes.axhspan(0.5 * LOG_FLOOR, LOG_FLOOR, color="0.93", linewidth=0)


def plot_line(axes: Axes, flight: Flight, values: Array, **line: Any) -> None:
    """Draw values (s) over time; `line` are Matplotlib's properties of the line."""
    # A single sample makes no line.
    marker = ("+" if "dashes" in line else "o") if len(values) == 1 else ""
    axes.plot(flight.time, values, marker=marker, markersize=4, **line)


def label_axes(axes: Axes, label: str) -> None:
    """Label the vertical axis, and the time below the lowest axes of a figure.

    The axes have all their lines already.
    """
    axes.set_ylabel(label)
    low, high = axes.get_ylim()
    share = _LEAST_RANGE_OF_CHARGE if label.startswith("charge") else _LEAST_RANGE
    least = max(round_off(label), share * abs(low + high))
    if axes.get_yscale() == "linear" and high - low < least:
        axes.set_ylim((low + high - least) / 2.0, (low + high + least) / 2.0)
    place = axes.get_subplotspec()
    lowest = place is None or place.is_last_row()
    # Axes that do not reach over the whole width have times of their own.
    narrow = place is not None and len(place.colspan) < place.get_gridspec().ncols
    axes.tick_params(labelbottom=lowest or narrow)
    axes.set_xlabel("time (s)" if lowest else "")


def round_off(label: str) -> float:
    """The range, in the unit of an axis' label, below which what varies is drawn as constant."""
    return _ROUND_OFF_DEGREES if label.endswith("(deg)") else ROUND_OFF


def add_key(axes: Axes, **key: Any) -> None:
    """Put a legend above axes, on the right, in as few rows as there is width for."""
    for columns in range(_MOST_COLUMNS, 0, -1):
        legend = axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, **key)
        if legend.get_window_extent().width < _KEY_WIDTH * axes.figure.bbox.width:
            break


def explain(axes: Axes, solid: str, dashed: str) -> None:
    """Say above axes what solid and dashed lines are."""
    lines = [
        Line2D([], [], color=COLOURS[0], label=solid, **SOLID),
        Line2D([], [], label=dashed, **DASHED),
    ]
    add_key(axes, handles=lines)


def symbol(name: str) -> str:
    """A coordinate or input as in the paper: θ₋₁ for `theta_m1`, F₂ for `F_2`, in mathematics.

    Other names lose what says thrust or torque, as the axis does, and the ends of their words where
    they are long.
    """
    match = re.fullmatch(r"(theta|tau|tau_prime|d|F)_(m?\d+)|(q)([xyzw])|([xyz])", name)
    if match is None:
        return _short(re.sub(r"^(F|tau|tau_prime)_", "", name).split("_"))
    letter, index, *_ = (part for part in (*match.groups(), "") if part is not None)
    letters = {"theta": r"\theta", "tau": r"\tau", "tau_prime": r"\tau\prime"}
    letter = letters.get(letter, letter)
    return f"${letter}_{{{index.replace('m', '-')}}}$" if index else f"${letter}$"


def _short(words: Sequence[str]) -> str:
    """A name made of beginnings of its words that are as long as there is room for."""
    for letters in range(max(map(len, words)), 0, -1):
        name = "_".join(word[:letters] for word in words)
        if len(name) <= _LONGEST_NAME:
            return name
    return f"{name[: _LONGEST_NAME - 1]}…"


def stack(flight: Flight, panels: Sequence[Curves], width: float) -> Figure:
    """Draw panels one above the other in a figure, not yet finished, whose width is in inches."""
    figure = new_figure(width, 0.4 + 1.7 * len(panels))
    column = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, curves in zip(column, panels, strict=True):
        plot(axes, flight, curves)
    return figure


def finished(figure: Figure, flight: Flight) -> Figure:
    """The figure with its heading, its axes in their places, and names beside curves."""
    place_panels(figure, add_heading(figure, flight))
    lay_out(figure)
    return figure


# A panel: the curves of the axes that it consists of, from above.
_Panel = list[Curves]


def coordinates(flight: Flight, letters: str = string.ascii_uppercase) -> Figure:
    """Draw the paper's Fig. 10: every coordinate, actual and desired, over time in s.

    Panels, with `letters` in their order: attitude angles, deg, or the quaternion, and the same as
    roll, pitch and yaw, deg; joints of the arm, revolute ones in deg, prismatic ones in m in a
    panel of their own; position of O₁, of the base centre or of the base's frame, whichever the
    coordinates are of, m, or the travel of a base that does not move freely, from its place.
    Constrained angles of base arms 2 … N, deg, have a panel only if they drift, which takes a
    system that was integrated with them; in flights of `simulate` they cannot. Attitudes and joints
    that vary far less than others, such as roll and pitch beside a yaw of many turns, have axes of
    their own.
    """
    panels = _panels(flight)
    pairs = [panels[place : place + 2] for place in range(0, len(panels), 2)]
    rows = [_heights(pair) for pair in pairs]
    heights = list(itertools.chain.from_iterable(rows))
    with style():
        figure = new_figure(FULL, 0.3 + sum(heights))
        grid = figure.add_gridspec(len(heights), 2, height_ratios=heights)
        begin, titles = 0, iter(letters)
        for pair, row in zip(pairs, rows, strict=True):
            end = begin + len(row)
            for column, parts in enumerate(pair):
                # The last of an odd number takes the whole row.
                columns = column if len(pair) == 2 else slice(None)
                places: Sequence[Any] = range(begin, end) if parts[1:] else [slice(begin, end)]
                group = [figure.add_subplot(grid[place, columns]) for place in places]
                group[0].set_title(next(titles), loc="left")
                for axes, part in zip(group, parts, strict=True):
                    plot(axes, flight, part)
            begin = end
        # The second panel explains both.
        explain(figure.axes[len(panels[0]) * (len(panels) > 1)], "actual", "desired")
        return finished(figure, flight)


def _panels(flight: Flight) -> list[_Panel]:
    """The contents of each panel."""
    layout = flight.layout
    numbers = range(layout.q.size)
    kinds = [
        [k for k in numbers[layout.q.joints] if layout.q.units[k] == unit] for unit in ("rad", "m")
    ]
    joints = [_coordinate_curves(flight, "joints", places) for places in kinds if places]
    place = flight.q[0, layout.q.position]
    starts = dict(zip(flight.points, flight.positions[0], strict=True))
    origin = next(
        (words for name, words in _ORIGINS.items() if np.allclose(place, starts.get(name, np.nan))),
        "the base",
    )
    arms = np.broadcast_arrays(flight.base_arm_angles, flight.base_arm_angles_desired)
    arm_names = [symbol(f"theta_{k}") for k in range(2, arms[0].shape[1] + 2)]
    drift = np.abs(arms[0] - arms[1]).max(initial=0.0) > _DRIFT
    base_arms = [Curves("base arms (deg)", arm_names, *np.degrees(arms))]
    attitude, position = numbers[layout.q.attitude], numbers[layout.q.position]
    where = f"position of {origin}" if layout.moves_freely else "travel of the base"
    return [
        *([_by_range(_coordinate_curves(flight, "attitude", attitude))] if attitude else []),
        *([_by_range(_roll_pitch_yaw(flight))] if layout.is_quaternion else []),
        *([base_arms] if drift else []),
        *map(_by_range, joints),
        *([[_coordinate_curves(flight, where, position)]] if position else []),
    ]


def _coordinate_curves(flight: Flight, quantity: str, places: Sequence[int]) -> Curves:
    """Curves, in deg or m, of coordinates that are all angles, all lengths or a quaternion.

    `quantity` is for the label, and `places` (k) are in q.
    """
    unit, factor = flight.layout.q.units[places[0]], 1.0
    if unit == "rad":
        unit, factor = "deg", 180.0 / np.pi
    label = f"{quantity} ({unit})" if unit != "1" else "quaternion"
    names = [symbol(flight.coordinates[place]) for place in places]
    actual, desired = (factor * q[:, places] for q in (flight.q, flight.q_desired))
    return Curves(label, names, actual, desired)


def _roll_pitch_yaw(flight: Flight) -> Curves:
    """Curves of the attitude by angles, deg, which do not jump by turns."""
    finite = np.isfinite(flight.q_desired).all(axis=1)  # A log may not have it.
    desired = np.full_like(flight.roll_pitch_yaw, np.nan)
    desired[finite] = roll_pitch_yaw(
        kinematics_of(flight.layout).rotation(flight.q_desired[finite])
    )
    actual, desired = (
        np.degrees(np.unwrap(angles, axis=0)) for angles in (flight.roll_pitch_yaw, desired)
    )
    return Curves("attitude (deg)", ["roll", "pitch", "yaw"], actual, desired)


def _by_range(curves: Curves) -> list[Curves]:
    """The curves in one panel, or in two if the larger would make the smaller look flat."""
    actual = np.where(np.isfinite(curves.values), curves.values, curves.values[0])
    ranges = np.ptp(actual, axis=0)
    ranked = np.sort(ranges[ranges > round_off(curves.label)])
    if not len(ranked) or ranked[-1] < _RATIO * ranked[0]:
        return [curves]
    # Between the two that differ most.
    wide = ranges >= ranked[np.argmax(ranked[1:] / ranked[:-1]) + 1]
    # In the order that the first of each has.
    return [_chosen(curves, wide == wide[0]), _chosen(curves, wide != wide[0])]


def _chosen(curves: Curves, which: Any) -> Curves:
    """Some of the curves, by a mask (k)."""
    names = list(itertools.compress(curves.names, which))
    reference = None if curves.reference is None else curves.reference[:, which]
    colours = list(itertools.compress(itertools.cycle(curves.colours), which))
    return Curves(curves.label, names, curves.values[:, which], reference, colours)


def _heights(panels: Sequence[_Panel]) -> list[float]:
    """Heights of the rows that panels beside each other take, of which some are split, in."""
    widest = max(panels, key=len)
    if len(widest) == 1:
        return [1.8]
    # Names at the ends of curves need height.
    shares = np.sqrt([len(curves.names) for curves in widest])
    return [float(height) for height in 2.2 * shares / shares.sum()]


def inputs(flight: Flight, width: float = COLUMN) -> Figure:
    """Draw thrusts F₁ … F_N in N, and the joints' torques in N m and forces in N, over time in s.

    Thrusts of rotors that lift and of rotors that push sideways have panels of their own. Lines are
    the applied inputs, with bands from the least to the greatest between samples; dashes, where
    they differ, the commanded ones. A dotted line is what each rotor bears of the weight, others
    are limits: red if all inputs of a panel have it, else in the colours of those that do. The
    background is grey while a force or torque acts on a frame for a time, or all the time where
    nothing else does, and hatched while a
    constraint holds.
    """
    places, units = np.arange(len(flight.input_names)), np.array(flight.input_units)
    lifts = places < 0
    lifts[: flight.rotors] = np.abs(thrust_directions(flight, 0)[:, 2]) >= _VERTICAL
    rotors, joints = places < flight.rotors, places >= flight.rotors
    mixed = lifts.any() and (rotors & ~lifts).any()
    groups = {
        "vertical thrust (N)" if mixed else "thrust (N)": lifts if mixed else rotors,
        "sideways thrust (N)": rotors & ~lifts if mixed else lifts & ~lifts,
        "joint torque (N m)": joints & (units == "N m"),
        "joint force (N)": joints & (units == "N"),
    }
    # What a log does not know has no panel.
    known = np.isfinite(flight.applied)
    shown = {k: np.flatnonzero(places) for k, places in groups.items() if known[:, places].any()}
    with style():
        figure = stack(flight, [_curves(flight, *named) for named in shown.items()], width)
        keys: dict[str, Any] = {}
        for axes, group in zip(figure.axes, shown.values(), strict=True):
            _draw_bands(axes, flight, group)
            keys |= _draw_bounds(axes, flight, group) | _draw_loads(axes, flight)
            axes.autoscale(axis="y")
            label_axes(axes, axes.get_ylabel())
        if not _followed(flight).all():
            keys = {
                "applied": Line2D([], [], color=COLOURS[0], **SOLID),
                "commanded": Line2D([], [], **DASHED),
                **keys,
            }
        if keys:
            add_key(figure.axes[0], handles=list(keys.values()), labels=list(keys))
        return finished(figure, flight)


# Labels of axes, and factors, of drawn commands by their units.
_OF_ROTORS = {"1": ("throttle (%)", 100.0), "rad/s": ("rotor speed (rad/s)", 1.0)}
_OF_JOINTS = {
    "rad": ("servo position (deg)", 180.0 / np.pi),
    "m": ("servo position (m)", 1.0),
    "rad/s": ("servo rate (rad/s)", 1.0),
    "m/s": ("servo rate (m/s)", 1.0),
}


def actuators(flight: Flight, width: float = COLUMN) -> Figure:
    """Draw throttles, speeds and positions of joints with servos over time in s.

    Throttles are in %, speeds in rad/s, positions in deg and m. Lines are the levels that rotors
    have and where joints are, dashes what motors and servos are sent.
    """
    panels = actuator_panels(flight) or [Curves("throttle (%)", [], flight.actuators[:, :0])]
    with style():
        figure = stack(flight, panels, width)
        explain(figure.axes[0], "actual", "sent")
        return finished(figure, flight)


def actuator_panels(flight: Flight) -> list[Curves]:
    """Curves of motors and servos, by kind; nothing for a robot without them."""
    states = dict(zip(flight.actuator_names, flight.actuators.T, strict=True))
    measured = {f"{x}_position": q for x, q in zip(flight.coordinates, flight.q.T, strict=True)}
    measured |= {f"{x}_rate": v for x, v in zip(flight.layout.v.names, flight.v.T, strict=True)}
    curves_of: dict[str, list[tuple[str, Array, Array]]] = {}
    for k, (name, unit) in enumerate(zip(flight.command_names, flight.command_units, strict=True)):
        kinds = _OF_ROTORS if k < flight.rotors else _OF_JOINTS
        if unit in kinds:
            label, factor = kinds[unit]
            sent = factor * flight.commands[:, k]
            actual = states.get(name, measured.get(name, flight.commands[:, k]))
            curve = symbol(flight.input_names[k]), factor * actual, sent
            curves_of.setdefault(label, []).append(curve)
    panels = []
    for label, curves in curves_of.items():
        actual, sent = (np.stack([line[k] for line in curves], axis=1) for k in (1, 2))
        panels.append(Curves(label, [name for name, _, _ in curves], actual, sent))
    return panels


def _curves(flight: Flight, label: str, places: NDArray[np.int_]) -> Curves:
    """Curves of inputs of one kind, with the commanded ones as reference where they differ."""
    differing = np.where(_followed(flight), np.nan, flight.commanded)
    names = [symbol(flight.input_names[place]) for place in places]
    colours = [COLOURS[place % len(COLOURS)] for place in places]
    return Curves(label, names, flight.applied[:, places], differing[:, places], colours)


def _draw_bands(axes: Axes, flight: Flight, places: NDArray[np.int_]) -> None:
    """Draw what applied inputs did between samples, where the samples do not show it."""
    applied = flight.applied
    seen = _SEEN * np.ptp(applied[:, places][np.isfinite(applied[:, places])])
    before = np.vstack([applied[:1], applied[:-1]])
    above = flight.applied_greatest - np.maximum(before, applied)
    below = np.minimum(before, applied) - flight.applied_least
    for place in places:
        # Others would be hidden by the curve, and make files of vectors large.
        if np.nanmax([above[:, place], below[:, place]], initial=0.0) > seen:
            ends = flight.applied_least[:, place], flight.applied_greatest[:, place]
            colour = COLOURS[place % len(COLOURS)]
            axes.fill_between(flight.time, *ends, step="pre", color=colour, **BAND)


def _draw_bounds(axes: Axes, flight: Flight, places: NDArray[np.int_]) -> dict[str, Any]:
    """Draw limits, and what each of these rotors bears of the weight; return the legend."""
    keys: dict[str, Any] = {}
    bearing = [place for place in places if place < flight.rotors]
    lift = np.abs(thrust_directions(flight, 0)[bearing, 2])
    if np.isfinite(flight.weight) and len(lift) and np.all(lift >= _VERTICAL):
        keys[f"weight / {len(lift)}"] = axes.axhline(flight.weight / lift.sum(), **_SHARE)
    limits = flight.input_limits[:, places]
    for limit in np.unique(limits[np.isfinite(limits)]):
        limited = places[(limits == limit).any(axis=0)]
        if len(limited) == len(places):
            keys["limit"] = axes.axhline(limit, **_LIMIT)
            continue
        # Dashes of the inputs that have this limit, each beside the one before, and a gap.
        for k, place in enumerate(limited):
            dashes = (-_DASH * k, (_DASH, _DASH * len(limited)))
            axes.axhline(limit, color=COLOURS[place % len(COLOURS)], linestyle=dashes)
            keys["limit by colour"] = Line2D([], [], color="0.3", linestyle="--")
    return keys


def _draw_loads(axes: Axes, flight: Flight) -> dict[str, Any]:
    """Shade times of gusts and of what acts on frames, hatch those of holds; return the legend."""
    acts = np.any(flight.frame_wrenches != 0.0, axis=2)
    now = np.any(acts & ~np.all(acts, axis=0), axis=1)
    for begin, end in flight.gusts:
        now |= (begin <= flight.time) & (flight.time <= end)
    if not now.any():  # Steady winds; torques alone are those of spinning rotors.
        now = np.any(flight.frame_wrenches[:, :, :3] != 0.0, axis=(1, 2))
    held = draw_spans(axes, flight, np.any(flight.hold_forces != 0.0, axis=1), "held", _HELD)
    return held | draw_spans(axes, flight, now, "external force")


def draw_spans(
    axes: Axes, flight: Flight, now: Flags, words: str, look: Mapping[str, Any] = _SPAN
) -> dict[str, Any]:
    """Shade the times of samples (s) at which something is; return the legend."""
    if not now.any():
        return {}
    edges = np.flatnonzero(np.diff(now, prepend=False, append=False))
    last = len(flight.time) - 1
    for begin, end in edges.reshape(-1, 2):
        axes.axvspan(flight.time[begin], flight.time[min(end, last)], **look)
    return {words: Patch(**look)}


def _followed(flight: Flight) -> Any:
    """True if inputs (s, nu) act as commanded, as far as a figure can show."""
    return np.isclose(flight.applied, flight.commanded, rtol=1e-4, atol=1e-6)


def reachable_wrenches_figure(found: ReachableWrenches) -> Figure:
    """Draw the forces that leave the torque of hovering as it is, and the torques likewise.

    A bold dot is hovering, and a line through it along each axis is how far that component reaches
    by itself. Underactuated bases have sets that are flat, or a line.

    Args:
        found: The wrenches of a robot, as `reachable_wrenches` has them.

    Returns:
        The figure.

    Raises:
        UsageError: No thrusts within the limits hover.
    """
    if found.margins is None:
        raise UsageError(f"{found.robot}: no thrusts within the limits hover")
    panels = (
        ("forces, with the torque of hovering", "$F_{0}$ (N)", found.forces, slice(0, 3)),
        ("torques, with the force of hovering", "$M_{0}$ (N m)", found.torques, slice(3, 6)),
    )
    with style():
        figure = new_figure(FULL, 3.7)
        figure.suptitle(
            f"{found.robot}, about {found.about}, in the base's axes",
            color="0.35",
            parse_math=False,
        )
        for column, (title, unit, shape, part) in enumerate(panels):
            axes: Any = figure.add_subplot(1, 2, column + 1, projection="3d")
            hover, margins = found.hover[part], found.margins[part]
            labels = [unit.format(axis) for axis in "xyz"]
            set_scene(axes, _bounds(shape.vertices), ticks=5, labels=labels)
            look = {"facecolors": (_INSIDE, 0.12), "edgecolors": (_INSIDE, 0.7), "linewidth": 0.8}
            faces = Poly3DCollection(_faces(shape), label="within the thrusts' limits", **look)
            axes.add_collection3d(faces)
            # How far each component reaches down and up from hovering.
            for axis, (down, up) in zip(np.eye(3), margins, strict=True):
                ends = np.array([hover - down * axis, hover + up * axis])
                label = "margins at hover" if axis[2] else None
                axes.plot(*ends.T, color=_MARGIN, lw=1.6, label=label, zorder=5)
            axes.plot(*hover[:, np.newaxis], "o", color=DARK, ms=4.5, label="hover", zorder=6)
            left = 0.5 * column
            figure.text(left + 0.25, 0.9, title, ha="center", weight="bold")
            fit(axes, left + 0.02, 0.08, 0.46, 0.8)
        handles, names = axes.get_legend_handles_labels()
        figure.legend(handles, names, loc="lower center", ncols=len(names))
        figure.draw_without_rendering()
        return figure


def _faces(shape: Polytope) -> list[Array]:
    """The polygons (k, 3) that bound a set; a flat one is a polygon itself."""
    if shape.basis.shape[1] < 3:
        return [ring_of(shape.vertices)]
    reach = _ON_FACET * float(np.ptp(shape.vertices, axis=0).max())
    away = np.abs(shape.vertices @ shape.normals.T - shape.offsets)
    return [ring_of(shape.vertices[distance <= reach]) for distance in away.T]


def ring_of(corners: Array) -> Array:
    """The corners (k, 3) of a flat convex polygon in the order in which they follow each other."""
    around = corners - corners.mean(axis=0)
    plane = np.linalg.svd(around)[2][:2]
    x, y = plane @ around.T
    return corners[np.argsort(np.arctan2(y, x))]


def _bounds(vertices: Array) -> tuple[Array, Array]:
    """Lowest and highest entries with room around, never flat."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    extent = high - low
    half = 0.54 * np.maximum(extent, _DEPTH * extent.max() or 1.0)
    return (low + high) / 2.0 - half, (low + high) / 2.0 + half


def add_heading(figure: Figure, flight: Flight) -> Text:
    """Name robot and scenario above a figure, and why the flight stopped if it did so early."""
    lines = [f"{flight.robot}, {flight.scenario}"]
    if flight.stopped:
        lines += textwrap.wrap(f"stopped {flight.stopped}", int(20 * figure.get_size_inches()[0]))
    colour = "#b00000" if flight.stopped else "0.35"
    return figure.suptitle("\n".join(lines), color=colour, parse_math=False)


def add_legend(axes: Axes, flight: Flight) -> tuple[float, float, float, float]:
    """Head the figure of 3-D axes, and explain below what their lines, which have labels, show.

    Returns left, bottom, width and height of the rest of the figure, in shares of it.
    """
    figure: Any = axes.figure
    heading = add_heading(figure, flight)
    handles, _ = axes.get_legend_handles_labels()
    anchor = (0.5, _bottom(figure, heading) - 0.005)
    # As few rows as the width of the figure allows.
    for rows in range(1, len(handles) + 1):
        columns = -(-len(handles) // rows)
        row = figure.legend(
            handles=handles, loc="upper center", bbox_to_anchor=anchor, ncols=columns
        )
        if columns == 1 or row.get_window_extent().width < 0.96 * figure.bbox.width:
            break
        row.remove()
    return 0.01, 0.01, 0.98, _bottom(figure, row) - 0.015


def _bottom(figure: Figure, artist: Artist) -> float:
    """The height (0 to 1) in a figure down to which an artist of it reaches."""
    return float(artist.get_window_extent().transformed(figure.transFigure.inverted()).y0)
