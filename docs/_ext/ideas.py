"""Drawings of ideas in the notebooks: what a term, a torque or a loop is, on one page each."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Polygon
from sketches import DASHED, arc, directions, draw_curved_arrow, sheet, spot

from gibbs_codegen.figures.appearance import COLOURS, DARK
from gibbs_codegen.figures.marks import (
    CONSTRAINT,
    QUIET,
    THRUST,
    Y_AXIS,
    Z_AXIS,
    draw_arrow,
    draw_bar,
    draw_joint,
    draw_name,
)
from gibbs_codegen.figures.style import FULL, style
from gibbs_codegen.robot.rotations import Array


def lift_sketch() -> Figure:
    """Draw a rod on the ground, with its weight, and in a lift far from any planet."""
    with style():
        figure = Figure(figsize=(FULL, 2.6))
        for place, words in (
            (1, "on the ground: weight pulls"),
            (2, "in a lift: its joint goes up with $g$"),
        ):
            axes = sheet(figure, (1, 2, place), (-2.0, 2.0), (-1.5, 1.25))
            along = directions(-35.0)[0]
            pivot = spot(-0.9, 0.75)
            centre = pivot + 0.85 * along
            draw_bar(axes, pivot, pivot + 1.7 * along, "0.85", 6.0)
            draw_joint(axes, pivot)
            axes.plot(*centre, "o", ms=6, mfc="white", mec=DARK, zorder=8)
            if place == 1:
                axes.plot([-1.8, 1.8], [-1.0, -1.0], color=QUIET, lw=2.0)
                draw_arrow(axes, centre, centre + spot(0.0, -0.8), THRUST)
                draw_name(axes, "$m g$", centre + spot(0.35, -0.7), THRUST)
            else:
                corners = np.array([(-1.5, -1.0), (1.5, -1.0), (1.5, 1.1), (-1.5, 1.1)])
                axes.add_patch(Polygon(corners, fill=False, edgecolor=QUIET, lw=2.0))
                draw_arrow(axes, spot(1.75, -0.3), spot(1.75, 0.7), Z_AXIS)
                draw_name(axes, "$g$", spot(1.9, 0.2), Z_AXIS)
                draw_arrow(axes, pivot, pivot + spot(0.0, 0.32), Z_AXIS)
            draw_name(axes, words, spot(0.0, -1.3))
        return figure


def books_sketch(masses: dict[int, tuple[int, ...]], total: float) -> Figure:
    """Draw the arms whose mass each chain counts, by its number, and their sum, kg.

    `masses` has the arms of each chain; those beyond 6 are the manipulator.
    """
    with style():
        figure = Figure(figsize=(FULL, 1.75))
        panels = [*masses.values(), tuple(arm for arms in masses.values() for arm in arms)]
        for place, arms in enumerate(panels, start=1):
            axes = sheet(figure, (1, len(panels), place), (-1.35, 1.35), (-1.9, 1.6))
            for arm in range(1, 7):
                out = directions(-180.0 + 60.0 * (arm - 1))[0]
                _draw_arm(axes, np.zeros(2), out, arm in arms)
            if any(arm > 6 for arm in arms):
                draw_bar(axes, spot(0.0, 0.0), spot(0.35, -1.2), COLOURS[5], 5.0)
            whole = place == len(panels)
            draw_name(axes, f"{total:g} kg" if whole else f"chain {place}", spot(0.0, 1.4))
            sign = "" if whole else "=" if place == len(panels) - 1 else "+"
            draw_name(axes, sign, spot(1.3, 0.0))
        return figure


def _draw_arm(axes: Axes, start: Array, end: Array, solid: bool) -> None:
    draw_bar(axes, start, end, DARK if solid else "white", 2.6)


def work_sketch() -> Figure:
    """Draw from above what one newton of motor 6 contributes to the row of the first angle."""
    with style():
        figure = Figure(figsize=(FULL, 3.6))
        axes = sheet(figure, (1, 1, 1), (-0.8, 5.2), (-0.5, 3.15))
        first, middle = spot(0.0, 0.0), spot(2.0, 0.0)
        along, across = directions(120.0)
        seat = middle + 2.0 * along
        draw_bar(axes, first, middle, "white", 7.0)
        draw_bar(axes, middle, seat, "0.8", 7.0)
        draw_arrow(axes, first, seat, DARK, DASHED)
        draw_name(axes, "$r - o$", 0.55 * seat + spot(-0.4, 0.0))
        tangent = 0.3 * np.array([-seat[1], seat[0]])
        draw_arrow(axes, seat, seat + tangent, Y_AXIS)
        draw_name(axes, r"$e\times(r - o)$", seat + tangent + spot(0.0, 0.2), Y_AXIS)
        draw_arrow(axes, seat, seat + 0.9 * across, THRUST)
        draw_name(axes, "1 N of motor 6", seat + 0.9 * across + spot(-0.75, -0.05), THRUST)
        draw_curved_arrow(axes, arc(first, 0.7, -25.0, 30.0), CONSTRAINT)
        draw_name(axes, r"$\delta\theta_1$", spot(0.95, -0.3), CONSTRAINT)
        draw_name(axes, "$O_1$", spot(-0.3, -0.2))
        draw_name(axes, "$O_2$", middle + spot(0.1, -0.27))
        words = "$\\Psi$ of this row:\none newton times the part\nof $e\\times(r-o)$ along it"
        draw_name(axes, words, spot(4.25, 0.6))
        return figure


def missing_force_sketch() -> Figure:
    """Draw base arm 4 in hover from the side, with its weight and what its chain lacks."""
    with style():
        figure = Figure(figsize=(FULL, 2.3))
        axes = sheet(figure, (1, 1, 1), (-2.6, 4.4), (-1.35, 1.2))
        root, end = spot(0.0, 0.0), spot(2.0, 0.0)
        draw_bar(axes, spot(-2.0, 0.0), root, "white", 7.0)
        draw_bar(axes, root, end, COLOURS[2], 7.0)
        draw_arrow(axes, spot(1.0, 0.0), spot(1.0, -0.9), THRUST)
        draw_name(axes, "weight of arm 4, 4.905 N: in chain 3", spot(2.6, -1.1), THRUST)
        draw_arrow(axes, root, spot(0.0, 0.9), CONSTRAINT, DASHED)
        draw_curved_arrow(axes, arc(root, 0.45, -60.0, 60.0), CONSTRAINT)
        draw_name(
            axes,
            "what the rest does to it at $O_2$:\nin no chain, and so missing in all",
            spot(2.1, 0.75),
            CONSTRAINT,
        )
        draw_name(axes, "arm 1, without mass here", spot(-1.3, -0.35))
        return figure


def held_joint_sketch() -> Figure:
    """Draw from above how motor 6 pushes, and the torque that keeps its arm from turning."""
    with style():
        figure = Figure(figsize=(FULL, 2.9))
        axes = sheet(figure, (1, 1, 1), (-3.2, 3.8), (-0.8, 2.1))
        along, across = directions(120.0)
        seat = 1.9 * along
        draw_bar(axes, spot(-1.9, 0.0), spot(0.0, 0.0), "0.93", 7.0)
        draw_bar(axes, spot(0.0, 0.0), seat, COLOURS[4], 7.0)
        draw_arrow(axes, seat, seat + 1.1 * across, THRUST)
        draw_name(axes, "$F_6 = 3$ N", seat + 1.1 * across + spot(-0.2, -0.2), THRUST)
        draw_curved_arrow(axes, arc(spot(0.0, 0.0), 0.75, 40.0, -80.0), CONSTRAINT)
        draw_name(
            axes, r"$\tau_6' = -3\,\mathrm{N}\cdot0.5\,\mathrm{m}$", spot(2.1, 0.1), CONSTRAINT
        )
        draw_name(axes, "0.5 m", 0.5 * seat + spot(0.45, 0.1))
        draw_name(axes, "$O_2$", spot(-0.15, -0.35))
        draw_name(axes, "arm 1", spot(-1.2, -0.3))
        return figure


def wheel_sketch() -> Figure:
    """Draw a piece of a bent arm that turns: the force that it needs, and the moment of that."""
    with style():
        figure = Figure(figsize=(FULL, 2.9))
        axes = sheet(figure, (1, 1, 1), (-2.6, 4.0), (-2.2, 0.75))
        draw_bar(axes, spot(-0.7, 0.0), spot(0.7, 0.0), "0.93", 6.0)
        axes.plot([0.0, 0.0], [-2.1, 0.6], color=QUIET, lw=0.9, ls=DASHED)
        elbow = spot(1.5, -1.3)
        draw_bar(axes, spot(0.0, 0.0), elbow, "0.85", 5.0)
        draw_bar(axes, elbow, spot(0.25, -2.0), "0.85", 5.0)
        axes.plot(*elbow, "s", ms=7, color=DARK, zorder=8)
        draw_arrow(axes, elbow, elbow - spot(0.95, 0.0), THRUST)
        draw_name(axes, r"needs $\omega^2\rho\,\mathrm{d}m$", spot(2.65, -1.3), THRUST)
        draw_arrow(axes, spot(-1.0, -0.05), spot(-1.0, -1.3), DARK)
        draw_name(axes, "$h$", spot(-1.2, -0.7))
        axes.plot([-1.1, 1.4], [-1.3, -1.3], color=QUIET, lw=0.8, ls=DASHED)
        draw_curved_arrow(axes, arc(spot(0.0, 0.0), 1.15, 10.0, -30.0), CONSTRAINT)
        draw_name(
            axes,
            r"moment $h\,\omega^2\rho\,\mathrm{d}m$," "\nfrom the vertical motors",
            spot(2.6, -0.35),
            CONSTRAINT,
        )
        draw_name(axes, "axis 7", spot(-0.42, 0.45), QUIET)
        draw_curved_arrow(axes, arc(spot(0.0, 0.5), 0.22, 200.0, 480.0), Z_AXIS)
        draw_name(axes, r"$\omega$", spot(0.42, 0.5), Z_AXIS)
        return figure


def loop_sketch() -> Figure:
    """Draw the control loop of computed torque as blocks, with all that makes its inputs late."""
    blocks = {
        "error\n$e,\\ \\dot e$": (0.0, 1.3),
        "$a_c = \\ddot q_d$\n$+\\,k_d\\dot e + k_p e$": (1.9, 1.3),
        "$f = M a_c - R$\n$B u = f$": (3.9, 1.3),
        "held for $h$,\ndelay $T$": (5.8, 1.3),
        "motors,\nlag $T_m$": (5.8, 0.0),
        "machine\n$M a = R + B u$": (3.9, 0.0),
        "sensors:\nnoise, delay": (1.6, 0.0),
    }
    with style():
        figure = Figure(figsize=(FULL, 2.5))
        axes = sheet(figure, (1, 1, 1), (-1.6, 6.8), (-0.6, 2.35))
        places = [np.array(place) for place in blocks.values()]
        for words, place in zip(blocks, places, strict=True):
            own = "machine" in words or "motors" in words
            box = FancyBboxPatch(
                tuple(place - (0.72, 0.36)),
                1.44,
                0.72,
                boxstyle="round,pad=0,rounding_size=0.1",
                facecolor="0.93" if own else "#e3eef6",
                edgecolor=DARK,
                lw=0.8,
            )
            axes.add_patch(box)
            draw_name(axes, words, place)
        for one, other in pairwise(places):
            step = (other - one) / np.hypot(*(other - one))
            room = 0.75 if abs(step[0]) > 0.5 else 0.4
            draw_arrow(axes, one + room * step, other - room * step, DARK)
        axes.plot([0.85, 0.0], [0.0, 0.0], color=DARK, lw=1.3)
        draw_arrow(axes, spot(0.0, 0.0), spot(0.0, 0.9), DARK)
        draw_name(axes, "$q, v$", spot(-0.25, 0.35))
        draw_arrow(axes, spot(0.0, 2.15), spot(0.0, 1.7), Y_AXIS)
        draw_name(axes, "desired $q_d, v_d, a_d$", spot(1.0, 2.1), Y_AXIS)
        return figure


IDEAS = (
    lift_sketch,
    work_sketch,
    missing_force_sketch,
    held_joint_sketch,
    wheel_sketch,
    loop_sketch,
)
