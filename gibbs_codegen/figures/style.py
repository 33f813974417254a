"""Widths, colours, style, heading, names kept apart, and saving."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib.style
import numpy as np
from matplotlib import rc_context, rcParams
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backend_bases import get_registered_canvas_class
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.text import Annotation, Text

from gibbs_codegen.errors import OutputError, cause_of, printable
from gibbs_codegen.figures import FORMATS

# Widths of a column and of a page of two columns, in.
COLUMN, FULL = 3.5, 7.2

# Points that a name at the end of a curve takes of the height, and that it stands off.
_NAME_HEIGHT, _NAME_DISTANCE = 10.5, 14.0
# Room around panels, points: of the numbers of an axis, with its ticks, of the name of an axis, of
# a title, between lines, and at edges.
_NUMBERS, _NAME, _TITLE, _APART, _EDGE = 15.0, 13.0, 14.0, 4.0, 3.0
# Points that a panel has of the height at least: a long heading makes the figure higher.
_LEAST_HEIGHT = 50.0

_STYLE: dict[str, Any] = {
    # The second family has what the first lacks, such as subscripts in a message.
    "font.family": ["STIXGeneral", "DejaVu Sans"],
    "mathtext.fontset": "stix",
    **dict.fromkeys(("font.size", "axes.titlesize", "axes.labelsize"), 9),
    **dict.fromkeys(("xtick.labelsize", "ytick.labelsize", "legend.fontsize"), 8.7),
    "figure.titlesize": 8.7,
    "axes.titleweight": "bold",
    **dict.fromkeys(("axes.linewidth", "xtick.major.width", "ytick.major.width"), 0.6),
    "axes.xmargin": 0,
    "axes.grid": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.4,
    "legend.frameon": False,
    "legend.handlelength": 1.8,
    "legend.columnspacing": 1.2,
    "legend.borderpad": 0,
    "legend.borderaxespad": 0.3,
    **{f"axes3d.{axis}axis.panecolor": "white" for axis in "xyz"},
    "savefig.dpi": 200,
    # TrueType: publishers refuse the Type 3 fonts that are the default.
    "pdf.fonttype": 42,
    "svg.hashsalt": "gibbs_codegen",
}


@contextmanager
def style() -> Iterator[None]:
    """The style of all drawings, for as long as one is made or saved."""
    if rcParams["svg.hashsalt"] == _STYLE["svg.hashsalt"]:  # It takes long, and is there already.
        yield
        return
    # How fine a picture is remains the user's: a notebook shows it at that size.
    parameters = {**_STYLE, "figure.dpi": rcParams["figure.dpi"]}
    with matplotlib.style.context(["default", parameters]), warnings.catch_warnings():
        # A letter of a scenario's name that no font has is drawn as a box, which shows it.
        warnings.filterwarnings("ignore", r"Glyph .* missing from")
        yield


def new_figure(width: float, height: float) -> Figure:
    """An empty figure, in, which knows sizes of letters without looking for a canvas each time."""
    return FigureCanvasAgg(Figure(figsize=(width, height))).figure


def place_panels(figure: Any, heading: Text) -> None:
    """Place the axes of a grid, which have all that they show, below the heading of the figure.

    The engines of Matplotlib draw all that has a size, twice. Here heights of panels are by sizes
    of letters, and widths by the numbers of their vertical axes.
    """
    point = figure.dpi / 72.0
    size = figure.get_size_inches() * 72.0
    panels = {axes: axes.get_subplotspec() for axes in figure.axes}
    grid = figure.axes[0].get_subplotspec().get_gridspec()
    above, below = np.zeros((2, grid.nrows))
    left, right = np.zeros((2, grid.ncols))
    for axes, place in panels.items():
        title = [_TITLE] if axes.get_title("left") else []
        keys = [key.get_window_extent().height / point for key in [axes.get_legend()] if key]
        over, under = place.rowspan.start, place.rowspan.stop - 1
        above[over] = max(above[over], _APART + max(title + keys, default=0.0))
        lines = [_NUMBERS * axes.xaxis.get_tick_params()["labelbottom"]]
        lines += [_NAME * bool(axes.get_xlabel())]
        below[under] = max(below[under], _APART + sum(lines))
    ratios = np.array(grid.get_height_ratios() or [1.0] * grid.nrows)
    shares = ratios / ratios.sum()
    outside = heading.get_window_extent().height / point + 2.0 * _EDGE + above.sum() + below.sum()
    size[1] = max(size[1], outside + _LEAST_HEIGHT / shares.min())
    figure.set_size_inches(size / 72.0)
    heading.set_y(1.0 - _EDGE / size[1])
    heights = shares * (size[1] - outside)
    top = size[1] - outside + above.sum() + below.sum()
    high = top - np.cumsum(above + np.append(0.0, (heights + below)[:-1]))
    low = high - heights
    numbers = {}
    for axes, place in panels.items():
        span = slice(low[place.rowspan.stop - 1], high[place.rowspan.start])
        axes.set_position((0.1, span.start / size[1], 0.8, (span.stop - span.start) / size[1]))
        names = [text.get_window_extent().width / point + _NAME_DISTANCE for text in axes.texts]
        before, after = place.colspan.start, place.colspan.stop - 1
        numbers[axes] = _widest_number(axes.yaxis, axes.get_ylim()) / point + 3.0 * _APART
        left[before] = max(left[before], numbers[axes] + _NAME + _EDGE)
        # The last number of the horizontal axis may be in the middle of its end.
        beyond = _widest_number(axes.xaxis, axes.get_xlim()) / point / 2.0
        right[after] = max(right[after], *names, beyond)
    right += _EDGE + _APART
    width = (size[0] - left.sum() - right.sum()) / grid.ncols
    first = np.cumsum(left + np.append(0.0, width + right[:-1]))
    for axes, place in panels.items():
        _, bottom, _, height = axes.get_position().bounds
        begin, end = first[place.colspan.start], first[place.colspan.stop - 1] + width
        axes.set_position((begin / size[0], bottom, (end - begin) / size[0], height))
        # Names of axes in one column are in one line.
        column = max(numbers[other] for other, at in panels.items() if at.colspan == place.colspan)
        axes.yaxis.set_label_coords(-column / (end - begin), 0.5)
        axes.xaxis.set_label_coords(0.5, -(_NUMBERS + 2.0) / (height * size[1]))
        spread(axes)


def _widest_number(axis: Axis, limits: tuple[float, float]) -> float:
    """The width, in pixels, of the widest number of an axis, those between powers of ten too."""
    low, high = sorted(limits)
    widths = [0.0]
    for places, formatter in (
        (axis.get_majorticklocs(), axis.get_major_formatter()),
        (axis.get_minorticklocs(), axis.get_minor_formatter()),
    ):
        texts = formatter.format_ticks([place for place in places if low <= place <= high])
        text, size = max(texts, key=len, default=""), rcParams["ytick.labelsize"]
        longest = Text(text=text, size=size, figure=axis.axes.figure)
        widths.append(longest.get_window_extent().width)
    return max(widths)


def spread(axes: Axes) -> None:
    """Move the names at the ends of curves apart, as little as can be; leave some of too many out.

    The axes have their place; the names are their annotations, in offset points.
    """
    names = [text for text in axes.texts if isinstance(text, Annotation)]
    if not names:
        return
    point = axes.figure.dpi / 72.0
    low, high = (edge / point / _NAME_HEIGHT for edge in axes.bbox.intervaly)
    kept = names[:: -(-len(names) // max(int(high - low), 1))]
    for name in set(names) - set(kept):
        name.remove()
    places = axes.transData.transform([name.xy for name in kept]) / point
    ends = places[:, 1] / _NAME_HEIGHT
    # Of equals the first is above.
    order = np.lexsort((-np.arange(len(kept)), ends.round(2)))
    # Less the rank of each: places that do not decrease are names that do not meet.
    wanted = ends[order] - np.arange(len(kept))
    lines = []
    for rank, index in enumerate(order):
        # Least squares under that condition (isotonic regression).
        means = [
            min(wanted[first : last + 1].mean() for last in range(rank, len(kept)))
            for first in range(rank + 1)
        ]
        place = np.clip(max(means), low, high - len(kept) + 1.0) + rank
        up = float(place - ends[index]) * _NAME_HEIGHT
        kept[index].set_position((_NAME_DISTANCE, up))
        start = places[index] + (1.0, 0.0)
        lines.append((kept[index].get_color(), start, places[index] + (_NAME_DISTANCE - 1.0, up)))
    colours, *ends_of_lines = zip(*lines, strict=True)
    # Thin lines lead from curves to names, which have room at the side of the axes.
    segments: Any = np.stack(ends_of_lines, axis=1) / 72.0
    look: dict[str, Any] = {"transform": axes.figure.dpi_scale_trans}
    leaders = LineCollection(segments, colors=colours, linewidths=0.5, **look)
    axes.figure.add_artist(leaders, clip=False)


def lay_out(figure: Figure) -> None:
    """Place the axes of a figure, if by an engine, once; make the ticks while the style is ours."""
    engine = figure.get_layout_engine()
    if engine:
        engine.execute(figure)
        figure.set_layout_engine("none")
    for axes in figure.axes:
        for axis in axes._axis_map.values():
            axis.get_major_ticks()
            axis.get_minor_ticks()


# Metadata for writers of formats: a date would make every file another.
_OPTIONS: dict[str, dict[str, Any]] = {
    "png": {"pil_kwargs": {"compress_level": 3}},
    "pdf": {"metadata": {"CreationDate": None}},
    "svg": {"metadata": {"Date": None}},
}


# Drawings on the way are laid out as fine as they are written.
@rc_context({"figure.dpi": _STYLE["savefig.dpi"]})
def save_figures(
    figures: Iterable[tuple[str, Figure]], folder: Path, formats: Sequence[str] = FORMATS[:1]
) -> list[Path]:
    """Write figures with their names, which are drawn on the way, and return the files in order.

    Raises `OutputError` if the folder, which is made if need be, cannot hold them.
    """
    paths = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with style():
            for name, figure in figures if formats else ():
                for suffix in formats:
                    path = folder / f"{name}.{suffix}"
                    # A writer of PDF loses what the disk said; memory takes it whole.
                    drawn = io.BytesIO()
                    # `Figure.savefig` would lay it out, and draw it, once more; and a new canvas
                    # knows no sizes of letters.
                    kind, canvas = get_registered_canvas_class(suffix), figure.canvas
                    canvas = canvas if isinstance(canvas, kind) else kind(figure)
                    figure.dpi = _STYLE["savefig.dpi"]  # Files of vectors leave another.
                    getattr(canvas, f"print_{suffix}")(drawn, **_OPTIONS[suffix])
                    path.write_bytes(drawn.getbuffer())
                    paths.append(path)
    except OSError as error:
        raise OutputError(
            f"{printable(folder)}: cannot hold the figures: {cause_of(error)}"
        ) from None
    return paths
