"""The paper's Fig. 10: every coordinate of a flight, actual and desired, over time."""

from __future__ import annotations

import itertools
import string
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from gibbs_codegen.figures.curves import Curves, explain, finished, plot, round_off, symbol
from gibbs_codegen.figures.style import FULL, style
from gibbs_codegen.simulator.record.flight import Flight

# Of ranges: curves that differ by more are not in one panel.
_RATIO = 5.0

# A panel: the curves of the axes that it consists of, from above.
_Panel = list[Curves]
# What constrained angles change by, rad, where they were integrated and drift.
_DRIFT = 1e-8

# Points of a base with arms that x, y, z may be of; else they are of the frame of the base.
_ORIGINS = {"O1": "$O_1$", "O2": "$O_2$"}


def coordinates(flight: Flight) -> Figure:
    """Draw the paper's Fig. 10: every coordinate, actual and desired, over time in s.

    Panels, A and so on: attitude angles, deg, or the quaternion; joints of the arm, revolute ones
    in deg, prismatic ones in m in a panel of their own; position of O₁, of the base centre or of
    the base's frame, whichever the coordinates are of, m. Constrained angles of base arms 2 … N,
    deg, have a panel only if they drift, which takes a system that was integrated with them; in
    flights of the simulator they cannot. Attitudes and joints that vary far less than others, such
    as roll and pitch beside a yaw of many turns, have axes of their own.
    """
    panels = _panels(flight)
    pairs = [panels[place : place + 2] for place in range(0, len(panels), 2)]
    rows = [_heights(pair) for pair in pairs]
    heights = list(itertools.chain.from_iterable(rows))
    with style():
        figure = Figure(figsize=(FULL, 0.3 + sum(heights)), layout="constrained")
        grid = figure.add_gridspec(len(heights), 2, height_ratios=heights)
        begin, letters = 0, iter(string.ascii_uppercase)
        for pair, row in zip(pairs, rows, strict=True):
            end = begin + len(row)
            for column, parts in enumerate(pair):
                # The last of an odd number takes the whole row.
                columns = column if len(pair) == 2 else slice(None)
                places: Sequence[Any] = range(begin, end) if parts[1:] else [slice(begin, end)]
                group = [figure.add_subplot(grid[place, columns]) for place in places]
                group[0].set_title(next(letters), loc="left")
                for axes, part in zip(group, parts, strict=True):
                    plot(axes, flight, part)
            begin = end
        # Of the second panel.
        explain(figure.axes[len(panels[0])], "actual", "desired")
        return finished(figure, flight)


def _panels(flight: Flight) -> list[_Panel]:
    """What each panel shows."""
    layout = flight.layout
    every = range(layout.q.size)
    kinds = [
        [k for k in every[layout.q.joints] if layout.q.units[k] == unit] for unit in ("rad", "m")
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
    return [
        _by_range(_coordinate_curves(flight, "attitude", every[layout.q.attitude])),
        *([base_arms] if drift else []),
        *map(_by_range, joints),
        [_coordinate_curves(flight, f"position of {origin}", every[layout.q.position])],
    ]


def _coordinate_curves(flight: Flight, what: str, places: Sequence[int]) -> Curves:
    """Curves, in deg or m, of coordinates that are all angles, all lengths or a quaternion.

    `what` is what they are, for the label, and `places` (k) are in q.
    """
    unit, factor = flight.layout.q.units[places[0]], 1.0
    if unit == "rad":
        unit, factor = "deg", 180.0 / np.pi
    label = f"{what} ({unit})" if unit != "1" else "quaternion"
    names = [symbol(flight.coordinates[place]) for place in places]
    actual, desired = (factor * q[:, places] for q in (flight.q, flight.q_desired))
    return Curves(label, names, actual, desired)


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
