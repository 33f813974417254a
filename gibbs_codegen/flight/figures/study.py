"""Figures of a study: how measures are spread, where the worst flights are, what keys explain."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from gibbs_codegen.figures import FORMATS
from gibbs_codegen.figures.appearance import COLOURS, DARK
from gibbs_codegen.figures.style import COLUMN, FULL, lay_out, save_figures, style
from gibbs_codegen.flight.sweeps.sensitivity import Sensitivity
from gibbs_codegen.flight.sweeps.study import Study

# Names of a heading, letters of a key and keys of a panel that are shown.
_MOST_NAMES, _LONGEST_KEY, _MOST_KEYS = 4, 30, 8
# Letters of a line of a measure's name above keys.
_LONGEST_LINE = 27
# Bins of a histogram; worst flights that are numbered; flights beyond which points are not drawn
# one by one in files of vectors.
_MOST_BINS, _WORST, _MOST_POINTS = 60, 5, 2000
# Values that differ by a smaller share differ by rounding.
_SAME = 1e-12
# Distance of points that share a number's place, in points of typography.
_NEAR = 12.0
# How many times as great as the least the greatest value is from which an axis is logarithmic.
_DECADES = 100.0

# Flights, those that ended early, and numbers of the worst, which points do not hide.
_DOTS: dict[str, Any] = {"linestyle": "", "marker": ".", "markersize": 2.5, "color": COLOURS[0]}
_DOTS |= {"alpha": 0.5, "markeredgewidth": 0}
_CROSSES: dict[str, Any] = {"linestyle": "", "marker": "x", "markersize": 4, "color": COLOURS[1]}
_CROSSES |= {"markeredgewidth": 0.8, "label": "ended early"}
_NUMBER: dict[str, Any] = {"color": DARK, "path_effects": [withStroke(linewidth=2, foreground="w")]}


def distributions(study: Study) -> Figure:
    """Draw histograms of each measure over the flights that went on to their end.

    They have the median and the range of nine tenths of the flights.
    """
    with style():
        figure, panels = _panels(study, 1.5)
        for axes, (measure, flights, least, low, median, high, greatest) in zip(
            panels, study.summary(), strict=True
        ):
            axes.set_xlabel(measure, parse_math=False)
            axes.set_ylabel("flights")
            if not flights:
                _say(axes, "no flight reached its end")
                continue
            if np.isclose(least, greatest, _SAME, 0.0):
                _say(axes, f"{least:.3g} in every flight")
                continue
            axes.axvspan(low, high, color="0.93", linewidth=0)
            axes.axvline(median, color=DARK, linewidth=0.8)
            logarithmic = _is_wide(least, greatest)
            values = study.whole[measure]
            values = values[np.isfinite(values)]
            seen = np.log10(values) if logarithmic else values
            edges = np.histogram_bin_edges(seen, "auto")
            if len(edges) > _MOST_BINS + 1:
                edges = np.linspace(edges[0], edges[-1], _MOST_BINS + 1)
            edges = 10.0**edges if logarithmic else edges
            axes.hist(values, edges.tolist(), color=COLOURS[0])
            axes.set_xscale("log" if logarithmic else "linear")
            axes.set_title(
                f"median {median:.3g}; nine tenths from {low:.3g} to {high:.3g}",
                loc="right",
                weight="normal",
            )
        return _finished(figure)


def worst_cases(study: Study) -> Figure:
    """Draw each measure over the key that explains most of it, and number the worst flights.

    Flights that ended early are crosses. Where no key is a number, the number of the case stands
    for it.
    """
    with style():
        figure, panels = _panels(study, 2.1)
        for axes, measure in zip(panels, study.measures, strict=True):
            _draw_worst(axes, study, measure)
        crosses = [line for axes in panels for line in axes.get_lines()[1:]]
        if crosses and len(study.stopped):
            figure.legend(handles=crosses[:1], loc="outside lower center")
        return _finished(figure)


def sensitivities(study: Study) -> Figure:
    """Draw what each key explains of each measure: alone, and in products with other keys.

    Bars have intervals of 95 %, and each key its rank correlation; those that explain most come
    first.
    """
    with style():
        figure, panels = _panels(study, 0.7 + 0.2 * min(len(study.keys) + 2, _MOST_KEYS))
        for axes, measure in zip(panels, study.measures, strict=True):
            _draw_sensitivity(axes, measure, study.sensitivity(measure)[:_MOST_KEYS])
        if drawn := [axes for axes in panels if axes.containers]:
            handles = [drawn[0].containers[0], drawn[0].containers[2]]
            figure.legend(handles=handles, loc="outside lower center", ncols=2)
        return _finished(figure)


FIGURES: tuple[Callable[[Study], Figure], ...] = (distributions, worst_cases, sensitivities)


def write_study_figures(
    study: Study, folder: Path, formats: Sequence[str] = FORMATS[:1]
) -> list[Path]:
    """Write every figure of a study in every format; two calls write the same bytes."""
    return save_figures(((draw.__name__, draw(study)) for draw in FIGURES), folder, formats)


def _draw_worst(axes: Axes, study: Study, measure: str) -> None:
    """Points of all flights of a measure, the worst of them with their numbers."""
    worst, table = study.worst(measure, _WORST), study.table
    # A key that some robot does not have would leave its flights out.
    numbers = [k for k in study.keys if table[k].dtype.kind in "fi" and np.isfinite(table[k]).all()]
    explaining = [bar.key for bar in study.sensitivity(measure) if bar.key in numbers]
    across = (explaining or numbers or ["case"])[0]
    axes.set_xlabel(across, parse_math=False)
    axes.set_ylabel(measure, parse_math=False)
    if not worst:
        _say(axes, "no flight has this measure")
        return
    early = table["stopped"] != ""
    for which, look in ((~early, _DOTS), (early, _CROSSES)):
        points = [table[name][which] for name in (across, measure)]
        axes.plot(*points, rasterized=len(table) > _MOST_POINTS, **look)
    axes.margins(0.05, 0.1)
    if _is_wide(np.nanmin(table[measure]), worst[0].value):
        axes.set_yscale("log")
    places = [(table[across][case.case], case.value) for case in worst]
    for ranks in _neighbours(axes, places):
        number = " ".join(str(rank + 1) for rank in ranks)
        place = places[ranks[0]]
        inwards = "right" if place[0] > sum(axes.get_xlim()) / 2 else "left"
        look = {"textcoords": "offset points", "horizontalalignment": inwards, **_NUMBER}
        axes.annotate(number, place, (0.0, 3.0), **look)
    named = ", ".join(f"{rank}: {case.case}" for rank, case in enumerate(worst, start=1))
    axes.set_title(f"worst cases {named}", loc="left", weight="normal")


def _neighbours(axes: Axes, places: Sequence[tuple[float, float]]) -> list[list[int]]:
    """Groups of points, by number, that are drawn too near each other for a name of their own."""
    axes.autoscale_view()  # Which waits for the drawing otherwise.
    drawn = axes.transData.transform(places) * 72.0 / axes.figure.dpi
    groups: list[list[int]] = []
    for point, place in enumerate(drawn):
        near = [g for g in groups if np.max(abs(drawn[g] - place), axis=-1).min() < _NEAR]
        if near:
            near[0].append(point)
        else:
            groups.append([point])
    return groups


def _draw_sensitivity(axes: Axes, measure: str, bars: Sequence[Sensitivity]) -> None:
    """Bars of what keys explain of a measure."""
    # On the left half: the right one is the heading of the correlations.
    name = textwrap.fill(measure, _LONGEST_LINE)
    axes.set_title(name, loc="left", weight="normal", parse_math=False)
    if not bars or np.isnan(bars[0].alone):
        _say(axes, "too few flights, or all alike")
        return
    numbers = np.nan_to_num([bar[1:5] for bar in bars])
    for column, (name, colour) in enumerate((("alone", 0), ("with others", 4))):
        shares, errors = numbers[:, 2 * column], numbers[:, 2 * column + 1]
        rows = np.arange(len(bars)) + 0.36 * (column - 0.5)
        axes.barh(rows, shares, 0.34, color=COLOURS[colour], label=name)
        ends = [np.minimum(errors, shares), np.minimum(errors, 1.0 - shares)]
        axes.errorbar(shares, rows, xerr=ends, fmt="none", ecolor=DARK, elinewidth=0.7)
    # Long keys show their end.
    whole = (bar.key for bar in bars)
    keys = [key if len(key) <= _LONGEST_KEY else f"…{key[1 - _LONGEST_KEY :]}" for key in whole]
    axes.set_yticks(range(len(bars)), keys, parse_math=False)
    for row, bar in enumerate(bars):
        text = "–" if np.isnan(bar.correlation) else f"{bar.correlation:+.2f}".replace("-", "−")
        place = axes.get_yaxis_transform()
        axes.text(1.02, row, text, transform=place, verticalalignment="center")
    axes.set(xlim=(0.0, 1.0), ylim=(len(bars) - 0.4, -0.6))
    axes.set_title("correlation", loc="right", weight="normal", x=1.16)
    axes.set_xlabel("share that the key explains")
    axes.grid(visible=False, axis="y")


def _panels(study: Study, height: float) -> tuple[Figure, list[Axes]]:
    """A figure with axes (of `height`, in) for each measure, and a heading."""
    count = len(study.measures)
    columns = min(count, 2)
    rows = -(-count // columns)
    size = (COLUMN if columns == 1 else FULL, 0.35 + (height + 0.45) * rows)
    figure = Figure(figsize=size, layout="constrained")
    panels = list(figure.subplots(rows, columns, squeeze=False).flat)
    for axes in panels:
        axes.set_axisbelow(True)
    for axes in panels[count:]:
        axes.remove()
    table, failed = study.table, len(study.failures)
    early = len(study.stopped)
    names = [_listed(np.unique(table[column]).tolist()) for column in ("robot", "scenario")]
    counts = [f"{len(table) - failed} flights"]
    counts += [f"{early} ended early"] if early else []
    counts += [f"{failed} cases failed"] if failed else []
    heading = f"{', '.join(names)}: {', '.join(counts)}"
    figure.suptitle(heading, color="0.35", parse_math=False)
    return figure, panels[:count]


def _finished(figure: Figure) -> Figure:
    lay_out(figure)
    return figure


def _say(axes: Axes, text: str) -> None:
    """Words in the place of a drawing."""
    axes.text(0.5, 0.5, text, transform=axes.transAxes, horizontalalignment="center")
    axes.set(xticks=[], yticks=[])


def _is_wide(least: float, greatest: float) -> bool:
    """True if values reach over so much that a linear axis would hide the small ones."""
    return bool(least > 0.0 and greatest > _DECADES * least)


def _listed(names: Sequence[str]) -> str:
    """Names in words, of many the first."""
    more = len(names) - _MOST_NAMES
    shown = ", ".join(names[:_MOST_NAMES])
    return f"{shown} and {more} more" if more > 0 else shown
