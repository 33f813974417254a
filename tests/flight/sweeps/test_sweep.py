"""Sweeps: the table is that of single flights, whatever computes it and in whatever pieces."""

from __future__ import annotations

import errno
import sys
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from gibbs_codegen import (
    GibbsCodegenError,
    OutputError,
    UsageError,
    load,
    normal,
    read_scenario,
    scaled,
    simulate,
    sweep,
    together,
    uniform,
)
from gibbs_codegen.files.toml import nested
from gibbs_codegen.flight import many
from gibbs_codegen.flight.scenario.parts import Motors, StartOffset
from gibbs_codegen.flight.sweeps import chunks

SHORT = {"duration": 0.05, "integration.method": "rk4"}
LATE = {**SHORT, "plant.*mass_per_length": scaled(0.8, 1.2), "start.offset[1]": uniform(-0.1, 0.1)}
WORST = {"worst [m]": "tip_error.max"}
# The end of flights long enough, and near enough to their limits, to show whatever rounds.
END = {"end": lambda flight: flight.q[-1].sum()}
FAR = {
    **LATE,
    "start.offset[1]": uniform(-0.01, 0.01),
    "duration": 1.0,
    "motors.limits": [[-60.0, 60.0]],
    "motors.time_constant": [0.0, 0.01],
}


class Backwards(Executor):
    """Computes what was asked for last, and not before there is nothing more to ask for."""

    def __init__(self, patience):
        self.waiting, self.patience = [], patience

    def submit(self, function, /, *arguments, **named):
        """What will be the result."""
        future = Future()
        self.waiting.append((future, function, arguments))
        if len(self.waiting) == self.patience:
            while self.waiting:
                last, function, arguments = self.waiting.pop()
                last.set_result(function(*arguments))
        return future


def kept_lines(folder):
    """What is kept of each case, in a line."""
    path = folder / chunks.FILE
    return list(filter(None, path.read_text().split("\n"))) if path.exists() else []


@pytest.fixture
def here():
    with ThreadPoolExecutor(1) as executor:
        yield executor


@pytest.fixture
def alone_is_another(monkeypatch):
    """Flights by themselves differ from those in blocks, however a processor rounds."""
    integrate = many.integrate
    monkeypatch.setattr(many, "integrate", lambda loop, q, *a: integrate(loop, q + 1e-9, *a))


@pytest.mark.slow
def test_measures_are_those_of_single_flights(robot, tmp_path, here):
    measure = {**WORST, "sum": lambda flight: flight.q[-1].sum()}
    parameters = {**LATE, "motors.time_constant": [0, 0.01], "gravity": [9.81, 3.7]}
    study = sweep(robot, "hover", parameters, 2, 5, measure, here, tmp_path)
    assert len(study.table) == 8
    assert not np.any(study.table["failed"] != "")
    module = load(robot, "c")
    for case, row in zip(study.cases, study.table, strict=True):
        flight = simulate(module, read_scenario("hover", nested(case.changes)))
        assert flight.tip_error.max() == pytest.approx(row["worst [m]"], rel=1e-9)
        assert flight.q[-1].sum() == pytest.approx(row["sum"], rel=1e-9)
        assert row["motors.time_constant"] == case.changes["motors.time_constant"]
        assert row["gravity"] == case.changes["parameters.gravity"]
        assert row["start.offset[1]"] == case.changes["start.offset"][1]
        mass = module.PARAMETERS["link3_mass_per_length"]
        assert 0.8 * mass < row["plant.link3_mass_per_length"] < 1.2 * mass


@pytest.mark.slow
def test_samples_are_the_same_in_every_combination(robot, tmp_path, here):
    table = sweep(
        robot, ["hover", "line"], {**LATE, "gravity": [9.81, 3.7]}, 3, 0, WORST, here, tmp_path
    ).table
    offsets = table["start.offset[1]"].reshape(4, 3)
    assert np.array_equal(offsets, np.broadcast_to(offsets[0], (4, 3)))
    assert table["scenario"].tolist() == ["hover"] * 6 + ["line"] * 6
    assert table["gravity"].tolist() == ([9.81] * 3 + [3.7] * 3) * 2


@pytest.mark.slow
@pytest.mark.usefixtures("alone_is_another")
def test_any_chunks_give_the_same_bytes(robot, tmp_path, here, monkeypatch):
    first = sweep(robot, "hover", FAR, 6, 1, END, here, tmp_path / "a")
    assert len(first.whole) == 12
    for flights in (1, 5):
        monkeypatch.setattr(chunks, "_MOST_FLIGHTS", flights)
        other = sweep(robot, "hover", FAR, 6, 1, END, here, tmp_path / str(flights))
        assert other.table.dtype == first.table.dtype
        assert other.table.tobytes() == first.table.tobytes()
    monkeypatch.setattr(chunks, "_MOST_FLIGHTS", 3)
    last = sweep(robot, "hover", FAR, 6, 1, END, Backwards(4), tmp_path / "last")
    assert last.table.tobytes() == first.table.tobytes()


@pytest.mark.slow
def test_one_call_again_flies_nothing(robot, tmp_path, here):
    def never(*_, **__):
        raise AssertionError("flown again")

    first = sweep(robot, "hover", LATE, 4, 1, WORST, here, tmp_path)
    broken = ThreadPoolExecutor(1)
    broken.submit = never
    again = sweep(robot, "hover", LATE, 4, 1, WORST, broken, tmp_path)
    assert again.table.tobytes() == first.table.tobytes()
    with pytest.raises(AssertionError):
        sweep(robot, "hover", LATE, 4, 2, WORST, broken, tmp_path)


@pytest.mark.slow
def test_more_samples_fly_only_what_is_lacking(robot, tmp_path, here, monkeypatch):
    monkeypatch.setattr(chunks, "_MOST_FLIGHTS", 2)
    parameters = {**LATE, "motors.time_constant": [0.0, 0.01]}
    found = []
    for samples in (5, 8):
        sweep(robot, "hover", parameters, samples, 1, WORST, here, tmp_path)
        found.append(kept_lines(tmp_path))
    assert [len(lines) for lines in found] == [10, 16]
    assert found[1][:10] == found[0]


def test_a_folder_of_the_users_is_left_alone(robot, tmp_path, here):
    (tmp_path / "table.csv").write_text("mine")
    with pytest.raises(UsageError, match=r"contains table.csv, which no sweep wrote"):
        sweep(robot, "hover", SHORT, executor=here, out=tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["table.csv"]


def test_a_flight_that_is_refused_is_a_row_with_its_reason(robot, tmp_path, here):
    parameters = {**SHORT, "plant.link3_mass_per_length": [1.0, -1e3]}
    measure = {**WORST, "fails": lambda flight: 1 / 0, "ends": lambda flight: sys.exit(3)}
    study = sweep(robot, "hover", parameters, measure=measure, executor=here, out=tmp_path)
    table = study.table
    assert table["unmeasured"].tolist() == [
        "measure fails: ZeroDivisionError: division by zero",
        "",
    ]
    assert (study.whole["case"], study.failures["case"], study.unmeasured["case"]) == (0, 1, 0)
    assert [each.flights for each in study.summary()] == [1, 0, 0]
    assert "masses and inertias that are zero or negative" in table["failed"][1]
    assert np.isnan(table["worst [m]"][1])
    assert np.isfinite(table["worst [m]"][0])


@pytest.mark.slow
def test_own_processes_fly_lambdas(robot, tmp_path, here):
    there = sweep(robot, "hover", LATE, 2, 0, {"x": lambda f: f.q.sum()}, None, tmp_path / "a")
    same = sweep(robot, "hover", LATE, 2, 0, {"x": lambda f: f.q.sum()}, here, tmp_path / "b")
    assert there.table.tobytes() == same.table.tobytes()


def test_one_factor_for_all_that_match(robot, tmp_path, here):
    parameters = {**SHORT, "plant.*mass_per_length": together(scaled(0.8, 1.2))}
    study = sweep(robot, "hover", parameters, 3, 0, WORST, here, tmp_path)
    known = load(robot).PARAMETERS
    for case, factor in zip(study.cases, study.table["plant.*mass_per_length"], strict=True):
        masses = {k: v for k, v in case.changes.items() if k.startswith("plant.")}
        assert len(masses) == 3
        for key, value in masses.items():
            assert value == factor * known[key.removeprefix("plant.")]
        assert 0.8 < factor < 1.2


def test_a_scenario_that_was_made_in_python_varies_too(robot, tmp_path, here):
    plain = read_scenario("hover", nested(SHORT))
    parameters = {
        "plant.gravity": [9.7, 9.8],
        "motors.time_constant": 0.01,
        "start.position[2]": 0.1,
    }
    table = sweep(robot, plain, parameters, measure=WORST, executor=here, out=tmp_path).table
    for gravity, row in zip((9.7, 9.8), table, strict=True):
        scenario = replace(
            plain,
            plant={"gravity": gravity},
            motors=Motors(time_constant=0.01),
            start=StartOffset((0.0, 0.0, 0.1)),
        )
        flight = simulate(load(robot, "c"), scenario)
        assert flight.tip_error.max() == pytest.approx(row["worst [m]"], rel=1e-9)
    with pytest.raises(UsageError, match="a Scenario has no such field; give a scenario file"):
        sweep(robot, plain, {"start.offset": [[0.0, 0.0, 0.1]]}, executor=here, out=tmp_path)


@pytest.mark.slow
def test_noise_is_another_in_every_sample(robot, tmp_path, here):
    parameters = {**SHORT, "control.rate": 200.0, "sensors.position": [0.01]}
    study = sweep(robot, "hover", parameters, 3, 1, WORST, here, tmp_path)
    assert len({case.changes["sensors.seed"] for case in study.cases}) == 3
    assert len(set(study.table["worst [m]"])) == 3
    module, case = load(robot, "c"), study.cases[1]
    flight = simulate(module, read_scenario("hover", nested(case.changes)))
    assert flight.tip_error.max() == pytest.approx(study.table["worst [m]"][1], rel=1e-9)


@pytest.mark.slow
def test_robots_cross_and_what_is_no_module_is_generated_once(robot, tmp_path, here):
    robots = [robot, "quadrotor_arm_2link"]
    parameters = {**SHORT, "plant.*mass*": scaled(0.9, 1.1), "gravity": [9.81, 9.7]}
    study = sweep(robots, "hover", parameters, 2, 0, WORST, here, tmp_path)
    assert study.table["robot"].tolist() == [robot] * 4 + ["quadrotor_arm_2link"] * 4
    assert np.isnan(study.table["plant.base_mass"][:4]).all()
    assert np.isnan(study.table["plant.link2_mass_per_length"][4:]).all()
    assert np.isfinite(study.table["worst [m]"]).all()
    made = [path.stat().st_mtime_ns for path in (tmp_path / "modules").glob("*/*/MANIFEST")]
    again = sweep(robots, "hover", parameters, 2, 0, WORST, here, tmp_path)
    assert again.table.tobytes() == study.table.tobytes()
    assert [p.stat().st_mtime_ns for p in (tmp_path / "modules").glob("*/*/MANIFEST")] == made
    assert len(made) == 1


def test_what_varies_decides_which_derivatives_are_generated(tmp_path, monkeypatch):
    asked = []

    def generated(word, folder, progress, derivatives, functions):
        asked.extend(derivatives)
        raise UsageError("enough")

    monkeypatch.setattr("gibbs_codegen.flight.sweeps.sweep.robot_source", generated)
    sensors = {"sensors": {"imu": [{}]}, "name": "two", "duration": 1}
    for key, values, name in (
        ("control.estimate", [False, True], "frame_poses_derivatives"),
        ("control.law", ["tracking", "predictive"], "forward_dynamics_derivatives"),
    ):
        with pytest.raises(UsageError, match="enough"):
            sweep("quadrotor", sensors, {key: values}, out=tmp_path)
        assert name in asked
        asked.clear()


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        (
            {"parameters": {"plant.link3_mas_per_length": [1.0]}},
            "no such parameter.*did you mean",
        ),
        ({"parameters": {"motor.time_constant": [1.0]}}, "motor: unknown key; did you mean motors"),
        ({"parameters": {"motors..x": [1.0]}}, "not a key"),
        ({"parameters": {"motors.time_constnt": [0.1]}, "samples": 4}, "time_constnt: unknown key"),
        (
            {"parameters": {"plant.link2_mass_per_length": 1.0, "plant.link2*": scaled(0.8, 1.2)}},
            r"plant.link2_mass_per_length and plant.link2\* both set plant.link2_mass_per_length",
        ),
        ({"parameters": {"gravity": 9.0, "parameters.gravity": 9.1}}, "gravity and parameters.gr"),
        (
            {"parameters": {"start.offset[2]": 0.1, "start.offset": [[0.0] * 3]}},
            "both set start.of",
        ),
        ({"parameters": {"motors.time_constant": scaled(0.5, 2.0)}}, "has no number there"),
        ({"parameters": {"start.offset[3]": [1.0]}}, "has no such entry"),
        (
            {"parameters": {"motors.time_constant": uniform(-0.1, 1), "control.frequency": [5, 0]}},
            r"hover: motors\.time_constant: must be at least 0, not -0\.1 \(given by a change\)\n"
            "hover: control.frequency: must be from 1e-09 to 10000, not 0 ",
        ),
        (
            {"parameters": {"start.offset[2]": [0.1, "up"]}},
            r"hover: start\.offset 3: must be a number, not a string",
        ),
        (
            {"parameters": {"motors.time_constant": normal(0.01, 0.01)}, "samples": 64},
            r"hover: motors\.time_constant: must be at least 0, not -0\.01",
        ),
        ({"samples": 4}, "no value is random"),
        ({"samples": 0}, "samples: must be a whole number of 1 or more, not 0"),
        ({"seed": -1}, "seed: must be a whole number of 0 or more"),
        ({"measure": {"a": "tip_error.most"}}, "must come one of max"),
        ({"measure": {"a": "tip_eror.max"}}, "no such series; did you mean tip_error"),
        ({"measure": {"a": "thrusts.max"}}, "There are .*applied, .*tip_error, .*work"),
        ({"measure": {"a": "walls.max"}}, "no such series"),
        ({"measure": {"case": "tip_error.max"}}, "a column of the table has that name"),
        ({"measure": {"a": 3}}, "must be a function of a flight"),
        ({"scenarios": "hovr"}, "did you mean hover"),
        ({"robots": "hexrotor"}, "no such robot"),
        ({"robots": []}, "at least one robot"),
        ({"parameters": {"duration": normal(1.0, 0.1)}, "samples": True}, "samples: must be"),
    ],
)
def test_what_means_nothing_is_refused(robot, tmp_path, parameters, words):
    given = {"robots": robot, "scenarios": "hover", "out": tmp_path / "sweep", **parameters}
    with pytest.raises(GibbsCodegenError, match=words):
        sweep(**given)


def test_values_are_checked_with_progress(robot, tmp_path):
    calls = []
    parameters = {"gravity": [9.7, 9.8], "start.offset[2]": [0.1, "up"]}
    with pytest.raises(GibbsCodegenError, match="must be a number"):
        sweep(robot, "hover", parameters, out=tmp_path, progress=lambda *call: calls.append(call))
    assert calls == [("checking values", share) for share in (0.0, 0.25, 0.5, 0.75)]


def test_a_row_that_was_changed_is_flown_again_with_a_word(robot, tmp_path, here, caplog):
    first = sweep(robot, "hover", LATE, 4, 1, WORST, here, tmp_path)
    path = tmp_path / chunks.FILE
    whole, lines = path.read_bytes(), kept_lines(tmp_path)
    digest, row, seal = lines[2].split(" ", 1)[0], *lines[2].split(" ", 1)[1].rsplit(" ", 1)
    for line in (
        f"{digest} {row.replace('e-0', 'e-1').replace('0.', '0.1')} {seal}",
        f"{lines[1].split()[0]} {row} {seal}",
        *(lines[2][:-1], lines[2][:80], "{}", "a b c d"),
    ):
        caplog.clear()
        path.write_text("\n".join([*lines[:2], line, lines[3]]))  # And not ended.
        again = sweep(robot, "hover", LATE, 4, 1, WORST, here, tmp_path)
        assert again.table.tobytes() == first.table.tobytes()
        assert [each.getMessage() for each in caplog.records] == [
            f"{path}: 1 lines are damaged or were changed; their flights are repeated"
        ]
        assert sorted(kept_lines(tmp_path)) == sorted([*lines, line])
    path.write_bytes(b"\0" * 100 + whole[:-30])
    again = sweep(robot, "hover", LATE, 4, 1, WORST, here, tmp_path)
    assert again.table.tobytes() == first.table.tobytes()


def test_rows_that_cannot_be_read_are_left_alone(robot, tmp_path, here, monkeypatch):
    sweep(robot, "hover", LATE, 2, 1, WORST, here, tmp_path)
    path = tmp_path / chunks.FILE

    def broken(self, *_):
        raise OSError(errno.EIO, "Input/output error")

    with monkeypatch.context() as patched:
        patched.setattr(type(path), "open", broken)
        with pytest.raises(OutputError, match=rf"{path}: cannot be read: Input/output error"):
            chunks.ResultFile(tmp_path, ())
    assert path.is_file()


@pytest.mark.slow
@pytest.mark.usefixtures("alone_is_another")
def test_what_takes_longer_than_thought_is_kept_piece_by_piece(robot, tmp_path, here, monkeypatch):
    parameters = {**FAR, "motors.time_constant": 0.01}
    first = sweep(robot, "hover", parameters, 6, 1, END, here, tmp_path / "a")
    monkeypatch.setattr(chunks, "_HANDED_OVER", 0.0)  # One flight at a time.
    told, kept = [], []

    def interrupt(what, share):
        if what == "checking values":
            return
        told.append(share)
        kept.append(len(kept_lines(tmp_path / "b")))
        if share > 0.4:
            raise KeyboardInterrupt

    again = (robot, "hover", parameters, 6, 1, END, here, tmp_path / "b")
    with pytest.raises(KeyboardInterrupt):
        sweep(*again, interrupt)
    assert [round(6 * share) for share in told if share] == [1, 2, 3]
    assert kept[-3:] == [1, 2, 3]
    told.clear()
    rest = sweep(*again, lambda what, share: told.append(share) if what == "flying" else None)
    assert [round(6 * share) for share in told if share] == [3, 4, 5, 6]
    assert rest.table.tobytes() == first.table.tobytes()


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ({}, True),
        ({"integration.method": "rk4"}, False),
        ({"control.rate": 200.0}, False),
        ({"control.rate": 200.0, "sensors.position": 0.01}, False),
        ({"duration": [0.01, 0.02], "motors.time_constant": 0.0}, False),
    ],
)
def test_flights_that_could_be_side_by_side_are_told(
    robot, tmp_path, here, monkeypatch, caplog, more, told
):
    monkeypatch.setattr(chunks, "_MOST_FLIGHTS", 1)
    monkeypatch.setattr("gibbs_codegen.flight.sweeps.sweep._LOG_SECONDS", 0.0)
    parameters = {"duration": 0.01, "motors.time_constant": [0.0, 0.01], **more}
    with caplog.at_level("INFO", "gibbs_codegen.flight.sweeps"):
        sweep(robot, "hover", parameters, executor=here, out=tmp_path, workers=1)
    assert "1 of 2 flights are done" in caplog.messages
    assert told == any('integration.method = "rk4"' in line for line in caplog.messages)
