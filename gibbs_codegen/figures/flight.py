"""Figures of a flight, for the widths of a two-column paper (3.5 and at most 7.2 in).

Each is a Matplotlib `Figure` that belongs to nobody: no window, no pyplot, no backend. The caller
saves it, shows it in a notebook or changes it. They look the same whatever the user's own style.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from gibbs_codegen.figures.coordinates import coordinates as coordinates
from gibbs_codegen.figures.curves import (
    DASHED,
    SOLID,
    Curves,
    add_key,
    finished,
    label_axes,
    plot_line,
    plot_logarithms,
    stack,
    symbol,
)
from gibbs_codegen.figures.inputs import inputs as inputs
from gibbs_codegen.figures.saving import save_figures
from gibbs_codegen.figures.snapshots import snapshots as snapshots
from gibbs_codegen.figures.snapshots import snapshots_panels as snapshots_panels
from gibbs_codegen.figures.style import COLOURS, COLUMN, style
from gibbs_codegen.simulator.record.flight import Flight


def constraint_torques(flight: Flight, width: float = COLUMN) -> Figure:
    """Draw the torques, N m, that hold base arms 2 … N (eqs. 14–17) and constrained links."""
    names = [symbol(name) for name in flight.constraint_names]
    with style():
        panel = Curves("constraint torque (N m)", names, flight.constraint_torques)
        return finished(stack(flight, [panel], width), flight)


def tracking_error(flight: Flight, width: float = COLUMN) -> Figure:
    """Draw how far the flight is from what is desired, on logarithmic axes, over time in s.

    Above in m: base centre, tip and, if there are prismatic joints, the largest of their errors.
    Below in rad: the largest error of an attitude angle or revolute joint and, if an arm is to be
    tangent to the path, its angle to the tangent. What is below `LOG_FLOOR` is drawn there.
    """
    error, places = np.abs(flight.errors), flight.layout.v
    sliding = [place for place in places.joint_places if places.units[place] == "m/s"]
    angular = [place for place, unit in enumerate(places.units) if unit == "rad/s"]
    distances = {"base centre": flight.centre_error}
    if flight.has_tip and places.joint_places:
        distances["tip"] = flight.tip_error
    if sliding:
        distances["prismatic joints"] = error[:, sliding].max(axis=1)
    angles = {"largest joint or attitude angle": error[:, angular].max(axis=1)}
    if flight.tangent_arm:
        angles[f"arm {flight.tangent_arm} to tangent"] = flight.heading_error
    with style():
        figure = Figure(figsize=(width, 3.6), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        plot_logarithms(above, flight, "error (m)", distances)
        plot_logarithms(below, flight, "error (rad)", angles)
        return finished(figure, flight)


def energy(flight: Flight, width: float = COLUMN) -> Figure:
    """Draw changes of energy since the start and the work done, J; below the error |ΔE − W|, J.

    Errors below `LOG_FLOOR`, which are roundoff, are drawn there.
    """
    kinetic, potential = (e - e[0] for e in (flight.kinetic_energy, flight.potential_energy))
    changes = {"kinetic": kinetic, "potential": potential, r"total $\Delta E$": kinetic + potential}
    with style():
        figure = Figure(figsize=(width, 3.6), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        for (name, change), colour in zip(changes.items(), COLOURS, strict=False):
            plot_line(above, flight, change, label=name, color=colour, **SOLID)
        plot_line(above, flight, flight.work, label="work $W$", **DASHED)
        label_axes(above, "change of energy (J)")
        add_key(above)
        error = {"": np.abs(flight.energy_error)}
        plot_logarithms(below, flight, r"error $|\Delta E - W|$ (J)", error)
        return finished(figure, flight)


FIGURES: tuple[Callable[[Flight], Figure], ...] = (
    coordinates,
    snapshots,
    snapshots_panels,
    inputs,
    constraint_torques,
    tracking_error,
    energy,
)


def write_figures(
    flight: Flight, folder: Path, formats: Sequence[str] = ("png", "pdf")
) -> list[Path]:
    """Write every figure in every format, and return the files; two calls write the same bytes.

    Inputs and constraint torques are left out where there are none.
    """
    series = {inputs: flight.applied, constraint_torques: flight.constraint_torques}
    drawn = (
        (draw.__name__, draw(flight))
        for draw in FIGURES
        if draw not in series or series[draw].shape[1]
    )
    return save_figures(drawn, folder, formats)
