"""Artists of a robot in 3-D axes, which are put wherever its parts are.

Matplotlib orders 3-D artists by one depth for each, which puts long ones wrong; here `zorder`
decides, from what lies behind to what lies in front.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.patheffects import withStroke
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from gibbs_codegen.figures.appearance import COLOURS, DARK, GOLD
from gibbs_codegen.robot.rotations import Array

_DISC_COLOUR = COLOURS[4]
_ROBOT_LEVEL = 10


@dataclass(frozen=True)
class Shapes:
    """Shapes of the parts of a robot, in world axes in m.

    `spokes` are lines (k, 3) to rotors, `gold` the base arm in gold, without entries where there is
    none, and `arms` lines along the links; `discs` (N, c, 3) are corners of the rotors. `joints`
    are the places on the arms, in order, that are marked as joints; None marks all.
    """

    spokes: Sequence[Array]
    gold: Array
    arms: Sequence[Array]
    discs: Array
    joints: list[int] | None = None

    def outline(self) -> Array:
        """Positions (p, 3) in the world, m, that are spread over all that is drawn."""
        shares = np.linspace(0.0, 1.0, 12)[:, np.newaxis, np.newaxis]
        drawn = (*self.spokes, self.gold, *self.arms)
        lines = [line[:-1] + shares * np.diff(line, axis=0) for line in drawn]
        return np.concatenate([points.reshape(-1, 3) for points in (*lines, self.discs)])


class RobotArtists:
    """Artists of a robot: rotors, spokes to them, the links, and one base arm in gold.

    A robot of higher `rank` covers those of lower rank; `colour` is that of the links; `scale`
    multiplies the widths of lines.
    """

    def __init__(
        self, axes: Any, shapes: Shapes, rank: int = 0, colour: Any = "0.4", scale: float = 1.0
    ) -> None:
        level = _ROBOT_LEVEL + 4 * rank

        def line(above: int, **style: Any) -> Any:
            return axes.plot([], [], [], zorder=level + above, solid_capstyle="round", **style)[0]

        self._discs = Poly3DCollection(
            shapes.discs,
            facecolor=_DISC_COLOUR,
            edgecolor=DARK,
            linewidth=0.4 * scale,
            alpha=0.35,
            zorder=level,
        )
        axes.add_collection3d(self._discs, autolim=False)
        self._spokes = line(1, color=DARK, linewidth=1.1 * scale)
        edge = withStroke(linewidth=2.0 * scale + 1.0, foreground=DARK)
        self._gold_arm = line(2, color=GOLD, linewidth=2.0 * scale, path_effects=[edge])
        self._links = line(
            3,
            color=colour,
            linewidth=1.5 * scale,
            marker="o",
            markersize=2.6 * scale,
            markerfacecolor="white",
            markeredgecolor=DARK,
            markeredgewidth=0.5 * scale,
            markevery=shapes.joints,
        )
        self.show(shapes)

    def name(self, gold: str, links: str) -> None:
        """Give the gold base arm and the links names for a legend, "" for none."""
        for artist, label in ((self._gold_arm, gold), (self._links, links)):
            if label:
                artist.set_label(label)

    def show(self, shapes: Shapes) -> None:
        """Put the artists where the robot is."""
        self._spokes.set_data_3d(*_one_line(shapes.spokes).T)
        self._gold_arm.set_data_3d(*shapes.gold.T)
        self._links.set_data_3d(*_one_line(shapes.arms).T)
        self._discs.set_verts(shapes.discs)


def _one_line(lines: Sequence[Array]) -> Array:
    """Lines as one, with what is no place between them."""
    parts: list[Array] = [np.empty((0, 3))]
    for line in lines:
        parts += [line, np.full((1, 3), np.nan)]
    return np.concatenate(parts[:-1] if len(parts) > 1 else parts)
