"""Derivatives of allocation and of closed loops, against differences of high order."""

from __future__ import annotations

import numpy as np
import pytest
from support.differences import rate

from gibbs_codegen.arrays import Program, evaluate, gradient, jacobian, variable
from gibbs_codegen.arrays.allocation import nearest_thrusts, smallest_thrusts
from gibbs_codegen.flight.plant.allocation import Allocation

Array = np.ndarray


def nearest(thrusts: Array, wrench: Array, columns: Array, least: Array, most: Array) -> Array:
    """Thrusts within limits, by SciPy's bounded least squares."""
    return Allocation(columns.T, np.stack([least, most])).in_flight().thrusts(wrench)


@pytest.mark.parametrize("rotors", [4, 6, 7])
@pytest.mark.parametrize("share", [0.3, 2.0])
def test_thrusts_within_limits_have_derivatives(rotors: int, share: float) -> None:
    random = np.random.default_rng(rotors)
    columns = random.normal(size=(rotors, 6))
    least, most = -0.4 - random.random(rotors), 0.4 + random.random(rotors)
    wrench = share * columns.T @ random.normal(size=rotors)
    inputs = variable("columns", rotors, 6), variable("wrench", 6)
    limits = variable("least", rotors), variable("most", rotors)
    exact = smallest_thrusts(*inputs)
    program = Program(
        "shared",
        (*inputs, *limits),
        {"thrusts": nearest_thrusts(exact, inputs[1], inputs[0], *limits)},
    )
    by_hand = {
        "smallest_thrusts": lambda columns, wrench: np.linalg.pinv(columns.T) @ wrench,
        "nearest_thrusts": nearest,
    }
    given = {"columns": columns, "wrench": wrench, "least": least, "most": most}
    found = evaluate(jacobian(program, [*given]), given, {}, externals=by_hand)
    bound = (found["thrusts"] <= least) | (found["thrusts"] >= most)
    assert bound.any() == (share > 1.0)
    weights = random.normal(size=rotors)
    bars = evaluate(
        gradient(program, [*given]), given | {"thrusts_bar": weights}, {}, externals=by_hand
    )
    for name, value in given.items():
        along = random.normal(size=value.shape)

        def moved(steps: Array, name: str = name, along: Array = along) -> Array:
            values = (given | {name: given[name] + step * along} for step in steps)
            return np.array(
                [evaluate(program, each, {}, externals=by_hand)["thrusts"] for each in values]
            )

        wanted = rate(moved, np.zeros(1), 1e-4)[0]
        slope = found[f"thrusts_by_{name}"].reshape(rotors, -1) @ along.ravel()
        np.testing.assert_allclose(slope, wanted, rtol=0, atol=1e-7 * (1.0 + np.abs(wanted).max()))
        np.testing.assert_allclose(
            np.sum(bars[f"{name}_bar"] * along), weights @ slope, rtol=1e-9, atol=1e-9
        )
