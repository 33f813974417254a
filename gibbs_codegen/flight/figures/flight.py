"""Figures of a flight, for the widths of a two-column paper (3.5 and at most 7.2 in).

Each is a Matplotlib `Figure` that belongs to nobody: no window, no pyplot, no backend. The caller
saves it, shows it in a notebook or changes it. They look the same whatever the user's own style.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from gibbs_codegen.figures import FORMATS
from gibbs_codegen.figures.appearance import COLOURS
from gibbs_codegen.figures.style import COLUMN, FULL, new_figure, save_figures, style
from gibbs_codegen.flight.figures import curves
from gibbs_codegen.flight.figures.curves import actuators as actuators
from gibbs_codegen.flight.figures.curves import coordinates as coordinates
from gibbs_codegen.flight.figures.curves import inputs as inputs
from gibbs_codegen.flight.figures.results import FIGURES as NAMES
from gibbs_codegen.flight.figures.snapshots import snapshots as snapshots
from gibbs_codegen.flight.figures.snapshots import snapshots_panels as snapshots_panels
from gibbs_codegen.flight.record.extent import led_points
from gibbs_codegen.flight.record.flight import Flight


def constraint_torques(flight: Flight, width: float = COLUMN) -> Figure:
    """Draw the torques, N m, that hold base arms 2 … N (eqs. 14–17) and constrained links."""
    names = [curves.symbol(name) for name in flight.constraint_names]
    with style():
        panel = curves.Curves("constraint torque (N m)", names, flight.constraint_torques)
        return curves.finished(curves.stack(flight, [panel], width), flight)


def tracking_error(flight: Flight, width: float = COLUMN) -> Figure:
    """Draw how far the flight is from what is desired, over time in s: linearly, and by logarithms.

    Above in m: base centre and tip, as far as they are led, and, if there are prismatic joints, the
    largest of their errors. Below in rad: the largest error of an attitude angle or revolute joint
    and, if an arm is to be tangent to the path, its angle to the tangent. What is below `LOG_FLOOR`
    is drawn there.
    """
    error, places = np.abs(flight.errors), flight.layout.v
    sliding = [place for place in places.joint_places if places.units[place] == "m/s"]
    angular = [place for place, unit in enumerate(places.units) if unit == "rad/s"]
    distances = {name: led.error for name, led in led_points(flight).items()}
    if sliding:
        distances["prismatic joints"] = error[:, sliding].max(axis=1)
    angles, turning = {}, len(range(places.size)[places.attitude])
    if angular:
        kinds = ["joint"] * (len(angular) > turning) + ["attitude angle"] * (turning > 0)
        angles[f"largest {' or '.join(kinds)}"] = error[:, angular].max(axis=1)
    if flight.tangent_arm:
        angles[f"arm {flight.tangent_arm} to tangent"] = flight.heading_error
    with style():
        panels = [("error (m)", distances), *([("error (rad)", angles)] if angles else [])]
        figure = new_figure(width, 3.0 * len(panels))
        rows = iter(figure.subplots(2 * len(panels), 1, sharex=True))
        for label, series in panels:
            curves.plot_lines(above := next(rows), flight, label, series)
            curves.add_key(above)
            curves.plot_logarithms(next(rows), flight, label, series)
        return curves.finished(figure, flight)


def battery(flight: Flight, width: float = COLUMN) -> Figure:
    """Draw the charge of the battery, %, its voltage, V, its current, A, and its power, W."""
    voltage, current = flight.battery[:, :1], flight.battery[:, 1:]
    charge = 100.0 * flight.actuators[:, -1:][:, : current.shape[1]]  # None without a battery.
    panels = {"charge (%)": charge, "voltage (V)": voltage, "current (A)": current}
    panels["power (W)"] = voltage * current
    with style():
        drawn = [curves.Curves(name, [""] * x.shape[1], x) for name, x in panels.items()]
        return curves.finished(curves.stack(flight, drawn, width), flight)


def outside(flight: Flight, width: float = COLUMN) -> Figure:
    """Draw sizes of forces, N, and of torques, N m, that act on frames from outside.

    They are of push, wind, walls, payloads and spinning rotors.
    """
    panels: list[curves.Curves] = []
    for label, part in (("force from outside (N)", slice(3)), ("torque (N m)", slice(3, 6))):
        sizes = np.linalg.norm(flight.frame_wrenches[:, :, part], axis=2)
        acts = np.flatnonzero(np.any(sizes > 0.0, axis=0))
        names = [curves.symbol(flight.frames[k]) for k in acts]
        if names or not panels:
            panels.append(curves.Curves(label, names, sizes[:, acts]))
    with style():
        return curves.finished(curves.stack(flight, panels, width), flight)


def energy(flight: Flight, width: float = COLUMN) -> Figure:
    """Draw changes of energy since the start and the work done, J; below the error |ΔE − W|, J.

    Errors below `LOG_FLOOR`, which are roundoff, are drawn there.
    """
    kinetic, potential = (e - e[0] for e in (flight.kinetic_energy, flight.potential_energy))
    changes = {"kinetic": kinetic, "potential": potential, r"total $\Delta E$": kinetic + potential}
    with style():
        figure = new_figure(width, 3.6)
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        for (name, change), colour in zip(changes.items(), COLOURS, strict=False):
            curves.plot_line(above, flight, change, label=name, color=colour, **curves.SOLID)
        curves.plot_line(above, flight, flight.work, label="work $W$", **curves.DASHED)
        curves.label_axes(above, "change of energy (J)")
        curves.add_key(above)
        error = {"": np.abs(flight.energy_error)}
        curves.plot_logarithms(below, flight, r"error $|\Delta E - W|$ (J)", error)
        return curves.finished(figure, flight)


def contacts(flight: Flight, width: float = COLUMN) -> Figure:
    """Draw forces of contacts, N: those along the normals, and the sizes of those across them.

    Those that never press are left out, unless none does. The background is grey while one slides.
    """
    presses = np.any(flight.contact_forces > 0.0, axis=0)
    shown = presses | ~np.any(presses)
    names = [name for name, is_shown in zip(flight.contact_names, shown, strict=True) if is_shown]
    pressed = flight.contact_forces[:, shown]
    across = np.linalg.norm(flight.contact_friction[:, shown], axis=-1)
    slides = (
        np.any(flight.contact_slip[:, shown] != 0.0, axis=-1) & (pressed > 0.0) & (across > 0.0)
    )
    panels = [curves.Curves("normal force (N)", names, pressed)]
    if across.any():
        panels.append(curves.Curves("friction (N)", names, across))
    with style():
        figure = curves.stack(flight, panels, width)
        for axes in figure.axes:
            key = curves.draw_spans(axes, flight, slides.any(axis=1), "slides")
        if key:
            curves.add_key(figure.axes[0], handles=list(key.values()), labels=list(key))
        return curves.finished(figure, flight)


def estimates(flight: Flight) -> Figure:
    """Draw errors of estimated coordinates and velocities, rad, m and per s, and two deviations."""
    layout = flight.layout
    pairs = [*layout.displacements, *zip(layout.v.names, layout.v.units, strict=True)]
    with style():
        figure = new_figure(FULL, 0.4 + 1.1 * layout.displaced.size)
        rows = figure.subplots(layout.displaced.size, 2, sharex=True, squeeze=False)
        for lacking in {*range(len(rows))} - {*layout.paired}:
            rows[lacking, 1].set_axis_off()
        for k, axes in enumerate([*rows[:, 0], *rows[layout.paired, 1]]):
            band, (name, unit) = 2.0 * flight.estimate_deviations[:, k], pairs[k]
            axes.fill_between(flight.time, -band, band, label="two deviations", **curves.BAND)
            error = flight.estimate_errors[:, k]
            curves.plot_line(axes, flight, error, label="error of estimates", linewidth=1.0)
            curves.label_axes(axes, f"{curves.symbol(name)} ({unit})")
        curves.add_key(rows[0, 1])
        return curves.finished(figure, flight)


FIGURES: tuple[Callable[[Flight], Figure], ...] = tuple(globals()[name] for name in NAMES)


def write_figures(
    flight: Flight, folder: Path, formats: Sequence[str] = FORMATS[:1], share: int = 0, of: int = 1
) -> list[Path]:
    """Write every figure in every format, and return the files; two calls write the same bytes.

    What is not known of a flight, or of its robot, is left out. Figures are dealt out to `of`
    shares, of which one is written.
    """
    counts: dict[Callable[..., Figure], int] = {
        inputs: int(np.isfinite(flight.applied).sum()),
        actuators: len(curves.actuator_panels(flight)),
        battery: flight.battery.shape[1],
        outside: int(np.any(flight.frame_wrenches)),
        constraint_torques: int(np.isfinite(flight.constraint_torques).sum()),
        tracking_error: int(np.isfinite(flight.q_desired).sum()),
        contacts: flight.contact_forces.shape[1],
        estimates: flight.estimates.shape[1],
    }
    drawn = [draw for draw in FIGURES if counts.get(draw, 1)][share::of]
    return save_figures(((draw.__name__, draw(flight)) for draw in drawn), folder, formats)
