"""What C knows of the environment: `Environment` of `native/loop.h`, and what fills it."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.simulator.integration.acting import Acting
from gibbs_codegen.simulator.integration.closed_loop import ClosedLoop
from gibbs_codegen.simulator.plant.vehicle import Array

_POINTER, _SIZE = ctypes.c_void_p, ctypes.c_ssize_t


class EnvironmentPart(ctypes.Structure):
    """`Environment` of `native/loop.h`."""

    _fields_ = (
        *(("frames", _SIZE), ("push", _POINTER), ("coefficients", _POINTER), ("wind", _POINTER)),
        *(("gusts", _SIZE), ("gust", _POINTER), ("walls", _SIZE), ("wall", _POINTER)),
        *(("spins", _SIZE), ("spin", _POINTER), ("payloads", _SIZE), ("payload", _POINTER)),
        ("gravity", _POINTER),
    )


def environment_values(closed: ClosedLoop, acting: Acting) -> dict[str, Any]:
    """Values of the part by names of its fields, while something acts; none where nothing does."""
    environment = closed.environment
    if environment is None:
        return {}
    walls, payloads = environment.walls, environment.payloads
    there = np.flatnonzero(np.logical_and(acting.payloads, payloads.masses > 0.0))
    if not (acting.push or environment.drag or len(walls.places) or environment.spin or len(there)):
        return {}
    values: dict[str, Any] = {
        "frames": len(closed.vehicle.frames),
        "push": np.where(acting.push, environment.pushing, 0.0),
        "walls": len(walls.places),
        "wall": _rows(walls.places, walls.points, walls.normals, walls.stiffness, walls.damping),
        "payloads": len(there),
        "payload": _rows(payloads.places[there], payloads.masses[there]),
        "gravity": payloads.gravity[..., 2],
    }
    if (drag := environment.drag) is not None:
        values |= {"coefficients": drag.coefficients, "wind": drag.velocity}
        values |= {"gusts": len(drag.gusts), "gust": drag.gusts}
    if (spin := environment.spin) is not None:
        values |= {"spins": len(spin.rotors)}
        values |= {"spin": _rows(spin.rotors, spin.places, spin.axes, spin.spins)}
    return values


def _rows(*columns: NDArray[Any]) -> Array:
    """A row of numbers for each of k things, of which every column has a number (k) or three."""
    return np.column_stack([np.asarray(column, dtype=np.float64) for column in columns])
