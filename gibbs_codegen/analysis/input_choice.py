"""Of all inputs that balance a robot, those of least thrust or of the widest margin to limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import linprog, nnls

from gibbs_codegen.analysis.equilibrium import RANK
from gibbs_codegen.errors import UsageError
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle

Aim = Literal["least_thrust", "widest_margin"]
AIMS: tuple[Aim, ...] = ("least_thrust", "widest_margin")

# Share of the largest input, or of 1 N, by which limits may seem to be exceeded.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Balancing:
    """All inputs that balance: `least` (nu), of least thrust, + `idle` (nu, k) times anything.

    The thrusts of `idle` produce no wrench on the base; they are orthonormal, and orthogonal to
    those of `least`.
    """

    least: Array
    idle: Array

    @classmethod
    def of(cls, vehicle: Vehicle, q: Array, force: Array) -> Balancing:
        """The inputs that produce a generalised force (nv), as nearly as they can."""
        columns = vehicle.thrust_wrenches(q)
        _, values, right = np.linalg.svd(columns)
        rank = int(np.sum(values > RANK * values.max(initial=0.0)))
        thrusts = np.linalg.pinv(columns, rcond=RANK) @ vehicle.base_wrench(q, force)
        loads = vehicle.input_matrix(q)[vehicle.arm_rates, : vehicle.rotors]
        idle = right[rank:].T
        efforts = force[vehicle.arm_rates] - loads @ thrusts
        return cls(np.concatenate([thrusts, efforts]), np.concatenate([idle, -loads @ idle]))


def chosen_inputs(vehicle: Vehicle, inputs: Balancing, limits: Array, aim: Aim) -> Array:
    """Inputs (nu) of least thrust, or whose thrust next to a limit is farthest from it.

    Of inputs with the same margin they are those of least thrust. `limits` (2, nu) may be infinite.
    Raises `UsageError` if no inputs within them balance, or no thrust has a limit on either side.
    """
    if aim == "least_thrust" and _within(inputs.least, limits):
        return inputs.least
    thrusts = np.arange(len(inputs.least)) < vehicle.rotors
    # Joint torques differ from thrusts in unit: their limits are kept, and no margin is sought.
    safest = _safest(inputs, limits, thrusts.astype(float))
    if safest is None or not _within(safest, limits):
        raise UsageError(_exceeded(vehicle, inputs, limits))
    margin = 0.0
    if aim == "widest_margin":
        margin = float(margins(safest, limits)[thrusts].min()) - _slack(safest)
    tightened = limits + np.outer([1.0, -1.0], margin * thrusts)
    return _least(inputs, tightened, safest)


def margins(inputs: Array, limits: Array) -> Array:
    """Distances (nu) of inputs from the nearer limit, negative beyond, infinite without limits."""
    within: Array = np.minimum(inputs - limits[0], limits[1] - inputs)
    return within


def _slack(inputs: Array) -> float:
    return _ROUNDING * max(1.0, float(np.abs(inputs).max(initial=0.0)))


def _within(inputs: Array, limits: Array) -> bool:
    return bool(np.all(margins(inputs, limits) >= -_slack(inputs)))


def _rows(inputs: Balancing, limits: Array) -> tuple[Array, Array, Array]:
    """The limits (2, nu) as rows · z ≥ bounds for inputs `least` + `idle` z.

    Rows (m, k), bounds (m), and the place of the input of each (m).
    """
    least, most = limits
    low, high = np.flatnonzero(np.isfinite(least)), np.flatnonzero(np.isfinite(most))
    rows = np.concatenate([inputs.idle[low], -inputs.idle[high]])
    bounds = np.concatenate([(least - inputs.least)[low], (inputs.least - most)[high]])
    return rows, bounds, np.concatenate([low, high])


def _safest(inputs: Balancing, limits: Array, counts: Array) -> Array | None:
    """The inputs (nu) whose least margin is the widest.

    None where none keep the limits of inputs that do not count. `counts` (nu): how much of the
    margin each must have; 0 to stay within limits only. Raises `UsageError` if the margin may grow
    without bound.
    """
    rows, bounds, places = _rows(inputs, limits)
    found = linprog(
        np.append(np.zeros(rows.shape[1]), -1.0),
        A_ub=np.column_stack([-rows, counts[places]]),
        b_ub=-bounds,
        bounds=(None, None),
        method="highs",
    )
    if found.status == 3:
        raise UsageError(
            "widest_margin: margins need limits on either side of the thrusts; give limits= as "
            "(least, most), N"
        )
    return inputs.least + inputs.idle @ found.x[:-1] if found.success else None


def _least(inputs: Balancing, limits: Array, safe: Array) -> Array:
    """Inputs (nu) of least thrust within limits, by Lawson and Hanson's least distance programming.

    `safe` (nu) are some within the limits.
    """
    rows, bounds, _ = _rows(inputs, limits)
    size = float(np.abs(bounds).max(initial=0.0)) or 1.0
    system = np.concatenate([rows.T, bounds[np.newaxis] / size])
    wanted = np.append(np.zeros(len(system) - 1), 1.0)
    left = wanted - system @ nnls(system, wanted)[0]
    least = inputs.least - inputs.idle @ (size * left[:-1] / left[-1])
    # Where the limits leave hardly any choice, rounding may spoil it.
    return least if _within(least, limits) else safe


def _exceeded(vehicle: Vehicle, inputs: Balancing, limits: Array) -> str:
    """The limits which even the best inputs exceed, in words."""
    nearest = _safest(inputs, limits, np.ones(len(inputs.least)))
    if nearest is None:
        nearest = inputs.least
    units = ("N",) * vehicle.rotors + vehicle.layout.effort_units
    beyond = [
        f"{name} is {value:.4g} {unit}, {-margin:.3g} {unit} {'below' if low else 'above'} its "
        f"limit of {limit:.4g} {unit}"
        for name, value, unit, margin, low, limit in zip(
            vehicle.inputs,
            nearest,
            units,
            margins(nearest, limits),
            nearest < limits[0],
            np.where(nearest < limits[0], *limits),
            strict=True,
        )
        if margin < -_slack(nearest)
    ]
    return (
        f"{vehicle.name}: no trim within the limits of its inputs; of all inputs that balance it "
        f"at this attitude, those that exceed them least: {'; '.join(beyond)}"
    )
