"""A study answers what its table says, and is read back as it was."""

from __future__ import annotations

import csv
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.synthetic_study import EFFORT, LAG, MASS, TIP, synthetic_study

from gibbs_codegen.cli.app import argument_parser
from gibbs_codegen.errors import OutputError, UsageError
from gibbs_codegen.files.toml import changes_of
from gibbs_codegen.flight.sweeps.cases import Case
from gibbs_codegen.flight.sweeps.study import Study, read_study


@pytest.fixture
def study(tmp_path: Path) -> Study:
    return synthetic_study(tmp_path / "study")


def test_columns_are_told_apart(study: Study) -> None:
    assert study.keys == (MASS, LAG, "control.law")
    assert study.measures == (TIP, EFFORT)
    assert len(study.failures) == 10
    assert len(study.stopped) == 20
    assert set(study.failures["case"]).isdisjoint(study.stopped["case"])
    assert len(study.whole) == 600 - 30


def test_the_summary_is_of_flights_that_went_on_to_their_end(study: Study) -> None:
    tip, effort = study.summary()
    kept = [row[TIP] for row in study.table if not row["stopped"] and not row["failed"]]
    assert tip.flights == effort.flights == len(kept)
    assert tip[2:] == pytest.approx(np.quantile(kept, [0, 0.05, 0.5, 0.95, 1]))
    assert tip.least == min(kept)
    none = Study(study.folder, study.cases[:5], study.table[:0])
    assert none.summary()[0].flights == 0
    assert np.isnan(none.summary()[0].median)


def test_the_worst_are_the_greatest_or_the_smallest(study: Study) -> None:
    values = [row[TIP] for row in study.table]
    worst = study.worst(TIP, 4)
    assert [each.value for each in worst] == sorted(v for v in values if v == v)[:-5:-1]
    assert all(values[each.case] == each.value for each in worst)
    assert worst[0].stopped == "at t = 0.31 s: control was lost: x is 20 m off"
    assert study.worst(EFFORT, 1, smallest=True)[0].value == np.nanmin(study.table[EFFORT])
    assert len(study.worst(TIP, 10_000)) == 590
    with pytest.raises(UsageError, match="tips: no such measure; there are tip, effort"):
        study.worst("tips")


@pytest.mark.parametrize(
    "changes",
    [
        {"start.offset": [0.1, -0.2, 1e-17], "duration": 1 / 3},
        {"control.law": "open_loop", "motors.compensation": False},
        {"name": 'it\'s "5"; $(rm) # {x', "push": {"frame": "tip", "force": [0, 0, 5.0]}},
        {"motors.limits": [-float("inf"), 1e300], "sensors.seed": 12345678901},
        {"arm.tip": None},
    ],
)
def test_the_command_gives_back_every_change(study: Study, changes: dict[str, Any]) -> None:
    """What a shell makes of the words is what the scenario is changed by, to the last bit."""
    case = Case(0, "my robots/a.toml", "hover", {}, changes)
    words = shlex.split(replace(study, cases=[case]).command(0))
    options = argument_parser().parse_args(words[1:])
    assert (options.robot, options.scenario) == ("my robots/a.toml", "hover")
    given = changes_of(options.set)
    for key, value in changes.items():
        *tables, last = key.split(".")
        place = given
        for table in tables:
            place = place[table]
        assert place[last] == value
        assert type(place[last]) is type(value)


def test_keys_with_influence_come_first(study: Study) -> None:
    tip, effort = study.sensitivity(TIP), study.sensitivity(EFFORT)
    assert tip[0].key == MASS
    assert tip[0].alone > 0.5
    assert abs(tip[0].correlation) < 0.15
    lag = next(each for each in tip if each.key == LAG)
    assert lag.alone <= lag.alone_error
    assert [each.key for each in effort][:2] == [MASS, "control.law"]
    assert effort[0].correlation > 0.9


def test_robots_count_as_a_key_where_there_are_several(tmp_path: Path) -> None:
    study = synthetic_study(tmp_path, robots=2)
    assert {each.key for each in study.sensitivity(TIP)} == {"robot", *study.keys}


def test_a_parameter_that_a_robot_does_not_have_is_a_key_of_the_others(tmp_path: Path) -> None:
    study = synthetic_study(tmp_path, robots=2)
    study.table[MASS][study.table["robot"] == "robot0"] = np.nan
    assert study.sensitivity(EFFORT)[0].key == MASS
    study.table[MASS] = np.nan
    none = replace(study)  # It keeps rows that it looked at.
    assert MASS not in {each.key for each in none.sensitivity(EFFORT)}


def test_a_study_is_read_back_as_it_was(study: Study) -> None:
    study.save()
    back = read_study(study.folder)
    assert list(back.cases) == list(study.cases)
    assert back.table.dtype == study.table.dtype
    assert back.table.tobytes() == study.table.tobytes()
    with (study.folder / "table.csv").open(encoding="utf-8", newline="") as file:
        names, *rows = csv.reader(file)
    assert tuple(names) == study.table.dtype.names
    assert [float(row[names.index(EFFORT)]) for row in rows] == pytest.approx(
        study.table[EFFORT], rel=0, nan_ok=True
    )
    assert sorted(p.name for p in study.folder.iterdir()) == [
        "cases.json",
        "table.csv",
        "table.npy",
    ]


def test_two_studies_of_the_same_have_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        synthetic_study(tmp_path / name, 50).save()
    for file in ("cases.json", "table.csv", "table.npy"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_what_is_no_study_is_refused(study: Study, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="nowhere: there is no such folder"):
        read_study(tmp_path / "nowhere")
    study.save()
    np.save(study.folder / "table.npy", study.table[::-1])
    with pytest.raises(UsageError, match=r"table.npy and cases.json are of different studies"):
        read_study(study.folder)
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="cannot be written"):
        replace(study, folder=tmp_path / "file").save()


@pytest.mark.slow  # pyarrow is in the extra `ci`.
def test_parquet_has_the_table(study: Study, tmp_path: Path) -> None:
    from pyarrow import parquet

    study.to_parquet(tmp_path / "table.parquet")
    back = parquet.read_table(tmp_path / "table.parquet").to_pydict()
    assert tuple(back) == study.table.dtype.names
    for name, values in back.items():
        assert np.array_equal(values, study.table[name], equal_nan=name in study.measures)
    with pytest.raises(OutputError, match="cannot be written"):
        study.to_parquet(tmp_path)
