"""A flight on disk: what is written is what was flown, and reads back."""

from __future__ import annotations

import csv
import dataclasses
import re
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from gibbs_codegen.errors import OutputError, UsageError
from gibbs_codegen.flight.record.flight import Flight, is_flight, read_flight
from gibbs_codegen.flight.record.series import RANGES
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.simulation import simulate


@pytest.fixture(scope="module")
def flight(fast: Callable[[str], ModuleType]) -> Flight:
    scenario = read_scenario("paper", {"duration": 0.3, "start": {"offset": [0.1, 0, 0]}})
    return simulate(fast("hexarotor_3link"), scenario)


def test_npz_reads_back_the_same(flight: Flight, tmp_path: Path) -> None:
    flight.write_npz(tmp_path / "flight.npz")
    again = read_flight(tmp_path)  # As `simulate --out` writes folders.
    assert np.array_equal(read_flight(tmp_path / "flight.npz").q, again.q)
    for field in dataclasses.fields(Flight):
        before, after = getattr(flight, field.name), getattr(again, field.name)
        assert type(before) is type(after), field.name
        assert np.array_equal(before, after), field.name


def test_a_flight_says_that_commands_of_motors_chatter(flight: Flight) -> None:
    """Every other sample at nothing does; what is lost does not, nor noise, rounding or a step."""
    every, once, quiet = (flight.commanded.copy() for _ in range(3))
    every[::2, 1] = 0.0
    every[1::2, 1] = np.abs(every).max()
    once[len(once) // 2 :] *= 0.2
    once[-1] = np.nan
    quiet[:, :6] += 0.1 * np.random.default_rng(0).normal(size=quiet[:, :6].shape)
    for commanded in (once, quiet, 1e-20 * every):
        assert dataclasses.replace(flight, commanded=commanded).notes == ()
    (note,) = dataclasses.replace(flight, commanded=every).notes
    assert re.match(r"Motor commands chatter: in 9\d% of the samples .*\(F_2 most often", note)


def test_a_flight_says_that_it_ends_far_from_its_path_or_overturned(flight: Flight) -> None:
    """One that begins as far away does not, nor one that ended there, nor one of a user's law.

    Nor one whose motors are off. What is far with inputs to spare may be so on purpose.
    """
    far, turned = flight.centre_desired.copy(), flight.q.copy()
    far[-1] = flight.point(flight.centre)[-1] + [2.0, 0.0, 0.0]
    # Half a turn about x, behind rotations about x, y and z.
    turned[-1, flight.layout.q.attitude] *= [1.0, -1.0, -1.0]
    turned[-1, flight.layout.q.attitude] += [np.pi, 0.0, 0.0]
    lost = dataclasses.replace(flight, centre_desired=far)
    assert lost.notes == ("The base ends 2 m from its desired position.",)
    asked = flight.commanded[-1]
    limited = dataclasses.replace(lost, input_limits=np.stack([asked - 1.0, asked]))
    assert "at their limits; control may be lost (a smaller integration" in limited.notes[0]
    spared = dataclasses.replace(lost, input_limits=np.stack([asked, asked]))
    assert spared.notes == lost.notes
    over = dataclasses.replace(flight, q=turned)
    words = (
        "The base ends overturned, its z axis 180° off its desired direction; control may be lost"
    )
    assert over.notes[0].startswith(words)
    for times in ([0.0, 0.2], [0.4, np.inf]):
        off = {"motor_times": np.array(times)}
        assert dataclasses.replace(over, **off).notes == ()
    unknown = np.full_like(flight.q_desired, np.nan)
    assert dataclasses.replace(over, q_desired=unknown).notes == ()
    assert dataclasses.replace(flight, centre_desired=far * np.nan).notes == ()
    away = far.copy()
    away[0, 0] -= 3.0
    begun = dataclasses.replace(lost, centre_desired=away)
    ended, users = (dataclasses.replace(lost, **{k: "own"}) for k in ("stopped", "law"))
    assert (begun.notes, ended.notes, users.notes) == ((), (), ())


def test_a_flight_saved_before_robots_were_trees_is_read(flight: Flight, tmp_path: Path) -> None:
    """Such files say nothing of attitude, units and parents: those were the same for all."""
    flight.write_npz(tmp_path / "now.npz")
    with np.load(tmp_path / "now.npz") as stored:
        new = ("law", "attitude", "coordinate_units", "parents", *RANGES)
        np.savez(tmp_path / "old.npz", **{key: stored[key] for key in stored if key not in new})
    again = read_flight(tmp_path / "old.npz")
    assert (flight.law, again.law) == ("computed_torque", "")
    for field in dataclasses.fields(Flight):
        if field.name == "law":
            continue
        # Nor of what was between samples.
        known = field.name.partition("_")[0] if field.name in RANGES else field.name
        before, after = getattr(flight, known), getattr(again, field.name)
        assert type(before) is type(after), field.name
        assert np.array_equal(before, after), field.name
    assert np.array_equal(again.errors, flight.errors)


def test_wrenches_on_frames(flight: Flight, tmp_path: Path) -> None:
    """Frames that nothing acts on have no columns, and older files have no wrenches."""
    wrenches = flight.frame_wrenches.copy()
    wrenches[:, 1] = np.arange(6) + flight.time[:, np.newaxis]
    walls = {"walls": np.ones((2, 6)), "wall_forces": np.ones((len(flight.time), 2))}
    loaded = dataclasses.replace(flight, frame_wrenches=wrenches, **walls)
    assert np.array_equal(loaded.frame_wrench("tip"), wrenches[:, 1])
    with pytest.raises(UsageError, match="hand: no such frame; there are base, tip"):
        loaded.frame_wrench("hand")
    columns = {f"{name} [{unit}]": values for name, unit, values in loaded.columns()}
    assert np.array_equal(columns["tip_force_z [N]"], wrenches[:, 1, 2])
    assert np.array_equal(columns["tip_torque_x [N m]"], wrenches[:, 1, 3])
    assert not any(name.startswith("base_force") for name in columns)
    assert np.array_equal(columns["wall_2_force [N]"], walls["wall_forces"][:, 1])
    loaded.write_npz(tmp_path / "now.npz")
    assert np.array_equal(read_flight(tmp_path / "now.npz").wall_forces, walls["wall_forces"])
    with np.load(tmp_path / "now.npz") as stored:
        new = ("frame", "wall_")
        older = {key: stored[key] for key in stored if not key.startswith(new)}
    np.savez(tmp_path / "old.npz", **older)
    again = read_flight(tmp_path / "old.npz")
    assert again.frames == ()
    assert again.frame_wrenches.shape == (len(flight.time), 0, 6)
    assert np.isnan(again.wall_forces).all()
    assert again.wall_forces.shape == (len(flight.time), 2)
    assert next(again.columns())[0] == "time"


def test_csv_has_a_named_column_with_a_unit_for_everything(flight: Flight, tmp_path: Path) -> None:
    flight.write_csv(tmp_path / "a.csv")
    with (tmp_path / "a.csv").open(encoding="utf-8", newline="") as file:
        header, *rows = list(csv.reader(file))
    assert header[0] == "time [s]"
    assert len(set(header)) == len(header)
    assert all(name.endswith("]") and " [" in name for name in header)
    values = np.array(rows, dtype=float)
    assert np.array_equal(values[:, 0], flight.time)
    column = dict(zip(header, values.T, strict=True))
    assert np.array_equal(column["theta_8 [rad]"], flight.q[:, 4])
    assert np.array_equal(column["theta_8_desired [rad]"], flight.q_desired[:, 4])
    assert np.array_equal(column["rate_x [m/s]"], flight.v[:, 6])
    assert np.array_equal(column["acceleration_theta_0 [rad/s^2]"], flight.a[:, 1])
    assert np.array_equal(column["F_3 [N]"], flight.applied[:, 2])
    assert np.array_equal(column["F_3_commanded [N]"], flight.commanded[:, 2])
    assert np.array_equal(column["tau_9 [N m]"], flight.applied[:, 8])
    assert np.array_equal(column["tau_prime_2 [N m]"], flight.constraint_torques[:, 0])
    assert np.array_equal(column["theta_4 [rad]"], flight.base_arm_angles[:, 2])
    assert np.array_equal(column["tip_z [m]"], flight.point("tip")[:, 2])
    assert np.array_equal(column["tip_z_desired [m]"], flight.tip_desired[:, 2])
    assert np.array_equal(column["work [J]"], flight.work)


def test_the_weight_is_that_of_the_masses(flight: Flight) -> None:
    """9 kg: a base of six arms of 0.5 m with 1 kg/m, and two links of 3 m with 1 kg/m."""
    assert flight.weight == pytest.approx(9.0 * 9.81)
    assert np.all(np.isinf(flight.input_limits))


def test_errors_are_distances(flight: Flight) -> None:
    assert flight.centre_error[0] == pytest.approx(0.1, abs=1e-12)
    assert flight.energy_error[0] == 0


def test_what_is_no_flight_is_refused(flight: Flight, tmp_path: Path) -> None:
    flight.write_npz(tmp_path / "whole.npz")
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    np.savez(tmp_path / "object.npz", robot=np.array([{"a": 1}], dtype=object))
    whole = (tmp_path / "whole.npz").read_bytes()
    contents = {"empty": b"", "text": b"not a zip file", "cut": whole[:-9], "half": whole[:5000]}
    for name, content in contents.items():
        (tmp_path / f"{name}.npz").write_bytes(content)
    for name, why in {
        "empty": "the file is empty",
        **dict.fromkeys(["text", "cut", "half"], "the file is cut off, or no .npz file"),
        "other": "it has no array",
        "object": "it is damaged, or its arrays are not those of a flight",
        "none": "No such file or directory",
        "../": "Is a directory",
    }.items():
        path = tmp_path / f"{name}.npz" if name.isalpha() else tmp_path
        words = f"^{re.escape(str(path))}: is not a saved flight: {why}.*; give a flight"
        with pytest.raises(UsageError, match=words):
            read_flight(path)


@pytest.mark.slow
def test_a_damaged_file_is_told(flight: Flight, tmp_path: Path) -> None:
    """Zlib, zipfile and NumPy have errors of their own for what is broken in the middle."""
    path = tmp_path / "damaged.npz"
    flight.write_npz(path)
    whole, random = path.read_bytes(), np.random.default_rng(0)
    refused = 0
    for _ in range(200):
        damaged = bytearray(whole)
        for place in random.integers(len(whole), size=3):
            damaged[place] = random.integers(256)
        path.write_bytes(damaged)
        is_flight(path)
        try:
            read_flight(path)
        except UsageError as error:
            refused += "damaged.npz: is not a saved flight: " in str(error)
    assert refused > 100


def test_a_folder_that_is_not_there(flight: Flight, tmp_path: Path) -> None:
    for write in (flight.write_csv, flight.write_npz):
        with pytest.raises(OutputError, match="cannot be written"):
            write(tmp_path / "none" / "a")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("weight", "x"), ("weight", [1.0, 2.0]), ("q", np.zeros((2, 9))), ("work", np.zeros(()))),
        *(("input_limits", "inf"), ("points", "a"), ("robot", 3.0)),
        ("time", [0.1, 0.0]),
    ],
)
def test_a_malformed_field_is_told(
    flight: Flight, name: str, value: object, tmp_path: Path
) -> None:
    flight.write_npz(tmp_path / "good.npz")
    if name == "time":  # Of two recordings, one after the other.
        value = flight.time[::-1]
    with np.load(tmp_path / "good.npz") as stored:
        np.savez(tmp_path / "bad.npz", **{**stored, name: np.array(value)})
    words = rf"bad\.npz: is not a saved flight: (its )?{name}"
    with pytest.raises(UsageError, match=words):
        read_flight(tmp_path / "bad.npz")
