"""Functions that are generated on request, with derivations so short that all is known of them.

`stretched` takes a scalar, and returns an array of every kind: a vector, a matrix that is mostly
zero, one without any entry, blocks of one. `weight` takes no argument.
"""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from numpy.typing import NDArray

from gibbs_codegen.derivation.functions import DERIVATIONS
from gibbs_codegen.derivation.systems import Array, Systems
from gibbs_codegen.interface import FUNCTIONS, Output, Row

STRETCHED = Row(
    "stretched",
    ("q", "v", "h"),
    (
        Output("moved", "v", "rad or m", derivation="moved"),
        Output("moved_dv", "vv", "s", derivation="moved_dv"),
        Output("moved_dq", "vv", "1", derivation="moved_dq"),
        Output("blocks", "f44v", "s", derivation="blocks"),
    ),
    "Velocities times a time, and what it is not all about.",
    "none",
    group="derivatives",
    on_request=True,
)
WEIGHT = Row(
    "weight",
    "",
    (Output("weights", "v", "N", derivation="weights"),),
    "Gravity as often as there are velocities.",
    "none",
    group="derivatives",
    on_request=True,
)


def _stretched(systems: Systems) -> tuple[list[sp.Expr], sp.Expr]:
    symbolic, (h,) = systems.symbolic, systems.symbolic.h
    return [systems.imported.tape.let(h * v) for v in symbolic.v], h


def _moved_dv(systems: Systems) -> Array:
    moved, h = _stretched(systems)
    size = len(moved)
    zero = sp.S.Zero
    rows = [[h if i == j else zero for j in range(size)] for i in range(size)]
    rows[0][-1], rows[-1][1] = moved[0], systems.imported.tape.let(sp.Integer(2) * h)
    return rows


def _blocks(systems: Systems) -> Array:
    moved, h = _stretched(systems)
    frames, width = len(systems.symbolic.W) // 6, len(moved)
    entries = [sp.S.Zero] * (frames * 16 * width)
    entries[width - 1], entries[16 * width - width] = h, moved[1]
    return entries


def expected(v: NDArray, h: NDArray, frames: int) -> list[NDArray]:
    """What `stretched` returns for states with a leading axis."""
    count, size = v.shape
    moved = v * h[:, None]
    by_v = np.einsum("s,ij->sij", h, np.eye(size))
    by_v[:, 0, -1], by_v[:, -1, 1] = moved[:, 0], 2.0 * h
    blocks = np.zeros((count, frames, 4, 4, size))
    blocks[:, 0, 0, 0, -1], blocks[:, 0, 3, 3, 0] = h, moved[:, 1]
    return [moved, by_v, np.zeros_like(by_v), blocks]


def add(patch: pytest.MonkeyPatch) -> list[str]:
    """Add both functions to the table; their names."""
    derivations = {
        "moved": lambda systems: _stretched(systems)[0],
        "moved_dv": _moved_dv,
        "moved_dq": lambda systems: (
            [[sp.S.Zero] * len(systems.symbolic.v)] * len(systems.symbolic.v)
        ),
        "blocks": _blocks,
        "weights": lambda systems: [systems.symbolic.parameters.gravity] * len(systems.symbolic.v),
    }
    for name, derivation in derivations.items():
        patch.setitem(DERIVATIONS, name, derivation)
    for row in (STRETCHED, WEIGHT):
        patch.setitem(FUNCTIONS, row.name, row)
    return [STRETCHED.name, WEIGHT.name]
