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
from matplotlib.backend_bases import get_registered_canvas_class
from matplotlib.figure import Figure
from matplotlib.text import Annotation

from gibbs_codegen.errors import OutputError, cause_of, printable
from gibbs_codegen.figures import FORMATS

# Widths of a column and of a page of two columns, in.
COLUMN, FULL = 3.5, 7.2

# Points that a name at the end of a curve takes of the height, and that it stands off.
_NAME_HEIGHT, _NAME_DISTANCE = 10.5, 14.0

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
    # How fine a picture is remains the user's: a notebook shows it at that size.
    parameters = {**_STYLE, "figure.dpi": rcParams["figure.dpi"]}
    with matplotlib.style.context(["default", parameters]), warnings.catch_warnings():
        # A letter of a scenario's name that no font has is drawn as a box; that is told by itself.
        warnings.filterwarnings("ignore", r"Glyph .* missing from")
        yield


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


def lay_out(figure: Figure) -> None:
    """Place the axes of a figure, once, and make the ticks while the style is ours."""
    engine = figure.get_layout_engine()
    if engine is None:
        figure.draw_without_rendering()
    else:
        engine.execute(figure)
        figure.set_layout_engine("none")


# A date would make every file another.
_METADATA: dict[str, dict[str, None]] = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}


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
        for name, figure in figures if formats else ():
            for suffix in formats:
                path = folder / f"{name}.{suffix}"
                # A writer of PDF loses what the disk said; memory takes it whole.
                drawn = io.BytesIO()
                # `Figure.savefig` would lay it out, and draw it, once more.
                canvas = get_registered_canvas_class(suffix)(figure)
                figure.dpi = _STYLE["savefig.dpi"]  # Files of vectors leave another.
                with style():
                    getattr(canvas, f"print_{suffix}")(drawn, metadata=_METADATA.get(suffix))
                path.write_bytes(drawn.getbuffer())
                paths.append(path)
    except OSError as error:
        raise OutputError(
            f"{printable(folder)}: cannot hold the figures: {cause_of(error)}"
        ) from None
    return paths
