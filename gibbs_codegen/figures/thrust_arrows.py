"""Thrusts of a flight as arrows from the rotors."""

from __future__ import annotations

from typing import Any

import numpy as np

from gibbs_codegen.figures.robot_drawing import rotor_radius, thrust_directions
from gibbs_codegen.figures.scene import VIEW, seen_from
from gibbs_codegen.figures.style import COLOURS
from gibbs_codegen.simulator.record.flight import Array, Flight

# Above robots.
_LEVEL = 50
# Of all thrusts, the share that arrows are not too short for: peaks would make the others dots.
_USUAL = 0.95
# The longest arrow, in radii of a rotor; length and half the width of a head, in its length.
LONGEST, _HEAD = 4.0, np.array([0.15, 0.06])


class ThrustArrows:
    """Arrows in 3-D axes of the usual view along the thrusts, as long as these are large.

    Peaks do not count; `scale` multiplies the widths of lines.
    """

    def __init__(self, axes: Any, flight: Flight, scale: float = 1.0) -> None:
        self._flight = flight
        thrusts = flight.applied[:, : flight.rotors]
        known = np.abs(thrusts[np.isfinite(thrusts)])
        usual = float(np.quantile(known, _USUAL)) if len(known) else 0.0
        self.reach = LONGEST * rotor_radius(flight)
        self._lengths = self.reach * np.clip(thrusts / (usual or 1.0), -1.0, 1.0)
        self._rotors = [flight.points.index(name) for name in flight.rotor_points]
        (self._line,) = axes.plot(
            [], [], [], color=COLOURS[3], linewidth=1.3 * scale, zorder=_LEVEL, label="thrust"
        )

    def show(self, sample: int) -> None:
        """Put the arrows where the rotors are at a sample."""
        flight = self._flight
        along = thrust_directions(flight, sample) @ flight.base_rotation[sample].T
        arrows = self._lengths[sample][:, np.newaxis] * along
        starts = flight.positions[sample][self._rotors]
        tips = starts + arrows
        # The barbs lie as they are seen best, across the line of sight.
        across = np.cross(along, seen_from(VIEW)[2])
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
        # Of a thrust of nothing no head is left either.
        sizes = np.clip(self._lengths[sample], -_HEAD[0] * self.reach, _HEAD[0] * self.reach)
        back = tips - sizes[:, np.newaxis] * along
        aside = _HEAD[1] / _HEAD[0] * sizes[:, np.newaxis] * across
        gap = np.full_like(tips, np.nan)
        points: Array = np.stack([starts, tips, back + aside, tips, back - aside, gap], axis=1)
        self._line.set_data_3d(*points.reshape(-1, 3).T)
