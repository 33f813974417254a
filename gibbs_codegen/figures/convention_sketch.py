"""The drawing of the page on conventions: world, base, rotors, rods and links."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gibbs_codegen.figures.frame_sketches import draw_frames
from gibbs_codegen.figures.marks import (
    CONSTRAINT,
    DASHED,
    QUIET,
    THRUST,
    X_AXIS,
    Y_AXIS,
    Z_AXIS,
    draw_arrow,
    draw_bar,
    draw_curved_arrow,
    draw_name,
    draw_out_of_page,
    draw_thrust,
)
from gibbs_codegen.figures.scene import seen_from
from gibbs_codegen.figures.sketches import arc, directions, spot
from gibbs_codegen.figures.style import DARK, style
from gibbs_codegen.robot.placement import Array, turn

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
