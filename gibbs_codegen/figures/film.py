"""What the frames of a film show: the whole flight and, beside it, the rotors from nearby."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from gibbs_codegen.figures.robot_drawing import PathDrawing, RobotDrawing, bounds, rotor_radius
from gibbs_codegen.figures.scene import VIEW, extent, fit, hide_numbers, set_scene
from gibbs_codegen.figures.style import add_legend
from gibbs_codegen.figures.thrust_arrows import LONGEST, ThrustArrows
from gibbs_codegen.simulator.record.flight import Array, Flight

# Height of frames, what heading and legend take of it, and how wide the whole flight may be, in.
_HEIGHT, _HEAD, _WIDTHS = 4.2, 0.5, (2.6, 5.4)
# How far the near view reaches at most, in what rotors and arrows take; and the share of the
# flight's size from which on there is none.
_REACH, _LARGE = 0.95, 0.7
# How much wider lines are in the near view.
_NEAR_SCALE = 1.8


class Film:
    """The scenes of a flight, in a figure of its own, and what moves in them.

    On the left is the whole flight. On the right, if they would be small on the left, are the
    rotors and what is close to them; this view goes with them.
    """

    def __init__(self, flight: Flight) -> None:
        self._flight = flight
        rotors = [flight.points.index(name) for name in flight.rotor_points]
        self._middles = flight.positions[:, rotors].mean(axis=1)
        whole = bounds(flight)
        self.near = _near_radius(flight, self._middles, whole)
        height = _HEIGHT - _HEAD
        wide, high = extent(whole, VIEW)
        left = float(np.clip(height * wide / high, *_WIDTHS))
        width = left + (height if self.near else 0.0)
        # Even in pixels, for mp4.
        self.figure = Figure(figsize=(0.02 * round(50.0 * width), _HEIGHT))
        axes: Any = self.figure.add_subplot(projection="3d")
        step = set_scene(axes, whole)
        hide_numbers(axes)
        self._moving = _artists(axes, flight)
        _, bottom, _, top = add_legend(axes, flight)
        fit(axes, 0.01, bottom, left / width - 0.02, top)
        self.figure.text(0.015, 0.025, f"grid {step:g} m")
        self._clock = self.figure.text(0.985, 0.025, "", fontsize=11, horizontalalignment="right")
        self._near_axes: Any = None
        if self.near:
            self._near_axes = self.figure.add_subplot(projection="3d")
            self._add_near_view(left / width, bottom, 0.99 - left / width, top)

    def show(self, sample: int) -> None:
        """Move everything to where it is at a sample."""
        for artists in self._moving:
            artists.show(sample)
        if self._near_axes is not None and np.all(np.isfinite(self._middles[sample])):
            low, high = self._near_box(sample)
            ends = {f"{name}lim": limits for name, *limits in zip("xyz", low, high, strict=True)}
            self._near_axes.set(**ends)
        self._clock.set_text(f"{self._flight.time[sample]:.2f} s")

    def _add_near_view(self, left: float, bottom: float, width: float, height: float) -> None:
        """Put the near view into a frame, in shares of the figure, that cuts off the rest."""
        axes = self._near_axes
        set_scene(axes, self._near_box(0))
        axes.set_axis_off()
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            axis.set_visible(False)
        self._moving += _artists(axes, self._flight, _NEAR_SCALE)
        fit(axes, left, bottom, width, height)
        frame = Rectangle(
            (left, bottom),
            width,
            height,
            transform=self.figure.transFigure,
            facecolor="none",
            edgecolor="0.7",
        )
        self.figure.add_artist(frame)
        for artist in (*axes.lines, *axes.collections):
            artist.set_clip_path(frame)

    def _near_box(self, sample: int) -> tuple[Array, Array]:
        """The cube that is as large, as it is seen, as a ball of the near view, m."""
        cube = np.ones(3) * 2.0 * self.near / extent((-np.ones(3), np.ones(3)), VIEW).max()
        return self._middles[sample] - cube, self._middles[sample] + cube


def _artists(axes: Any, flight: Flight, scale: float = 1.0) -> list[Any]:
    """Drawings in 3-D axes that `show` a sample; `scale` multiplies the widths of lines."""
    return [
        PathDrawing(axes, flight, desired="0.65"),
        RobotDrawing(axes, flight, scale=scale),
        ThrustArrows(axes, flight, scale),
    ]


def _near_radius(flight: Flight, middles: Array, whole: tuple[Array, Array]) -> float:
    """How far, m, the near view reaches from the rotors' middles (s, 3).

    It is 0 if `whole`, the lowest and highest coordinates of the flight, shows them about as large.
    """
    rotors = [flight.points.index(name) for name in flight.rotor_points]
    distances = np.linalg.norm(flight.positions - middles[:, np.newaxis], axis=2)
    room = rotor_radius(flight) * (1.0 + LONGEST)
    farthest = [np.nanmax(which, initial=0.0) for which in (distances, distances[:, rotors])]
    # An arm that is long beside the base is cut off.
    radius = float(min(farthest[0] + 0.5 * room, _REACH * (farthest[1] + room)))
    return radius if 2.0 * radius < _LARGE * np.max(whole[1] - whole[0]) else 0.0
