"""Shares of a measure's variance that its keys explain, with their errors.

The measure is replaced by its ranks, so that a few flights that went astray do not decide.

Alone: the flights are put into groups by the key, of equal values or of equally many neighbouring
ones. The share that a key explains is how much of the variance of the ranks lies between the
groups, as in the test of Kruskal and Wallis: the first-order index of Sobol, of ranks. A
correlation would overlook keys that do harm in both directions, such as a mass that is not as the
law knows it.

With others: masses that are off in the same direction add up, and in opposite directions make up
for each other, which no key shows by itself. A surface of the second degree over the ranks of all
keys is fitted to the ranks of the measure; the share is what it explains less without the products
of the key with others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from gibbs_codegen.flight.vectors import Array

# Groups of neighbours, flights in each at least, and flights in all without which nothing is said.
_MOST_GROUPS, _LEAST_OF_GROUP, _LEAST_FLIGHTS = 10, 5, 20
# Flights that a surface needs for each of its terms, of which there may be so many.
_FLIGHTS_OF_TERM, _MOST_TERMS = 3, 600
# Parts that are left out in turn, to see how much a share depends on which flights there are.
_PARTS = 20


class Sensitivity(NamedTuple):
    """The dependence of a measure on a key; NaN where nothing can be said.

    - `alone`: what the key explains alone of the variance of the measure's ranks, 0 to 1.
    - `alone_error`: half the width of the interval around it that holds the true share in 95 of 100
      studies.
    - `joint`, `joint_error`: the same of products with others; each key of a product has it.
    - `correlation`: rank correlation (Spearman) of key and measure, −1 to 1: which way the measure
      goes with the key, if it goes one way. NaN for keys that are no numbers.
    """

    key: str
    alone: float
    alone_error: float
    joint: float
    joint_error: float
    correlation: float


def sensitivities(keys: Mapping[str, NDArray[Any]], measure: Array) -> list[Sensitivity]:
    """The dependence of a measure (n), which is finite, on some keys.

    Keys have values (n): numbers, or texts that are no more than names. NaN is a flight that has no
    such key, which what is said of the key leaves out.
    """
    ranks = scipy.stats.rankdata(measure)
    if len(ranks) < _LEAST_FLIGHTS or np.ptp(ranks) == 0.0:
        return [Sensitivity(key, *[np.nan] * 5) for key in keys]
    # Neighbours in the order of the cases are spread over the parts.
    part = np.arange(len(ranks)) % _PARTS
    has_key = [values == values for values in keys.values()]  # NaN is unlike itself.
    pairs = list(zip(keys.values(), has_key, strict=True))
    alone = [_first_order(_groups(values[has]), measure[has], part[has]) for values, has in pairs]
    joint = _joint([_features(values) for values in keys.values()], ranks, part)
    ways = [_correlation(values[has], measure[has]) for values, has in pairs]
    return [
        Sensitivity(key, *a, *j, way)
        for key, a, j, way in zip(keys, alone, joint, ways, strict=True)
    ]


def _correlation(values: NDArray[Any], measure: Array) -> float:
    if values.dtype.kind not in "fiub" or len(np.unique(values)) < 2 or np.ptp(measure) == 0.0:
        return float("nan")
    ranks = [scipy.stats.rankdata(variable) for variable in (values, measure)]
    return float(np.corrcoef(*ranks)[0, 1])


def _with_error(share: float, without: Array) -> tuple[float, float]:
    """A share with half of its interval, from the shares without each part (the jackknife)."""
    spread = (_PARTS - 1.0) / _PARTS * np.sum((without - without.mean()) ** 2)
    error = scipy.stats.t.ppf(0.975, _PARTS - 1) * np.sqrt(spread)
    return float(np.clip(share, 0.0, 1.0)), float(error)


def _first_order(
    group: NDArray[np.int_], measure: Array, part: NDArray[np.int_]
) -> tuple[float, float]:
    """Share that a key explains alone, and how far off that may be.

    `group` (n) has the numbers of the groups by the key, and `part` (n) has the numbers of the
    parts that are left out in turn. NaN of one group, of few flights, and where the measure is the
    same in all.
    """
    if len(group) < _LEAST_FLIGHTS or group.max() == 0 or np.ptp(measure) == 0.0:
        return float("nan"), float("nan")
    ranks = scipy.stats.rankdata(measure)
    without = [_between(group[part != left], ranks[part != left]) for left in range(_PARTS)]
    return _with_error(_between(group, ranks), np.array(without))


def _groups(values: NDArray[Any]) -> NDArray[np.int_]:
    """Numbers (n) of the groups of flights: of equal values where these are few, or neighbours."""
    distinct, place = np.unique(values, return_inverse=True)
    most = min(_MOST_GROUPS, len(values) // _LEAST_OF_GROUP)
    if len(distinct) <= max(most, 2) or values.dtype.kind not in "fiub":
        return place
    order = scipy.stats.rankdata(values, method="ordinal") - 1
    return order * most // len(values)


def _between(group: NDArray[np.int_], ranks: Array) -> float:
    """The share of the variance that lies between groups, less that by chance."""
    count = np.bincount(group)
    groups, flights = int(np.count_nonzero(count)), len(ranks)
    if flights <= groups:
        return float("nan")
    means = np.bincount(group, ranks) / np.maximum(count, 1)
    between = float(count @ (means - ranks.mean()) ** 2)
    total = float(np.sum((ranks - ranks.mean()) ** 2))
    # Epsilon squared (Kelley 1935): without influence it is 0 on the average.
    within = (total - between) / (flights - groups)
    return 1.0 - within * (flights - 1.0) / total


def _features(values: NDArray[Any]) -> tuple[Array, int]:
    """Features of a surface for a key (n, f), and the number that it multiplies with others'.

    These are Legendre's polynomials of the ranks of numbers, of the first and second degree, and
    for each text but one whether it is that; 0 where a flight has no such key.
    """
    if not (has := values == values).all():
        inner, multiplied = _features(values[has])
        features = np.zeros((len(values), inner.shape[1]))
        features[has] = inner
        return features, multiplied
    distinct = np.unique(values)
    if values.dtype.kind not in "fiub":
        features = (values[:, np.newaxis] == distinct[1:]).astype(float)
        return features - features.mean(axis=0), features.shape[1]
    place = 2.0 * (scipy.stats.rankdata(values) - 0.5) / len(values) - 1.0
    curves = [place - place.mean(), 1.5 * place**2 - 0.5][: max(len(distinct) - 1, 0)]
    return np.stack(curves, axis=-1) if curves else np.zeros((len(values), 0)), min(len(curves), 1)


def _joint(
    features: Sequence[tuple[Array, int]], ranks: Array, part: NDArray[np.int_]
) -> list[tuple[float, float]]:
    """Share that each key explains in products with others, and how far off that may be.

    `features` are as `_features` gives them, `ranks` (n) of the measure, and `part` (n) as of
    `_first_order`. NaN where there are too few flights for so many keys.
    """
    terms = [np.ones((len(ranks), 1)), *(columns for columns, _ in features)]
    owners: list[set[int]] = [set() for columns in terms for _ in range(columns.shape[1])]
    for second, (columns, count) in enumerate(features):
        for first, (others, other_count) in enumerate(features[:second]):
            product = others[:, :other_count, np.newaxis] * columns[:, np.newaxis, :count]
            terms.append(product.reshape(len(ranks), -1))
            owners += [{first, second}] * terms[-1].shape[1]
    if len(owners) > min(_MOST_TERMS, len(ranks) // _FLIGHTS_OF_TERM):
        return [(float("nan"), float("nan"))] * len(features)
    whole = np.concatenate([*terms, ranks[:, np.newaxis] - ranks.mean()], axis=1)
    grams = np.stack([whole[part == k].T @ whole[part == k] for k in range(_PARTS)])
    kept = [np.array([key not in owner for owner in owners]) for key in range(len(features))]
    chosen = np.ones(len(owners), dtype=bool)

    def lost(gram: Array) -> Array:
        return _explained(gram, chosen) - np.array([_explained(gram, which) for which in kept])

    total = grams.sum(axis=0)
    without = np.stack([lost(total - gram) for gram in grams])
    return [_with_error(*gains) for gains in zip(lost(total), without.T, strict=True)]


def _explained(gram: Array, kept: NDArray[np.bool_]) -> float:
    """Adjusted coefficient of determination: the share of the variance that the kept terms explain.

    What chance lets them explain is taken off. `gram` has the sums of products of terms, the first
    of which is 1, and of the measure, which is last.
    """
    matrix, right = gram[:-1, :-1][np.ix_(kept, kept)], gram[:-1, -1][kept]
    flights = gram[0, 0]
    # Terms may be the same where keys have few values.
    ridge = 1e-10 * np.trace(matrix) / len(matrix)
    fitted = right @ np.linalg.solve(matrix + ridge * np.eye(len(matrix)), right)
    total = gram[-1, -1] - gram[0, -1] ** 2 / flights
    rest = (gram[-1, -1] - fitted) / (flights - np.count_nonzero(kept))
    return float(1.0 - rest * (flights - 1.0) / total)
