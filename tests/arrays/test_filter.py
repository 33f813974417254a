"""Filters of the state: against the textbook where all is linear, and by their own statistics."""

from __future__ import annotations

import ctypes
import re
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.compiled import build
from support.emitted import module_with_derivatives
from support.pages import files_of

from benchmarks.filter_consistency import consistency, module_of
from gibbs_codegen import (
    Estimator,
    Observation,
    generate,
    parse_robot,
    read_flight,
    read_scenario,
    simulate,
)
from gibbs_codegen.arrays import Functions, evaluate
from gibbs_codegen.cli.simulate import estimation
from gibbs_codegen.errors import ScenarioFileError, UsageError
from gibbs_codegen.flight.figures.flight import estimates
from gibbs_codegen.machine.filters import CALLED, FilteredSensor, StateFilter
from gibbs_codegen.machine.sensors import SensorAt
from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.runtime.load import load

Array = np.ndarray
MASS, H = 1.7, 0.01
CART = f"""
name = "cart"
[base]
motion = "fixed"
mass = 1.0
inertia = [1, 1, 1, 0, 0, 0]
[[link]]
name = "cart"
xyz = [0, 0, 0]
joint = "prismatic"
axis = "x"
mass = {MASS}
[[frame]]
name = "tip"
on = "cart"
"""


@pytest.fixture(scope="module")
def cart() -> ModuleType:
    return module_with_derivatives(parse_robot(CART), *CALLED)


def test_a_cart_is_followed_as_by_the_textbook(cart: ModuleType) -> None:
    """Place, rate and an unknown force of a cart, and the bias of a second sensor of its place."""
    sensors = {"encoders": SensorAt("encoders", 0, ()), "gps": SensorAt("gps", 1, ())}
    made = StateFilter(
        Functions(cart),
        {name: FilteredSensor(at, (0,) * (name == "gps")) for name, at in sensors.items()},
        efforts=True,
    )
    programs, rng = made.programs(), np.random.default_rng(1)
    assert list(made.places) == ["q", "v", "efforts", "gps_bias"]
    noise, variances = np.array([0.0, 0.3, 0.5, 0.1]), {"encoders": [1e-3], "gps": np.full(6, 0.2)}
    ahead = np.eye(4)
    ahead[0, 1:3], ahead[1, 2] = (H, H**2 / (2 * MASS)), H / MASS
    slopes = {"encoders": np.eye(4)[:1], "gps": np.zeros((6, 4))}
    slopes["gps"][0, [0, 3]], slopes["gps"][3, 1] = 1.0, 1.0
    x, spread = rng.normal(size=4), np.diag([1.0, 2.0, 3.0, 4.0])
    known = {"q": x[:1], "v": x[1:2], "loads": x[2:3], "biases": x[3:], "covariance": spread}
    for k in range(40):
        u, name = rng.normal(size=1), ("encoders", "gps")[k % 2]
        reading = rng.normal(size=len(variances[name]))
        slope, own = slopes[name], np.diag(variances[name])
        x = ahead @ x + np.array([H**2 / (2 * MASS), H / MASS, 0.0, 0.0]) * u
        spread = ahead @ spread @ ahead.T + H * np.diag(noise)
        inverse = np.linalg.inv(slope @ spread @ slope.T + own)
        miss, gain = reading - slope @ x, spread @ slope.T @ inverse
        expected_nis = miss @ inverse @ miss
        x, spread = x + gain @ miss, (np.eye(4) - gain @ slope) @ spread
        given = {"u": u, "h": H, "noise": noise, "gravity": np.zeros(3), "gate": np.inf}
        given |= {"reading": reading, "variances": variances[name]}
        for program in (programs["filter_predict"], programs[f"filter_update_{name}"]):
            inputs = {key: value for key, value in (known | given).items() if key in program.names}
            found = evaluate(program, inputs, {"robot": cart})
            known |= {key.removesuffix("_next"): y for key, y in found.items() if key != "nis"}
        state = np.concatenate([known[key] for key in ("q", "v", "loads", "biases")])
        np.testing.assert_allclose(state, x, rtol=0, atol=1e-12)
        np.testing.assert_allclose(known["covariance"], spread, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(known["covariance"], known["covariance"].T)
        np.testing.assert_allclose(found["nis"], expected_nis, rtol=1e-9)


def test_c_has_the_numbers_of_numpy(cart: ModuleType, tmp_path: Path) -> None:
    """Of a structure with coordinates, velocities, loads and the covariance, row by row."""
    _, folder = generate_robot(
        parse_robot(CART), CART, tmp_path, laws=["state_filter"], verify=False
    )
    sources = [str(folder / f"cart{ending}.c") for ending in ("", "_laws")]
    library = ctypes.CDLL(str(build("gcc", ["-shared", "-fPIC"], sources, tmp_path / "cart.so")))
    constants = ctypes.addressof(ctypes.c_char.in_dll(library, "cart_default_constants"))
    programs = StateFilter(
        Functions(cart), {"encoders": FilteredSensor(SensorAt("encoders", 0, ()))}, efforts=True
    ).programs()
    parts = {"q": [0.1], "v": [0.2], "loads": [0.3], "covariance": np.diag([1.0, 2.0, 3.0])}
    known = {name: np.array(x, dtype=float) for name, x in parts.items()}
    in_c, nis = np.concatenate([x.ravel() for x in known.values()]), np.zeros(1)
    given = {
        "u": np.array([0.4]),
        "gravity": np.zeros(3),
        "h": 0.01,
        "noise": np.array([0.0, 0.1, 0.2]),
    }
    given |= {"reading": np.array([0.11]), "variances": np.array([1e-4]), "gate": 10.0}
    for name, program in programs.items():
        inputs = {x: (known | given)[x] for x in program.names}
        found = evaluate(program, inputs, {"robot": cart})
        known |= {key.removesuffix("_next"): x for key, x in found.items() if key != "nis"}
        passed = [x for key, x in given.items() if key in program.names]
        arguments = [
            ctypes.c_double(x) if isinstance(x, float) else ctypes.c_void_p(x.ctypes.data)
            for x in (in_c, *passed, *([nis] if "nis" in found else []))
        ]
        if name == "filter_predict":  # The other calls no function of the robot.
            arguments.insert(0, ctypes.c_void_p(constants))
        getattr(library, f"cart_{name}")(*arguments)
        expected = np.concatenate([x.ravel() for x in known.values()])
        np.testing.assert_allclose(in_c, expected, rtol=1e-13)
    np.testing.assert_allclose(nis, found["nis"], rtol=1e-12)


LEVER = np.array([0.1, -0.05, 0.02])
BODY = f"""
name = "body"
[base]
mass = 1.3
inertia = [0.02, 0.03, 0.04, 0, 0, 0]
attitude = "quaternion"
[[frame]]
name = "imu"
on = "base"
xyz = {LEVER.tolist()}
"""


def test_an_imu_leads_as_by_the_textbook() -> None:
    """Sola's error-state filter (2017) of an IMU off the centre, of its poses and its biases."""
    body = module_with_derivatives(parse_robot(BODY), *CALLED)
    biased = {"imu": tuple(range(6)), "pose": ()}
    sensors = {x: FilteredSensor(SensorAt(x, 1, ()), biased[x]) for x in biased}
    predict, update = StateFilter(Functions(body), sensors, leads="imu").programs().values()
    rng, h, gravity = np.random.default_rng(4), 1e-3, np.array([0.0, 0.0, -9.81])
    noise = np.repeat([0.0, 0.0, 1e-3, 0.0, 1e-3, 1e-4], 3)
    of_imu, of_pose = np.repeat([4.0, 0.01], 3), np.full(9, 1e-4)

    def reading(time: float) -> Array:
        a, b = np.sin(3.0 * time), np.cos(2.0 * time)
        return np.array([0.5 * a, 0.3 * b, 9.81 + a, 0.4 * a, 0.3, 0.5 * b])

    known = {
        "q": np.array([0.0, 0, 0, 0, 0, 0, 1]),
        "v": np.array([0.3, 0.2, 0.1, *reading(0.0)[3:]]),
        "biases": np.zeros(6),
        "covariance": np.diag(np.repeat([1e-2, 1e-2, 4e-2, 1e-4, 1e-2, 1e-4], 3)),
    }

    def of_textbook() -> tuple[Array, Array, Array, Array]:
        """Place, speed, attitude, and the covariance with biases, of what our filter knows."""
        turn, (v, spin) = Rotation.from_quat(known["q"][3:]).as_matrix(), known["v"].reshape(2, 3)
        moved = v + np.cross(spin, LEVER)
        to, x = np.zeros((15, 18)), turn @ skew(LEVER)
        to[:3, :6] = np.hstack([turn, -x])
        to[3:6, 3:12] = np.hstack([-turn @ skew(moved), turn, -x])
        to[6:9, 3:6], to[9:, 12:] = np.eye(3), np.eye(6)
        place = known["q"][:3] + turn @ LEVER
        return place, turn @ moved, turn, to @ known["covariance"] @ to.T

    place, speed, turn, spread = of_textbook()
    bias = np.zeros(6)
    for k in range(300):
        before, now = reading(h * k), reading(h * (k + 1))
        given = {"before": before, "reading": now, "variances": of_imu, "h": h, "noise": noise}
        found = evaluate(predict, known | given | {"gravity": gravity}, {"robot": body})
        known = {name: found.get(f"{name}_next", x) for name, x in known.items()}
        turned = Rotation.from_rotvec(h * (0.5 * (before + now) - bias)[3:]).as_matrix()
        force = 0.5 * (before - bias)[:3] + 0.5 * turned @ (now - bias)[:3]
        ahead = np.eye(15)
        ahead[:3, 3:6], ahead[3:6, 6:9] = h * np.eye(3), -h * turn @ skew(force)
        ahead[3:6, 9:12], ahead[6:9, 12:] = -h * turn, -h * np.eye(3)
        ahead[6:9, 6:9] = turned.T
        spread = ahead @ spread @ ahead.T + h * np.diag(np.r_[[0.0] * 3, noise[6:9], noise[9:]])
        spread[3:9, 3:9] += h**2 * np.diag(of_imu)
        growth = turn @ force + gravity
        place, speed, turn = (
            place + h * speed + h**2 / 2 * growth,
            speed + h * growth,
            turn @ turned,
        )
        if k % 30 < 29:
            continue
        told = np.concatenate([place, turn[:, 0], turn[:, 1]]) + 0.01 * rng.standard_normal(9)
        slope = np.zeros((9, 15))
        slope[:3, :3] = np.eye(3)
        slope[3:, 6:9] = np.vstack([-turn @ skew(axis) for axis in np.eye(3)[:2]])
        miss = told - np.concatenate([place, turn[:, 0], turn[:, 1]])
        gain = spread @ slope.T @ np.linalg.inv(slope @ spread @ slope.T + np.diag(of_pose))
        move, spread = gain @ miss, (np.eye(15) - gain @ slope) @ spread
        place, speed, bias = place + move[:3], speed + move[3:6], bias + move[9:]
        turn = turn @ Rotation.from_rotvec(move[6:9]).as_matrix()
        given = {"reading": told, "variances": of_pose, "gate": np.inf}
        found = evaluate(update, known | given, {"robot": body})
        known = {name: found.get(f"{name}_next", x) for name, x in known.items()}
    its_place, its_speed, its_turn, its_spread = of_textbook()
    sizes = np.sqrt(np.diagonal(spread))
    off = Rotation.from_matrix(turn.T @ its_turn).as_rotvec(), known["biases"] - bias
    off = np.concatenate([its_place - place, its_speed - speed, *off]) / sizes
    assert np.abs(off).max() < 0.02
    np.testing.assert_allclose(
        its_spread / np.outer(sizes, sizes), spread / np.outer(sizes, sizes), atol=0.02
    )


def test_the_imu_that_leads_leads_by_its_readings_alone() -> None:
    """Calls between them change nothing; where it is silent, motion goes on by the velocity."""
    body = module_with_derivatives(parse_robot(BODY), *CALLED)
    chosen = read_scenario(
        {
            "name": "led",
            "duration": 1.0,
            "control": {"estimate": True, "filter": {"by": "imu"}},
            "sensors": {
                "imu": [{"rate": 20, "accelerometer_noise": 0.1}],
                "pose": [{"rate": 10, "position_noise": 0.01, "attitude_noise": 0.01}],
            },
        }
    )
    found = []
    for count in (1, 3):
        estimator = Estimator(body, chosen.sensors, chosen.control.filter)
        estimator.begin([0.0, 0, 0, 0, 0, 0, 1], [1.0, 0, 0, 0, 0, 0])
        for k in range(1, 21):
            for time in 0.05 * (k - 1 + np.arange(1, count + 1) / count):
                estimator.follow(time, [])
            told = [k % 3, 0.0, 9.81, 0.0, 0.1 * (k % 2), 0.2]
            place = [0.05 * k, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
            come = [("imu", 0.05 * k, told), *[("pose", 0.05 * k, place)] * (k % 2)]
            estimator.follow(0.05 * k, [], come)
        found.append(estimator.estimate)
    np.testing.assert_allclose(found[1].q, found[0].q, atol=1e-12)
    np.testing.assert_allclose(found[1].covariance, found[0].covariance, atol=1e-12)
    estimator.begin([0.0, 0, 0, 0, 0, 0, 1], [1.0, 0, 0, 0, 0, 0])
    estimator.follow(1.0, [])
    estimate = estimator.estimate
    np.testing.assert_allclose(estimate.q, [1.0, 0, 0, 0, 0, 0, 1], atol=1e-12)
    # Along x of white noise of 10 m/s²/√Hz, less what steps at whose ends it comes leave out.
    expected = np.sqrt(0.01**2 * 2 + (100 + 0.05**2) * np.sum((0.01 * np.arange(100)) ** 2) * 0.01)
    np.testing.assert_allclose(estimate.deviations["q"][0], expected, rtol=1e-6)


def skew(x: Array) -> Array:
    """The matrix of a cross product with x (3) before it."""
    return np.cross(np.eye(3), x)


SENSED = {
    "name": "sensed",
    "duration": 1.0,
    "control": {"estimate": True, "rate": 100.0},
    "sensors": {
        "encoders": [{"rate": 100.0, "noise": 1e-3}],
        "gps": [{"frame": "tip", "rate": 25.0, "delay": 0.05, "horizontal_noise": 0.01}],
    },
}


def test_readings_that_come_late_count_as_if_they_were_on_time(cart: ModuleType) -> None:
    """So they do, to the last bit, but for time: what came since is taken again after them."""
    sensors, rng = read_scenario(SENSED).sensors, np.random.default_rng(2)
    late, prompt = Estimator(cart, sensors), Estimator(cart, sensors)
    pending: list[tuple[str, float, Array]] = []
    for estimator in (late, prompt):
        estimator.begin([0.1], [0.2])
    for k in range(1, 51):
        time, u = 0.01 * k, rng.normal(size=1)
        now = [("encoders", time, rng.normal(0.0, 0.01, 1))]
        gps = ("gps", time, rng.normal(0.0, 0.01, 6)) if k % 4 == 0 else None
        pending += [gps] if gps else []
        come = [x for x in pending if x[1] + 0.05 <= time + 1e-9 or k == 50]
        pending = [x for x in pending if x not in come]
        late.follow(time, u, [*now, *come])
        prompt.follow(time, u, [*now, *([gps] if gps else [])])
    one, other = late.estimate, prompt.estimate
    np.testing.assert_allclose(one.q, other.q, rtol=0, atol=1e-14)
    np.testing.assert_allclose(one.covariance, other.covariance, rtol=0, atol=1e-14)
    assert one.deviations["q"].shape == (1,)
    assert one.values.keys() == {"efforts"}


def test_the_mass_of_a_payload_is_found(cart: ModuleType) -> None:
    """A mass of 0.4 kg makes a cart that is pushed to and fro slower."""
    numbers = {"payload": "tip", "mass": 0.2, "effort": 0.0, "acceleration": 0.01}
    scenario = read_scenario(SENSED, {"control.filter": numbers})
    estimator, rng = (
        Estimator(cart, scenario.sensors, scenario.control.filter),
        np.random.default_rng(3),
    )
    place = rate = 0.0
    estimator.begin([place], [rate])
    for k in range(1, 301):
        u = 5.0 * np.sin(0.05 * k)
        a = u / (MASS + 0.4)
        place, rate = place + H * (rate + 0.5 * H * a), rate + H * a
        estimator.follow(H * k, [u], [("encoders", H * k, [place + 1e-3 * rng.standard_normal()])])
    estimate = estimator.estimate
    deviation = estimate.deviations["payload"]
    assert 0.0 < deviation < 0.1
    assert abs(estimate.values["payload"] - 0.4) < 3.0 * deviation


def test_outliers_and_dropouts_change_nothing(cart: ModuleType) -> None:
    estimator = Estimator(cart, read_scenario(SENSED).sensors)
    estimator.begin([0.0], [0.0])
    estimator.follow(0.01, [0.0])
    before = estimator.estimate
    estimator.follow(0.01, [0.0], [("encoders", 0.01, [5.0]), ("gps", 0.01, np.full(6, np.nan))])
    after = estimator.estimate
    np.testing.assert_array_equal(after.q, before.q)
    np.testing.assert_array_equal(after.covariance, before.covariance)
    estimator.follow(0.01, [0.0], [("encoders", 0.01, [0.01])])
    assert estimator.estimate.q > 0.004


def test_what_sensors_go_on_telling_is_no_outlier(cart: ModuleType) -> None:
    """The sixth in a row counts, as a right one in between does not let it, and none does."""
    for right, nothing, found in ((None, None, 5.0), (3, None, 0.0), (None, 3, 5.0)):
        estimator = Estimator(cart, read_scenario(SENSED).sensors)
        estimator.begin([0.0], [0.0])
        for k in range(6 + (nothing is not None)):
            reading = estimator.estimate.q if k == right else [np.nan if k == nothing else 5.0]
            estimator.follow(H * k, [0.0], [("encoders", H * k, reading)])
        assert abs(estimator.estimate.q[0] - found) < 0.1


def test_long_times_are_several_steps(cart: ModuleType) -> None:
    """Five of the longest are; and a wrench acts on a frame of an arm whose base is fixed."""
    numbers = {"control.filter": {"wrench": "tip"}}
    scenario = read_scenario(SENSED, numbers)
    long, short = (Estimator(cart, scenario.sensors, scenario.control.filter) for _ in range(2))
    for estimator, times in ((long, [0.05]), (short, 0.01 * np.arange(1, 6))):
        estimator.begin([0.1], [0.2])
        for time in times:
            estimator.follow(time, [1.0])
    assert long.estimate.values.keys() == {"wrench", "efforts"}
    np.testing.assert_allclose(long.estimate.covariance, short.estimate.covariance, atol=1e-15)
    np.testing.assert_allclose(long.estimate.q, short.estimate.q, rtol=1e-14)


def test_readings_that_cannot_be_are_refused(cart: ModuleType) -> None:
    estimator = Estimator(cart, read_scenario(SENSED).sensors)
    with pytest.raises(UsageError, match="call begin"):
        estimator.follow(0.0, [0.0])
    estimator.begin([0.0], [0.0])
    for k in range(1, 21):
        estimator.follow(H * k, [0.0])
    before = estimator.estimate
    for time, reading, words in (
        (0.1, ("encoders", 0.1, [0.0]), "must not be before the last, 0.2 s"),
        (0.3, ("encoder", 0.3, [0.0]), "'encoder' is none of gps, encoders"),
        (0.3, ("encoders", 0.3, [0.0, 0.0]), "must be 1 numbers"),
        (0.3, ("encoders", 0.4, [0.0]), "but now only 0.14 s to 0.3 s are accepted"),
        (0.3, ("gps", 0.1, np.zeros(6)), "give the sensor a longer delay"),
    ):
        with pytest.raises(UsageError, match=words):
            estimator.follow(time, [0.0], [reading])
    assert estimator.estimate.time == before.time


def test_flights_keep_what_was_estimated(cart: ModuleType, tmp_path: Path) -> None:
    """At every sample, also between those of the law, with errors and what sensors left."""
    told = []

    def law(observation: Observation) -> list[float]:
        told.append(observation.estimate)
        return [np.sin(9.0 * observation.time)]

    changes = {"duration": 0.3, "control.rate": 50.0, "sensors.gps": [], "start.settled": False}
    simulate(cart, read_scenario(SENSED, changes), law).write_npz(tmp_path / "flight.npz")
    flight = read_flight(tmp_path / "flight.npz")
    rows = [int(np.argmin(np.abs(flight.time - x.time))) for x in told]
    np.testing.assert_array_equal(
        flight.estimates[rows], [[*x.q, *x.v, *x.values["efforts"]] for x in told]
    )
    deviations = [np.concatenate([*x.deviations.values()]) for x in told]
    np.testing.assert_array_equal(flight.estimate_deviations[rows], deviations)
    errors = np.column_stack([flight.q, flight.v]) - flight.estimates[:, :2]
    np.testing.assert_allclose(flight.estimate_errors, errors, rtol=0, atol=1e-15)
    assert len({*flight.estimates[:, 0]}) == len(flight.time) == 31
    columns = {name: values for name, _, values in flight.columns()}
    np.testing.assert_array_equal(
        columns["effort_cart_deviation"], flight.estimate_deviations[:, 2]
    )
    np.testing.assert_array_equal(columns["encoders_innovation"], flight.innovations[:, 0])
    size = np.sqrt(np.mean(errors[:, 0] ** 2))
    inside = np.mean(np.abs(errors) < 2.0 * flight.estimate_deviations[:, :2])
    words = rf"off by {size:.2g} m, .* m/s \(RMS\), {100 * inside:.3g} % .*: encoders "
    assert re.search(words, estimation(flight))
    assert estimation(replace(flight, innovations=np.nan * flight.innovations)).endswith(
        "two deviations"
    )
    for k, axes in enumerate(estimates(flight).axes):
        np.testing.assert_array_equal(axes.lines[0].get_ydata(), errors[:, k])
        assert axes.get_ylabel() == ("cart (m)", "cart (m/s)")[k]


def test_a_filter_needs_sensors(cart: ModuleType) -> None:
    with pytest.raises(UsageError, match="a filter needs some"):
        Estimator(cart, None)
    with pytest.raises(ScenarioFileError, match=r"control\.estimate: needs sensors"):
        read_scenario({k: x for k, x in SENSED.items() if k != "sensors"})
    with pytest.raises(ScenarioFileError, match=r"control\.estimate: must be false if"):
        read_scenario(SENSED, {"sensors.delay": 0.1})


@pytest.fixture(scope="module")
def quadrotor(tmp_path_factory: pytest.TempPathFactory) -> ModuleType:
    return module_of(str(tmp_path_factory.mktemp("modules")))


@pytest.mark.slow
@pytest.mark.parametrize("by", ["model", "imu"])
def test_errors_are_as_large_as_deviations_say(quadrotor: ModuleType, by: str) -> None:
    """Normalised squared errors of state and readings over runs of a quadrotor with an arm."""
    found = consistency(quadrotor, 50, 0.6, by=by)
    if by == "imu":  # Joints do not go as by noise.
        del found["encoders"]
    for name, (mean, deviation, _) in found.items():
        assert abs(mean - 1.0) < 3.0 * deviation, name


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["quadrotor_arm_2link", "hexarotor_3link"])
def test_an_imu_alone_leads_along_a_path(robot: str, quadrotor: ModuleType, tmp_path: Path) -> None:
    """Without errors of readings, by quaternions and by angles, and with no sensor of places."""
    module = quadrotor
    if robot != "quadrotor_arm_2link":
        module = load(generate(robot, tmp_path, derivatives=CALLED, verify=False), "c")
    changes = {
        "duration": 1,
        "control": {"rate": 250, "frequency": 3, "attitude_frequency": 10, "estimate": True},
        "sensors": {"imu": [{"rate": 250}], "encoders": [{"rate": 250}]},
    }
    changes["control"]["filter"] = {"by": "imu", "acceleration": 0.0}
    errors = simulate(module, read_scenario("circle", changes)).estimate_errors
    assert np.abs(errors[:, : errors.shape[1] // 2]).max() < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize(("by", "least", "most"), [("imu", 0.0, 0.005), ("model", 0.02, 0.07)])
def test_estimates_go_through_an_impact_and_a_hold(by: str, least: float, most: float) -> None:
    """An IMU feels them; the dynamics do not know them, are off for a while, and come back."""
    text = files_of("docs/howto/constraints.md")["percher.toml"]
    percher = module_with_derivatives(parse_robot(text), *CALLED)
    changes = {
        "duration": 1.2,
        "base": {"path": {"kind": "fixed", "position": [0, 0, 1]}},
        "hold": [{"constraint": "grip", "begin": 0.3, "end": 0.6, "idle": True}],
        "control": {"rate": 250, "estimate": True, "filter": {"by": by}},
        "sensors": {
            "imu": [{"rate": 250, "accelerometer_noise": 0.02, "gyroscope_noise": 1e-3}],
            "encoders": [{"rate": 125, "noise": 1e-3}],
            "pose": [{"rate": 125, "position_noise": 1e-3, "attitude_noise": 5e-3}],
        },
    }
    flight = simulate(percher, read_scenario("hover", changes))
    off = np.linalg.norm(flight.estimate_errors[:, :3], axis=1)
    assert not flight.stopped
    assert least < off.max() < most
    assert off[-10:].max() < 5e-3


@pytest.mark.slow
@pytest.mark.parametrize("place", ["pose", "gps"])
def test_a_flight_on_estimates_stays_by_one_that_is_told_the_state(
    quadrotor: ModuleType, place: str
) -> None:
    """In wind, by a common IMU with biases, and motion capture, or GPS with RTK and a compass."""
    imu = {"rate": 250, "accelerometer_noise": 2e-3, "gyroscope_noise": 1.7e-4}
    imu |= {"accelerometer_bias": [0.05, -0.03, 0.04], "gyroscope_bias": [0.005, 0.002, -0.003]}
    others = {
        "pose": {
            "pose": [{"delay": 0.02, "position_noise": 1e-3, "attitude_noise": 5e-3}],
        },
        "gps": {
            "gps": [
                {
                    "rate": 10,
                    "delay": 0.1,
                    "horizontal_noise": 0.01,
                    "vertical_noise": 0.015,
                    "velocity_noise": 0.03,
                }
            ],
            "magnetometer": [{"noise": 4e-7}],
        },
    }
    sensors = {"imu": [imu], "encoders": [{"noise": 3e-4, "resolution": 1e-3}], **others[place]}
    gains = {"rate": 250, "frequency": 3, "attitude_frequency": 10}
    wind = {"velocity": [3, 1, 0], "drag": {"base": 0.3}}
    told = {"duration": 2, "control": gains, "sensors": sensors | {"seed": 1}, "wind": wind}
    flights = [
        simulate(quadrotor, read_scenario("circle", told | {"control.estimate": estimate}))
        for estimate in (False, True)
    ]
    assert not any(flight.stopped for flight in flights)
    off = np.linalg.norm(flights[0].q[:, :3] - flights[1].q[:, :3], axis=1)
    assert 1e-5 < off.max() < 0.03
    # And the wind is told by its force and torque on the base.
    felt, told = flights[1].frame_wrenches[100:, 0], flights[1].estimates[100:, 17:23]
    assert np.abs(felt[:, :3]).max() > 0.5
    assert np.mean(np.abs(told - felt) < 2.0 * flights[1].estimate_deviations[100:, 16:22]) > 0.9
