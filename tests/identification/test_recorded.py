"""What logs tell and lack, told by name, place and duration: no fit."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gibbs_codegen import UsageError, load, read_scenario, simulate, write_log
from gibbs_codegen.flight.logs.log import recorded_of
from gibbs_codegen.flight.logs.motion import on_base
from gibbs_codegen.flight.logs.reading import Recorded, Samples
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.identification.identify import identify
from gibbs_codegen.identification.recorded import Recording, flight_recordings, recordings_of

SECONDS = 6.0


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return Vehicle(load("quadrotor_arm_2link"))


def sampled(rate: float, values: Callable[[np.ndarray], np.ndarray], late: float = 0.0) -> Samples:
    """A series that is stamped `late` after it was measured."""
    time = np.arange(0.0, SECONDS, 1.0 / rate)
    return Samples(np.round(1e9 * time).astype(np.int64), values(time - late))


def angle(time: np.ndarray) -> np.ndarray:
    return 0.3 * np.sin(4.0 * time) + 0.1 * np.sin(9.0 * time)


def turned(time: np.ndarray) -> np.ndarray:
    return Rotation.from_rotvec(np.outer(angle(time), [1.0, 0.0, 0.0])).as_quat()


def felt(time: np.ndarray) -> np.ndarray:
    rate = 1.2 * np.cos(4.0 * time) + 0.9 * np.cos(9.0 * time)
    return np.stack(
        [*np.zeros((2, len(time))), 9.81 + angle(time), rate, *np.zeros((2, len(time)))], 1
    )


def log(vehicle: Vehicle, pose_late: float = 0.0, imu_late: float = 0.0) -> Recorded:
    """Of a base that rolls: a pose 100 times a second, an IMU and commands 200 times."""
    place = sampled(100, lambda time: np.outer(np.cos(time), [1.0, 2.0, 3.0]), pose_late)
    joints = {name: sampled(100, np.sin) for name in vehicle.joint_names}
    sent = {name: sampled(200, np.cos) for name in vehicle.commands}
    imus = {"base": sampled(200, felt, imu_late)}
    attitude = sampled(100, turned, pose_late)
    return Recorded(place, attitude, None, None, joints, {}, {}, (), imus, sent)


def without(samples: Samples, *gaps: tuple[float, float]) -> Samples:
    """It without what was read within some times, s."""
    for begin, end in gaps:
        samples = samples.rows((samples.time <= 1e9 * begin) | (samples.time >= 1e9 * end))
    return samples


def recorded(vehicle: Vehicle, **changes: object) -> list[Recording]:
    return recordings_of(vehicle, log(vehicle)._replace(**changes), "flown")


def test_a_log_that_is_whole_is_told_nothing_of(vehicle, caplog) -> None:
    (part,) = recorded(vehicle)
    assert not caplog.text
    assert np.isfinite(part.q[::2]).all()
    assert np.isnan(part.q[1::2]).all()


@pytest.mark.parametrize("what", ["position", "forearm", "the IMU at base"])
def test_gaps_of_readings_are_told_and_are_nothing_read(vehicle, caplog, what) -> None:
    whole, gaps = log(vehicle), [(1.5, 2.0), (3.0, 3.4)]
    if what == "position":
        (part,) = recorded(vehicle, position=without(whole.position, *gaps))
        column = part.q[::2, 0]
    elif what == "forearm":
        joints = {**whole.joints, what: without(whole.joints[what], *gaps)}
        (part,) = recorded(vehicle, joints=joints)
        column = part.q[::2, vehicle.module.COORDINATES.index(what)]
    else:
        (part,) = recorded(vehicle, imus={"base": without(whole.imus["base"], *gaps)})
        column = part.imus["base"][::2, 0]
    words = "is not known for 0.5 s after 1.5 s, 0.4 s after 3 s; the motion is found without it"
    assert caplog.messages == [f"flown: {what} {words} there"]
    time = part.time[::2]
    inside = np.logical_or(
        *(((begin + 0.006 < time) & (time < end - 0.006)) for begin, end in gaps)
    )
    np.testing.assert_array_equal(np.isnan(column), inside)


def test_a_log_is_cut_where_any_command_is_not_known(vehicle, caplog) -> None:
    """One motor's gap is within another's; the part behind the last is too short."""
    sent, names = log(vehicle).commands, vehicle.commands
    gaps = {names[0]: (2.0, 3.0), names[2]: (2.5, 2.75), names[3]: (5.5, 5.8)}
    sent = {**sent, **{name: without(sent[name], gap) for name, gap in gaps.items()}}
    first, second = recorded(vehicle, commands=sent)
    assert (first.time[0], second.time[0]) == pytest.approx((0.0, 3.0), abs=0.006)
    assert (first.time[-1], second.time[-1]) == pytest.approx((2.0, 5.5), abs=0.006)
    told = ", ".join(f"{end - begin:.3g} s after {begin:g} s" for begin, end in gaps.values())
    words = f"flown: commands of {', '.join(gaps)} are not known for {told}; the log is cut there"
    assert caplog.messages == [words, caplog.messages[-1]]
    assert "samples from 5.8 s on are left out, because a part needs at least 200" in caplog.text


@pytest.mark.parametrize(
    ("pose", "imu", "words"),
    [
        (0.03, 0.0, "the pose lags the IMU at base by 0.0300 ±"),
        (0.0, 0.03, "the IMU at base lags the pose by 0.0300 ±"),
    ],
)
def test_of_a_pose_and_an_imu_the_later_is_moved(vehicle, caplog, pose, imu, words) -> None:
    """Though neither is known for a while, in which the straight lines between say nothing."""
    whole = log(vehicle, pose, imu)
    attitude = without(whole.attitude, (4.0, 4.5))
    felt_late = {"base": without(whole.imus["base"], (1.0, 2.0))}
    (part,) = recordings_of(vehicle, whole._replace(attitude=attitude, imus=felt_late), "flown")
    assert caplog.messages[0].startswith(f"flown: {words}")
    known = np.isfinite(part.q[:, 3])
    roll = Rotation.from_quat(part.q[known, 3:7]).as_rotvec()[:, 0]
    np.testing.assert_allclose(roll, angle(part.time[known]), atol=2e-3)
    measured = part.imus["base"][:, 3]
    np.testing.assert_allclose(
        measured[np.isfinite(measured)], felt(part.time)[np.isfinite(measured), 3], atol=2e-2
    )


def delays(vehicle: Vehicle, caplog: pytest.LogCaptureFixture, late: float, seed: int) -> list[str]:
    """What is told of a delay, s, with the noise of motion capture and of a biased gyroscope."""
    rng, whole = np.random.default_rng(seed), log(vehicle, max(late, 0.0), max(-late, 0.0))
    attitude, imu = whole.attitude, whole.imus["base"]
    shakes = Rotation.from_rotvec(3e-3 * rng.standard_normal((len(attitude.time), 3)))
    shaken = Rotation.from_quat(attitude.values) * shakes
    spins = 7e-3 * rng.standard_normal((len(imu.time), 3)) + [0.02, -0.01, 0.015]
    noisy = imu._replace(values=imu.values + np.pad(spins, ((0, 0), (3, 0))))
    caplog.clear()
    recorded(vehicle, attitude=attitude._replace(values=shaken.as_quat()), imus={"base": noisy})
    return caplog.messages


@pytest.mark.parametrize("late", [0.015, 0.06, -0.015, -0.2])
def test_delays_are_found_in_noise_with_their_deviations(vehicle, caplog, late) -> None:
    for seed in range(4):
        (told,) = delays(vehicle, caplog, late, seed)
        assert ("the pose lags" in told) == (late > 0.0)
        found, deviation = map(
            float, re.findall(r"by (\S+) ± (\S+) s, which is corrected", told)[0]
        )
        assert found == pytest.approx(abs(late), abs=1e-3)
        assert abs(found - abs(late)) < 4.0 * deviation < 2e-3


def test_an_imu_anywhere_on_the_base_tells_a_delay(caplog) -> None:
    """The camera is pitched, so that a roll turns it about two of its axes."""
    quadrotor = Vehicle(load("quadrotor"))
    whole, axes = log(quadrotor, 0.03), on_base(quadrotor)["camera"][:3, :3]
    turned = [half @ axes for half in np.split(whole.imus["base"].values, 2, axis=1)]
    imu = whole.imus["base"]._replace(values=np.concatenate(turned, axis=1))
    recordings_of(quadrotor, whole._replace(imus={"camera": imu}), "flown")
    assert "flown: the pose lags the IMU at camera by 0.0300 ±" in caplog.text


@pytest.mark.parametrize("frames", [("base", "camera"), ("camera", "base")])
def test_of_two_imus_each_has_its_own_delay(caplog, frames) -> None:
    """The pose is late by 30 ms, the IMU at base by 10, and that at the camera is not."""
    quadrotor = Vehicle(load("quadrotor"))
    whole, axes = log(quadrotor, 0.03), on_base(quadrotor)["camera"][:3, :3]
    late = {"base": sampled(200, felt, 0.01)}
    turned = [half @ axes for half in np.split(whole.imus["base"].values, 2, axis=1)]
    late["camera"] = whole.imus["base"]._replace(values=np.concatenate(turned, axis=1))
    log_of_both = whole._replace(imus={frame: late[frame] for frame in frames})
    (part,) = recordings_of(quadrotor, log_of_both, "flown")
    roll = Rotation.from_quat(part.q[::2, 3:7]).as_rotvec()[:, 0]
    known = np.isfinite(roll)
    # Times count from where all are known, and the pose, which came last, begins 30 ms early.
    shift = (whole.imus["base"].time[0] * 1e-9) + part.time[::2]
    np.testing.assert_allclose(roll[known], angle(shift)[known], atol=3e-3)
    rates = part.imus["base"][:, 3], -part.imus["camera"][:, 3] / -axes[0, 0]
    both = np.isfinite(rates[0]) & np.isfinite(rates[1])
    np.testing.assert_allclose(rates[0][both], rates[1][both], atol=2e-2)


def test_no_delay_is_found_where_there_is_none(vehicle, caplog) -> None:
    assert not any(delays(vehicle, caplog, 0.0, seed) for seed in range(20))


def test_what_cannot_be_told_of_delays_and_commands_is_said(vehicle, caplog) -> None:
    still = sampled(100, lambda time: turned(0.0 * time))
    sent = {name: sampled(10, np.cos) for name in vehicle.commands}
    recorded(vehicle, attitude=still, commands=sent)
    assert caplog.messages == [
        "flown: turns too little, or unlike its IMU, to tell whether the pose lags the IMU at "
        "base; no delay is assumed; turn it to and fro quickly, and compare the axes of both",
        "flown: commands are logged 10 times a second, too rarely for lags and quick motion",
    ]


def test_a_series_that_ends_early_shortens_a_log(vehicle, caplog) -> None:
    whole = log(vehicle)
    late = without(whole.imus["base"], (-1.0, 0.5))
    (part,) = recorded(vehicle, position=without(whole.position, (4.0, 9.0)), imus={"base": late})
    assert caplog.messages == [
        "flown: of 5.995 s only 3.5 s are read, from where the IMU at base begins, at 0.5 s, to "
        "where position ends; times count from that begin"
    ]
    assert part.time[-1] == pytest.approx(3.5, abs=0.006)


def test_logs_that_lack_what_they_need_are_refused(vehicle, caplog) -> None:
    whole, name = log(vehicle), vehicle.commands[0]
    with pytest.raises(
        UsageError, match=rf"has no {name}, and forces need it; .*--name {name}=NAME"
    ):
        recorded(vehicle, commands={k: x for k, x in whole.commands.items() if k != name})
    spoilt = whole.imus["base"]._replace(values=np.full((1200, 6), np.nan))
    with pytest.raises(UsageError, match="fewer than 20 samples of the IMU at base; name another"):
        recorded(vehicle, imus={"base": spoilt})
    assert "1200 of 1200 samples of the IMU at base, which are not numbers" in caplog.text
    (part,) = recorded(vehicle)
    with pytest.raises(UsageError, match=r"from 50 to 60 s; flown lasts 5\.98"):
        identify(vehicle.module, part, between=(50.0, 60.0))


HOVER = {
    "duration": 2.1,
    "integration": {"method": "rk4", "step": 0.01, "rate": 100},
    "control.rate": 100,
}


def test_of_sensors_that_read_the_same_the_first_counts_and_others_are_named(
    vehicle, caplog, tmp_path
) -> None:
    coarse, imu = {"name": "coarse", "resolution": 0.5}, {"accelerometer_noise": 5.0}
    sensors = {"imu": [{}, {"name": "imu_2", **imu}], "encoders": [{}, coarse], "pose": [{}]}
    flight = simulate(vehicle.module, read_scenario("hover", HOVER | {"sensors": sensors}))
    (part,) = flight_recordings(flight, vehicle.module, "flown")
    unused = "imu_2_acceleration, imu_2_angular_velocity, coarse_upper_arm, coarse_forearm"
    assert f"flown: identify does not use its readings {unused}" in caplog.messages
    write_log(flight, tmp_path / "tables", "csv")
    assert "not written to the tables: readings imu_2_acceleration, imu_2_ang" in caplog.text
    assert np.nanstd(part.imus["base"][:, :3], axis=0).max() < 1.0
    places = [vehicle.module.COORDINATES.index(name) for name in vehicle.joint_names]
    np.testing.assert_allclose(part.q[:, places], flight.q[: len(part.q), places], atol=1e-9)


def test_topics_of_readings_that_are_not_read_are_named(vehicle, caplog) -> None:
    recorded(vehicle, unread="/imu/cam, /pose")
    assert caplog.messages == ["flown: identify does not use its readings /imu/cam, /pose"]


COUNT = 800
AT_REST = {
    "time": 1e-3 * np.arange(COUNT),
    "commands": np.full((COUNT, 4), 1.5 * 9.81 / 4),
    "q": np.tile([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], (COUNT, 1)),
    "imus": {"base": np.tile([0.0, 0.0, 9.81, 0.0, 0.0, 0.0], (COUNT, 1))},
}
NO_ATTITUDE = np.where(np.arange(7) < 3, AT_REST["q"], 0.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"time": [AT_REST["time"]] * 2}, "recording: has 2 samples"),
        ({"time": np.full(COUNT, np.nan)}, "not evenly spaced"),
        ({"commands": np.zeros((COUNT, 3))}, r"commands: must be rows of F_front_left, .*, 3\)"),
        ({"q": AT_REST["q"][:, :6].tolist()}, r"q: must be rows of x, y, z, qx, .*\(800, 6\)"),
        ({"q": AT_REST["q"][1:]}, r"q: must be rows of x, .*\(799, 7\)"),
        ({"q": NO_ATTITUDE}, "q: at 0 s the attitude is no unit quaternion; NaN says"),
        ({"imus": {"base": np.zeros((COUNT, 3))}}, r"imus: base: must be rows of .*\(800, 3\)"),
        ({"imus": {"nose": np.zeros((COUNT, 6))}}, "quadrotor has no frame nose; .* base, camera"),
    ],
)
def test_recordings_that_are_not_of_the_robot_are_refused(change, words) -> None:
    with pytest.raises(UsageError, match=words):
        identify(load("quadrotor"), Recording(**(AT_REST | change)))


def test_what_a_fit_leaves_out_of_recordings_is_named(caplog) -> None:
    """An IMU that one log alone has, and 0.2 s to predict; not a spike that is cut off."""
    module, felt = load("quadrotor", backend="c"), AT_REST["imus"]["base"].copy()
    felt[100] += 50.0
    lists = {name: AT_REST[name].tolist() for name in ("time", "commands", "q")}
    logs = [
        Recording(**lists, imus={"base": felt.tolist()}, source="first"),
        Recording(**(AT_REST | {"imus": {"base": felt, "camera": felt}}), source="second"),
    ]
    caplog.clear()
    found = identify(module, logs, ["base_mass"], hold_out=0.33, between=(0.15, 1.0))
    assert found.settled
    assert caplog.messages == [
        "second: identify does not use its IMU at camera: it cannot move, or other logs lack it",
        "first, second: nothing is predicted in the part held out, because it is shorter than "
        "0.5 s",
    ]
    with pytest.raises(UsageError, match="logs: there is none"):
        identify(module, [])


@pytest.mark.parametrize(
    ("sensors", "exact"),
    [({"pose": [{}]}, "joints"), ({"encoders": [{}], "gps": [{"rate": 25}]}, "attitude")],
)
def test_what_no_sensor_of_a_flight_reads_is_said_to_be_exact(
    vehicle, caplog, sensors, exact
) -> None:
    flight = simulate(vehicle.module, read_scenario("hover", HOVER | {"sensors": sensors}))
    flight_recordings(flight, vehicle.module, "flown")
    (told,) = (words for words in caplog.messages if "without noise" in words)
    assert told.startswith(f"flown: no sensor reads the {exact}; ")


@pytest.mark.parametrize("delay", [0.0, 0.012])
def test_readings_are_taken_once_when_they_come(vehicle, tmp_path, delay: float) -> None:
    """Joints that move less than a step of their encoders, at rates that are no share of 200."""
    sensors = {"encoders": [{"rate": 80, "resolution": 0.05, "delay": delay}]}
    sensors |= {"imu": [{"rate": 150, "delay": delay}], "pose": [{"rate": 30, "delay": delay}]}
    steps = {"method": "rk4", "step": 0.005, "rate": 200}
    changes = {"duration": 2, "integration": steps, "control.rate": 200, "sensors": sensors}
    flight = simulate(vehicle.module, read_scenario("hover", changes))
    told = flight_recordings(flight, vehicle.module, "flown")[0]
    write_log(flight, tmp_path / "bag")
    log = recorded_of(vehicle, tmp_path / "bag", {"odometry": "/pose"})
    (of_bag,) = recordings_of(vehicle, log, "bag")
    rows = np.ceil(200 * (np.arange(160) / 80 + delay) - 1e-6).astype(int)
    read = np.flatnonzero(np.isfinite(told.q[:, -1]))
    assert {*(rows - rows[0])[2:-4]} <= {*read}
    assert len(read) == pytest.approx(160, abs=4)
    for part in (told, of_bag):
        assert np.isfinite(part.imus["base"][:, 0]).sum() == pytest.approx(300, abs=8)
        assert np.isfinite(part.q[:, 0]).sum() == pytest.approx(60, abs=4)
