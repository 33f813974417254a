"""The columns of a flight: its time series one by one, with names and units."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gibbs_codegen.simulator.record.series import Array, Series

Column = tuple[str, str, Array]
# What the names of columns of inputs end in, and the series.
_INPUTS = {
    "": "applied",
    "_least": "applied_least",
    "_greatest": "applied_greatest",
    "_commanded": "commanded",
    "_commanded_least": "commanded_least",
    "_commanded_greatest": "commanded_greatest",
}


def columns_of(flight: Series) -> Iterator[Column]:
    """Every scalar series of a flight, time first.

    Args:
        flight: The flight.

    Yields:
        Name, unit and values (s) of each.
    """
    yield "time", "s", flight.time
    places, velocities = flight.layout.q, flight.layout.v
    # Components of velocities have names of their own, rates those of their coordinates.
    rates = [f"rate_{name}" if name in places.names else name for name in velocities.names]
    growth = [f"acceleration_{name}" for name in velocities.names]
    per_square = [f"{unit}^2" for unit in velocities.units]
    for names, units, suffix, series in (
        (places.names, places.units, "", flight.q),
        (places.names, places.units, "_desired", flight.q_desired),
        (rates, velocities.units, "", flight.v),
        (rates, velocities.units, "_desired", flight.v_desired),
        (growth, per_square, "", flight.a),
        (growth, per_square, "_desired", flight.a_desired),
    ):
        for name, unit, values in zip(names, units, series.T, strict=True):
            yield f"{name}{suffix}", unit, values
    yield from _inputs(flight)
    for name, values in zip(flight.constraint_names, flight.constraint_torques.T, strict=True):
        yield name, "N m", values
    for k, values in enumerate(flight.base_arm_angles.T, start=2):
        yield f"theta_{k}", "rad", values
    for j, point in enumerate(flight.points):
        for i, axis in enumerate("xyz"):
            yield f"{point}_{axis}", "m", flight.positions[:, j, i]
    yield from _wrenches(flight)
    for k, values in enumerate(flight.wall_forces.T, start=1):
        yield f"wall_{k}_force", "N", values
    for point, series in ((flight.centre, flight.centre_desired), ("tip", flight.tip_desired)):
        for axis, values in zip("xyz", series.T, strict=False):
            yield f"{point}_{axis}_desired", "m", values
    yield "centre_error", "m", flight.centre_error
    if flight.has_tip:
        yield "tip_error", "m", flight.tip_error
    yield "heading_error", "rad", flight.heading_error
    yield "kinetic_energy", "J", flight.kinetic_energy
    yield "potential_energy", "J", flight.potential_energy
    yield "work", "J", flight.work
    yield "energy_error", "J", flight.energy_error


def _inputs(flight: Series) -> Iterator[Column]:
    names, units = flight.input_names, flight.input_units
    for suffix, series in _INPUTS.items():
        for name, unit, values in zip(names, units, getattr(flight, series).T, strict=True):
            yield f"{name}{suffix}", unit, values


def _wrenches(flight: Series) -> Iterator[Column]:
    """Wrenches on those frames on which one acts at some time."""
    for frame, series in zip(flight.frames, np.moveaxis(flight.frame_wrenches, 1, 0), strict=True):
        if np.any(series):
            for k, axis in enumerate("xyz"):
                yield f"{frame}_force_{axis}", "N", series[:, k]
                yield f"{frame}_torque_{axis}", "N m", series[:, k + 3]
