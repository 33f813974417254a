"""Drawings of how the chains couple: the paper's Figs. 6 to 9 for any robot.

Each is a Matplotlib `Figure` that belongs to nobody: no window, no pyplot, no backend. The caller
saves it, shows it in a notebook or changes it. Sizes follow from the number of unknowns, so that
symbols keep the size in which they can be read.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, groupby
from math import ceil, sqrt
from typing import Any

from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch, Rectangle
from matplotlib.path import Path

from gibbs_codegen.derivation.hybrid import Filling, filled_entries
from gibbs_codegen.equations.chain_names import hybrid_names
from gibbs_codegen.equations.show import chain_equation
from gibbs_codegen.equations.typeset import Name, accelerated
from gibbs_codegen.figures.appearance import COLOURS, DARK
from gibbs_codegen.figures.marks import short_name
from gibbs_codegen.figures.style import style
from gibbs_codegen.robot.chains import Chain, decompose, first_row
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.file import AnyRobot, as_robot
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import coordinate_of

# Fig. 6, in units of a row: distance between rows and between chains, and where things stand.
_ROW, _CHAIN_GAP, _PADDING = 0.21, 1.0, 0.25
_LEFT_WIDTH, _RIGHT_WIDTH, _BETWEEN = 8.5, 11.5, 12.5
# Letters of a joint's name that are shown.
_LONGEST_NAME = 10

# Figs. 7–9: inches of a cell, and cells that labels and gaps between the arrays take.
_CELL = 0.24
_LABELS, _GAP, _HEAD, _FOOT = 2.6, 1.4, 3.4, 2.7
# Cells that the title of an array takes at least.
_TITLE = 3.5
# As many chains fill a cell side by side; of more, the colours stand in rows.
_MOST_STRIPES = 3
# Points of headings and small symbols, and of Fig. 6's given names.
_SMALL, _GIVEN = 10.0, 8.0


def chain_colour(number: int) -> str:
    """Colour, #rrggbb, of chain 1 … N in every drawing; colours repeat after ten chains."""
    return COLOURS[(number - 1) % len(COLOURS)]


def coupling_figure(robot: AnyRobot) -> Figure:
    """Draw Fig. 6: each chain's unknowns, and which of the hybrid system's unknowns each is.

    The hybrid unknowns are numbered by their rows, from −1. Arrows and boxes have the colours of
    the chains. The three unknowns of the attitude share a line and an arrow, as do the three of the
    position, which every chain has.

    Args:
        robot: The robot, or its file or name.

    Returns:
        The figure.
    """
    robot = as_robot(robot)
    chains = decompose(robot)
    heights = [len(_lines(robot, chain.unknowns)) + _CHAIN_GAP for chain in chains]
    tops = list(accumulate(heights, initial=0.0))
    height = tops[-1] - _CHAIN_GAP
    with style():
        figure, axes = _canvas(
            (-1.6, _LEFT_WIDTH + _BETWEEN + _RIGHT_WIDTH + 0.2), (-2.2, height + 0.6), _ROW
        )
        step = _draw_hybrid_unknowns(axes, robot, height)
        _symbol(axes, _LEFT_WIDTH / 2, -1.0, "unknowns of the chains", size=_SMALL)
        for chain, top in zip(chains, tops, strict=False):
            _draw_chain(axes, robot, chain, top, (step, len(chains)))
    return figure


def _lines(robot: Robot, names: Sequence[str]) -> list[list[int]]:
    """Places of unknowns by lines: attitude, position, and each other one by itself."""
    v = layout_of(robot).v
    parts = {name: part for part in (v.attitude, v.position) for name in v.names[part]}
    runs = groupby(range(len(names)), lambda place: parts.get(names[place], place))
    return [list(run) for _, run in runs]


def _draw_hybrid_unknowns(axes: Axes, robot: Robot, height: float) -> float:
    """Draw the column of hybrid unknowns with their rows; return the distance of lines, rows."""
    left, unknowns = _LEFT_WIDTH + _BETWEEN, Description(robot).hybrid_coordinates
    names = hybrid_names(robot)
    # Names that the robot file gives joints, by those of their coordinates.
    joint_names = {
        coordinate_of(robot, i): short_name(label, _LONGEST_NAME)
        for i, link in enumerate(robot.links, start=1)
        if (label := link.coordinate or link.name)
    }
    lines = _lines(robot, [unknown.name for unknown in unknowns])
    step = height / len(lines)
    _symbol(axes, left + _RIGHT_WIDTH / 2, -1.0, "hybrid unknowns, row $k$", size=_SMALL)
    for number, line in enumerate(lines):
        y, name = (number + 0.5) * step, unknowns[line[0]].name
        _box(axes, (left, y - 0.42 * step), (_RIGHT_WIDTH, 0.84 * step), "0.35", "0.97")
        _symbol(
            axes,
            left + 0.2 * _RIGHT_WIDTH,
            y,
            ", ".join(_row_number(robot, k) for k in line),
            "0.45",
        )
        symbols = ", ".join(_math(accelerated(names[unknowns[place].name])) for place in line)
        at = 0.45 if name in joint_names else 0.65
        _symbol(axes, left + at * _RIGHT_WIDTH, y, symbols, size=min(11.0, 7.5 * step))
        if name in joint_names:
            _symbol(axes, left + 0.77 * _RIGHT_WIDTH, y, joint_names[name], "0.45", _GIVEN)
    return step


def _draw_chain(
    axes: Axes, robot: Robot, chain: Chain, top: float, hybrid: tuple[float, int]
) -> None:
    """Draw the unknowns of a chain from row `top`, and arrows to the hybrid unknowns.

    `hybrid` is the distance between lines of hybrid unknowns, rows, and the number of all chains.
    """
    step, chains = hybrid
    lines = _lines(robot, chain.unknowns)
    colour, length = chain_colour(chain.number), len(lines)
    size = (_LEFT_WIDTH, length + 2 * _PADDING)
    _box(axes, (0.0, top - _PADDING), size, colour, (colour, 0.1))
    text = axes.text(-0.8, top + length / 2, f"chain {chain.number}", rotation=90)
    text.set(ha="center", va="center", color=colour, fontweight="bold")
    # Arrows that come to the same unknown end beside each other.
    aside = 0.6 * ((chain.number - 0.5) / chains - 0.5)
    whole = _lines(robot, [unknown.name for unknown in Description(robot).hybrid_coordinates])
    ends = {place: number for number, line in enumerate(whole) for place in line}
    places = chain_equation(robot, chain.number, 18).places
    for number, line in enumerate(lines):
        y = top + number + 0.5
        symbols = ", ".join(_math(places[item].unknown) for item in line)
        _symbol(axes, _LEFT_WIDTH / 2, y, symbols)
        end = (ends[places[line[0]].row + 1] + 0.5 + aside) * step
        # It leaves and arrives level.
        right, middle = _LEFT_WIDTH + _BETWEEN, _LEFT_WIDTH + 0.5 * _BETWEEN
        points = [(_LEFT_WIDTH, y), (middle, y), (middle, end), (right, end)]
        path = Path(points, [Path.MOVETO, Path.CURVE4, Path.CURVE4, Path.CURVE4])
        arrow = FancyArrowPatch(path=path, arrowstyle="-|>", mutation_scale=5, color=colour)
        arrow.set(linewidth=0.8)
        axes.add_patch(arrow)


def hybrid_pattern_figure(robot: AnyRobot) -> Figure:
    """Draw Figs. 7–9: I_H, R_H and B_H of F_H = B_H u, each entry in the colours of its chains.

    An entry to which several chains add is split among their colours. Rows and columns are labelled
    with the unknowns and the inputs, rows also with their numbers from −1. Thick frames are the
    blocks of the equations of motion I θ̈ + Γ τ′ = R + Ψ F + Φ τ; below them are the constraints.
    The constraint rows and columns of eq. 15 hold 1 and −1. Blank entries are zero in every
    posture.

    Args:
        robot: The robot, or its file or name.

    Returns:
        The figure.
    """
    robot = as_robot(robot)
    filled = filled_entries(robot)
    names_by_unknown = hybrid_names(robot)
    description = Description(robot)
    names = [accelerated(names_by_unknown[c.name]) for c in description.hybrid_coordinates]
    acting = [names_by_unknown[c.name] for c in description.inputs]
    size, width = len(names), len(acting)
    joints = range(size)[description.layout.constrained]
    motions = size - len(joints)
    residual_left = max(size + _GAP, (size - 1) / 2 + _TITLE)
    input_left = max(residual_left + 1 + _GAP, residual_left + (1 - width) / 2 + _TITLE)
    right = input_left + max(width, (width + _TITLE) / 2)
    drives = [(r"\Psi", robot.rotors), (r"\Phi", width - robot.rotors)]
    parts: tuple[tuple[Filling, float, str, list[Name], list[tuple[str, int]]], ...] = (
        (filled.matrix, 0.0, "$I_H$ (Fig. 7)", names, [("I", motions), (r"\Gamma", len(joints))]),
        (filled.residual, residual_left, "$R_H$ (Fig. 8)", [], [("R", 1)]),
        (filled.inputs, input_left, "$B_H$ (Fig. 9)", acting, drives),
    )
    with style():
        figure, axes = _canvas((-_LABELS, right + 0.3), (-_HEAD, size + _FOOT), _CELL)
        for entries, left, title, columns, blocks in parts:
            _draw_filling(axes, entries, left)
            _symbol(axes, left + len(entries[0]) / 2, -_HEAD + 0.5, title, size=_SMALL)
            for column, name in enumerate(columns):
                _symbol(axes, left + column + 0.5, -0.6, _math(name), size=_SMALL)
            for symbol, wide in blocks:
                if wide:
                    frame = Rectangle((left, 0.0), wide, motions, fill=False)
                    frame.set(edgecolor=DARK, linewidth=1.4, zorder=3)
                    axes.add_patch(frame)
                    axes.hlines(-1.3, left + 0.15, left + wide - 0.15, colors=DARK, linewidth=0.8)
                    _symbol(axes, left + wide / 2, -1.9, f"${symbol}$", size=11)
                left += wide
        for row, name in enumerate(names):
            _symbol(axes, -2.1, row + 0.5, _row_number(robot, row), "0.45", _SMALL)
            _symbol(axes, -0.8, row + 0.5, _math(name), size=_SMALL)
        for joint, row in zip(joints, range(motions, size), strict=True):
            _symbol(axes, row + 0.5, joint + 0.5, "−1", "white", 9)
            _symbol(axes, joint + 0.5, row + 0.5, "1", "white", 9)
        in_row = max(int((input_left + width) // 4.5), 1)
        for place, chain in enumerate(decompose(robot)):
            x, y = 4.5 * (place % in_row), size + 0.7 + 1.2 * (place // in_row)
            colour = chain_colour(chain.number)
            _box(axes, (x, y), (0.7, 0.7), colour, colour)
            text = f"chain {chain.number}"
            axes.text(x + 1.0, y + 0.35, text, va="center", fontsize=_SMALL, color=DARK)
    return figure


def _row_number(robot: Robot, place: int) -> str:
    """The number of the hybrid row at a place."""
    return f"{first_row(robot) + place}".replace("-", "−")


def _math(symbol: Name) -> str:
    """A symbol in Matplotlib's mathematics, which sets a prime apart unless it is a letter."""
    return f"${symbol.latex}$".replace("'", r"\prime")


def _canvas(x: tuple[float, float], y: tuple[float, float], unit: float) -> tuple[Figure, Axes]:
    """Axes between such x and y, downwards, that fill a figure, with `unit` inches to a unit."""
    figure = Figure(figsize=((x[1] - x[0]) * unit, (y[1] - y[0]) * unit))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=x, ylim=y[::-1])
    axes.set_axis_off()
    return figure, axes


def _symbol(
    axes: Axes, x: float, y: float, text: str, colour: str = DARK, size: float = 9.5
) -> None:
    """Write a text, its size in points, with its middle at a place."""
    axes.text(x, y, text, ha="center", va="center", color=colour, fontsize=size)


def _box(axes: Axes, place: Sequence[float], size: Sequence[float], edge: str, face: Any) -> None:
    """Draw a box with round corners, from its left upper one."""
    (left, top), (width, height) = place, size
    box = FancyBboxPatch((left, top), width, height, boxstyle="round,pad=0,rounding_size=0.3")
    box.set(edgecolor=edge, facecolor=face, linewidth=0.7)
    axes.add_patch(box)


def _draw_filling(axes: Axes, entries: Filling, left: float) -> None:
    """Draw the cells of one array on a grid, split into tiles, one for each chain that adds."""
    cells, colours = [], []
    for y, row in enumerate(entries):
        for x, chains in enumerate(row):
            # Side by side or, where they would be too thin, in rows.
            in_row = len(chains) if len(chains) <= _MOST_STRIPES else ceil(sqrt(len(chains)))
            stripes = [chains[i : i + in_row] for i in range(0, len(chains), in_row or 1)]
            for down, stripe in enumerate(stripes):
                for along, number in enumerate(stripe):
                    near, far = (left + x + (along + k) / len(stripe) for k in (0, 1))
                    top, low = (y + (down + k) / len(stripes) for k in (0, 1))
                    cells.append([(near, top), (far, top), (far, low), (near, low)])
                    colours.append(chain_colour(number))
    axes.add_collection(PolyCollection(cells, facecolors=colours, edgecolors="none"))
    height, width = len(entries), len(entries[0])
    axes.hlines(range(height + 1), left, left + width, colors="0.75", linewidth=0.4)
    columns = [left + x for x in range(width + 1)]
    axes.vlines(columns, 0, height, colors="0.75", linewidth=0.4)
