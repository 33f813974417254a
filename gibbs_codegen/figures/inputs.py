"""The inputs of a flight over time, with what bounds and disturbs them."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from gibbs_codegen.figures.curves import (
    DASHED,
    SOLID,
    Curves,
    add_key,
    finished,
    label_axes,
    stack,
    symbol,
)
from gibbs_codegen.figures.style import COLOURS, COLUMN, style
from gibbs_codegen.simulator.record.flight import Array, Flight

# Shares of a thrust along the base normal: of rotors that are called vertical at least this.
_VERTICAL = 0.5
_BAND: dict[str, Any] = {"alpha": 0.3, "linewidth": 0}
# Of the range of a panel: what leaves the range of the samples by less is not seen.
_SEEN = 0.005
_SPAN: dict[str, Any] = {"color": "0.92", "zorder": 0, "linewidth": 0}
_SHARE: dict[str, Any] = {"color": "0.45", "linewidth": 0.9, "linestyle": (0, (1, 1.2))}
# Of the limits of some of the inputs in a panel, pt.
_DASH = 5.0
_LIMIT: dict[str, Any] = {"color": "#b00000", "linewidth": 0.8, "linestyle": "-."}


def inputs(flight: Flight, width: float = COLUMN) -> Figure:
    """Draw thrusts F₁ … F_N in N, and the joints' torques in N m and forces in N, over time in s.

    Thrusts of rotors that lift and of rotors that push sideways have panels of their own. Lines are
    the applied inputs, with bands from the least to the greatest between samples; dashes, where
    they differ, the commanded ones. A dotted line is what each rotor bears of the weight, others
    are limits: red if all inputs of a panel have it, else in the colours of those that do. The
    background is grey while a force or torque acts on a frame for a time.
    """
    places, units = np.arange(len(flight.input_names)), np.array(flight.input_units)
    lifts = places < 0
    lifts[: flight.rotors] = _lift(flight) >= _VERTICAL
    rotors, joints = places < flight.rotors, places >= flight.rotors
    mixed = lifts.any() and (rotors & ~lifts).any()
    groups = {
        "vertical thrust (N)" if mixed else "thrust (N)": lifts if mixed else rotors,
        "sideways thrust (N)": rotors & ~lifts if mixed else lifts & ~lifts,
        "joint torque (N m)": joints & (units == "N m"),
        "joint force (N)": joints & (units == "N"),
    }
    shown = {label: np.flatnonzero(which) for label, which in groups.items() if which.any()}
    with style():
        figure = stack(flight, [_curves(flight, *each) for each in shown.items()], width)
        keys: dict[str, Any] = {}
        for axes, group in zip(figure.axes, shown.values(), strict=True):
            _draw_bands(axes, flight, group)
            keys |= _draw_bounds(axes, flight, group) | _draw_spans(axes, flight)
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


def _lift(flight: Flight) -> Array:
    """What share (N) of each thrust is along the base normal, at the start."""
    directions = flight.thrust_directions
    first = directions if directions.ndim == 2 else directions[0]
    share: Array = np.abs(first[:, 2])
    return share


def _curves(flight: Flight, label: str, places: NDArray[np.int_]) -> Curves:
    """Curves of inputs of one kind, with the commanded ones as reference where they differ."""
    differing = np.where(_followed(flight), np.nan, flight.commanded)
    names = [symbol(flight.input_names[place]) for place in places]
    colours = [COLOURS[place % len(COLOURS)] for place in places]
    return Curves(label, names, flight.applied[:, places], differing[:, places], colours)


def _draw_bands(axes: Axes, flight: Flight, places: NDArray[np.int_]) -> None:
    """Draw what applied inputs did between samples, where the samples do not show it."""
    applied = flight.applied
    seen = _SEEN * np.ptp(applied[np.isfinite(applied[:, places]).all(axis=1)][:, places])
    before = np.vstack([applied[:1], applied[:-1]])
    above = flight.applied_greatest - np.maximum(before, applied)
    below = np.minimum(before, applied) - flight.applied_least
    for place in places:
        # Others would be hidden by the curve, and make files of vectors large.
        if np.nanmax([above[:, place], below[:, place]], initial=0.0) > seen:
            ends = flight.applied_least[:, place], flight.applied_greatest[:, place]
            colour = COLOURS[place % len(COLOURS)]
            axes.fill_between(flight.time, *ends, step="pre", color=colour, **_BAND)


def _draw_bounds(axes: Axes, flight: Flight, places: NDArray[np.int_]) -> dict[str, Any]:
    """Draw limits, and what each of these rotors bears of the weight; return the legend."""
    keys: dict[str, Any] = {}
    bearing = [place for place in places if place < flight.rotors]
    lift = _lift(flight)[bearing]
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


def _draw_spans(axes: Axes, flight: Flight) -> dict[str, Any]:
    """Shade times at which a gust blows, or a frame is acted on for a time; return the legend."""
    acts = np.any(flight.frame_wrenches != 0.0, axis=2)
    now = np.any(acts & ~np.all(acts, axis=0), axis=1)
    for begin, end in flight.gusts:
        now |= (begin <= flight.time) & (flight.time <= end)
    if not now.any():
        return {}
    edges = np.flatnonzero(np.diff(now, prepend=False, append=False))
    last = len(flight.time) - 1
    for begin, end in edges.reshape(-1, 2):
        axes.axvspan(flight.time[begin], flight.time[min(end, last)], **_SPAN)
    return {"external force": Patch(**_SPAN)}


def _followed(flight: Flight) -> Any:
    """Whether inputs (s, nu) act as commanded, as far as a figure can show."""
    return np.isclose(flight.applied, flight.commanded, rtol=1e-4, atol=1e-6)
