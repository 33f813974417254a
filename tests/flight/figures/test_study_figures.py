"""Figures of a study show its table, whatever a study holds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.synthetic_study import EFFORT, LAG, MASS, TIP, synthetic_study

from gibbs_codegen.flight.figures import study as figures
from gibbs_codegen.flight.sweeps.chunks import REASONS
from gibbs_codegen.flight.sweeps.study import Study


@pytest.fixture(scope="module")
def study() -> Study:
    return synthetic_study(Path("study"))


@pytest.mark.slow
def test_every_flight_that_went_on_is_in_the_histogram(study: Study) -> None:
    figure = figures.distributions(study)
    tip, effort = figure.axes
    for axes, measure in ((tip, TIP), (effort, EFFORT)):
        bars: Any = [bar for bar in axes.patches if bar.get_width() and bar.get_y() == 0]
        heights = sum(bar.get_height() for bar in axes.containers[0])
        assert heights == len(study.whole) == 570
        assert axes.get_xlabel() == measure
        assert bars
        median = f"median {np.median(study.whole[measure]):.3g};"
        assert axes.get_title(loc="right").startswith(median)
    # Values over more than two decades are on a logarithmic axis.
    assert (tip.get_xscale(), effort.get_xscale()) == ("log", "linear")
    assert figure.get_suptitle() == "robot0, hover: 590 flights, 20 ended early, 10 cases failed"


def test_what_differs_by_rounding_alone_is_one_value(study: Study) -> None:
    table = study.table.copy()
    table[EFFORT] = np.nextafter(2.0, np.where(np.arange(len(table)) % 2, 2.0, 3.0))
    effort = figures.distributions(replace(study, table=table)).axes[1]
    assert [text.get_text() for text in effort.texts] == ["2 in every flight"]


@pytest.mark.slow
def test_the_worst_are_numbered_over_the_key_that_explains_most(study: Study) -> None:
    tip, effort = figures.worst_cases(study).axes
    assert (tip.get_xlabel(), tip.get_ylabel()) == (MASS, TIP)
    dots, crosses = tip.get_lines()
    early = study.table["stopped"] != ""
    assert np.array_equal(crosses.get_xdata(), study.table[MASS][early])
    assert np.array_equal(dots.get_ydata(), study.table[TIP][~early], equal_nan=True)
    for axes, measure in ((tip, TIP), (effort, EFFORT)):
        worst = study.worst(measure)
        named = ", ".join(f"{rank}: {each.case}" for rank, each in enumerate(worst, start=1))
        assert axes.get_title(loc="left") == f"worst cases {named}"
        numbers = " ".join(text.get_text() for text in axes.texts).split()
        assert sorted(numbers) == ["1", "2", "3", "4", "5"]
        for text in axes.texts:
            first = worst[int(text.get_text().split()[0]) - 1]
            assert text.xy == (study.table[MASS][first.case], first.value)


@pytest.mark.slow
def test_worst_flights_that_are_alike_share_the_place_of_a_number() -> None:
    alike = synthetic_study(Path("alike"), broken=False)
    alike.table[TIP][7:10] = alike.table[TIP].max() + 1.0
    alike.table[MASS][7:9] = 1.0
    alike.table[MASS][9] = 0.8
    axes = figures.worst_cases(alike).axes[0]
    assert [text.get_text() for text in axes.texts][:2] == ["1 2", "3"]
    assert not axes.collections


@pytest.mark.slow
def test_the_figures_are_those_that_a_new_table_removes(study: Study, tmp_path: Path) -> None:
    kept = replace(study, folder=tmp_path)
    kept.save()
    paths = figures.write_study_figures(kept, tmp_path)
    kept.save()
    assert all(path.exists() for path in paths)
    replace(kept, table=kept.table[::-1]).save()
    assert not any(path.exists() for path in paths)


@pytest.mark.slow
def test_keys_that_a_robot_does_not_have_hide_no_flight(study: Study) -> None:
    table = study.table.copy()
    table[MASS][::2] = np.nan
    assert figures.worst_cases(replace(study, table=table)).axes[0].get_xlabel() == LAG


def test_bars_are_the_shares_with_their_intervals(study: Study) -> None:
    for axes, measure in zip(figures.sensitivities(study).axes, study.measures, strict=True):
        found = study.sensitivity(measure)
        assert [text.get_text() for text in axes.get_yticklabels()] == [e.key for e in found]
        bars: Any = [axes.containers[0], axes.containers[2]]
        # Those of both kinds lie side by side.
        assert all(
            one.get_y() + one.get_height() <= other.get_y()
            for one, other in zip(*bars, strict=True)
        )
        intervals: Any = axes.collections
        for drawn, lines, place in zip(bars, intervals, (1, 3), strict=True):
            assert [bar.get_width() for bar in drawn] == [each[place] for each in found]
            for (low, high), each in zip(lines.get_segments(), found, strict=True):
                share, error = each[place], each[place + 1]
                assert low[0] == pytest.approx(max(share - error, 0.0), abs=1e-12)
                assert high[0] == pytest.approx(min(share + error, 1.0))


def _odd_studies() -> dict[str, Study]:
    few = synthetic_study(Path("few"), 8, broken=False)
    few.table["stopped"] = "at t = 0 s: $5 of θ₀ is too_much"
    few.table[TIP] = np.nan
    alike = synthetic_study(Path("alike"), 60, robots=6, broken=False)
    alike.table[TIP] = 1e-9
    fixed = synthetic_study(Path("fixed"), 60)
    dtype = [("$x" if name == TIP else name, kind) for name, kind in fixed.table.dtype.descr]
    odd = replace(fixed, table=fixed.table.astype(dtype))
    none = replace(fixed, cases=[replace(case, values={}) for case in fixed.cases])
    columns = ["case", "robot", "scenario", EFFORT, *REASONS]
    return {
        "few": few,
        "alike": alike,
        "$": odd,
        "no key": replace(none, table=fixed.table[columns]),
    }


@pytest.mark.parametrize("kind", ["few", pytest.param("alike", marks=pytest.mark.slow), "no key"])
def test_a_study_of_any_kind_is_drawn(kind: str, tmp_path: Path) -> None:
    study = _odd_studies()[kind]
    paths = figures.write_study_figures(study, tmp_path, ("svg",))
    assert [path.name for path in paths] == [f"{d.__name__}.svg" for d in figures.FIGURES]
