"""Values that a sweep's keys take on."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.stats

from gibbs_codegen import UsageError, log_uniform, normal, scaled, together, uniform
from gibbs_codegen.flight.distributions import varied
from gibbs_codegen.flight.sweeps.cases import noise_seed, shares


@pytest.mark.parametrize(
    ("given", "known"),
    [
        (uniform(-1.0, 3.0), scipy.stats.uniform(-1.0, 4.0)),
        (normal(2.0, 0.5), scipy.stats.norm(2.0, 0.5)),
        (log_uniform(0.01, 10.0), scipy.stats.loguniform(0.01, 10.0)),
    ],
)
def test_numbers_are_of_the_distribution(given, known):
    drawn = given.draw.at(shares(1000, 1, seed=3)[:, 0])
    assert np.all(np.isfinite(drawn))
    # Points of Sobol are so even that a thousand fit ten times as well as independent draws.
    assert scipy.stats.kstest(drawn, known.cdf).statistic < 4e-3


def test_the_first_samples_stay_when_there_are_more():
    assert np.array_equal(shares(2000, 5, seed=1)[:700], shares(700, 5, seed=1))
    assert not np.array_equal(shares(8, 5, seed=1), shares(8, 5, seed=2))


def test_points_fill_the_square_evenly():
    cells = (shares(256, 2, seed=0) * 16).astype(int)
    assert len({tuple(cell) for cell in cells.tolist()}) == 256


def test_noise_differs_from_sample_to_sample():
    seeds = {noise_seed(seed, sample) for seed in range(20) for sample in range(50)}
    assert len(seeds) == 1000
    assert all(0 <= seed < 2**63 for seed in seeds)


def test_what_scaled_and_together_take():
    assert scaled([0.8, 1.0]) == scaled((0.8, 1.0))
    assert scaled(0.8, 1.2).draw == uniform(0.8, 1.2).draw
    assert together(scaled(normal(1.0, 0.1))).relative
    assert varied(np.array([1.0, 2.0])).levels == (1.0, 2.0)
    assert varied([np.zeros(2), (np.float64(1.0),)]).levels == ([0.0, 0.0], [1.0])
    assert varied("geometric").levels == ("geometric",)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda: uniform(2.0, 1.0), r"uniform\(2.0, 1.0\): the first number must be below"),
        (lambda: uniform(0.0, float("nan")), "two finite numbers"),
        (lambda: normal(0.0, 0.0), "the standard deviation, must be above 0"),
        (lambda: log_uniform(0.0, 1.0), "must be above 0"),
        (lambda: varied([]), "an empty list"),
    ],
)
def test_what_means_nothing_is_refused(wrong, words):
    with pytest.raises(UsageError, match=words):
        wrong()
