"""How every NumPy module makes constants of parameters, imported by itself."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from gibbs_codegen.emitted.preparation import prepared

DEFAULTS = {"mass": 2.0, "length": 3.0}


def inertia(values: dict[str, float]) -> tuple[float, tuple[float, ...]]:
    return values["mass"], (values["mass"] * values["length"] ** 2,)


def test_parameters_keep_their_defaults() -> None:
    assert prepared(inertia, DEFAULTS, [], {}) == (18.0,)
    assert prepared(inertia, DEFAULTS, [], {"length": np.float32(2.0)}) == (8.0,)
    assert DEFAULTS == {"mass": 2.0, "length": 3.0}


@pytest.mark.parametrize(
    ("parameters", "error", "message"),
    [
        ([1, 2], TypeError, 'parameters must map names to numbers, such as {"gravity": 3.71}'),
        ({"mas": 1.0}, ValueError, "unknown parameter 'mas': did you mean mass?"),
        ({"zzz": 1.0}, ValueError, "unknown parameter 'zzz': PARAMETERS has all names"),
        (
            {"drag": 1.0},
            ValueError,
            "drag is not a parameter of this module, because it is zero in",
        ),
        ({"mass": "1"}, TypeError, "mass must be real numbers: not str"),
        ({"mass": np.ones((1,) * 32)}, ValueError, "mass must have at most 31 axes, not 32"),
        ({"mass": math.inf}, ValueError, "mass must be a finite number, not inf"),
        ({"mass": 0.0}, ValueError, "these parameters leave an acceleration undetermined"),
        ({"mass": 1e308}, ValueError, "these parameters are too large or too small to compute"),
    ],
)
def test_parameters_are_refused_by_name(
    parameters: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error) as raised:
        prepared(inertia, DEFAULTS, ["drag"], parameters)
    assert str(raised.value).startswith(message)


@pytest.mark.parametrize("distance", [0.0, -1.5, [1.0, 0.0]])
def test_distances_of_constraints_are_above_zero(distance: Any) -> None:
    defaults = {**DEFAULTS, "constraint_rope_distance": 1.0}
    with pytest.raises(
        ValueError, match=r"^constraint_rope_distance.* above 0, m, not (0\.0|-1\.5)"
    ):
        prepared(inertia, defaults, [], {"constraint_rope_distance": distance})
