"""The array program of a closed loop, and the values of its inputs in a flight."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, Any

import numpy as np

from gibbs_codegen.arrays import closed_loop
from gibbs_codegen.arrays.closed_loop import Surroundings
from gibbs_codegen.flight.control.geometric import LeaningController
from gibbs_codegen.flight.control.laws import law_program
from gibbs_codegen.flight.integration.state_history import Loads
from gibbs_codegen.flight.plant.environment import Environment
from gibbs_codegen.flight.plant.vehicle import Array
from gibbs_codegen.flight.scenario.orientation import LARGEST_THETA_0

if TYPE_CHECKING:
    from gibbs_codegen.flight.integration.closed_loop import ClosedLoop

# Shares of a wrench that thrusts may fail to produce and still count as exact.
DOUBLE, SINGLE = 1e-9, 1e-4


def loop_values(
    closed: ClosedLoop, bounds: Array | float, loads: Loads, exact: float = DOUBLE
) -> dict[str, Any]:
    """Values of the inputs of a closed loop's program by their names, while something acts.

    `bounds` of errors, then of their rates, are (2 nv) or one number. `exact` is DOUBLE or SINGLE.
    """
    plant = closed.vehicle
    values = {
        **law_values(closed),
        "centre": plant.centre_offset(plant.neutral),
        "wrenches": np.swapaxes(plant.thrust_wrenches(), -1, -2),
        "losses": plant.damping,
        "bounds": np.broadcast_to(bounds, (*np.shape(bounds)[:-1], 2 * plant.layout.v.size)),
        "largest_lean": LARGEST_THETA_0,
        "exact": exact,
    }
    if loads.inputs is not None:
        values["held"] = np.array(loads.inputs)
    return values | acting(closed.environment, loads)[1]


def law_values(closed: ClosedLoop) -> dict[str, Any]:
    """Those of the inputs that tell what is commanded and what acts."""
    lag = closed.actuators.lag
    pace = np.divide(1.0, lag, out=np.zeros(np.shape(lag)), where=lag > 0.0)
    return {**closed.controller.values, **closed.actuators.values, "lag": lag, "pace": pace}


def loop_tables(closed: ClosedLoop) -> list[Array]:
    """Tables of the curves that a closed loop follows: of its motion, then of its centre of mass.

    The latter is there with the geometric law alone.
    """
    law, reference = closed.controller, closed.controller.reference
    curves = reference, law.centre if isinstance(law, LeaningController) else reference
    pieces = reference.begin, reference.step, len(reference.coefficients)
    return [np.concatenate([pieces, each.coefficients.ravel()]) for each in curves]


def loop_program(
    closed: ClosedLoop, loads: Loads, each: Collection[str] = ()
) -> closed_loop.ClosedLoop:
    """The closed loop as an array program, while something acts.

    `each` are names of inputs that differ from flight to flight.
    """
    law, held = closed.controller, loads.inputs is not None
    return law_program(
        law.vehicle,
        law.allocation,
        "held" if held else law.law,
        integral=law.memory > 0,
        limited=closed.limited,
        lags=closed.lags,
        compensates=closed.compensates and not held,
        around=acting(closed.environment, loads)[0],
        each=each,
    )


def acting(environment: Environment | None, loads: Loads) -> tuple[Surroundings, dict[str, Any]]:
    """What acts on which frames, and the figures of that."""
    if environment is None:
        return Surroundings(), {}
    walls, payloads, values = environment.walls, environment.payloads, dict[str, Any]()
    masses = np.where(loads.payloads, payloads.masses, 0.0)
    there = np.flatnonzero(np.any(masses > 0.0, axis=tuple(range(masses.ndim - 1))))
    drag, spin = environment.drag, environment.spin
    if pushes := bool(np.any(loads.push)):
        values["push"] = np.multiply.outer(loads.push, environment.pushing)
    if drag is not None:
        values |= {"drag": drag.coefficients, "wind": drag.velocity, "gusts": drag.gusts}
    for k, wall in enumerate(walls.walls):
        values[f"wall_{k}"] = np.array([wall.stiffness, wall.damping, *wall.figures])
    if spin is not None:
        values["spins"] = np.column_stack((spin.axes, spin.spins))
    if len(there):
        values |= {"payloads": masses[..., there], "gravity": payloads.gravity}
    found = Surroundings(
        pushes,
        drag is not None,
        0 if drag is None else len(drag.gusts),
        tuple(
            (frame, wall.surface, len(wall.figures))
            for frame, wall in zip(walls.places.tolist(), walls.walls, strict=True)
        ),
        () if spin is None else tuple(zip(spin.rotors.tolist(), spin.places.tolist(), strict=True)),
        tuple(payloads.places[there].tolist()),
    )
    return found, values
