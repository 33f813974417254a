"""Directions of wrenches on the base in words, for messages and reports."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import UsageError

Array = NDArray[np.float64]

# Components of a wrench, force rows first.
DIRECTIONS = (
    "force along x",
    "force along y",
    "force along z",
    "torque about x",
    "torque about y",
    "torque about z",
)
# Singular values below this share of the largest belong to directions that rotors cannot command.
RANK = 1e-9
# What limits may be exceeded by, as a share of the greatest, as of SciPy's solver; and its status
# where nothing is within them.
_FEASIBLE, _INFEASIBLE = 1e-7, 2


def directions(basis: Array, names: Sequence[str] = DIRECTIONS) -> tuple[str, ...]:
    """Directions, such as "force along x", of the columns of `basis` (m, k), or sums of such.

    The m components have `names`; wrenches have force first.
    """
    rest, pivots = basis.T.copy(), []
    for _ in rest:
        pivots.append(int(np.argmax(np.linalg.norm(rest, axis=0))))
        axis = rest[:, pivots[-1]] / np.linalg.norm(rest[:, pivots[-1]])
        rest -= np.outer(axis, axis @ rest)
    # Reduced so that each direction has a component of its own, and is that alone if it can be.
    reduced = basis @ np.linalg.inv(basis[sorted(pivots)])
    return tuple(_in_words(direction, names) for direction in reduced.T)


def _in_words(direction: Array, names: Sequence[str]) -> str:
    parts: list[str] = []
    for component, name in zip(direction, names, strict=True):
        if abs(component) > 1e-6:
            factor = "" if abs(abs(component) - 1.0) < 1e-6 else f"{abs(component):.3g} × "
            sign = ("− " if component < 0 else "+ ") if parts else ("−" if component < 0 else "")
            parts.append(f"{sign}{factor}{name}")
    return " ".join(parts)


def rank(matrix: Array) -> int:
    """In how many directions what a matrix maps can be commanded."""
    values = np.linalg.svd(matrix, compute_uv=False)
    return int(np.sum(values > RANK * values.max(initial=0.0)))


def null_space(matrix: Array) -> Array:
    """Orthonormal columns that a matrix maps to zero."""
    return np.asarray(np.linalg.svd(matrix)[2][rank(matrix) :].T)


def leans(axis: Array, along: Sequence[int], about: Sequence[int]) -> bool:
    """True if a base that turns about some of its axes directs thrust along all that it moves.

    `axis` (…, 3) are directions of the thrust; it moves along axes of the numbers `along`.
    """
    ways = np.stack([axis, *(np.cross(np.eye(3)[k], axis) for k in about)], axis=-1)
    moves = np.broadcast_to(np.eye(3)[:, along], (*axis.shape, len(along)))
    both = np.concatenate([ways, moves], axis=-1)
    reached, wanted = (np.linalg.matrix_rank(x, tol=RANK) for x in (ways, both))
    return bool(np.all(reached == wanted))


def farthest(ways: Array, limits: Array, value: Array) -> Array | None:
    """The steps z (k) for which ways z is within limits and value · z is greatest; None if none is.

    `ways` are (N, k), `limits` (2, N). Raises `UsageError` if SciPy fails.
    """
    low, high = limits
    # The tolerances of SciPy's solver are absolute.
    scale = np.abs(ways).max(axis=0, initial=0.0)
    scale[scale == 0.0] = 1.0
    size = float(np.abs(limits).max(initial=0.0)) or 1.0
    ways, low, high, worth = ways / scale, low / size, high / size, value / scale
    if len(worth) == 1:
        moves = ways[:, 0] != 0.0
        ends = np.sort(np.array([low, high])[:, moves] / ways[moves, 0], axis=0)
        least, most = ends[0].max(initial=-np.inf), ends[1].min(initial=np.inf)
        beyond = max(least - most, np.maximum(low, -high)[~moves].max(initial=-np.inf))
        step = most if worth > 0.0 else least if worth < 0.0 else np.clip(0.0, least, most)
        return None if beyond > _FEASIBLE else np.array([step]) * size / scale
    from scipy.optimize import linprog  # It takes longer to import than all else here.

    optimum = linprog(
        -worth / (np.abs(worth).max(initial=0.0) or 1.0),
        A_ub=np.concatenate([ways, -ways]),
        b_ub=np.concatenate([high, -low]),
        bounds=(None, None),
        method="highs",
    )
    if optimum.status == _INFEASIBLE:
        return None
    if not optimum.success:
        raise UsageError(f"SciPy finds no thrusts within limits: {optimum.message}")
    return np.asarray(optimum.x) * size / scale
