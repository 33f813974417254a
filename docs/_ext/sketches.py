"""Drawings for teaching: a link, why eq. 4 holds, a pendulum.

They are of no robot in particular, and say what the letters of the notebooks stand for.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

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
    draw_joint,
    draw_name,
)
from gibbs_codegen.figures.style import FULL, style
from gibbs_codegen.robot.rotations import Array, turn

PLACE, _MOTION = COLOURS[1], COLOURS[6]
# Of lines without a body.
DASHED = (0, (4, 3))


def link_sketch() -> Figure:
    """Draw one link with its joint, its frame and one of its particles: r, ρ and p = r + ρ."""
    with style():
        figure = Figure(figsize=(FULL, 2.9))
        axes = sheet(figure, (1, 1, 1), (-0.45, 6.75), (-0.4, 2.5))
        origin, joint = np.zeros(2), np.array([2.7, 0.35])
        along, across = directions(26.0)
        particle = joint + 2.5 * along + 0.2 * across
        world(axes, origin, 0.95, ("$X_0$", "$Z_0$"))
        draw_bar(axes, joint - 0.12 * along, joint + 3.6 * along, "0.93", 26.0)
        for step, colour, name in ((along, X_AXIS, "$x$"), (across, Y_AXIS, "$y$")):
            draw_arrow(axes, joint, joint + 1.05 * step, colour)
            draw_name(axes, name, joint + 1.22 * step, colour)
        draw_out_of_page(axes, joint, Z_AXIS)
        draw_name(axes, "$z$", joint - 0.24 * across, Z_AXIS)
        draw_name(axes, "joint $o$", joint + spot(0.12, -0.5))
        draw_arrow(axes, origin, joint, DARK)
        draw_name(axes, r"$\mathbf{r}$", 0.55 * joint + spot(0.07, -0.2))
        draw_arrow(axes, joint, particle, PLACE)
        draw_name(axes, r"$\mathbf{\rho}$", 0.3 * joint + 0.7 * particle + 0.17 * across, PLACE)
        draw_arrow(axes, origin, particle, THRUST, DASHED)
        middle = 0.36 * particle
        draw_name(axes, r"$\mathbf{p} = \mathbf{r} + \mathbf{\rho}$", middle + spot(-0.3, 0.3))
        axes.plot(*particle, "s", ms=6, color=DARK, zorder=8)
        draw_name(axes, r"particle, $\mathrm{d}m$", particle + spot(0.1, 0.3))
        turning = joint + 3.1 * along
        draw_curved_arrow(axes, arc(turning, 0.62, -40.0, 62.0), _MOTION)
        draw_name(axes, r"$\mathbf{\omega},\ \dot{\mathbf{\omega}}$", turning + spot(0.92, 0.3))
        return figure


def tangent_sketch() -> Figure:
    """Draw why ∂p̈/∂θ̈ = ∂p/∂θ: left a particle on a rod that turns and its path, right its p̈."""
    with style():
        figure = Figure(figsize=(FULL, 3.0))
        left = sheet(figure, (1, 2, 1), (-0.5, 3.0), (-0.55, 2.45))
        angle, reach = 32.0, 1.5
        along, across = directions(angle)
        pivot, particle = np.zeros(2), reach * along
        left.plot(*arc(pivot, reach, -8.0, 78.0).T, color=QUIET, lw=1.0, ls=DASHED)
        left.plot([0.0, 1.3], [0.0, 0.0], color=QUIET, lw=0.8, ls=DASHED)
        draw_bar(left, pivot, particle, "0.85", 5.0)
        draw_curved_arrow(left, arc(pivot, 0.9, 0.0, angle), X_AXIS)
        draw_name(left, r"$\theta$", 1.08 * directions(angle / 2.0)[0], X_AXIS)
        tangent = reach * across  # per radian, to scale
        draw_arrow(left, particle, particle + tangent, Y_AXIS)
        place = particle + tangent + spot(0.5, 0.1)
        draw_name(left, r"$\partial\mathbf{p}/\partial\theta$", place, Y_AXIS)
        draw_joint(left, pivot)
        draw_name(left, "pivot", spot(-0.05, -0.25))
        draw_name(left, "path", spot(1.65, -0.4), QUIET)
        left.plot(*particle, "s", ms=6, color=DARK, zorder=8)
        draw_name(left, r"$\mathbf{p}(\theta)$", particle + spot(0.38, -0.05))
        right = sheet(figure, (1, 2, 2), (-2.55, 1.9), (-1.65, 1.85))
        _accelerations(right, along, across)
        return figure


def _accelerations(axes: Axes, along: Array, across: Array) -> None:
    """Draw p̈ of one particle, at the origin of the axes, for three values of θ̈.

    `along` and `across` are unit vectors (2) of the rod and of the tangent.
    """
    at, inward = np.zeros(2), -1.1 * along
    ends = [inward + 0.8 * k * across for k in (0, 1, 2)]
    line = np.array([ends[0] - 0.35 * across, ends[-1] + 0.45 * across])
    axes.plot(*line.T, color=Y_AXIS, lw=1.0, ls=DASHED, zorder=1)
    for k, end in enumerate(ends):
        draw_arrow(axes, at, end, THRUST if k else DARK)
        draw_name(axes, rf"$\ddot\theta = {k}$", end + spot(-0.42, -0.12))
    axes.plot(0.0, 0.0, "s", ms=6, color=DARK, zorder=8)
    draw_name(
        axes, r"$\ddot{\mathbf{p}}$ of the particle, at one speed $\dot\theta$", spot(0.62, 0.35)
    )
    draw_name(axes, r"one unit of $\ddot\theta$ moves the tip", spot(0.6, -1.0), Y_AXIS)
    draw_name(
        axes,
        r"by $\partial\mathbf{p}/\partial\theta$, for every $\dot\theta$",
        spot(0.6, -1.3),
        Y_AXIS,
    )


def pendulum_sketch() -> Figure:
    """Draw a rod with the accelerations of its particle, and a double pendulum's angles."""
    with style():
        figure = Figure(figsize=(FULL, 2.75))
        _draw_rod(sheet(figure, (1, 2, 1), (-0.8, 3.3), (-2.4, 0.62)))
        _draw_double(sheet(figure, (1, 2, 2), (-0.8, 3.3), (-2.4, 0.62)))
        return figure


def _draw_rod(axes: Axes) -> None:
    angle = -38.0
    along, across = directions(angle)
    particle, tip = 2.05 * along, 2.9 * along
    _pivot(axes)
    draw_bar(axes, np.zeros(2), tip, "0.85", 6.0)
    draw_curved_arrow(axes, arc(np.zeros(2), 0.95, 0.0, angle), X_AXIS)
    draw_name(axes, r"$\theta$", 1.15 * directions(angle / 2.0)[0], X_AXIS)
    for step, name, colour, aside in (
        (0.85 * across, r"$s\ddot\theta$", THRUST, spot(-0.05, 0.2)),
        (-0.8 * along, r"$s\dot\theta^2$", THRUST, spot(-0.2, -0.22)),
        (spot(0.0, 0.78), "$g$", Z_AXIS, spot(-0.16, 0.0)),
    ):
        draw_arrow(axes, particle, particle + step, colour)
        draw_name(axes, name, particle + step + aside, colour)
    axes.plot(*particle, "s", ms=6, color=DARK, zorder=8)
    draw_name(axes, r"$\mu\,\mathrm{d}s$ at $s$", particle + spot(-0.6, -0.25))
    draw_name(axes, "$l$", tip + spot(0.12, -0.14))
    draw_name(axes, "here θ = −38°", spot(0.3, -2.1), QUIET)
    _pivot_joint(axes)


def _draw_double(axes: Axes) -> None:
    first, second = -62.0, 40.0
    along = directions(first)[0]
    outer = directions(first + second)[0]
    elbow = 1.45 * along
    _pivot(axes)
    end = elbow + 1.0 * along
    axes.plot(*np.array([elbow, end]).T, color=QUIET, lw=0.9, ls=DASHED)
    draw_bar(axes, np.zeros(2), elbow, "0.85", 6.0)
    draw_bar(axes, elbow, elbow + 1.45 * outer, "0.85", 6.0)
    draw_curved_arrow(axes, arc(np.zeros(2), 0.75, 0.0, first), X_AXIS)
    draw_name(axes, r"$\theta_1$", 0.98 * directions(first / 2.0)[0], X_AXIS)
    draw_curved_arrow(axes, arc(elbow, 0.75, first, first + second), X_AXIS)
    draw_name(axes, r"$\theta_2$", elbow + 0.98 * directions(first + second / 2.0)[0], X_AXIS)
    draw_name(axes, "rod 1", 0.5 * elbow + spot(-0.42, -0.05))
    draw_name(axes, "rod 2", elbow + 0.9 * outer + spot(0.3, 0.25))
    draw_name(axes, "here θ₁ = −62°, θ₂ = +40°", spot(-0.05, -2.1), QUIET)
    draw_joint(axes, elbow)
    _pivot_joint(axes)


def _pivot(axes: Axes) -> None:
    """Draw the horizontal from which angles count, through the pivot at the origin."""
    axes.plot([0.0, 2.2], [0.0, 0.0], color=QUIET, lw=0.9, ls=DASHED)
    draw_name(axes, "horizontal", spot(2.65, 0.0), QUIET)
    axes.plot([-0.4, 0.4], [0.32, 0.32], color=DARK, lw=1.4)
    axes.plot([-0.2, 0.0, 0.2], [0.32, 0.0, 0.32], color=DARK, lw=1.0)


def _pivot_joint(axes: Axes) -> None:
    draw_joint(axes, np.zeros(2))
    draw_name(axes, "pivot", spot(-0.45, -0.05))


def sheet(
    figure: Figure,
    place: tuple[int, int, int],
    across: tuple[float, float],
    up: tuple[float, float],
) -> Axes:
    """Add axes without any frame, in which one unit is as long upwards as to the side.

    `place` are rows and columns of the figure's axes, and the number of these; `across` and `up`
    have the lowest and highest coordinate each way.
    """
    rows, columns, number = place
    row, column = divmod(number - 1, columns)
    size = (1.0 / columns, 1.0 / rows)
    axes = figure.add_axes((column * size[0], 1.0 - (row + 1) * size[1], *size))
    axes.set_axis_off()
    axes.set(xlim=across, ylim=up, aspect="equal")
    return axes


def spot(x: float, y: float) -> Array:
    """A place or a step (2) in the plane of a drawing."""
    return np.array([x, y])


def directions(angle: float) -> tuple[Array, Array]:
    """Unit vectors (2) along and across a link at an angle, degrees, the latter to the left."""
    c, s = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
    return np.array([c, s]), np.array([-s, c])


def arc(centre: Array, radius: float, start: float, stop: float) -> Array:
    """Points (k, 2) of an arc, whose ends are at angles from the horizontal in degrees."""
    angles = np.deg2rad(np.linspace(start, stop, 40))
    points: Array = centre + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return points


def world(axes: Axes, origin: Array, size: float, names: tuple[str, str]) -> None:
    """Draw two axes of the world, named to the right and upwards."""
    for step, name in zip(np.eye(2), names, strict=True):
        draw_arrow(axes, origin, origin + size * step, QUIET)
        draw_name(axes, name, origin + (size + 0.2) * step, QUIET)


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


def draw_curved_arrow(axes: Axes, points: Array, colour: str) -> None:
    """Draw an arrow along a curve (k, 2)."""
    axes.plot(*points[:-3].T, color=colour, lw=1.3, zorder=6)
    draw_arrow(axes, points[-4], points[-1], colour)


def draw_out_of_page(axes: Axes, place: Array, colour: str) -> None:
    """Draw an axis that points at the reader."""
    axes.plot(*place, "o", ms=9, mfc="white", mec=colour, mew=1.3, zorder=8)
    axes.plot(*place, ".", ms=5, color=colour, zorder=9)
