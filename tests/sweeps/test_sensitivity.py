"""Shares are those of statistics, in both directions of a key, and errors hold what they say."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gibbs_codegen.sweeps.sensitivity import sensitivity


@pytest.mark.parametrize("names", [["a", "b", "c"], [0.0, 0.01, 0.02]])
def test_shares_of_groups_are_those_of_kruskal_and_wallis(names: list[object]) -> None:
    random = np.random.default_rng(1)
    place = random.integers(0, 3, 200)
    measure = random.standard_normal(200) + 0.7 * place
    found = sensitivity("key", np.array(names)[place], measure)
    statistic = stats.kruskal(*(measure[place == group] for group in range(3))).statistic
    assert found.share == pytest.approx(1.0 - (1.0 - statistic / 199) * 199 / 197, rel=1e-12)
    if isinstance(names[0], str):
        assert np.isnan(found.correlation)
    else:
        assert found.correlation == pytest.approx(stats.spearmanr(place, measure).statistic)


def test_harm_in_both_directions_is_seen() -> None:
    """A correlation sees nothing where a value is bad for being too small as for too great."""
    mass = np.random.default_rng(2).uniform(0.8, 1.2, 2000)
    found = sensitivity("mass", mass, abs(mass - 1.0))
    assert abs(found.correlation) < 0.1
    assert found.share > 0.9


def test_a_flight_that_went_astray_changes_little() -> None:
    random = np.random.default_rng(3)
    key = random.uniform(size=500)
    measure = key + 0.3 * random.standard_normal(500)
    before = sensitivity("key", key, measure)
    measure[17] = 1e9
    assert sensitivity("key", key, measure).share == pytest.approx(before.share, abs=0.01)


@pytest.mark.parametrize("slope", [0.0, 0.3, 2.0])
def test_nineteen_of_twenty_intervals_hold_the_true_share(slope: float) -> None:
    random = np.random.default_rng(4)

    def draw(flights: int) -> tuple[float, float]:
        key = random.uniform(size=flights)
        measure = slope * (key - 0.5) ** 2 + 0.1 * random.standard_normal(flights)
        return sensitivity("key", key, measure)[1:3]

    true = draw(200_000)[0]
    held = [abs(share - true) <= error for share, error in (draw(300) for _ in range(100))]
    assert np.mean(held) > 0.88


def test_what_cannot_be_known_is_not_a_number() -> None:
    random = np.random.default_rng(5)
    few, many = random.uniform(size=19), random.uniform(size=50)
    for key, measure in ((few, few), (np.ones(50), many), (many, np.ones(50))):
        found = sensitivity("key", key, measure)
        assert np.isnan([found.share, found.error, found.correlation]).all()
