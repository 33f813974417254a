"""Shares are those of statistics, in both directions of a key, and errors hold what they say."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from gibbs_codegen.flight.sweeps.sensitivity import Sensitivity, sensitivities


def of_one(values: NDArray[Any], measure: NDArray[np.float64]) -> Sensitivity:
    (found,) = sensitivities({"key": values}, measure)
    return found


@pytest.mark.parametrize("names", [["a", "b", "c"], [0.0, 0.01, 0.02]])
def test_shares_of_groups_are_those_of_kruskal_and_wallis(names: list[object]) -> None:
    random = np.random.default_rng(1)
    place = random.integers(0, 3, 200)
    measure = random.standard_normal(200) + 0.7 * place
    found = of_one(np.array(names)[place], measure)
    statistic = stats.kruskal(*(measure[place == group] for group in range(3))).statistic
    assert found.alone == pytest.approx(1.0 - (1.0 - statistic / 199) * 199 / 197, rel=1e-12)
    if isinstance(names[0], str):
        assert np.isnan(found.correlation)
    else:
        assert found.correlation == pytest.approx(stats.spearmanr(place, measure).statistic)


def test_flights_without_a_key_are_left_out_of_it() -> None:
    """As a robot with fewer links has it: NaN, beside a key that all flights have."""
    random = np.random.default_rng(8)
    key, other = random.uniform(size=(2, 400))
    measure = key + other
    key[::2] = np.nan
    measure[::2] = 5.0 + other[::2]
    found, always = sensitivities({"key": key, "other": other}, measure)
    assert found.alone == pytest.approx(of_one(key[1::2], measure[1::2]).alone)
    assert found.correlation == pytest.approx(stats.spearmanr(key[1::2], measure[1::2])[0])
    assert np.isfinite([*found[1:], *always[1:]]).all()


def test_harm_in_both_directions_is_seen() -> None:
    """A correlation sees nothing where a value is bad for being too small as for too great."""
    mass = np.random.default_rng(2).uniform(0.8, 1.2, 2000)
    found = of_one(mass, abs(mass - 1.0))
    assert abs(found.correlation) < 0.1
    assert found.alone > 0.9
    assert found.joint == 0.0


@pytest.mark.parametrize("kind", ["numbers", "texts", "both"])
def test_keys_that_do_harm_together_are_seen(kind: str) -> None:
    """The measure is great where two keys agree, of which neither says anything alone."""
    random = np.random.default_rng(6)
    first, second, other = random.choice([-1.0, 1.0], (3, 1000))
    measure = first * second + 0.5 * random.standard_normal(1000)
    keys: dict[str, NDArray[Any]] = {"first": first, "second": second, "other": other}
    if kind != "numbers":
        keys["first"] = np.where(first > 0, "on", "off")
    if kind == "texts":
        keys["second"] = np.where(second > 0, "left", "right")
    one, two, none = sensitivities(keys, measure)
    # Of a least-squares fit of the product to the ranks.
    true = stats.spearmanr(first * second, measure).statistic ** 2
    for each in (one, two):
        assert abs(each.alone) <= each.alone_error + 0.01
        assert abs(each.joint - true) < each.joint_error < 0.1
    assert none.joint < 0.01


def test_a_flight_that_went_astray_changes_little() -> None:
    random = np.random.default_rng(3)
    key = random.uniform(size=500)
    measure = key + 0.3 * random.standard_normal(500)
    before = of_one(key, measure)
    measure[17] = 1e9
    assert of_one(key, measure).alone == pytest.approx(before.alone, abs=0.01)


@pytest.mark.slow
def test_nineteen_of_twenty_intervals_hold_the_true_shares() -> None:
    random = np.random.default_rng(4)

    def draw(flights: int) -> Sensitivity:
        first, second = random.uniform(-0.5, 0.5, (2, flights))
        measure = random.standard_normal(flights)
        return sensitivities({"first": first, "second": second}, measure)[0]

    true, studies = draw(100_000), [draw(300) for _ in range(100)]
    assert np.mean([abs(each.alone - true.alone) <= each.alone_error for each in studies]) > 0.88
    assert np.mean([abs(each.joint - true.joint) <= each.joint_error for each in studies]) > 0.88


def test_what_cannot_be_known_is_not_a_number() -> None:
    random = np.random.default_rng(5)
    few, many = random.uniform(size=19), random.uniform(size=50)
    for key, measure in ((few, few), (many, np.ones(50))):
        assert np.isnan(of_one(key, measure)[1:]).all()
    assert np.isnan(of_one(np.ones(50), many).alone)
    assert np.isnan(of_one(np.ones(50), many).correlation)
    # A surface over twelve keys has more terms than fifty flights can tell apart.
    found = sensitivities({str(key): random.uniform(size=50) for key in range(12)}, many)
    assert np.isnan([each.joint for each in found]).all()
    assert np.isfinite([each.alone for each in found]).all()
