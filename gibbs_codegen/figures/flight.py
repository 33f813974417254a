"""Figures of a flight, for the widths of a two-column paper (3.5 and at most 7.2 in).

Each is a Matplotlib `Figure` that belongs to nobody: no window, no pyplot, no backend. The caller
saves it, shows it in a notebook or changes it. They look the same whatever the user's own style.
"""

from __future__ import annotations

import io
import itertools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from gibbs_codegen.errors import OutputError, printable
from gibbs_codegen.figures.snapshots import snapshots, snapshots_panels
from gibbs_codegen.figures.style import COLUMN, DARK, FULL, add_heading, spread, style
from gibbs_codegen.simulator.flight import Array, Flight

# Curves on a logarithmic axis end here: it is where what is exactly zero is drawn.
LOG_FLOOR = 1e-17

# Okabe and Ito (2008) without yellow and black, then four of Tol's muted colours.
_COLOURS = (
    *("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00"),
    *("#332288", "#882255", "#999933", "#777777"),
)
_SOLID: dict[str, Any] = {"linewidth": 1.7, "solid_capstyle": "butt"}
_DASHED: dict[str, Any] = {"linewidth": 0.8, "color": DARK, "dashes": (4, 3)}
# What varies less than this, in the unit of its axis, is drawn as constant.
_ROUND_OFF = 1e-3
# Of ranges: curves that differ by more are not in one panel.
_RATIO = 5.0
# A date would make every file another.
_METADATA: dict[str, dict[str, None]] = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}


class _Curves(NamedTuple):
    """What axes show over time: `values` (s, k), dashed `reference` (s, k), names and colours."""

    label: str
    names: list[str]
    values: Array
    reference: Array | None = None
    colours: Sequence[str] = _COLOURS


def coordinates(flight: Flight) -> Figure:
    """The paper's Fig. 10: every coordinate, actual and desired, over time in s.

    A: attitude angles, deg. B: constrained angles of base arms 2 … N, deg. C: joints of the arm,
    revolute ones in deg, prismatic ones in m in a panel of their own. D: position of O₁ (or of the
    base centre, where the coordinates are its), m. In A and C, coordinates that vary far less than
    others, such as roll and pitch beside a yaw of many turns, have axes of their own.
    """
    layout = flight.layout
    every = range(layout.size)
    kinds = [[k for k in every[layout.joints] if layout.units[k] == unit] for unit in ("rad", "m")]
    origin = "$O_1$" if np.allclose(flight.q[:, layout.position], flight.point("O1")) else "$O_2$"
    arms = np.broadcast_arrays(flight.base_arm_angles, flight.base_arm_angles_desired)
    arm_names = [_symbol(f"theta_{k}") for k in range(2, flight.rotors + 1)]
    joint_curves = [_coordinate_curves(flight, "joints", places) for places in kinds if places]
    panels = [
        ("A", _by_range(_coordinate_curves(flight, "attitude", every[layout.attitude]))),
        ("B", [_Curves("base arms (deg)", arm_names, *np.degrees(arms))]),
        *zip(("C", "C′"), map(_by_range, joint_curves), strict=False),
        ("D", [_coordinate_curves(flight, f"position of {origin}", every[layout.position])]),
    ]
    pairs = [panels[place : place + 2] for place in range(0, len(panels), 2)]
    rows = [_heights([parts for _, parts in pair]) for pair in pairs]
    heights = list(itertools.chain.from_iterable(rows))
    with style():
        figure = Figure(figsize=(FULL, 0.3 + sum(heights)), layout="constrained")
        grid = figure.add_gridspec(len(heights), 2, height_ratios=heights)
        begin = 0
        for pair, row in zip(pairs, rows, strict=True):
            end = begin + len(row)
            for column, (letter, parts) in enumerate(pair):
                # The last of an odd number takes the whole row.
                columns = column if len(pair) == 2 else slice(None)
                places: Sequence[Any] = range(begin, end) if parts[1:] else [slice(begin, end)]
                group = [figure.add_subplot(grid[place, columns]) for place in places]
                group[0].set_title(letter, loc="left")
                for axes, part in zip(group, parts, strict=True):
                    _plot(axes, flight, part)
            begin = end
        # Of B.
        _explain(figure.axes[len(panels[0][1])], "actual", "desired")
        return _finished(figure, flight)


def inputs(flight: Flight) -> Figure:
    """Thrusts F₁ … F_N in N, and the joints' torques in N m and forces in N, over time in s.

    Lines are what acts; dashes, where they differ, are what was commanded.
    """
    thrusts, joints = flight.input_names[: flight.rotors], flight.input_names[flight.rotors :]
    units = dict(zip(joints, flight.layout.effort_units, strict=True))
    panels = [
        _input_curves(flight, "thrust (N)", thrusts),
        _input_curves(flight, "joint torque (N m)", [n for n in joints if units[n] == "N m"]),
        _input_curves(flight, "joint force (N)", [n for n in joints if units[n] == "N"]),
    ]
    with style():
        figure = _stack(flight, [curves for curves in panels if curves.names])
        if not _followed(flight).all():
            _explain(figure.axes[0], "applied", "commanded")
        return _finished(figure, flight)


def constraint_torques(flight: Flight) -> Figure:
    """Torques τ'₂ … τ'_N, N m, that keep base arms 2 … N from turning (eqs. 14–17)."""
    names = [rf"$\tau$′$_{{{k}}}$" for k in range(2, flight.rotors + 1)]
    with style():
        panel = _Curves("constraint torque (N m)", names, flight.constraint_torques)
        return _finished(_stack(flight, [panel]), flight)


def tracking_error(flight: Flight) -> Figure:
    """How far the flight is from what is desired, on logarithmic axes, over time in s.

    Above in m: base centre, tip and, where joints slide, the largest of their errors. Below in rad:
    the largest error of an attitude angle or revolute joint and, where the attitude follows the
    path, its angle to the tangent. What is exactly 0 is drawn at `LOG_FLOOR`.
    """
    error, layout = np.abs(flight.q - flight.q_desired), flight.layout
    sliding = [place for place in layout.joint_places if layout.units[place] == "m"]
    angular = [place for place, unit in enumerate(layout.units) if unit == "rad"]
    distances = {"base centre": flight.centre_error}
    if layout.joint_places:
        distances["tip"] = flight.tip_error
    if sliding:
        distances["sliding joints"] = error[:, sliding].max(axis=1)
    angles = {"largest of coordinates": error[:, angular].max(axis=1)}
    if flight.tangent_arm:
        angles[f"arm {flight.tangent_arm} to path"] = flight.heading_error
    with style():
        figure = Figure(figsize=(COLUMN, 3.6), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        _plot_logarithms(above, flight, "distance (m)", distances)
        _plot_logarithms(below, flight, "angle (rad)", angles)
        return _finished(figure, flight)


def energy(flight: Flight) -> Figure:
    """Changes of energy since the start and the work done, J; below how well they balance.

    The error |ΔE − W| is relative to the largest |ΔE| or |W| of the flight; what is exactly 0 is
    drawn at `LOG_FLOOR`.
    """
    kinetic, potential = (e - e[0] for e in (flight.kinetic_energy, flight.potential_energy))
    changes = {"kinetic": kinetic, "potential": potential, r"total $\Delta E$": kinetic + potential}
    largest = np.fmax.reduce(np.abs([kinetic + potential, flight.work]), axis=None)
    error = np.abs(flight.energy_error) / (largest or 1.0)
    with style():
        figure = Figure(figsize=(COLUMN, 3.6), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        for (name, change), colour in zip(changes.items(), _COLOURS, strict=False):
            _line(above, flight, change, label=name, color=colour, **_SOLID)
        _line(above, flight, flight.work, label="work $W$", **_DASHED)
        _label(above, "change of energy (J)")
        _legend(above)
        _plot_logarithms(below, flight, r"$|\Delta E - W|$, relative (1)", {"": error})
        return _finished(figure, flight)


FIGURES: tuple[Callable[[Flight], Figure], ...] = (
    coordinates,
    snapshots,
    snapshots_panels,
    inputs,
    constraint_torques,
    tracking_error,
    energy,
)


def write_figures(
    flight: Flight, folder: Path, formats: Sequence[str] = ("png", "pdf")
) -> list[Path]:
    """Write every figure to `folder`, made if need be, in every format; return paths in order.

    Two calls write the same bytes. Raises `OutputError`.
    """
    paths = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for draw in FIGURES:
            figure = draw(flight)
            for suffix in formats:
                path = folder / f"{draw.__name__}.{suffix}"
                # A writer of PDF loses what the disk said; memory takes it whole.
                drawn = io.BytesIO()
                with style():
                    figure.savefig(drawn, format=suffix, metadata=_METADATA.get(suffix))
                path.write_bytes(drawn.getbuffer())
                paths.append(path)
    except OSError as error:
        raise OutputError(
            f"{printable(folder)}: cannot hold the figures: {error.strerror}"
        ) from None
    return paths


def _coordinate_curves(flight: Flight, what: str, places: Sequence[int]) -> _Curves:
    """Coordinates that are all angles, in degrees, or all lengths."""
    is_angle = flight.layout.units[places[0]] == "rad"
    unit, factor = ("deg", 180.0 / np.pi) if is_angle else ("m", 1.0)
    names = [_symbol(flight.coordinates[place]) for place in places]
    actual, desired = (factor * q[:, places] for q in (flight.q, flight.q_desired))
    return _Curves(f"{what} ({unit})", names, actual, desired)


def _by_range(curves: _Curves) -> list[_Curves]:
    """The curves in one panel, or in two where the larger would make the smaller look flat."""
    actual = np.where(np.isfinite(curves.values), curves.values, curves.values[0])
    ranges = np.ptp(actual, axis=0)
    ranked = np.sort(ranges[ranges > _ROUND_OFF])
    if not len(ranked) or ranked[-1] < _RATIO * ranked[0]:
        return [curves]
    # Between the two that differ most.
    wide = ranges >= ranked[np.argmax(ranked[1:] / ranked[:-1]) + 1]
    # In the order that the first of each has.
    return [_chosen(curves, wide == wide[0]), _chosen(curves, wide != wide[0])]


def _heights(panels: Sequence[list[_Curves]]) -> list[float]:
    """Heights of the rows that panels beside each other take, of which some are split, in."""
    widest = max(panels, key=len)
    if len(widest) == 1:
        return [1.8]
    # Names at the ends of curves need height.
    shares = np.sqrt([len(curves.names) for curves in widest])
    return [float(height) for height in 2.2 * shares / shares.sum()]


def _chosen(curves: _Curves, which: Any) -> _Curves:
    """Some of the curves, by a mask (k)."""
    names = list(itertools.compress(curves.names, which))
    reference = None if curves.reference is None else curves.reference[:, which]
    colours = list(itertools.compress(itertools.cycle(curves.colours), which))
    return _Curves(curves.label, names, curves.values[:, which], reference, colours)


def _input_curves(flight: Flight, label: str, names: Sequence[str]) -> _Curves:
    places = [flight.input_names.index(name) for name in names]
    differing = np.where(_followed(flight), np.nan, flight.commanded)
    applied = flight.applied[:, places]
    return _Curves(label, [_symbol(name) for name in names], applied, differing[:, places])


def _followed(flight: Flight) -> Any:
    """Whether inputs (s, nu) act as commanded, as far as a figure can show."""
    return np.isclose(flight.applied, flight.commanded, rtol=1e-4, atol=1e-6)


def _symbol(name: str) -> str:
    """The paper's symbol of a coordinate or input: θ₋₁ of `theta_m1`, F₂ of `F_2`."""
    letter, _, index = name.partition("_")
    letter = {"theta": r"\theta", "tau": r"\tau"}.get(letter, letter)
    return f"${letter}_{{{index.replace('m', '-')}}}$" if index else f"${letter}$"


def _stack(flight: Flight, panels: Sequence[_Curves]) -> Figure:
    """Panels of one column's width, one above the other."""
    figure = Figure(figsize=(COLUMN, 0.4 + 1.7 * len(panels)), layout="constrained")
    column = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, curves in zip(column, panels, strict=True):
        _plot(axes, flight, curves)
    return figure


def _plot(axes: Axes, flight: Flight, curves: _Curves) -> None:
    """Values as coloured lines with their names at the end, the reference dashed over them."""
    for column, name in enumerate(curves.names):
        values, colour = curves.values[:, column], curves.colours[column % len(curves.colours)]
        _line(axes, flight, values, color=colour, **_SOLID)
        if curves.reference is not None:
            _line(axes, flight, curves.reference[:, column], zorder=3, **_DASHED)
        # A flight that stopped because it diverged may end in what is not a number.
        finite = values[np.isfinite(values)]
        axes.annotate(
            name,
            xy=(flight.time[-1], finite[-1] if len(finite) else 0.0),
            xytext=(14.0, 0.0),
            textcoords="offset points",
            color=colour,
            verticalalignment="center",
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": colour, "lw": 0.5, "shrinkA": 1, "shrinkB": 0},
        )
    _label(axes, curves.label)


def _plot_logarithms(axes: Axes, flight: Flight, label: str, series: Mapping[str, Array]) -> None:
    axes.set_yscale("log")
    for (name, values), colour in zip(series.items(), _COLOURS, strict=False):
        _line(axes, flight, np.maximum(values, LOG_FLOOR), label=name, color=colour, linewidth=1.0)
    _label(axes, label)
    if "" not in series:
        _legend(axes)


def _line(axes: Axes, flight: Flight, values: Array, **kwargs: Any) -> None:
    # A single sample makes no line.
    marker = ("+" if "dashes" in kwargs else "o") if len(values) == 1 else ""
    axes.plot(flight.time, values, marker=marker, markersize=4, **kwargs)


def _label(axes: Axes, label: str) -> None:
    axes.set_ylabel(label)
    low, high = axes.get_ylim()
    if axes.get_yscale() == "linear" and high - low < _ROUND_OFF:
        axes.set_ylim((low + high - _ROUND_OFF) / 2.0, (low + high + _ROUND_OFF) / 2.0)
    place = axes.get_subplotspec()
    lowest = place is None or place.is_last_row()
    axes.tick_params(labelbottom=lowest)
    axes.set_xlabel("time (s)" if lowest else "")


def _legend(axes: Axes, **kwargs: Any) -> None:
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, **kwargs)


def _explain(axes: Axes, solid: str, dashed: str) -> None:
    """Say above axes what solid and dashed lines are."""
    lines = [
        Line2D([], [], color=_COLOURS[0], label=solid, **_SOLID),
        Line2D([], [], label=dashed, **_DASHED),
    ]
    _legend(axes, handles=lines)


def _finished(figure: Figure, flight: Flight) -> Figure:
    """The figure with its heading, and with names beside curves that do not cover each other."""
    add_heading(figure, flight)
    figure.align_ylabels()
    # Lays the figure out, so that heights are known, and makes the ticks while the style is ours.
    figure.draw_without_rendering()
    for axes in figure.axes:
        spread(axes)
    return figure
