"""How much of what varies in a measure each key explains alone, with how far off that may be.

The measure is replaced by its ranks, so that a few flights that went astray do not decide. The
flights are put into groups by the key, of equal values or of equally many neighbouring ones. The
share that a key explains is how much of the variance of the ranks lies between the groups, as in
the test of Kruskal and Wallis: the first-order index of Sobol, of ranks. A correlation would
overlook keys that do harm in both directions, such as a mass that is not as the law knows it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy.stats
from numpy.typing import NDArray

# Groups of neighbours, flights in each at least, and flights in all without which nothing is said.
_MOST_GROUPS, _LEAST_OF_GROUP, _LEAST_FLIGHTS = 10, 5, 20
# Parts that are left out in turn, to see how much a share depends on which flights there are.
_PARTS = 20


class Sensitivity(NamedTuple):
    """How a measure depends on a key.

    Attributes:
        key: the key.
        share: what the key explains alone of the variance of the measure's ranks, 0 to 1.
        error: half the width of the interval around it that holds the true share in 95 of 100
            studies.
        correlation: rank correlation (Spearman) of key and measure, −1 to 1: which way the measure
            goes with the key, if it goes one way. NaN for keys that are no numbers.
    """

    key: str
    share: float
    error: float
    correlation: float


def sensitivity(key: str, values: NDArray[Any], measure: NDArray[np.float64]) -> Sensitivity:
    """How a measure depends on a key.

    Args:
        key: The key.
        values: Its values (n): numbers, or texts that are no more than names.
        measure: The measure (n), finite.

    Returns:
        Share, error and correlation; NaN where the flights are too few, or are all alike.
    """
    group, numbers = _groups(values), values.dtype.kind in "fiub"
    ranks = scipy.stats.rankdata(measure)
    if len(ranks) < _LEAST_FLIGHTS or group.max() == 0 or np.ptp(ranks) == 0.0:
        return Sensitivity(key, np.nan, np.nan, np.nan)
    share = _share(group, ranks)
    # The jackknife. Neighbours in the order of the cases are spread over the parts.
    part = np.arange(len(ranks)) % _PARTS
    without = np.array([_share(group[part != left], ranks[part != left]) for left in range(_PARTS)])
    spread = (_PARTS - 1.0) / _PARTS * np.sum((without - without.mean()) ** 2)
    error = float(scipy.stats.t.ppf(0.975, _PARTS - 1) * np.sqrt(spread))
    places = scipy.stats.rankdata(values) if numbers else np.zeros(len(ranks))
    correlation = float(np.corrcoef(places, ranks)[0, 1]) if np.ptp(places) > 0.0 else np.nan
    return Sensitivity(key, float(np.clip(share, 0.0, 1.0)), error, correlation)


def _groups(values: NDArray[Any]) -> NDArray[np.int_]:
    """Numbers (n) of the groups of flights: of equal values where these are few, or neighbours."""
    distinct, place = np.unique(values, return_inverse=True)
    most = min(_MOST_GROUPS, len(values) // _LEAST_OF_GROUP)
    if len(distinct) <= max(most, 2) or values.dtype.kind not in "fiub":
        return place
    order = scipy.stats.rankdata(values, method="ordinal") - 1
    groups: NDArray[np.int_] = order * most // len(values)
    return groups


def _share(group: NDArray[np.int_], ranks: NDArray[np.float64]) -> float:
    """The share of the variance that lies between groups, less what chance puts there."""
    count = np.bincount(group)
    groups, flights = int(np.count_nonzero(count)), len(ranks)
    means = np.bincount(group, ranks) / np.maximum(count, 1)
    between = float(count @ (means - ranks.mean()) ** 2)
    total = float(np.sum((ranks - ranks.mean()) ** 2))
    if flights <= groups:
        return float("nan")
    # Epsilon squared (Kelley 1935): without influence it is 0 on the average.
    within = (total - between) / (flights - groups)
    return 1.0 - within * (flights - 1.0) / total
