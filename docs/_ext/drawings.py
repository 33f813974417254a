"""The drawings of pages; `python docs/_ext/drawings.py` writes them to docs/_static."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch
from sketches import (
    DASHED,
    arc,
    directions,
    draw_curved_arrow,
    draw_frames,
    draw_out_of_page,
    sheet,
    spot,
)

from gibbs_codegen.figures.appearance import COLOURS, DARK, seen_from
from gibbs_codegen.figures.marks import (
    CONSTRAINT,
    QUIET,
    THRUST,
    X_AXIS,
    Y_AXIS,
    Z_AXIS,
    draw_arrow,
    draw_bar,
    draw_name,
    draw_thrust,
)
from gibbs_codegen.figures.style import style
from gibbs_codegen.robot.rotations import Array, turn

# As wide as a page on a phone; inches.
_WIDTH = 3.75
_HEIGHTS = {"1  World, base, rotors": 2.45, "2  A base of rods, from above": 3.1}
_LINKS = {"3  Links: Denavit–Hartenberg": 2.5}


def conventions_sketch() -> Figure:
    """Draw the conventions of robot files, one below the other: frames, signs and angles."""
    heights = _HEIGHTS | _LINKS
    with style():
        figure = Figure(figsize=(_WIDTH, sum(heights.values())))
        top = 1.0
        for (title, height), draw in zip(
            heights.items(), (_draw_base, _draw_rods, draw_frames), strict=True
        ):
            share = height / sum(heights.values())
            figure.text(0.02, top - 0.01, title, fontsize=11, weight="bold", va="top")
            axes = figure.add_axes((0.0, top - share, 1.0, share - 0.035))
            axes.set_axis_off()
            draw(axes)
            axes.set_aspect("equal")
            axes.autoscale(False)
            top -= share
        figure.axes[2].set(xlim=(-1.1, 5.3), ylim=(-0.75, 2.75))
        return figure


def _draw_base(axes: Axes) -> None:
    """Draw a base with its frame above the world's, a rotor, and how it spins."""
    axes.set(xlim=(-0.5, 4.9), ylim=(-0.7, 2.3))
    flat = seen_from((22.0, -55.0))[:2]
    _draw_triad(axes, flat, np.zeros(3), np.eye(3), ("$X$", "$Y$", "$Z$ up"), quiet=True)
    draw_name(axes, "world", spot(0.0, -0.27), QUIET)
    place = np.array([2.0, 0.35, 1.15])
    base = turn(2, np.deg2rad(-18.0)) @ turn(1, np.deg2rad(-6.0))
    draw_arrow(axes, np.zeros(2), flat @ place, DARK, DASHED)
    draw_name(axes, "position $x, y, z$", 0.5 * (flat @ place) + spot(0.85, -0.12))
    _draw_triad(axes, flat, place, base, ("$x$", "$y$", "$z$"))
    draw_name(axes, "base", flat @ place + spot(-0.33, 0.12))
    seat = place + base @ np.array([1.15, 1.35, 0.0])
    axes.plot(*np.array([flat @ place, flat @ seat]).T, color="0.7", lw=4.0, zorder=2)
    angles = np.linspace(0.2, 2.0 * np.pi - 0.55, 50)
    ring = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    draw_curved_arrow(axes, (seat + 0.5 * ring @ base.T) @ flat.T, CONSTRAINT)
    tip = flat @ (seat + 0.85 * base[:, 2])
    draw_arrow(axes, flat @ seat, tip, THRUST)
    draw_name(axes, "thrust $F > 0$", tip + spot(-0.1, 0.2), THRUST)
    words = "counter-clockwise, seen\nfrom the tip: drag < 0"
    draw_name(axes, words, flat @ seat + spot(0.05, -0.72), CONSTRAINT)


def _draw_triad(
    axes: Axes,
    flat: Array,
    origin: Array,
    turned: Array,
    names: tuple[str, str, str],
    quiet: bool = False,
) -> None:
    """Draw a frame, with its axes in columns (3, 3) and their names, in grey if `quiet`.

    `flat` (2, 3) are unit vectors of the page.
    """
    colours = (QUIET,) * 3 if quiet else (X_AXIS, Y_AXIS, Z_AXIS)
    at = flat @ origin
    for name, along, colour in zip(names, turned.T, colours, strict=True):
        step = flat @ (0.8 * along)
        draw_arrow(axes, at, at + step, colour)
        draw_name(axes, name, at + step + 0.2 * step / np.hypot(*step), colour)


def _draw_rods(axes: Axes) -> None:
    """Draw six rods from above: numbers, angles, frames of arms 1 and 3, thrusts."""
    axes.set(xlim=(-2.35, 2.35), ylim=(-1.95, 1.85))
    radius, odd_thrust, even_thrust = 1.25, (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)
    for k in range(1, 7):
        angle = -180.0 + 60.0 * (k - 1)
        along = directions(angle)[0]
        end = radius * along
        draw_bar(axes, spot(0.0, 0.0), end, "0.93", 6.0)
        name = f"motor {k}" + ("\n$O_1$" if k == 1 else "")
        thrust = odd_thrust if k % 2 else even_thrust
        # The axes of arm 1 are those of the base: it begins at its motor and ends at the centre.
        own = np.deg2rad(0.0 if k == 1 else angle)
        draw_thrust(axes, end, float(own), thrust, "", spot(0.0, 0.0))
        draw_name(axes, name, 1.37 * end if k in (1, 4) else 1.27 * end)
    middle = spot(0.0, 0.0)
    draw_arrow(axes, -radius * spot(1, 0) + spot(0.12, 0), spot(-0.52, 0.0), X_AXIS)
    draw_name(axes, "$x_1$", spot(-0.68, 0.2), X_AXIS)
    draw_arrow(axes, middle, spot(0.0, 0.72), Y_AXIS)
    draw_name(axes, "$y$", spot(0.0, 0.88), Y_AXIS)
    draw_arrow(axes, middle, spot(0.72, 0.0), X_AXIS)
    draw_name(axes, "$x$", spot(0.82, 0.16), X_AXIS)
    draw_out_of_page(axes, middle, Z_AXIS)
    draw_name(axes, "$O_2$, $z$", spot(0.0, -0.68), Z_AXIS)
    draw_curved_arrow(axes, arc(middle, 0.95, 0.0, -60.0), CONSTRAINT)
    draw_name(axes, "−60°", spot(1.08, -0.55), CONSTRAINT)
    draw_name(axes, "⊙ thrust towards you, → along the arm's $y$", spot(0.0, -1.78), THRUST)


_WIDTH, _UNIT = 3.75, 0.55  # inches, of the page and of one row
_FILE, _VALUE, _MODULE = "0.93", "#e3eef6", "#fdebdd"
# From top to bottom: what there is, what it is made of, and the folders that make the next of it.
_STAGES = (
    ("robot file", "TOML; from URDF, MJCF or SDF", _FILE, "files, exchange, robot"),
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


def axes_sketch() -> Figure:
    """Draw the axes of world and base, above as they are here, below as autopilots have them."""
    level = np.diag([1.0, -1.0, -1.0])
    swapped = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    sheets: tuple[tuple[str, Array, tuple[str, str, str]], ...] = (
        ("world, here", np.eye(3), ("$X$ east", "$Y$ north", "$Z$ up")),
        ("base, here", np.eye(3), ("$x$ forwards", "$y$ left", "$z$ up")),
        ("world, NED", swapped, ("$X$ north", "$Y$ east", "$Z$ down")),
        ("base, FRD", level, ("$x$ forwards", "$y$ right", "$z$ down")),
    )
    flat = seen_from((30.0, -50.0))[:2]
    with style():
        figure = Figure(figsize=(_WIDTH, 3.1))
        for place, (title, columns, names) in enumerate(sheets, start=1):
            low, high = ((-0.75, 1.4), (-1.1, 1.05))[place > 2]
            axes = sheet(figure, (2, 2, place), (-1.3, 1.3), (low, high))
            draw_name(axes, rf"$\bf{{{title.replace(' ', '~')}}}$", spot(-0.55, high - 0.15))
            for name, along, colour in zip(names, columns.T, (X_AXIS, Y_AXIS, Z_AXIS), strict=True):
                tip = flat @ (0.8 * along)
                draw_arrow(axes, spot(0.0, 0.0), tip, colour)
                draw_name(
                    axes, name, tip + spot(0.12 * np.sign(tip[0]), 0.22 * np.sign(tip[1])), colour
                )
        return figure


STATIC = Path(__file__).parent.parent / "_static"
DRAWINGS = {
    "architecture.svg": architecture_sketch,
    "axes.svg": axes_sketch,
    "conventions.svg": conventions_sketch,
}


def write_drawings(folder: Path) -> None:
    """Write every drawing into a folder."""
    for name, draw in DRAWINGS.items():
        path = folder / name
        with style():
            draw().savefig(path, metadata={"Date": None})
        text = path.read_text(encoding="utf-8")
        path.write_text(re.sub(r'(?<= d=")[^"]*', _rounded, text), encoding="utf-8")


def _rounded(curve: re.Match[str]) -> str:
    """A curve, most of them letters, with one decimal place: the file is half as large."""
    return re.sub(r"(\.\d)\d+", r"\1", curve[0])


if __name__ == "__main__":
    write_drawings(STATIC)
