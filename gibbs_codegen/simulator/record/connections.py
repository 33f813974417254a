"""How the points of a robot hang together, for drawings."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.simulator.plant.vehicle import Vehicle

_log = logging.getLogger("gibbs_codegen")


def point_parents(vehicle: Vehicle) -> NDArray[np.intp]:
    """Numbers (k) of the points that points are joined to, for drawings, −1 for none.

    For rotors and joints that is the joint that carries them or the base centre; for frames, the
    same where they are on the last link of an arm, or the base centre for a tip without an arm.
    """
    centre, parents = vehicle.points.index(vehicle.centre), vehicle.carriers.copy()
    joint = centre + 1 + vehicle.rotors
    frame = joint + vehicle.joints
    if np.any(parents < 0):
        _log.warning(
            "%s: its links are not drawn, since the module, which an earlier version generated, "
            "does not say what carries what; generate it again",
            vehicle.name,
        )
        parents[centre + 1 : joint] = centre
    parents[: centre + 1] = -1
    on_the_way = np.isin(parents, parents[joint:frame])
    on_the_way[parents == centre] = True
    on_the_way[:frame] = False
    if vehicle.has_tip:
        tip = vehicle.points.index("tip")
        on_the_way[tip] &= parents[tip] != centre
    parents[on_the_way] = -1
    return parents
