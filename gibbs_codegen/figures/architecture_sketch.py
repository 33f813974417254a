"""The drawing of the page on architecture: the stages from a robot file to a flight."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from gibbs_codegen.figures.marks import QUIET, draw_arrow, draw_name
from gibbs_codegen.figures.sketches import spot
from gibbs_codegen.figures.style import COLOURS, DARK, style

_WIDTH, _UNIT = 3.75, 0.55  # inches, of the page and of one row
_FILE, _VALUE, _MODULE = "0.93", "#e3eef6", "#fdebdd"
# From top to bottom: what there is, what it is made of, and the folders that make the next of it.
_STAGES = (
    ("robot file", "TOML; from URDF, xacro or MJCF", _FILE, "files, exchange, robot"),
    ("Robot", "checked plain data", _VALUE, "derivation, symbolic"),
    ("tape", "Gibbs–Appell equations, step by step", _VALUE, "graph"),
    ("graph", "operations as integers; derivatives", _VALUE, "program"),
    ("Program", "statements, in no language yet", _VALUE, "targets, emitted"),
    ("text of the files", "Python, C, MATLAB …", _VALUE, "verification, files"),
    ("generated module", "checked; needs NumPy only", _MODULE, "runtime"),
    ("functions", "NumPy, C, CasADi, JAX", _MODULE, "flight"),
    ("flight", "series, figures, studies", _MODULE, ""),
)


def architecture_sketch() -> Figure:
    """Draw the stages from a robot file to a flight, and the package's folders between them."""
    rows = 2 * len(_STAGES) - 1
    with style():
        figure = Figure(figsize=(_WIDTH, _UNIT * (rows + 0.6)))
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set(xlim=(0.0, _WIDTH / _UNIT), ylim=(rows + 0.3, -0.3))
        for place, stage in enumerate(_STAGES):
            _draw_stage(axes, 2.0 * place, stage)
        return figure


def _draw_stage(axes: Axes, top: float, stage: tuple[str, str, str, str]) -> None:
    """Draw a box from `top`, in rows, and below it the arrow to the next."""
    name, words, colour, folders = stage
    right = _WIDTH / _UNIT
    shape = "round,pad=0,rounding_size=0.15"
    box = FancyBboxPatch(
        (0.25, top), right - 0.5, 1.1, boxstyle=shape, facecolor=colour, edgecolor=DARK, lw=0.8
    )
    axes.add_patch(box)
    middle = right / 2.0
    draw_name(axes, rf"$\bf{{{name.replace(' ', '~')}}}$", spot(middle, top + 0.33))
    draw_name(axes, words, spot(middle, top + 0.78))
    if folders:
        draw_arrow(axes, spot(middle, top + 1.15), spot(middle, top + 1.95), QUIET)
        draw_name(axes, folders, spot(middle + 1.7, top + 1.55), COLOURS[0])
