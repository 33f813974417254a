"""Curves over the time of a flight: lines, their names at the end, labels and legends."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from gibbs_codegen.figures.style import COLOURS, DARK, add_heading, spread
from gibbs_codegen.simulator.record.flight import Array, Flight

# Curves on a logarithmic axis end here, in m, rad or J: what is below is roundoff. Axes reach at
# least so many times as far.
LOG_FLOOR, _LEAST_REACH = 1e-12, 1e3

SOLID: dict[str, Any] = {"linewidth": 1.7, "solid_capstyle": "butt"}
DASHED: dict[str, Any] = {"linewidth": 0.8, "color": DARK, "dashes": (4, 3)}
# What varies less than this, in the unit of its axis, is drawn as constant; in degrees, less than
# anybody could see.
ROUND_OFF, _ROUND_OFF_DEGREES = 1e-3, 0.1
# What the range of linear axes is at least, as a share of the sum of their ends.
_LEAST_RANGE = 0.1
# Of names beside curves.
_LONGEST_NAME = 14
# Of a figure's width: a legend, beside names at the ends of curves and numbers at the axis.
_KEY_WIDTH = 0.65
_MOST_COLUMNS = 4


class Curves(NamedTuple):
    """What axes show over time: `values` (s, k), dashed `reference` (s, k), names and colours."""

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
        axes.annotate(
            name,
            xy=(flight.time[-1], finite[-1] if len(finite) else 0.0),
            xytext=(14.0, 0.0),
            textcoords="offset points",
            color=colour,
            verticalalignment="center",
            annotation_clip=False,
            # From the middle of the left edge of the name, wherever `spread` moves it.
            arrowprops={
                "arrowstyle": "-",
                "color": colour,
                "lw": 0.5,
                "shrinkA": 1,
                "shrinkB": 0,
                "relpos": (0.0, 0.5),
            },
        )
    label_axes(axes, curves.label)


def plot_logarithms(axes: Axes, flight: Flight, label: str, series: Mapping[str, Array]) -> None:
    """Draw series (s) on a logarithmic axis, with a legend of their names, none for ""."""
    axes.set_yscale("log")
    for (name, values), colour in zip(series.items(), COLOURS, strict=False):
        raised = np.maximum(values, LOG_FLOOR)
        plot_line(axes, flight, raised, label=name, color=colour, linewidth=1.0)
    low, high = axes.get_ylim()
    if low < 10.0 * LOG_FLOOR:
        axes.set_ylim(0.5 * LOG_FLOOR, max(high, _LEAST_REACH * LOG_FLOOR))
        axes.axhspan(0.5 * LOG_FLOOR, LOG_FLOOR, color="0.93", linewidth=0)
    label_axes(axes, label)
    if "" not in series:
        add_key(axes)


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
    least = max(round_off(label), _LEAST_RANGE * abs(low + high))
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
    found = re.fullmatch(r"(theta|tau|tau_prime|d|F)_(m?\d+)|(q)([xyzw])|([xyz])", name)
    if found is None:
        return _short(re.sub(r"^(F|tau|tau_prime)_", "", name).split("_"))
    letter, index, *_ = (part for part in (*found.groups(), "") if part is not None)
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
    figure = Figure(figsize=(width, 0.4 + 1.7 * len(panels)), layout="constrained")
    column = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, curves in zip(column, panels, strict=True):
        plot(axes, flight, curves)
    return figure


def finished(figure: Figure, flight: Flight) -> Figure:
    """The figure with its heading, and names moved beside curves so that none covers another."""
    add_heading(figure, flight)
    figure.align_ylabels()
    # Lays the figure out, so that heights are known, and makes the ticks while the style is ours.
    figure.draw_without_rendering()
    for axes in figure.axes:
        spread(axes)
    return figure
