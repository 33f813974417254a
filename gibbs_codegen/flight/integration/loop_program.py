"""The array program of a closed loop, and the values of its inputs in a flight."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from gibbs_codegen.arrays import closed_loop
from gibbs_codegen.arrays.closed_loop import Surroundings
from gibbs_codegen.flight.control.geometric import GeometricLaw
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.state_history import Loads
from gibbs_codegen.flight.plant.allocation import force_axis
from gibbs_codegen.flight.plant.environment import Environment
from gibbs_codegen.flight.plant.vehicle import Array
from gibbs_codegen.flight.scenario.orientation import LARGEST_THETA_0

# Shares of a wrench that thrusts may fail to produce and still count as exact.
DOUBLE, SINGLE = 1e-9, 1e-4


def loop_values(
    closed: ClosedLoop, bounds: Array | float, loads: Loads, exact: float = DOUBLE
) -> dict[str, Any]:
    """Values of the inputs of a closed loop's program by their names, while something acts.

    `bounds` of errors, then of their rates, are (2 nv) or one number. `exact` is DOUBLE or SINGLE.
    """
    plant, law = closed.vehicle, closed.controller
    model, reference = law.vehicle, law.reference
    size = 2 * plant.layout.v.size
    least, most = closed.actuators.inputs[..., 0, :], closed.actuators.inputs[..., 1, :]
    lag = closed.actuators.lag
    values = {
        "stiffness": law.gains.stiffness,
        "damping": law.gains.damping,
        "integral": law.gains.integral,
        "known_centre": model.centre_offset(model.neutral),
        "known_wrenches": np.swapaxes(model.thrust_wrenches(), -1, -2),
        "distribution": law.allocation.inverse,
        "centre": plant.centre_offset(plant.neutral),
        "wrenches": np.swapaxes(plant.thrust_wrenches(), -1, -2),
        "losses": plant.damping,
        "least": least,
        "most": most,
        "margin": 1e-9 * np.where(np.isfinite(most - least), most - least, 0.0),
        "lag": lag,
        "pace": np.divide(1.0, lag, out=np.zeros(np.shape(lag)), where=lag > 0.0),
        "end": reference.end,
        "bounds": np.broadcast_to(bounds, (*np.shape(bounds)[:-1], size)),
        "largest_lean": LARGEST_THETA_0,
        "exact": exact,
    }
    if law.allocation.limits is not None:
        limits = np.array(law.allocation.limits)
        limits = limits[:, np.newaxis] if limits.ndim == 1 else limits
        limits = np.broadcast_to(limits, (*limits.shape[:-1], plant.rotors))
        values |= {"least_shared": limits[..., 0, :], "most_shared": limits[..., 1, :]}
    if isinstance(law, GeometricLaw):
        axis = force_axis(model.thrust_wrenches())
        values |= {"mass": law.mass, "weight": law.weight, "axis": axis}
    if loads.inputs is not None:
        values["held"] = np.array(loads.inputs)
    return values | _around(closed.environment, loads)[1]


def loop_tables(closed: ClosedLoop) -> list[Array]:
    """Tables of the curves that a closed loop follows: of its motion, then of its centre of mass.

    The latter is there with the geometric law alone.
    """
    law, reference = closed.controller, closed.controller.reference
    curves = reference, law.centre if isinstance(law, GeometricLaw) else reference
    pieces = reference.begin, reference.step, len(reference.coefficients)
    return [np.concatenate([pieces, each.coefficients.ravel()]) for each in curves]


def loop_program(
    closed: ClosedLoop, loads: Loads, each: Collection[str] = ()
) -> closed_loop.ClosedLoop:
    """The closed loop as an array program, while something acts.

    `each` are names of inputs that differ from flight to flight.
    """
    law, allocation = closed.controller, closed.controller.allocation
    return closed_loop.ClosedLoop(
        closed.vehicle.module,
        law.law if loads.inputs is None else "held",
        len(closed.vehicle.frames),
        integral=law.memory > 0,
        limited=closed.limited,
        shared=allocation.limits is not None,
        lags=closed.lags,
        compensates=closed.compensates and loads.inputs is None,
        moves=closed.vehicle.rotors_move,
        refuses=allocation.refuses and (bool(allocation.missing) or closed.vehicle.rotors_move),
        around=_around(closed.environment, loads)[0],
        each=each,
    )


def _around(environment: Environment | None, loads: Loads) -> tuple[Surroundings, dict[str, Any]]:
    """What acts on which frames, and the figures of that."""
    if environment is None:
        return Surroundings(), {}
    walls, payloads, values = environment.walls, environment.payloads, dict[str, Any]()
    there = np.flatnonzero(np.logical_and(loads.payloads, payloads.masses > 0.0))
    drag, spin = environment.drag, environment.spin
    if loads.push:
        values["push"] = environment.pushing
    if drag is not None:
        values |= {"drag": drag.coefficients, "wind": drag.velocity, "gusts": drag.gusts}
    if len(walls.places):
        columns = (walls.points, walls.normals, walls.stiffness, walls.damping)
        values["walls"] = np.column_stack(columns)
    if spin is not None:
        values["spins"] = np.column_stack((spin.axes, spin.spins))
    if len(there):
        values |= {"payloads": payloads.masses[there], "gravity": payloads.gravity}
    found = Surroundings(
        bool(loads.push),
        drag is not None,
        0 if drag is None else len(drag.gusts),
        tuple(walls.places.tolist()),
        () if spin is None else tuple(zip(spin.rotors.tolist(), spin.places.tolist(), strict=True)),
        tuple(payloads.places[there].tolist()),
    )
    return found, values
