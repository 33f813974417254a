"""Robots on wheels, from torques, joints' encoders, and motion capture or encoders of wheels."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pytest
from support.emitted import compiled_module
from support.machines import cart, link

from gibbs_codegen import design, identify, parse_robot, read_scenario, simulate
from gibbs_codegen.flight.logs.motion import on_base
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.identification.identify import model_of
from gibbs_codegen.identification.recorded import Readings, flight_recordings
from gibbs_codegen.identification.smoothing import Smoother
from gibbs_codegen.identification.unknowns import Unknowns

pytestmark = pytest.mark.usefixtures("compiled_to_run")

ROVER = cart(
    "rover",
    link("arm", "z", [0.2, 0, 0.4], 3, [0.3, 0, 0], [0.01, 0.1, 0.1]),
    com=[0.3, 0, 0.2],
    moments=[10, 10, 15.6],
    effort=60,
)
ROVER += '[[frame]]\nname = "rim"\non = "left"\nxyz = [0.1, 0, 0]\n'
REAL = {"base_mass": 34.0, "base_com_x": 0.26, "base_inertia_zz": 13.5, "arm_com_x": 0.35}
POINTS = [[0, 0, 0], [1, 0.3, 0], [1.5, 1.2, 0], [0.9, 2, 0], [-0.5, 1.7, 0], [-1, 1, 0]]
WAY = {
    "name": "bends",
    "duration": 10,
    "plant": REAL,
    "base": {
        "attitude": {"kind": "tangent"},
        "path": {"kind": "waypoints", "times": [0, 2, 4, 6, 8, 10], "points": POINTS},
    },
    "arm": {
        "moves_deg": {
            "arm": [
                {"to": to, "begin": k, "duration": 1}
                for k, to in enumerate((60, -50, 80, -20, 70, -60, 40, -80, 30, 0))
            ]
        }
    },
    "control": {"rate": 100},
    "integration": {"method": "rk4", "step": 0.005, "rate": 100},
}


@pytest.fixture(scope="module")
def flight() -> Flight:
    return simulate(compiled_module(parse_robot(ROVER)), read_scenario(WAY))


def test_a_frame_on_a_wheel_is_not_on_the_base() -> None:
    assert [*on_base(Vehicle(compiled_module(parse_robot(ROVER))))] == ["base"]


@pytest.mark.parametrize("captured", [True, False])
def test_numbers_of_a_rover_are_found_within_their_deviations(flight, captured: bool) -> None:
    """Of the base nothing is known but by its wheels, of which nothing is known but by it."""
    module, rng = compiled_module(parse_robot(ROVER)), np.random.default_rng(3)
    recording = flight_recordings(flight, module, "bends")[0]
    q = flight.q[: len(recording.time)].copy()
    q[:, 3:] = 1e-3 * np.round(1e3 * q[:, 3:])  # Encoders.
    q[:, :3] += rng.normal(size=(len(q), 3)) * [5e-4, 5e-4, 1e-3]
    q[:, slice(4, 6) if captured else slice(0, 3)] = np.nan
    found = identify(module, replace(recording, q=q), [*REAL], hold_out=0.25)
    assert found.settled
    sought = [found.names.index(name) for name in REAL]
    off = found.values[sought] - np.array([*REAL.values()])
    assert np.abs(off / found.deviations[sought]).max() < 4.0
    np.testing.assert_allclose(found.values[sought], [*REAL.values()], rtol=0.01)
    assert found.prediction.keys() == {"position, m", "attitude, rad", "joints, rad or m"}
    assert all(after < before for before, after in found.prediction.values())


@pytest.mark.parametrize("posed", [True, False])
def test_what_stands_still_is_read_as_often_as_what_moves(posed: bool, caplog) -> None:
    """A rover and its arm that stand from 1 s on; a step of the encoder is every 0.04 s on the way.

    Where a sensor reads its pose the grid has its 50 encoder readings a second, not 100 samples.
    """
    changes = {
        "duration": 4,
        "base": {"path": {"kind": "line", "start": [0, 0, 0], "end": [1, 0, 0], "duration": 1}},
        "arm": {"moves_deg": {"arm": [{"to": 30, "duration": 1}]}},
        "sensors.encoders": [{"rate": 50, "delay": 0.01, "resolution": 0.02}],
        "sensors.pose": [{"rate": 25}] if posed else [],
    }
    module = compiled_module(parse_robot(ROVER))
    flight = simulate(module, read_scenario({**WAY, **changes, "plant": {}}))
    told = flight_recordings(flight, module, "stands")[0]
    shares = np.isfinite(told.q[:, :4]).mean(axis=0)
    np.testing.assert_allclose(shares, [0.5] * 3 + [1] if posed else [1] * 3 + [0.5], atol=0.02)
    assert "not known" not in caplog.text


def test_a_prior_of_a_number_adds_to_what_the_log_tells_of_it(flight) -> None:
    module = compiled_module(parse_robot(ROVER))
    recording = flight_recordings(flight, module, "bends")[0]
    model, told = model_of(module, [recording]), []
    for prior in (0.3, {"*": 0.1, "base_*": 0.02, "base_mass": 0.01}):
        unknowns = Unknowns(module, [*REAL], prior)
        smoother = Smoother(model, unknowns, [Readings(recording, module, ())])
        told.append(np.linalg.inv(smoother.covariance(smoother.start())))
    sizes = {"base_mass": 0.01, "arm_com_x": 0.1}
    more = [sizes.get(name, 0.02) ** -2 - 0.3**-2 for name in unknowns.names]
    np.testing.assert_allclose(told[1] - told[0], np.diag(more), atol=1e-8 * np.max(told))


def test_how_certain_states_are_is_that_of_the_dense_equations(flight, monkeypatch) -> None:
    """The determinant by differences of residuals along all states, and its slope by numbers."""
    module = compiled_module(parse_robot(ROVER))
    recording, samples = flight_recordings(flight, module, "bends")[0], 8
    model, unknowns = model_of(module, [recording]), Unknowns(module, [*REAL], 0.3)
    smoother = Smoother(model, unknowns, [Readings(recording, module, ())])
    monkeypatch.setattr("gibbs_codegen.identification.smoothing._EVERY", 1)
    commands = smoother.commands(0.0)[:samples]
    smoother.commands = lambda delay: commands
    for name in ("q", "has", "felt", "follows", "_weights"):
        setattr(smoother, name, getattr(smoother, name)[:samples])
    smoother.follows[-1] = 0.0
    state = smoother.first = {name: values[:samples] for name, values in smoother.first.items()}
    estimate = replace(smoother.start(), state=state, covariance=np.diag(smoother.prior**2) / 100)
    size = model.nd + model.nv + model.nx + model.pulls

    def volume(shared: np.ndarray) -> float:
        def residuals(step: np.ndarray) -> np.ndarray:
            state = model.moved(estimate.state, step.reshape(samples, size))
            misses, gaps, _ = smoother._residuals(replace(estimate, shared=shared, state=state))
            first = state["pull"][0] / estimate.wind
            return np.concatenate([misses.ravel(), gaps.ravel(), first])

        ways = 1e-6 * np.eye(samples * size)
        slopes = np.array([residuals(way) - residuals(-way) for way in ways]) / 2e-6
        return np.linalg.slogdet(slopes @ slopes.T)[1]

    factors = np.diagonal(smoother._eliminated(estimate, 0)[0], axis1=1, axis2=2)
    assert -2 * np.log(factors).sum() == pytest.approx(volume(estimate.shared), rel=1e-6)
    dense = [
        volume(estimate.shared + way) - volume(estimate.shared - way)
        for way in np.diag(0.02 * smoother.prior)
    ]
    slope = 0.5 * np.array(dense) / (0.04 * smoother.prior)
    assert np.abs(slope).max() > 1e-3
    # Its forward differences over a step and over twice as much give what they are without one.
    wider = replace(estimate, covariance=4 * estimate.covariance)
    tilt = 2 * smoother._tilt(estimate) - smoother._tilt(wider)
    np.testing.assert_allclose(tilt, slope, rtol=1e-3, atol=1e-4)


def test_a_design_moves_the_arm_and_keeps_the_path(caplog: pytest.LogCaptureFixture) -> None:
    """Points that it would choose bend next to a stop. The torque of the arm has no limits.

    What leads the tip leads it no more.
    """
    module = compiled_module(parse_robot(ROVER))
    led = {**WAY, "plant": {}, "arm": {"tip": {"kind": "fixed", "position": [0.5, 0, 0.4]}}}
    planned = tomllib.loads(design(module, ["base_mass", "arm_com_x"], led, tries=1).scenario)
    assert planned["base"] == WAY["base"]
    assert planned["arm"].keys() == {"moves_deg"}
    assert "rover: only joints are moved" in caplog.text
