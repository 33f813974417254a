"""Generated modules with derivatives by central differences, to test what needs derivatives."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from support.differences import rate

Array = NDArray[np.float64]


def differentiated(module: ModuleType) -> ModuleType:
    """A module with `forward_dynamics_derivatives` for one state, as `--derivatives` adds it."""
    made = ModuleType(module.__name__)
    vars(made).update(vars(module))

    def derivatives(q: ArrayLike, v: ArrayLike, u: ArrayLike, constants: Any = None) -> Any:
        q, v, u = (np.asarray(each, dtype=np.float64) for each in (q, v, u))

        def moved(time: Array, way: tuple[Array, Array, Array]) -> Array:
            by_q, by_v, by_u = (time[:, np.newaxis] * each for each in way)
            there = module.integrate(q + 0.0 * by_q[:, :1], by_q)
            return module.forward_dynamics(there, v + by_v, u + by_u, constants=constants)

        sizes = (len(v), len(v), len(u))
        columns: list[list[Array]] = [[], [], []]
        for place, size in enumerate(sizes):
            for axis in np.eye(size):
                way = tuple(axis if k == place else np.zeros(n) for k, n in enumerate(sizes))
                slope = rate(lambda time, way=way: moved(time, way), np.zeros(1))
                columns[place].append(slope[0])
        acceleration = module.forward_dynamics(q, v, u, constants=constants)
        return (acceleration, *(np.transpose(each) for each in columns))

    made.forward_dynamics_derivatives = derivatives
    made.DERIVATIVES = ("forward_dynamics_derivatives",)
    return made
