"""Scenario files: every key is read, every fault is told, and nothing else ever comes out."""

from __future__ import annotations

import copy
import math
import string
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.tools import run

from gibbs_codegen.errors import ScenarioFileError, UsageError
from gibbs_codegen.files.toml import changes_of
from gibbs_codegen.flight.scenario.file import parse_scenario, read_scenario, shipped_scenarios
from gibbs_codegen.flight.scenario.orientation import Level, Tangent, Turn
from gibbs_codegen.flight.scenario.parts import (
    MAX_DURATION,
    Control,
    Gust,
    Motors,
    Move,
    Payload,
    Push,
    Sensors,
    Settings,
    StartOffset,
    Wind,
)
from gibbs_codegen.flight.scenario.paths import Circle, Fixed, Harmonic, Line, Sum, Term
from gibbs_codegen.flight.scenario.scenario import ArmTask, Scenario
from gibbs_codegen.flight.scenario.walls import Cylinder, Plane

LEAST = """
name = "test"
duration = 5
[base]
path = { kind = "fixed", position = [1, 2, 3] }
"""

# Every key there is, none at its default.
FULL: dict[str, Any] = {
    "name": "full",
    "description": "all that can be said",
    "duration": 7.5,
    "base": {
        "path": {"kind": "circle", "centre": [0, 0, 2], "radius": 2, "period": 8},
        "attitude": {"kind": "level", "heading_deg": 30, "rate_deg": -10},
    },
    "arm": {
        "tip": {"kind": "line", "start": [1, 0, 0], "end": [1, 1, 0], "duration": 3},
        "guess": {"d_8": 0.25},
        "guess_deg": {"theta_7": 20, "theta_9": -90},
        "limits": {"d_8": [0, 0.5]},
        "limits_deg": {"theta_9": [-120, 0]},
        "effort": {"theta_7": 20, "d_8": 30},
        "velocity": {"theta_9": 3},
    },
    "start": {"offset": [0.1, -0.2, 0.3], "turn_deg": [5, 0, -15]},
    "control": {
        "law": "open_loop",
        "frequency": 4,
        "damping_ratio": 0.7,
        "attitude_frequency": 16,
        "integral": 0.5,
        "rate": 200,
        "delay": 0.004,
    },
    "motors": {"limits": [-10, 25], "time_constant": 0.05, "compensation": False},
    "sensors": {
        "position": 0.002,
        "attitude_deg": 0.1,
        "joints": 0.003,
        "velocity": 0.01,
        "angular_velocity": 0.02,
        "joint_rates": 0.05,
        "delay": 0.004,
        "seed": 12345,
    },
    "push": {"frame": "base", "force": [5, 0, -2], "torque": [0, 3, 1], "begin": 2, "end": 4},
    "integration": {
        "method": "rk4",
        "step": 0.002,
        "relative_tolerance": 1e-8,
        "absolute_tolerance": 1e-9,
        "rate": 50,
        "divergence": 3,
    },
    "parameters": {"gravity": 3.7, "link_2_mass": 1.5},
    "plant": {"link_2_mass": 1.7},
    "payload": [{"frame": "tip", "mass": 0.3, "begin": 1, "end": 3}],
    "wind": {
        "velocity": [3, -1, 2],
        "gusts": [{"amplitude": [1, 2, 4], "begin": 2, "duration": 1.5}],
        "drag": {"base": 0.4},
        "rotational_drag": {"base": 0.02},
    },
    "wall": [
        {
            "frame": "tip",
            "point": [5, 1, 2],
            "normal": [-1, 3, 2],
            "stiffness": 400,
            "damping": 30,
        },
        {
            "kind": "cylinder",
            "frame": "base",
            "point": [1, 2, 3],
            "axis": [0, 0, 2],
            "radius": 0.4,
            "stiffness": 500,
            "damping": 20,
        },
    ],
}


def toml(value: object) -> str:
    """A value as TOML on one line; what is no TOML is left as it is, for others to refuse."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key_text(k)} = {toml(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, str):
        escaped = "".join(
            c if c.isprintable() and c not in '"\\' else f"\\U{ord(c):08x}" for c in value
        )
        return f'"{escaped}"'
    return repr(value)


def key_text(key: str) -> str:
    plain = key and set(key) <= set(string.ascii_letters + string.digits + "_-")
    return key if plain else toml(key)


def document(values: Mapping[str, Any]) -> str:
    return "".join(f"{key_text(key)} = {toml(value)}\n" for key, value in values.items())


def parse(values: Mapping[str, Any]) -> Scenario:
    return parse_scenario(document(values), "s.toml")


def faults(text: str) -> list[str]:
    """Lines of the refusal of a file."""
    with pytest.raises(ScenarioFileError) as refusal:
        parse_scenario(text, "s.toml")
    return str(refusal.value).splitlines()


def with_change(path: tuple[str | int, ...], value: object) -> dict[str, Any]:
    changed = copy.deepcopy(FULL)
    inner: Any = changed
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return changed


# --- what is read


def test_all_keys() -> None:
    degree = math.pi / 180
    assert parse(FULL) == Scenario(
        name="full",
        duration=7.5,
        base=Circle((0, 0, 2), 2, 8),
        attitude=Level(30 * degree, -10 * degree),
        arm=ArmTask(
            tip=Line((1, 0, 0), (1, 1, 0), 3),
            guess={"d_8": 0.25, "theta_7": math.radians(20), "theta_9": -90 * degree},
            limits={"d_8": (0, 0.5), "theta_9": (np.radians(-120), 0)},
            effort={"theta_7": 20, "d_8": 30},
            velocity={"theta_9": 3},
            named=frozenset(
                {
                    ("d_8", "guess"),
                    ("d_8", "limits"),
                    ("theta_7", "guess_deg"),
                    ("theta_9", "guess_deg"),
                    ("theta_9", "limits_deg"),
                }
            ),
        ),
        start=StartOffset((0.1, -0.2, 0.3), (math.radians(5), 0, math.radians(-15))),
        control=Control("open_loop", 4, 0.7, 16, 0.5, 200, 0.004),
        motors=Motors((-10, 25), 0.05, compensation=False),
        sensors=Sensors(0.002, 0.1 * degree, 0.003, 0.01, 0.02, 0.05, 0.004, 12345),
        push=Push((5, 0, -2), 2, 4, (0, 3, 1), "base"),
        integration=Settings("rk4", 0.002, 1e-8, 1e-9, 50, 3),
        parameters={"gravity": 3.7, "link_2_mass": 1.5},
        plant={"link_2_mass": 1.7},
        payloads=(Payload("tip", 0.3, 1, 3),),
        wind=Wind({"base": 0.4}, (3, -1, 2), (Gust((1, 2, 4), 1.5, 2),), {"base": 0.02}),
        walls=(
            Plane("tip", (5, 1, 2), (-1, 3, 2), 400, 30),
            Cylinder("base", (1, 2, 3), (0, 0, 2), 0.4, 500, 20),
        ),
        description="all that can be said",
    )


def test_a_tip_force_is_a_push_of_the_tip() -> None:
    """Scenarios of before there were pushes at any frame keep their meaning."""
    old = LEAST + "[tip_force]\nforce = [1, 2, 3]\nbegin = 2\n"
    assert parse_scenario(old).push == Push((1, 2, 3), begin=2, frame="tip")
    whole = parse_scenario(LEAST + "[tip_force]\nforce = [1, 2, 3]\n").push
    assert whole == Push((1, 2, 3), frame="tip")
    new = old.replace("tip_force", "push")
    assert parse_scenario(new).push == parse_scenario(old).push
    assert faults(new + "[tip_force]\nforce = [1, 2, 3]\n") == [
        "s.toml:9: tip_force: must be left out, because push already pushes the robot"
    ]


def test_defaults() -> None:
    assert parse_scenario(LEAST) == Scenario("test", 5, Fixed((1, 2, 3)))


def leaves(value: object, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Paths of all values in a document that hold no others."""
    inside: Any = ()
    if isinstance(value, dict):
        inside = value.items()
    elif isinstance(value, list):
        inside = enumerate(value)
    else:
        yield path
    for key, entry in inside:
        yield from leaves(entry, (*path, key))


OTHERS: dict[object, object] = {
    "full": "other",
    "all that can be said": "else",
    "level": "tangent",
    "open_loop": "off",
    "rk4": "adaptive",
    "base": "tip",
    "tip": "base",
    12345: 54321,
}


@pytest.mark.parametrize("path", [*leaves(FULL)], ids=lambda path: ".".join(map(str, path)))
def test_no_key_is_read_in_vain(path: tuple[str | int, ...]) -> None:
    """Every value of the full file, changed, changes the scenario, or is refused beside others."""
    value: Any = FULL
    for key in path:
        value = value[key]
    other: object = OTHERS.get(value)
    if isinstance(value, int | float) and other is None:
        other = not value if isinstance(value, bool) else 0.9 * value + 0.003
    if path[-1] == "kind":
        # Another kind has other keys: those that are there are now unknown, so this one is read.
        others = {"circle": "fixed", "line": "fixed", "level": "tangent", "cylinder": "plane"}
        other = others[value]
        assert "unknown key" in "\n".join(faults(document(with_change(path, other))))
        return
    changed = parse(with_change(path, other))
    assert changed != parse(FULL)


def test_tangent_attitudes() -> None:
    for text, arm in (('{ kind = "tangent" }', 2), ('{ kind = "tangent", arm = 5 }', 5)):
        assert parse_scenario(LEAST + f"attitude = {text}").attitude == Tangent(arm)


def test_a_tip_beside_the_base() -> None:
    text = LEAST + '[arm]\ntip_beside_base = { kind = "harmonic", x = [{ amplitude = 0.5 }] }'
    beside = Harmonic(x=(Term(0.5),))
    assert parse_scenario(text).arm.tip == Sum((Fixed((1, 2, 3)), beside))
    alone = parse_scenario(text.replace("tip_beside_base", "tip"))
    assert alone.arm.tip == beside


def test_postures_in_degrees_and_metres() -> None:
    text = LEAST + "[arm]\nposture = { d_8 = 0.25 }\nposture_deg = { theta_7 = 180 }"
    assert parse_scenario(text).arm.posture == {"d_8": 0.25, "theta_7": pytest.approx(np.pi)}
    assert parse_scenario(LEAST + "[arm]\nposture = {}").arm.posture == {}
    assert parse_scenario(LEAST + "[arm]").arm.posture is None


def test_scenarios_that_ship() -> None:
    assert shipped_scenarios() == (
        *("circle", "delta", "drive", "flip", "hold", "hover", "inspection", "line", "paper"),
        *("push", "reach"),
    )
    for name in shipped_scenarios():
        scenario = read_scenario(name)
        assert scenario.name == name
        assert scenario.description
        if scenario.base is not None:
            assert scenario.base(np.linspace(0.0, scenario.duration, 11)).shape == (11, 4, 3)
    paper = read_scenario("paper")
    assert paper.attitude == Tangent(2)
    assert read_scenario("circle").attitude == Tangent(2)
    assert read_scenario("hover").arm == ArmTask()
    # The line is at rest before the flight ends.
    assert not read_scenario("line").base(8.0)[1:].any()


def test_a_file_by_its_path(tmp_path: FilePath) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(document(FULL), encoding="utf-8")
    assert read_scenario(str(file)) == parse(FULL)
    shorter = read_scenario(str(file), {"duration": 2, "start": {"offset": [0, 0, 1]}})
    assert (shorter.duration, shorter.start.position) == (2, (0, 0, 1))
    # The rest of a table stays.
    assert shorter.start.rotation == parse(FULL).start.rotation
    with pytest.raises(ScenarioFileError, match=r"start\.offset: must have 3 numbers, not 2"):
        read_scenario(str(file), {"start": {"offset": [0, 0]}})


@pytest.mark.parametrize("name", ["papr", "", ".", "/", "a\0b", "x" * 5000, "nowhere/paper.toml"])
def test_there_is_no_such_file(name: str) -> None:
    with pytest.raises(UsageError) as refusal:
        read_scenario(name)
    assert len(str(refusal.value)) < 300


def test_a_near_miss_is_suggested() -> None:
    with pytest.raises(UsageError, match=r"no scenario of that name ships; did you mean paper\?"):
        read_scenario("papr")


def test_a_file_that_is_not_a_page_of_text(tmp_path: FilePath) -> None:
    file = tmp_path / "s.toml"
    file.write_bytes(b'name = "\xff"')
    with pytest.raises(ScenarioFileError, match="not UTF-8"):
        read_scenario(str(file))
    file.write_bytes(b"#" * 1_000_001)
    with pytest.raises(
        ScenarioFileError, match="larger than 1000000 bytes, the limit for a scenario"
    ):
        read_scenario(str(file))


# --- what is refused


def test_all_faults_are_told_at_once_with_key_and_line() -> None:
    text = """name = 3
duraton = 5
[base]
attitude = { kind = "level", heading = 30 }
[base.path]
kind = "circle"
centre = [0, 0]
radius = -1
[arm.posture_deg]
theta_7 = true
d-8 = 1
[control]
law = "openloop"
frequency = 0
delay = 0.01
[motors]
limits = [5, 5]
compensation = 1
[integration]
step = 1e-9
rate = inf
[parameters]
gravity = "9.81"
mass = nan
"""
    assert faults(text) == [
        "s.toml:1: name: must be a string, not a number",
        "s.toml:2: duraton: unknown key; did you mean duration?",
        "s.toml:4: base.attitude.heading: unknown key; did you mean heading_deg?",
        "s.toml:5: base.path.period: missing: the time of a turn, in s; negative: the other way "
        "round",
        "s.toml:7: base.path.centre: must have 3 numbers, not 2",
        "s.toml:8: base.path.radius: must be at least 0, not -1",
        "s.toml:10: arm.posture_deg.theta_7: must be a number, not a boolean",
        "s.toml:11: arm.posture_deg.'d-8': must be the name of a joint, that of its coordinate, "
        "such as theta_7",
        "s.toml:12: control.rate: missing: a delay needs the rate of the law, Hz",
        "s.toml:13: control.law: must be one of 'tracking', 'computed_torque', 'geometric', "
        "'passive', 'adaptive', 'impedance', 'force', 'geometric_impedance', 'geometric_force', "
        "'predictive', 'open_loop', 'off', not 'openloop'; did you mean 'open_loop'?",
        "s.toml:14: control.frequency: must be from 1e-09 to 10000, not 0",
        "s.toml:17: motors.limits: the least thrust must be below the greatest",
        "s.toml:18: motors.compensation: must be true or false, not a number",
        "s.toml:20: integration.step: must be at least 1e-06, not 1e-09",
        "s.toml:21: integration.rate: must be a finite number, not inf",
        "s.toml:23: parameters.gravity: must be a number, not a string",
        "s.toml:24: parameters.mass: must be a finite number, not nan",
    ]


def tables(value: object, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Paths of all tables in a document."""
    if isinstance(value, dict):
        yield path
        for key, entry in value.items():
            yield from tables(entry, (*path, key))


# Tables of which only the robot tells what keys they may have.
ROBOTS_OWN = {("parameters",), ("plant",), ("wind", "drag"), ("wind", "rotational_drag")}


@pytest.mark.parametrize("path", [p for p in tables(FULL) if p not in ROBOTS_OWN], ids=".".join)
def test_unknown_keys_of_any_table(path: tuple[str, ...]) -> None:
    key = "the colour"
    found = "\n".join(faults(document(with_change((*path, key), 1))))
    named = path and path[-1].removesuffix("_deg") in ("guess", "limits", "effort", "velocity")
    said = "must be the name of a" if named else "unknown key"
    assert f"'{key}': {said}" in found or f"{key}: {said}" in found


@pytest.mark.parametrize("path", [p for p in tables(FULL) if p], ids=".".join)
@pytest.mark.parametrize("value", [3, True, "text", []])
def test_what_should_be_a_table(path: tuple[str, ...], value: object) -> None:
    found = faults(document(with_change(path, value)))
    assert any(f"{'.'.join(path)}: must be a table, not " in line for line in found)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("name", "", "must be 1 to 200 characters on one line"),
        ("name", "a\nb", "must be 1 to 200 characters on one line"),
        ("name", "\x1b[31m", "must be 1 to 200 characters on one line"),
        ("name", "x" * 201, "must be 1 to 200 characters on one line"),
        ("description", "a\nb", "must be 0 to 200 characters on one line"),
        ("description", 3, "must be a string, not a number"),
        ("duration", 0, "must be from 0.001 to 3600 s"),
        ("duration", -1.0, "must be from 0.001 to 3600 s"),
        ("duration", 1e9, "must be from 0.001 to 3600 s"),
        ("duration", True, "must be a number, not a boolean"),
        ("duration", math.inf, "must be a finite number, not inf"),
        ("duration", 10**400, "must be a finite number, not a huge number"),
        ("base.attitude.kind", "tangential", "did you mean 'tangent'?"),
        ("base.attitude", {"kind": "tangent", "arm": 0}, "arm: must be from 1 to 256, not 0"),
        ("base.attitude", {"kind": "tangent", "arm": 2.0}, "arm: must be a whole number, not 2.0"),
        ("base.attitude", {"kind": "tangent", "heading_deg": 0}, "heading_deg: unknown key"),
        ("base.attitude", {"kind": "level", "arm": 2}, "arm: unknown key"),
        ("arm.posture_deg", {"theta_7": 0}, "tip already gives the motion of the arm"),
        ("arm.tip_beside_base", {"kind": "fixed", "position": [0] * 3}, "tip already gives the"),
        ("arm.tip_in_base", {"kind": "fixed", "position": [0] * 3}, "tip already gives the"),
        ("arm.guess_deg", {"": 1}, "must be the name of a joint, that of its coordinate"),
        ("arm.guess_deg", {"theta_7\n": 1}, r"'theta_7\n': must be the name of a joint"),
        ("arm.guess_deg", {"theta_7": [1]}, "theta_7: must be a number, not a list"),
        ("arm.limits_deg", {"theta_9": [0, 0]}, "the lower limit must be below the upper"),
        ("arm.limits_deg", {"theta_9": [9, -9]}, "the lower limit must be below the upper"),
        ("arm.limits_deg", {"theta_9": 9}, "theta_9: must be a list of 2 numbers, not a number"),
        ("arm", {"guess_deg": {"theta_7": 1}}, "arm.guess_deg: starts the search for a tip path"),
        ("start.offset", [0, 0], "must have 3 numbers, not 2"),
        ("start.turn_deg", [0, 0, "x"], "turn_deg 3: must be a number, not a string"),
        ("control.frequency", 1e300, "must be at most 1e+12 in size, not 1e+300"),
        ("control.frequency", 1e5, "must be from 1e-09 to 10000, not 100000.0"),
        ("control.damping_ratio", -0.1, "must be from 0 to 10000, not -0.1"),
        ("control.law", "off ", "did you mean 'off'?"),
        ("motors.limits", [25, 10], "the least thrust must be below the greatest"),
        ("motors.time_constant", -1, "must be at least 0, not -1"),
        ("sensors.position", -1, "must be at least 0, not -1"),
        ("sensors.attitude_deg", 100, "must be from 0 to 90°, not 100"),
        ("sensors.delay", 11, "must be from 0 to 10 s, not 11"),
        ("sensors.seed", 1.5, "must be a whole number"),
        ("tip_force", {"begin": 1}, "tip_force.force: missing: [x, y, z] in N"),
        ("tip_force", {"force": [1, 2, 3], "torque": [1, 2, 3]}, "tip_force.torque: unknown key"),
        ("push", {"begin": 1}, "push.force: missing: give a force, a torque, or both"),
        ("push.end", 2, "must be after begin, 2 s"),
        ("push.begin", -1, "must be at least 0, not -1"),
        ("push.torque", [1, 2], "must have 3 numbers, not 2"),
        ("push.frame", 3, "push.frame: must be a string, not a number"),
        ("arm.effort", {"theta_7": -1}, "arm.effort.theta_7: must be at least 1e-09, not -1"),
        ("arm.velocity", {"theta 7": 1}, "must be the name of a joint, that of its coordinate"),
        ("integration.method", "euler", "must be one of 'adaptive', 'rk4', not 'euler'"),
        ("integration.step", 1e-9, "must be at least 1e-06, not 1e-09"),
        ("integration.step", 0, "must be at least 1e-06, not 0"),
        ("integration.relative_tolerance", 0.5, "must be from 3e-14 to 0.1, not 0.5"),
        ("integration.relative_tolerance", 0, "must be from 3e-14 to 0.1, not 0"),
        ("integration.absolute_tolerance", -1, "must be from 1e-16 to 0.1, not -1"),
        ("integration.rate", 1e6, "more than 1000000 samples in 7.5 s; lower it"),
        ("integration.rate", 0, "must be at least 0.1, not 0"),
        ("integration.divergence", 0, "must be at least 1e-09, not 0"),
        ("parameters.gravity", True, "gravity: must be a number, not a boolean"),
        ("parameters.gravity", {"a": 1}, "gravity: must be a number, not a table"),
        ("parameters", {"\x1b": "x"}, r"parameters.'\x1b': must be a number, not a string"),
        ("parameters", {"x[1].y": "x"}, "parameters.'x[1].y': must be a number, not a string"),
        ("plant.gravity", "x", "plant.gravity: must be a number, not a string"),
        ("payload", {"frame": "tip"}, "must be an array of tables, [[payload]], not a table"),
        ("payload", [{"mass": 1}], "payload 1: frame: missing: the frame at whose origin it is"),
        ("payload", [{"frame": "tip", "mass": -1}], "mass: must be at least 0, not -1"),
        (
            "payload",
            [{"frame": "tip", "mass": 1, "begin": 2, "end": 2}],
            "payload 1: end: must be after begin, 2 s",
        ),
        ("payload", [{"frame": "tip", "mass": 1}] * 21, "21 payloads; give at most 20"),
        ("wind", {"velocity": [1, 0, 0]}, "wind.drag: missing: coefficients of drag, N s/m, by"),
        ("wind.drag", {}, "wind.drag: names no frame; give frames and their coefficients"),
        ("wind.drag", {"base": -1}, "wind.drag.base: must be at least 0, not -1"),
        ("wind.gusts", [{"amplitude": [1, 0, 0]}], "duration: missing: how long it lasts, s"),
        (
            "wind.gusts",
            [{"amplitude": [1, 0, 0], "duration": 0}],
            "duration: must be at least 1e-09, not 0",
        ),
        ("wall", [{"frame": "tip"}], "wall 1: point: missing: a point of the plane"),
        ("base.path.radius", -(10**13), "must be at most 1e+12 in size, not -10000000000000"),
    ],
)
def test_one_fault(path: str, value: object, message: str) -> None:
    found = faults(document(with_change(tuple(path.split(".")), value)))
    assert message in "\n".join(found)
    assert all(line.startswith("s.toml:") and line.isprintable() for line in found)


def test_too_many_steps_are_refused() -> None:
    long = LEAST.replace("duration = 5", "duration = 1000") + "[integration]\nstep = 2e-6\n"
    # The adaptive method takes no such steps.
    assert parse_scenario(long).integration.step == 2e-6
    assert faults(long + 'method = "rk4"') == [
        "s.toml:7: integration.step: more than 100000000 steps in 1000 s; take longer ones"
    ]


def test_a_posture_outside_its_limits_is_refused() -> None:
    text = LEAST + "[arm]\nlimits_deg = { theta_7 = [-30, 30] }\nlimits = { d_8 = [0, 0.5] }\n"
    within = parse_scenario(text + "posture_deg = { theta_7 = 30 }\nposture = { d_8 = 0 }")
    assert within.arm.posture is not None
    assert faults(text + "posture_deg = { theta_7 = 31 }\nposture = { d_8 = -0.1 }") == [
        "s.toml:9: arm.posture_deg.theta_7: must be within its limits, -30 to 30, not 31",
        "s.toml:10: arm.posture.d_8: must be within its limits, 0 to 0.5, not -0.1",
    ]


@pytest.mark.parametrize("what", ["name", "duration"])
def test_what_is_required(what: str) -> None:
    values = {key: value for key, value in FULL.items() if key != what}
    assert any(f"{what}: missing" in line for line in faults(document(values)))


def test_the_longest_flight() -> None:
    values = {**FULL, "duration": MAX_DURATION}
    assert parse(values).duration == 3600.0
    assert "at most" in faults(document({**FULL, "duration": 1e13}))[0]


# --- hostile documents


@pytest.mark.parametrize(
    "key", ["start", "base.path.kind", "control.law", "parameters.x", "name", "x"]
)
@pytest.mark.parametrize("depth", [20, 1_000, 4_000])
def test_what_is_nested_too_deeply(key: str, depth: int) -> None:
    text = f"{key}{'.a' * depth} = 1\n"
    assert "nested too deeply" in faults(text)[0]
    assert "nested too deeply" in faults("x = " + "[" * depth + "]" * depth)[0]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "=",
        "name",
        "\0",
        'name = "a',
        "[base\n",
        "[[base]]\n[[base]]",
        "a = 1\na = 2",
        "x = 0x" + "f" * 10_000,
        "x = " + "9" * 5_000,
        "duration = 1e999999999",
        "\ufeffname = 3",
        "name = '''" + "x" * 100_000,
        "x = " + "[" * 100_000,
        "\n" * 100_000 + "x = 1",
    ],
)
def test_documents_of_nonsense(text: str) -> None:
    assert faults(text)


@pytest.mark.slow
def test_a_huge_document_is_refused_in_a_line_for_each_of_its_first_faults() -> None:
    text = document({f"k{i}": math.nan for i in range(20_000)})
    lines = faults(text)
    assert len(lines) == 51
    assert "more" in lines[-1]


NUMBERS = st.sampled_from([0, -0.0, 1, -1, 2, 1e-6, 1e-300, 5e-324, 0.1, 3600, 1e9]) | (
    st.sampled_from([1e12, 1e300, 1e308, -1e308, 10**30, 10**400, math.nan, math.inf, -math.inf])
)
WORDS = (
    st.sampled_from(["kind", "fixed", "line", "circle", "harmonic", "waypoints", "level", "off"])
    | st.sampled_from(
        ["", "theta_7", "d_8", "theta_", "\n", "\x7f", "é😀", "$x_{", "a.b", "x" * 300]
    )
    | st.text(max_size=5)
)
VALUES = st.recursive(
    NUMBERS | WORDS | st.booleans() | st.floats() | st.integers(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(WORDS, inner, max_size=3),
    max_leaves=6,
)
PATHS = [
    {"kind": "fixed", "position": [0, 0, 1]},
    {"kind": "harmonic", "x": [{"amplitude": 1, "growth": 0.1, "frequency": 2, "phase_deg": 9}]},
    {"kind": "line", "start": [0, 0, 1], "end": [1, 0, 1], "duration": 2, "begin": 0.5},
    {"kind": "circle", "centre": [0, 0, 1], "radius": 1, "period": 4, "normal": [0, 0, 1]},
    {"kind": "waypoints", "times": [0, 1, 2], "points": [[0, 0, 0], [1, 0, 0], [2, 1, 0]]},
]


def places(value: object) -> list[tuple[Any, Any]]:
    """All pairs of a container in a document and a key or place in it."""
    found: list[tuple[Any, Any]] = []
    inside: Any = ()
    if isinstance(value, dict):
        inside = value.items()
    elif isinstance(value, list):
        inside = enumerate(value)
    for key, entry in inside:
        found.append((value, key))
        found += places(entry)
    return found


@st.composite
def mutants(draw: st.DrawFn) -> dict[str, Any]:
    """The full scenario with any paths, and then with entries replaced, removed and added."""
    values = copy.deepcopy(FULL)
    values["base"]["path"], values["arm"]["tip"] = (
        copy.deepcopy(draw(st.sampled_from(PATHS))) for _ in range(2)
    )
    for _ in range(draw(st.integers(0, 4))):
        container, key = draw(st.sampled_from(places(values)))
        how = draw(st.sampled_from(["replace", "replace", "remove", "add"]))
        if how == "replace":
            container[key] = draw(VALUES)
        elif how == "remove":
            del container[key]
        elif isinstance(container, dict):
            container[draw(WORDS)] = draw(VALUES)
        else:
            container.append(draw(VALUES))
        if not places(values):
            break
    return values


@pytest.mark.slow
@settings(max_examples=200)
@given(values=mutants())
def test_a_document_makes_a_scenario_or_a_refusal(values: dict[str, Any]) -> None:
    """And what makes a scenario can be flown: its paths give what is asked of them."""
    scenario = refusal = None
    try:
        scenario = parse(values)
    except ScenarioFileError as error:
        refusal = error
    if refusal is not None:
        assert refusal.faults
        assert all(line.isprintable() for line in str(refusal).split("\n"))
        return
    assert scenario is not None
    for path in (scenario.base, scenario.arm.tip):
        if path is not None:
            assert path(np.linspace(0.0, scenario.duration, 5)).shape == (5, 4, 3)
    assert 0 < scenario.duration <= MAX_DURATION
    numbers = [*scenario.start.position, *scenario.start.rotation, *scenario.parameters.values()]
    assert np.all(np.isfinite(numbers))


@pytest.mark.slow
@settings(max_examples=100)
@given(text=st.text(st.characters(), max_size=60))
def test_any_text_is_refused(text: str) -> None:
    assert faults(text)


@pytest.mark.slow
@settings(max_examples=100)
@given(
    entries=st.lists(
        st.builds(
            "{}{}{}".format,
            WORDS,
            st.sampled_from(["=", "", " = ", ".a=", "=="]),
            st.text(max_size=9),
        ),
        max_size=3,
    )
)
def test_any_changes_are_understood_or_refused(entries: list[str]) -> None:
    said = ""
    try:
        read_scenario("hover", changes_of(entries))
    except (UsageError, ScenarioFileError) as error:
        said = str(error)
    assert all(line.isprintable() for line in said.split("\n"))


# --- changes from the command line


@pytest.mark.parametrize(
    ("entries", "changes"),
    [
        ([], {}),
        (["duration=5"], {"duration": 5}),
        (["duration = 5.5"], {"duration": 5.5}),
        (["start.offset=[0.2, 0, 0]"], {"start": {"offset": [0.2, 0, 0]}}),
        (["control.law=open_loop"], {"control": {"law": "open_loop"}}),
        (['control.law="open_loop"'], {"control": {"law": "open_loop"}}),
        (["name=a flight"], {"name": "a flight"}),
        (["name=a=b"], {"name": "a=b"}),
        (["name="], {"name": None}),
        (['name=é 😀 \x7f\t\\ "'], {"name": 'é 😀 \x7f\t\\ "'}),
        (['base.path={ kind = "fixed" }'], {"base": {"path": {"kind": "fixed"}}}),
        (["start.offset=[1,2,3]", "duration=2"], {"start": {"offset": [1, 2, 3]}, "duration": 2}),
        (["a.b=1", "a.c=2"], {"a": {"b": 1, "c": 2}}),
        (["a=1", "a=2"], {"a": 2}),
        (["a=1", "a.b=2"], {"a": {"b": 2}}),
        (["a.b=2", "a=1"], {"a": 1}),
        (['arm.posture_deg."theta_8"=-45'], {"arm": {"posture_deg": {"theta_8": -45}}}),
    ],
)
def test_changes(entries: list[str], changes: dict[str, Any]) -> None:
    assert changes_of(entries) == changes


def test_entries_of_lists_are_changed_by_their_numbers() -> None:
    walls = [{"kind": "plane", "frame": "tip", "point": [1, 0, 0], "normal": [-1, 0, 0]}] * 2
    tables = {"name": "walls", "duration": 1, "wall": walls, "start": {"offset": [0, 0, 1]}}
    changes = changes_of(["wall.2.stiffness=400", "start.offset.1=0.5", "wall.1="])
    scenario = read_scenario(tables, changes)
    assert [wall.stiffness for wall in scenario.walls] == [400.0]
    assert scenario.start.position == (0.5, 0.0, 1.0)
    for entry in ("wall.3.stiffness=400", "wall.3=", "wall.stiffness=400"):
        with pytest.raises(ScenarioFileError, match="wall"):
            read_scenario(tables, changes_of([entry]))


def test_changes_of_tables_leave_their_other_keys() -> None:
    tables = {
        "name": "a",
        "duration": 3,
        "base": {"path": {"kind": "fixed", "position": [0, 0, 0]}},
    }
    moved = {"offset": [1, 2, 3], "turn_deg": [4, 5, 6]}
    found = read_scenario(tables | {"start": moved}, {"start.offset": [7, 8, 9]})
    expected = read_scenario(tables | {"start": moved | {"offset": [7, 8, 9]}})
    assert found == expected


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("duration", "duration: must be KEY=VALUE, such as duration=5"),
        ("", ": must be KEY=VALUE"),
        ("=5", "not a key, such as start.offset, before the ="),
        ("a b=5", "not a key"),
        ("[start]=5", "not a key"),
        ("a.=5", "not a key"),
        ("x\ny=5", r"x\ny=5: not a key"),
        ("a" + ".a" * 50_000 + "=1", "not a key"),
    ],
)
def test_changes_that_are_none(entry: str, message: str) -> None:
    with pytest.raises(UsageError) as refusal:
        changes_of([entry])
    assert message in str(refusal.value)
    assert len(str(refusal.value)) < 200


def test_changes_are_checked_as_the_file_is() -> None:
    changes = changes_of(["start.offset=[0.2,0,0]", "control.law=open_loop", "duration=2"])
    changed = read_scenario("hover", changes)
    assert changed.start == StartOffset((0.2, 0, 0))
    assert changed.control == Control("open_loop")
    assert changed.duration == 2
    assert changed.base == read_scenario("hover").base
    dots = {"control": {"rate": 500}, "control.delay": 0.001, "start.offset": (0, 0, 1)}
    same = {"control": {"rate": 500, "delay": 0.001}, "start": {"offset": (0, 0, 1)}}
    assert read_scenario("hover", dots) == read_scenario("hover", same)
    assert dots["control"] == {"rate": 500}
    with pytest.raises(ScenarioFileError, match=r"duraton: unknown key; did you mean duration\?"):
        read_scenario("hover", changes_of(["duraton=2"]))
    deep: list[Any] = []
    for _ in range(5000):
        deep = [deep]
    with pytest.raises(ScenarioFileError, match="nested too deeply"):
        read_scenario("hover", {"x": deep})


@pytest.mark.parametrize("entry", ["arm.tip", "motors.limits", "motors.time_constant", "arm"])
def test_what_is_not_there_cannot_be_taken_away(entry: str) -> None:
    with pytest.raises(ScenarioFileError) as refusal:
        read_scenario("hover", changes_of([f"{entry}="]))
    assert str(refusal.value) == (
        f"hover.toml: {entry}: there is no such entry to remove; an empty value (None in Python) "
        "removes an entry"
    )


def test_what_is_there_can_be_taken_away() -> None:
    assert read_scenario("paper", changes_of(["arm.tip="])).arm.tip is None
    assert read_scenario("paper", changes_of(["arm="])).arm.tip is None
    with pytest.raises(ScenarioFileError, match=r"base\.path\.kind: missing; one of"):
        read_scenario("hover", changes_of(["base.path.kind="]))
    with pytest.raises(ScenarioFileError, match=r"hover\.toml: duration: missing: the time to fly"):
        read_scenario("hover", changes_of(["duration="]))


def test_a_robot_file_is_told_from_a_scenario() -> None:
    assert faults('name = "a"\n\ngravity = 9.81\n[base]\nrotors = 6\n') == [
        "s.toml:3: gravity: a key of a robot file; give a scenario here"
    ]


def test_what_was_changed_is_not_looked_for_in_the_file() -> None:
    with pytest.raises(ScenarioFileError) as refused:
        read_scenario("hover", {"duration": -0.1 - 0.2, "start": {"ofset": [1, 2, 3]}})
    assert [fault.text("hover.toml") for fault in refused.value.faults] == [
        "hover.toml: duration: must be from 0.001 to 3600 s, not -0.3 (given by a change)",
        "hover.toml: start.ofset: unknown key; did you mean offset? (given by a change)",
    ]
    # Tables of Python are no file, from which anything was changed.
    tables = {"name": "mine", "duration": -1, "description": None, "base": {"path.kind": "hold"}}
    with pytest.raises(ScenarioFileError) as refused:
        read_scenario(tables, {"control.frequency": 0})
    assert str(refused.value).splitlines() == [
        "scenario: duration: must be from 0.001 to 3600 s, not -1",
        "scenario: base.'path.kind': unknown key; did you mean path?",
        "scenario: control.frequency: must be from 1e-09 to 10000, not 0 (given by a change)",
    ]


def test_moves_of_joints() -> None:
    leg = {"to": 90, "begin": 1, "duration": 2}
    after = {"to": 0.0, "begin": 3, "duration": 1}
    arm = read_scenario("hover", {"arm": {"moves_deg": {"theta_7": [leg, after]}}}).arm
    assert arm.moves == {"theta_7": [Move(math.pi / 2, 2, 1), Move(0.0, 1, 3)]}
    assert arm.named == {("theta_7", "moves_deg")}
    for moves, words in (
        ([leg, leg], r"begin: must not be before 3, when the move before it ends, not 1"),
        ([{"to": 90, "duration": 0}], r"arm\.moves_deg\.theta_7 1: duration"),
        ([], r"theta_7: empty list of moves; give one, or leave the joint out"),
        ({"to": 3, "duration": 1}, r"must be a list of moves, \[\{ to = …, duration = … \}\], not"),
        ([leg | {"begin": 5}], r"theta_7 1: begin: must be before 5, when the flight ends, not 5"),
        ([{"begin": 1, "duration": 1}], r"arm\.moves_deg\.theta_7 1: to"),
    ):
        with pytest.raises(ScenarioFileError, match=words):
            read_scenario("hover", {"arm": {"moves_deg": {"theta_7": moves}}})
    beyond = {"moves_deg": {"theta_7": [leg]}, "limits_deg": {"theta_7": [-10, 80]}}
    with pytest.raises(ScenarioFileError, match="to: must be within its limits, -10 to 80, not 90"):
        read_scenario("hover", {"arm": beyond})


def test_constraints_that_take_hold_after_the_end_are_refused() -> None:
    words = "hold 2: begin: must be before 5, when the flight ends, not 5"
    with pytest.raises(ScenarioFileError, match=words):
        read_scenario(
            "hover", {"hold": [{"constraint": "grip"}, {"constraint": "grip", "begin": 5}]}
        )


def test_a_turn_about_an_axis_that_is_next_to_nothing() -> None:
    turn = {"kind": "turn", "axis": [0, 1e-200, 0], "angle_deg": 90, "duration": 1}
    with pytest.raises(ScenarioFileError, match="axis: a direction of length zero"):
        read_scenario("hover", {"base": {"attitude": turn}})


@pytest.mark.parametrize(
    ("part", "words"),
    [
        (lambda: Move(math.nan, 1.0, 0.0), "to: must be a finite number, not nan"),
        (lambda: Move(1.0, 1.0, math.inf), "begin: must be a finite number, not inf"),
        (lambda: Move(1.0, math.inf, 0.0), "duration: must be a finite number, not inf"),
        (lambda: Turn((0.0, 0.0, 0.0), 1.0, 1.0), "axis: a direction of length zero"),
        (lambda: Turn((0.0, math.nan, 0.0), 1.0, 1.0), "axis[1]: must be a finite number, not nan"),
        (lambda: Turn((0.0, 0.0, 1.0), 1.0, 0.0), "duration: must be at least 1e-09, not 0.0"),
        (lambda: Sensors(seed=1.5), "seed: must be a whole number, not 1.5"),
        (lambda: Motors(compensation=1), "compensation: must be true or false, not a number"),
        (lambda: Payload("tip", 1.0, end=math.nan), "end: must be a number, not nan"),
        (lambda: Settings(divergence=math.nan), "divergence: must be a number, not nan"),
        (lambda: Settings(divergence=-math.inf), "divergence: must be at least 1e-09, not -inf"),
        (lambda: Fixed((1, 2, 3), kind="fixed"), "kind: unknown key; known keys: position"),
        (lambda: Fixed((1, 2, 3), **{"": 0}), "unknown key; known keys: position"),
        (
            lambda: replace(read_scenario("hover"), control="off"),
            "control: must be Control(…), not a string",
        ),
    ],
)
def test_parts_made_in_python_that_mean_nothing(part: Callable[[], object], words: str) -> None:
    with pytest.raises(UsageError) as refusal:
        part()
    assert words in str(refusal.value)


def test_parts_made_in_python_may_be_endless_or_numpy_s() -> None:
    assert Settings(divergence=math.inf).divergence == math.inf
    assert Push((1, 2, 3), end=math.inf).end == math.inf
    assert Motors(compensation=np.bool_(False)) == Motors(compensation=False)
    assert Sensors(seed=np.int64(3)) == Sensors(seed=3)


def test_a_fault_of_keys_is_said_by_the_first_scenario_of_a_process() -> None:
    """Tables are completed by the first that is read, by names of the frame that reads it."""
    code = """if True:
        from gibbs_codegen import ScenarioFileError, read_scenario
        circle = {"kind": "circle", "centre": [0, 0, 1], "radius": 0.1, "period": 4}
        try:
            read_scenario("hover", {"arm.frames": {"tip": circle}, "arm.posture_deg": {"a": 1}})
        except ScenarioFileError as error:
            print(error)
    """
    assert "frames already gives the motion of the arm" in run([sys.executable, "-c", code])
