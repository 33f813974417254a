"""What all figures share: widths, colours, style, heading, and names that keep apart."""

from __future__ import annotations

import textwrap
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib.style
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Annotation, Text

from gibbs_codegen.simulator.record.flight import Flight

# Widths of a column and of a page of two columns, in.
COLUMN, FULL = 3.5, 7.2

# Of curves and chains, which colour-blind eyes can tell apart: Okabe and Ito (2008) without yellow
# and black, then four of Tol's muted colours.
COLOURS = (
    *("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00"),
    *("#332288", "#882255", "#999933", "#777777"),
)
# Black and yellow of the same palette, the yellow darker for white paper.
DARK = "0.15"
GOLD = "#f2c200"

# Points that a name at the end of a curve takes of the height, and that it stands off.
_NAME_HEIGHT, _NAME_DISTANCE = 10.5, 14.0

_STYLE: dict[str, Any] = {
    # The second family has what the first lacks, such as subscripts in a message.
    "font.family": ["STIXGeneral", "DejaVu Sans"],
    "mathtext.fontset": "stix",
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "axes.labelsize": 9,
    "axes.linewidth": 0.6,
    "axes.xmargin": 0,
    "axes.grid": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.4,
    "xtick.labelsize": 8.7,
    "ytick.labelsize": 8.7,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.fontsize": 8.7,
    "legend.frameon": False,
    "legend.handlelength": 1.8,
    "legend.columnspacing": 1.2,
    "legend.borderpad": 0,
    "legend.borderaxespad": 0.3,
    "axes3d.xaxis.panecolor": "white",
    "axes3d.yaxis.panecolor": "white",
    "axes3d.zaxis.panecolor": "white",
    "figure.titlesize": 8.7,
    "savefig.dpi": 200,
    # TrueType: publishers refuse the Type 3 fonts that are the default.
    "pdf.fonttype": 42,
    "svg.hashsalt": "gibbs_codegen",
}


@contextmanager
def style() -> Iterator[None]:
    """The style of all drawings, for as long as one is made or saved."""
    with matplotlib.style.context(["default", _STYLE]), warnings.catch_warnings():
        # A letter of a scenario's name that no font has is drawn as a box; that is told by itself.
        warnings.filterwarnings("ignore", r"Glyph .* missing from")
        yield


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


def spread(axes: Axes) -> None:
    """Move the names at the ends of curves apart, as little as can be; leave some of too many out.

    The axes are laid out; the names are their annotations, in offset points.
    """
    names = [text for text in axes.texts if isinstance(text, Annotation)]
    if not names:
        return
    size = _NAME_HEIGHT * axes.figure.dpi / 72.0
    low, high = (edge / size for edge in axes.get_window_extent().intervaly)
    kept = names[:: -(-len(names) // int(high - low))]
    for name in set(names) - set(kept):
        name.remove()
    ends = axes.transData.transform([name.xy for name in kept])[:, 1] / size
    order = np.argsort(ends)
    # Less the rank of each: places that do not decrease are names that do not meet.
    wanted = ends[order] - np.arange(len(kept))
    for rank, index in enumerate(order):
        # Least squares under that condition (isotonic regression).
        means = [
            min(wanted[first : last + 1].mean() for last in range(rank, len(kept)))
            for first in range(rank + 1)
        ]
        place = np.clip(max(means), low, high - len(kept) + 1.0) + rank
        kept[index].set_position((_NAME_DISTANCE, float(place - ends[index]) * _NAME_HEIGHT))
