"""Drawings for teaching: the frames of neighbouring links, and a base chain seen from above."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gibbs_codegen.figures.marks import (
    CONSTRAINT,
    DASHED,
    QUIET,
    X_AXIS,
    Y_AXIS,
    Z_AXIS,
    draw_arrow,
    draw_bar,
    draw_curved_arrow,
    draw_joint,
    draw_name,
    draw_out_of_page,
)
from gibbs_codegen.figures.scene import seen_from
from gibbs_codegen.figures.sketches import PLACE, arc, directions, sheet, spot, world
from gibbs_codegen.figures.style import DARK, FULL, style
from gibbs_codegen.robot.placement import Array, turn


def frames_sketch() -> Figure:
    """Draw the frames of two links that follow each other, with α, a, θ and d between them."""
    with style():
        figure = Figure(figsize=(FULL, 3.7))
        axes = sheet(figure, (1, 1, 1), (-1.3, 5.5), (-0.75, 2.75))
        draw_frames(axes)
        return figure


def draw_frames(axes: Axes) -> None:
    """Draw the frames of two links on axes from (-1, -0.7) to (5.3, 2.7)."""
    flat = seen_from((20.0, -68.0))[:2]
    twist, angle, step, slide = 34.0, 65.0, 2.6, 1.9
    tilted = turn(0, np.deg2rad(twist))
    final = tilted @ turn(2, np.deg2rad(angle))
    foot = np.array([step, 0.0, 0.0])
    origin = foot + slide * tilted[:, 2]
    draw_bar(axes, flat @ np.zeros(3), flat @ foot, "0.88", 9.0)
    draw_bar(axes, flat @ origin, flat @ (origin + 2.3 * final[:, 0]), "0.88", 9.0)
    draw_frame(axes, flat, np.zeros(3), np.eye(3), "i-1")
    draw_frame(axes, flat, origin, final, "i")
    axis = np.array([foot - 0.35 * tilted[:, 2], origin])
    axes.plot(*(axis @ flat.T).T, color=Z_AXIS, lw=1.0, ls=DASHED, zorder=4)
    for before, after, at, size, normal, name in (
        (np.eye(3)[2], tilted[:, 2], foot, 0.85, np.eye(3)[0], r"$\alpha_i$"),
        (tilted[:, 0], final[:, 0], origin, 0.95, tilted[:, 2], r"$\theta_i$"),
    ):
        _angle(axes, flat, (at, before, after, normal), size, name)
    middle = flat @ ((foot + origin) / 2.0)
    draw_name(axes, "$a_i$", flat @ (0.62 * foot) + spot(0.0, -0.26), PLACE)
    draw_name(axes, "$d_i$", middle + spot(-0.3, 0.0), PLACE)
    draw_name(axes, "link $i-1$", flat @ (0.3 * foot) + spot(0.0, -0.3))
    draw_name(axes, "link $i$", flat @ (origin + 1.9 * final[:, 0]) + spot(0.25, -0.33))


def draw_frame(axes: Axes, flat: Array, origin: Array, turned: Array, index: str) -> None:
    """Draw three axes of a frame, in columns (3, 3), with their names, all of one index.

    `flat` (2, 3) are unit vectors of the page.
    """
    at = flat @ origin
    for letter, along, colour in zip("xyz", turned.T, (X_AXIS, Y_AXIS, Z_AXIS), strict=True):
        end = flat @ (origin + 1.25 * along)
        draw_arrow(axes, at, end, colour)
        away = (end - at) / np.hypot(*(end - at))
        aside = spot(-away[1], away[0]) if letter == "x" else away
        draw_name(axes, f"${letter}_{{{index}}}$", end + 0.24 * aside, colour)
    draw_joint(axes, at)
    draw_name(axes, f"$o_{{{index}}}$", at + spot(-0.24, -0.12))


def _angle(
    axes: Axes, flat: Array, turning: tuple[Array, Array, Array, Array], size: float, name: str
) -> None:
    """Draw an angle between two directions in space as an arc of radius `size` with its name.

    `flat` (2, 3) are unit vectors of the page; `turning` is the apex, the two unit vectors, and the
    axis about which one becomes the other.
    """
    apex, before, after, normal = turning
    whole = np.arctan2(normal @ np.cross(before, after), before @ after)
    angles = np.linspace(0.0, whole, 30)[:, np.newaxis]
    arc = apex + size * (np.cos(angles) * before + np.sin(angles) * np.cross(normal, before))
    start = np.array([apex, apex + 1.15 * size * before])
    axes.plot(*(start @ flat.T).T, color=QUIET, lw=0.9, ls=DASHED)
    draw_curved_arrow(axes, arc @ flat.T, CONSTRAINT)
    middle = flat @ (apex + 1.3 * (arc[len(arc) // 2] - apex))
    draw_name(axes, name, middle)


def chain_sketch() -> Figure:
    """Draw chain 2 of the paper's robot, seen from above, with the letters of its derivation."""
    with style():
        figure = Figure(figsize=(FULL, 3.6))
        axes = sheet(figure, (1, 1, 1), (-0.5, 7.0), (-0.5, 3.25))
        heading, fixed, length = 24.0, -60.0, 2.4
        (x_1, y_1), (x_3, y_3) = directions(heading), directions(heading + fixed)
        first = np.array([1.9, 0.95])
        centre = first + length * x_1
        end = centre + length * x_3
        world(axes, np.zeros(2), 1.0, ("$X_0$", "$Y_0$"))
        draw_arrow(axes, np.zeros(2), first, DARK)
        draw_name(axes, "$(x, y, z)$", 0.55 * first + spot(0.25, -0.28))
        axes.plot(*np.array([first, first + spot(1.5, 0.0)]).T, color=QUIET, lw=0.9, ls=DASHED)
        axes.plot(*np.array([centre, centre + 1.5 * x_1]).T, color=QUIET, lw=0.9, ls=DASHED)
        draw_bar(axes, first, centre, "white", 9.0)
        draw_bar(axes, centre, end, "0.8", 9.0)
        for at, along, across, index in ((first, x_1, y_1, 3), (centre, x_3, y_3, 4)):
            for step, letter, colour in ((along, "x", X_AXIS), (across, "y", Y_AXIS)):
                draw_arrow(axes, at, at + 0.95 * step, colour)
                name = f"${letter}_{{2,{index}}}$"
                # Beside its link, or at the end of the arrow.
                place = at + (step - 0.23 * across if letter == "x" else 1.17 * step)
                draw_name(axes, name, place, colour)
            draw_out_of_page(axes, at, Z_AXIS)
        _angles_of_chain(axes, (first, centre), heading, fixed)
        mass_centre = (centre + end) / 2.0
        axes.plot(*mass_centre, "o", ms=7, mfc="white", mec=DARK, zorder=8)
        for text, place in (
            ("$O_1 = o_{2,3}$", first + spot(-0.15, -0.32)),
            ("$O_2 = o_{2,4}$", centre + spot(-0.1, 0.36)),
            ("$o_{2,5}$, motor 3", end + spot(0.1, -0.27)),
            ("arm 1, length $l_1$,\nno mass here", first + 0.62 * length * x_1 + spot(-0.55, 0.62)),
            ("arm 3", centre + 0.8 * length * x_3 + spot(-0.48, -0.1)),
            ("centre of mass,\nat $b/B_0$", mass_centre + spot(0.98, 0.15)),
        ):
            draw_name(axes, text, place)
        return figure


def _angles_of_chain(axes: Axes, joints: tuple[Array, Array], heading: float, fixed: float) -> None:
    """Draw the two angles, in degrees, of the chain that are seen from above.

    `joints` are the places (2) of joints 3 and 4.
    """
    first, centre = joints
    draw_curved_arrow(axes, arc(first, 1.3, 0.0, heading), X_AXIS)
    name = first + 1.55 * directions(heading / 2.0)[0]
    draw_name(axes, r"$\theta_{2,3}$", name, X_AXIS)
    draw_curved_arrow(axes, arc(centre, 1.2, heading, heading + fixed), CONSTRAINT)
    name = centre + 1.75 * directions(heading + 0.35 * fixed)[0]
    draw_name(axes, r"$\theta_{2,4} = -60°$", name, CONSTRAINT)
