"""Paths in scenario files: what is read, what is refused, and with what words."""

from __future__ import annotations

import math
import tomllib
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gibbs_codegen.errors import Fault
from gibbs_codegen.files.table import Table, file_table, key_path, read_table
from gibbs_codegen.flight.scenario.paths import (
    AnyPath,
    Circle,
    Fixed,
    Harmonic,
    Line,
    Path,
    Term,
    Waypoints,
)

KINDS = {
    "fixed": "position = [1, 2, 3]",
    "harmonic": "x = [{ amplitude = 2, growth = -0.05, frequency = 1, phase_deg = 90 }]",
    "line": "start = [0, 0, 1]\nend = [1, 2, 3]\nduration = 4\nbegin = 0.5",
    "circle": "centre = [1, 2, 3]\nradius = 2\nperiod = 8\nnormal = [1, 0, 1]\nphase_deg = 30",
    "waypoints": "times = [0, 1, 3]\npoints = [[0, 0, 0], [1, 2, 3], [4, 4, 4]]\n"
    'velocities = ["rest", [1, 0.5, 0], "rest"]',
}


@file_table
class PathFile(Table):
    """A file that holds nothing but a path."""

    path: AnyPath


def read_path(table: dict[str, Any]) -> tuple[Path | None, list[Fault]]:
    found, refusals = read_table(PathFile, {"path": table})
    return found and found.path, [Fault(key_path(place), words) for place, words in refusals]


def read(text: str) -> tuple[Path | None, list[Fault]]:
    return read_path(tomllib.loads(text))


def accepted(kind: str, text: str) -> Path:
    path, faults = read(f'kind = "{kind}"\n{text}')
    assert faults == []
    assert path is not None
    return path


def refused(kind: str, text: str) -> list[str]:
    path, faults = read(f'kind = "{kind}"\n{text}')
    assert faults
    assert path is None
    return [f"{fault.path}: {fault.message}" for fault in faults]


def test_each_kind_is_read() -> None:
    assert accepted("fixed", KINDS["fixed"]) == Fixed((1, 2, 3))
    term = Term(2.0, -0.05, 1.0, math.pi / 2)
    assert accepted("harmonic", KINDS["harmonic"]) == Harmonic(x=(term,))
    assert accepted("line", KINDS["line"]) == Line((0, 0, 1), (1, 2, 3), 4, 0.5)
    circle = Circle((1, 2, 3), 2, 8, (1, 0, 1), math.radians(30))
    assert accepted("circle", KINDS["circle"]) == circle
    path = accepted("waypoints", KINDS["waypoints"])
    points = [(0, 0, 0), (1, 2, 3), (4, 4, 4)]
    same = Waypoints([0, 1, 3], points, ["rest", (1, 0.5, 0), "rest"])
    time = np.linspace(0.0, 3.0, 20)
    assert_allclose(path(time), same(time))


def test_defaults() -> None:
    assert accepted("harmonic", "") == Harmonic()
    one = accepted("harmonic", "z = [{ amplitude = 1.5 }, { amplitude = 1, frequency = 2 }]")
    assert one == Harmonic(z=(Term(1.5, 0, 0, 0), Term(1, 0, 2, 0)))
    line = accepted("line", "start = [0, 0, 1]\nend = [1, 2, 3]\nduration = 4")
    assert line == Line((0, 0, 1), (1, 2, 3), 4, 0.0)
    circle = accepted("circle", "centre = [1, 2, 3]\nradius = 2\nperiod = -8")
    assert circle == Circle((1, 2, 3), 2, -8, (0, 0, 1), 0.0)
    assert accepted("circle", "centre = [1, 2, 3]\nradius = 0\nperiod = 1") is not None


@pytest.mark.parametrize("kind", KINDS)
def test_every_key_is_read(kind: str) -> None:
    """A key that changed nothing would be an option that is accepted and never read."""
    time = np.linspace(0.0, 3.0, 7)
    before = accepted(kind, KINDS[kind])(time)
    changed = {
        "position": "[1, 2, 4]",
        "x": "[{ amplitude = 3 }]",
        "start": "[1, 1, 1]",
        "end": "[1, 1, 1]",
        "duration": "3",
        "begin": "0.7",
        "centre": "[0, 0, 0]",
        "radius": "1",
        "period": "-8",
        "normal": "[1, 0, 0]",
        "phase_deg": "31",
        "times": "[0, 1.5, 3]",
        "points": "[[0, 0, 0], [1, 2, 3], [4, 4, 5]]",
        "velocities": '["rest", "free", "rest"]',
    }
    for line in KINDS[kind].splitlines():
        key = line.partition(" =")[0]
        after = accepted(kind, KINDS[kind].replace(line, f"{key} = {changed[key]}"))(time)
        assert not np.allclose(before, after), key


def test_every_key_of_a_term_is_read() -> None:
    text = KINDS["harmonic"]
    before = accepted("harmonic", text)
    for key, value in (("amplitude = 2", 3), ("growth = -0.05", 0), ("frequency = 1", 2)):
        changed = text.replace(key, f"{key.partition(' ')[0]} = {value}")
        assert accepted("harmonic", changed) != before
    for axis in "yz":
        assert accepted("harmonic", text.replace("x =", f"{axis} =")) != before


def test_a_kind_is_needed() -> None:
    assert read("")[1] == [
        Fault("path.kind", "missing; one of fixed, harmonic, line, circle, waypoints")
    ]
    path, faults = read('kind = "cirle"\nradius = true')
    assert path is None
    assert [f.path for f in faults] == ["path.kind"]
    assert "did you mean 'circle'?" in faults[0].message


@pytest.mark.parametrize(
    ("kind", "missing"),
    [
        ("fixed", ["position"]),
        ("line", ["start", "end", "duration"]),
        ("circle", ["centre", "radius", "period"]),
        ("waypoints", ["times", "points"]),
    ],
)
def test_what_is_missing_is_told_at_once(kind: str, missing: list[str]) -> None:
    found = refused(kind, "")
    assert [line.partition(":")[0] for line in found] == [f"path.{key}" for key in missing]
    assert all("missing" in line for line in found)


@pytest.mark.parametrize("kind", KINDS)
def test_unknown_keys_are_refused(kind: str) -> None:
    assert refused(kind, KINDS[kind] + "\nspeed = 2")[0].startswith("path.speed: unknown key")


@pytest.mark.parametrize(
    ("kind", "was", "now", "message"),
    [
        ("fixed", "[1, 2, 3]", "[1, 2]", "position: must have 3 numbers, not 2"),
        ("fixed", "[1, 2, 3]", "[1, 2, true]", "position[2]: must be a number, not a boolean"),
        ("fixed", "[1, 2, 3]", "[1, 2, nan]", "position[2]: must be a finite number, not nan"),
        ("fixed", "[1, 2, 3]", '"here"', "position: must be a list of 3 numbers, not a string"),
        ("harmonic", "x =", "w =", "w: unknown key"),
        ("harmonic", "growth", "grwth", "x[0].grwth: unknown key; did you mean growth?"),
        ("harmonic", "amplitude = 2, ", "", "x[0].amplitude: missing: the amplitude, in m"),
        ("harmonic", "= [{ amplitude = 2", "= [3, { amplitude = 2", "x[0]: must be a table"),
        ("harmonic", "x = [", "x = 1 # [", "x: must be an array of tables"),
        ("harmonic", "frequency = 1", "frequency = inf", "x[0].frequency: must be a finite"),
        ("line", "duration = 4", "duration = 0", "duration: must be at least 1e-09, not 0"),
        ("line", "duration = 4", "duration = -4", "duration: must be at least 1e-09, not -4"),
        ("line", "begin = 0.5", "begin = 1979-05-27", "begin: must be a number, not a date"),
        ("circle", "radius = 2", "radius = -2", "radius: must be at least 0, not -2"),
        ("circle", "period = 8", "period = 0.0", "period: must not be 0"),
        ("circle", "normal = [1, 0, 1]", "normal = [0, 0, 0]", "direction of length zero"),
        ("circle", "radius", "radios", "path.radios: unknown key; did you mean radius?"),
        ("waypoints", "[0, 1, 3]", "[0, 1]", "points: 3 points at 2 times; give as many of both"),
        ("waypoints", "[0, 1, 3]", "[0, 1, 1]", "times[2]: must be after 1, not 1"),
        ("waypoints", "[0, 1, 3]", "[0, 4, 3]", "times[2]: must be after 4, not 3"),
        ("waypoints", "[0, 1, 3]", "[0, 1, inf]", "times[2]: must be a finite number, not inf"),
        ("waypoints", "[0, 1, 3]", "3", "times: must be a list"),
        ("waypoints", "[1, 2, 3]", "[1, 2]", "points[1]: must have 3 numbers, not 2"),
        ("waypoints", "[1, 2, 3]", "7", "points[1]: must be a list of 3 numbers, not a number"),
        ("waypoints", "[0, 1, 3]", "[0, 5e-324, 1]", "times: no smooth curve"),
        ("waypoints", '["rest", [', '["stop", [', "velocities[0]: must be one of 'rest', 'free'"),
        ("waypoints", '["rest", [', "[3, [", "velocities[0]: must be a list of 3 numbers"),
        ("waypoints", '["rest", [', '["free", [', "velocities[0]: the path ends here"),
        ("waypoints", "0.5, 0]", "0.5]", "velocities[1]: must have 3 numbers, not 2"),
        ("waypoints", "0.5, 0]", "0.5, true]", "velocities[1][2]: must be a number, not a bool"),
        ("waypoints", ', "rest"]', "]", "velocities[1]: 2 velocities of 3 points; give as many"),
        ("waypoints", "[4, 4, 4]", "[1, 2, 3]", "velocities[1]: this point is repeated"),
    ],
)
def test_what_is_wrong_is_told(kind: str, was: str, now: str, message: str) -> None:
    assert was in KINDS[kind]
    found = refused(kind, KINDS[kind].replace(was, now))
    assert message in "\n".join(found)
    assert all("\n" not in line and len(line) < 200 for line in found)


def test_a_path_of_one_waypoint_or_too_many_is_refused() -> None:
    one = refused("waypoints", "times = [0]\npoints = [[0, 0, 0]]")
    assert "1 points at 1 times; give as many of both, 2 to 10000" in one[0]
    count = 1_000_000
    table = {"kind": "waypoints", "times": [*range(count)], "points": [[0, 0, 0]] * count}
    path, faults = read_path(table)
    assert path is None
    words = "1000000 entries; give at most 10000"
    assert [fault.message for fault in faults] == [words] * 2


def test_ten_thousand_waypoints_are_read() -> None:
    count = 10_000
    table = {
        "kind": "waypoints",
        "times": [*range(count)],
        "points": [[0, 0, i] for i in range(count)],
    }
    path, _ = read_path(table)
    assert path is not None
    # Far from the ends the steps are even.
    assert_allclose(path(5000.5)[:2, 2], [5000.5, 1.0], rtol=1e-9)


def test_a_harmonic_of_too_many_terms_is_refused() -> None:
    _, faults = read_path({"kind": "harmonic", "y": [{"amplitude": 1}] * 101})
    assert [f.path for f in faults] == ["path.y"]
    assert "101 terms; give at most 100" in faults[0].message
