"""Motions of a linear model that its inputs do not reach."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import schur

from gibbs_codegen.simulator.plant.vehicle import Array

# Share of the largest influence below which one is rounding.
_RANK = 1e-9


def unreached(a: Array, b: Array, matters: Callable[[complex], bool]) -> Array:
    """Orthonormal combinations (n, k) that no input reaches, and whose eigenvalues matter.

    For a column w, wᵀ x goes its own way. Eigenvalues of the whole model would not serve: those of
    integrators are double, and rounding moves them by its square root. So what inputs reach is
    taken away first.
    """
    rest = _complement(_reached(a, b))
    if not rest.shape[1]:
        return rest
    _, vectors, count = schur((rest.T @ a @ rest).T, output="complex", sort=matters)
    mattering = vectors[:, :count]
    left, _, _ = np.linalg.svd(np.concatenate([mattering.real, mattering.imag], axis=1))
    combinations: Array = rest @ left[:, :count]
    return combinations


def _reached(a: Array, b: Array) -> Array:
    """Orthonormal columns (n, r) that span B, A B, A² B and so on."""
    reached = np.zeros((len(a), 0))
    added, scale = b, np.linalg.norm(b, 2) if b.size else 0.0
    while added.shape[1]:
        # Twice, since once leaves rounding.
        for _ in range(2):
            added = added - reached @ (reached.T @ added)
        left, values, _ = np.linalg.svd(added, full_matrices=False)
        fresh = left[:, values > _RANK * scale]
        reached = np.concatenate([reached, fresh], axis=1)
        added, scale = a @ fresh, np.linalg.norm(a, 2)
    return reached


def _complement(columns: Array) -> Array:
    """Orthonormal columns of all that is orthogonal to given ones."""
    left, _, _ = np.linalg.svd(columns)
    complement: Array = left[:, columns.shape[1] :]
    return complement
