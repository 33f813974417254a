"""Motions that are to tell numbers: within limits, and as certain as a fit then is."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from support.command import run

from gibbs_codegen import (
    Design,
    UsageError,
    design,
    generate,
    identify,
    load,
    read_scenario,
    simulate,
)
from gibbs_codegen.flight.scenario.file import parse_scenario
from gibbs_codegen.identification.design import searched

pytestmark = pytest.mark.usefixtures("compiled_to_run")

ARM = """
[[link]]
name = "upper"
xyz = [0, 0, -0.05]
axis = "y"
length = 0.25
mass_per_length = 0.4
limits_deg = [-60, 120]
velocity = 2.5
effort = 4
"""
DRONE = """
name = "drone"
[base]
mass = 1.2
inertia = [0.012, 0.013, 0.02, 0, 0, 0]
com = [0.01, 0, 0.01]
attitude = "quaternion"
""" + "".join(
    f"[[rotor]]\nposition = [{x}, {y}, 0]\ndrag = {0.016 * x * y / 0.04}\nlimits = [0, 9]\n"
    for x in (0.2, -0.2)
    for y in (0.2, -0.2)
)
TABLE = 'name = "table_arm"\n[base]\nmotion = "fixed"\n'
OUTER = ARM.replace("upper", "outer").replace("[0, 0, -0.05]", "[0.25, 0, 0]")
NUMBERS = ["base_mass", "base_inertia_??", "upper_mass_per_length"]


def module_of(folder: Path, text: str) -> ModuleType:
    place = folder / "robot.toml"
    place.write_text(text, encoding="utf-8")
    return load(generate(place, folder, verify=False), backend="c")


@pytest.fixture(scope="module")
def drone(tmp_path_factory: pytest.TempPathFactory) -> ModuleType:
    return module_of(tmp_path_factory.mktemp("drone"), DRONE + ARM)


@pytest.fixture(scope="module")
def designed(drone: ModuleType) -> Design:
    return design(drone, NUMBERS, {"duration": 6, **SCENARIO}, room=0.6, tries=5)


SCENARIO: Mapping[str, Any] = {
    "name": "small room",
    "base.path": {"kind": "fixed", "position": [0, 0, 1]},
    "control": {"rate": 200, "frequency": 2},
    "integration": {"method": "rk4", "step": 0.0025, "rate": 200},
    "sensors.imu": [{"rate": 200, "accelerometer_noise": 0.01, "gyroscope_noise": 0.001}],
    "sensors.encoders": [{"rate": 100, "resolution": 1e-3}],
}


@pytest.mark.slow  # 16 s, for the first of these tests; inline: the search, below.
def test_limits_hold_in_flight(drone: ModuleType, designed: Design) -> None:
    flight = simulate(drone, parse_scenario(designed.scenario))
    assert not flight.stopped
    least, most = flight.input_limits
    assert np.all(flight.commanded > least)
    assert np.all(flight.commanded < most)
    places = [drone.COORDINATES.index(name) for name in ("x", "y", "z")]
    # The spline between points goes a little further than these.
    assert np.abs(flight.q_desired[:, places] - [0, 0, 1]).max() < 1.2 * 0.6
    arm, rate = flight.q[:, -1], flight.v[:, -1]
    assert np.degrees(arm.min()) > -60.0
    assert np.degrees(arm.max()) < 120.0
    assert np.abs(rate).max() < 2.5
    assert flight.q_desired[-1] == pytest.approx(flight.q_desired[-3], abs=1e-3)


@pytest.mark.slow  # With the one above.
def test_a_fit_is_as_certain_as_expected(drone: ModuleType, designed: Design) -> None:
    """Of the machine as it is in the file, with other noise."""
    scenario = read_scenario(tomllib.loads(designed.scenario), {"sensors.seed": 7})
    found = identify(drone, simulate(drone, scenario), NUMBERS)
    assert found.names == designed.names
    ratio = found.deviations / designed.deviations
    assert ratio.min() > 0.8, ratio
    assert ratio.max() < 1.3, ratio


@pytest.mark.slow  # With the one above.
def test_it_tells_more_than_a_circle(drone: ModuleType, designed: Design) -> None:
    """The least eigenvalue of the information, in units of the numbers, by ten and more."""
    circle = {"kind": "circle", "centre": [0, 0, 1], "radius": 0.6, "period": 6}
    flight = simulate(
        drone,
        read_scenario(
            {
                "duration": 6,
                **SCENARIO,
                "base.path": circle,
                "arm.moves_deg.upper": [{"to": 20, "duration": 5}],
            }
        ),
    )
    plain = identify(drone, flight, NUMBERS)
    scale = np.outer(designed.before, designed.before)
    least = [1.0 / np.linalg.eigvalsh(x.covariance / scale)[-1] for x in (designed, plain)]
    assert least[0] > 10.0 * least[1]


@pytest.mark.slow  # 3 s, with the ones above.
def test_what_readings_of_motions_lack_is_told_of_the_best_alone(
    drone: ModuleType, caplog: pytest.LogCaptureFixture
) -> None:
    scenario = {key: x for key, x in SCENARIO.items() if key != "base.path"}
    found = design(drone, ["base_mass"], {"duration": 2, **scenario}, tries=2)
    assert np.ptp(parse_scenario(found.scenario).base.points, axis=0).min() > 0.1
    (told,) = (words for words in caplog.messages if "reads the pose" in words)
    assert told.startswith("small room: ")


@pytest.mark.slow  # 7 s; inline: the search, below.
def test_an_arm_on_a_table(tmp_path: Path) -> None:
    """It bends and stretches, which one joint after the other would not tell."""
    module = module_of(tmp_path, TABLE + ARM + OUTER)
    few, many = (design(module, ["*_per_length"], tries=k) for k in (1, 6))
    assert np.all(many.deviations < few.deviations)
    assert "[base]" not in many.scenario
    flight = simulate(module, parse_scenario(many.scenario))
    assert np.abs(flight.v).max() < 2.5
    found = identify(module, flight, ["*_per_length"])
    ratio = found.deviations / many.deviations
    assert ratio.min() > 0.7, ratio
    assert ratio.max() < 1.4, ratio


@pytest.mark.parametrize(
    ("robot", "numbers", "moved"),
    [
        ("cart_pole", ["pole_mass", "cart_mass"], []),
        pytest.param(  # 8 s.
            *("planar_quadrotor_arm", ["upper_arm_mass", "base_inertia_yy"], [0, 2]),
            marks=pytest.mark.slow,
        ),
    ],
)
def test_what_stands_on_rails_or_flies_in_a_plane(robot: str, numbers: list[str], moved) -> None:
    """Nothing drives the pole, and the plane has a pose that is read with noise."""
    module = load(robot, backend="c")
    planned = design(module, numbers, tries=1)
    scenario = parse_scenario(planned.scenario)
    if moved:
        ways = np.ptp(scenario.base.points, axis=0)
        assert [*np.flatnonzero(ways > 0.1)] == moved
    fitted = identify(module, simulate(module, scenario), numbers)
    ratio = fitted.deviations / planned.deviations
    assert ratio.min() > 0.7, ratio
    assert ratio.max() < 1.4, ratio


def test_without_drives_nothing_moves(tmp_path: Path) -> None:
    hanging = ARM.replace("effort = 4", "effort = 0").replace("velocity = 2.5\n", "")
    with pytest.raises(UsageError, match="no driven joint to move"):
        design(module_of(tmp_path, TABLE + hanging), ["upper_mass_per_length"])


def test_a_search_finds_the_edge_of_what_is_allowed() -> None:
    """The least of |x − a|² in a ball is where the way to a leaves it."""
    a = np.array([0.9, -0.6, 0.5, 0.1])

    def judge(x: np.ndarray) -> float:
        return np.inf if np.linalg.norm(x) > 0.7 else float(np.sum((x - a) ** 2))

    found = searched(judge, np.zeros(4), 400, lambda detail, share: None)
    assert found == pytest.approx(0.7 * a / np.linalg.norm(a), abs=0.15)


def test_an_interrupted_search_keeps_the_best() -> None:
    values = iter([3.0, 1.0, 2.0])

    def judge(x: np.ndarray) -> float:
        if (value := next(values, None)) is None:
            raise KeyboardInterrupt
        judged.append(x)
        return value

    judged: list[np.ndarray] = []
    found = searched(judge, np.zeros(2), 9, lambda detail, share: None)
    assert np.array_equal(found, judged[1])


def test_what_cannot_be_designed_is_refused(tmp_path: Path) -> None:
    for words in ([], [".", "--design", "new.toml"]):
        refused = run("identify", "quadrotor", *words, cwd=tmp_path)
        assert (refused.returncode, "and not both" in refused.stderr) == (2, True)
    for words, fault in {
        ". --scenario hover": "--scenario: does not go with LOG",
        ". --room 2": "--room: does not go with LOG",
        "--design x --between 1 2 --hold-out 0.2": "--hold-out, --between: does not go with",
        "--design x --name imu=/a": "--name: does not go with --design",
        "--design x --out y": "--out: does not go with --design",
        "--design x --room 0": "--room: must be above 0",
    }.items():
        refused = run("identify", "quadrotor", *words.split(), cwd=tmp_path)
        assert (refused.returncode, fault in refused.stderr) == (2, True), refused.stderr
    refused = run("identify", "quadrotor", ".", "--between", "5", "2", cwd=tmp_path)
    assert (refused.returncode, "2 s, its end, is not after 5 s" in refused.stderr) == (2, True)
    (tmp_path / "there.toml").write_text("")
    refused = run("identify", "quadrotor", "--design", "there.toml", cwd=tmp_path)
    assert (refused.returncode, "exists already" in refused.stderr) == (2, True)
    with pytest.raises(UsageError, match="room"):
        design("quadrotor", room=0.0)
