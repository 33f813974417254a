"""Arms on the ground, from encoders and torques that err."""

from __future__ import annotations

import argparse

import numpy as np
import pytest
from scipy.linalg import expm
from support.emitted import compiled_module
from support.machines import base, link, machine

from gibbs_codegen import UsageError, generate, identify, load, parse_robot
from gibbs_codegen.cli.identify import run as command
from gibbs_codegen.errors import Fault, RobotFileError
from gibbs_codegen.identification.model import Model
from gibbs_codegen.identification.recorded import Recording
from gibbs_codegen.identification.unknowns import Unknowns

pytestmark = pytest.mark.usefixtures("compiled_to_run")

ARM = machine(
    "arm",
    base(1, [0.02, 0.02, 0.03], motion="fixed"),
    link("shoulder", "y", [0, 0, 0.1], 2, [0.25, 0, 0], [0.01, 0.06, 0.06]),
    link("elbow", "y", [0.5, 0, 0], 1, [0.2, 0, 0], [0.003, 0.02, 0.02]),
)
# What it carries: 0.3 kg at 0.35 m along the last link.
REAL = {"elbow_mass": 1.3, "elbow_com_x": (0.2 + 0.3 * 0.35) / 1.3}
STEP, SUBSTEPS = 5e-3, 5


@pytest.fixture(scope="module")
def module(tmp_path_factory):
    folder = tmp_path_factory.mktemp("modules")
    (folder / "arm.toml").write_text(ARM, "utf-8")
    return load(generate(folder / "arm.toml", folder, verify=False), backend="c")


def moved(module, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates and torques (s, 2) of an arm that follows sines, by a law that knows the file."""
    constants = module.prepare(dict(REAL))
    sizes, rates = np.array([[0.8, 0.3], [0.9, 0.4]]), np.array([[1.1, 4.1], [1.7, 5.3]])
    rows, h = [], STEP / SUBSTEPS
    q, v = np.zeros(2), (sizes * rates).sum(axis=1)

    def change(state: np.ndarray, u: np.ndarray) -> np.ndarray:
        q, v = np.split(state, 2)
        return np.concatenate([v, module.forward_dynamics(q, v, u, constants=constants)])

    for k in range(round(seconds / STEP)):
        phase = rates * k * STEP
        error = (sizes * np.sin(phase)).sum(axis=1) - q
        slower = (sizes * rates * np.cos(phase)).sum(axis=1) - v
        a = -(sizes * rates**2 * np.sin(phase)).sum(axis=1) + 100 * error + 20 * slower
        u = module.inverse_dynamics(q, v, a)
        rows.append((q, u))
        state = np.concatenate([q, v])
        for _ in range(SUBSTEPS):
            first = change(state, u)
            second = change(state + 0.5 * h * first, u)
            third = change(state + 0.5 * h * second, u)
            last = change(state + h * third, u)
            state = state + h / 6 * (first + 2 * second + 2 * third + last)
        q, v = np.split(state, 2)
    return np.array([row[0] for row in rows]), np.array([row[1] for row in rows])


@pytest.mark.slow  # 3 s; inline: the refusals and names below.
def test_a_payload_is_found_with_an_honest_deviation(module) -> None:
    q, u = moved(module, 8.0)
    rng, time = np.random.default_rng(0), STEP * np.arange(len(q))
    scores = []
    for _ in range(3):
        read = q + 5e-5 * rng.standard_normal(q.shape)
        sent = u + 0.03 * rng.standard_normal(u.shape)
        found = identify(module, Recording(time, sent, read), ["elbow_mass", "elbow_com_x"])
        scores.append((found.values - [*REAL.values()]) / found.deviations)
        np.testing.assert_allclose(found.values, [*REAL.values()], rtol=0.01)
        assert found.settled
    assert np.abs(scores).max() < 4.0
    assert np.abs(scores).max() > 0.1
    assert not found.contradictions
    # A prior that all but excludes the payload: log 1.3 / 0.05 is 5.2 deviations.
    sure = identify(module, Recording(time, sent, read), [*REAL], prior=0.05)
    assert sure.settled
    assert "elbow_mass: 1.3 is 1.3 times the robot file's 1, 5.2" in sure.contradictions[0]
    assert "elbow_com_x" in sure.contradictions[1]


def test_a_fit_that_does_not_settle_says_so_and_writes_no_robot_file(
    module, tmp_path, monkeypatch, capsys
) -> None:
    q, u = moved(module, 1.5)
    recording = Recording(STEP * np.arange(len(q)), u, q, {"base": np.zeros((len(q), 6))})
    monkeypatch.setattr("gibbs_codegen.identification.smoothing._MOST", 1)
    found = identify(module, recording, ["elbow_mass"])
    assert (found.settled, found.robot_file, found.unseen) == (False, "", ())
    assert np.isnan(found.deviations).all()
    assert "did not converge" in found.text().splitlines()[0]
    assert "shoulder_mass" in found.advice[0]
    assert found.advice[1].startswith("add `damping` and `friction` to the links")
    assert "±" not in found.text()
    assert "error of the input tau_elbow" in found.text()
    assert "IMU" not in found.text(), "a base that cannot move has no biases"
    monkeypatch.setattr("gibbs_codegen.cli.identify.identify", lambda *_: found)
    options = {"logs": [str(tmp_path)], "design": None, "out": str(tmp_path / "new"), "name": []}
    options |= {"robot": str(module.__path__[0]), "free": [], "prior": [], "hold_out": 0.0}
    options |= {"between": None, "room": None, "scenario": None}
    assert command(argparse.Namespace(**options)) == 1
    assert "did not converge" in capsys.readouterr().err
    assert {path.name for path in (tmp_path / "new").iterdir()} == {"report.txt", "report.html"}


def test_a_fit_that_settled_is_told_though_no_robot_file_may_have_it(
    module, tmp_path, monkeypatch
) -> None:
    q, u = moved(module, 1.5)

    def refused(*_):
        raise RobotFileError("arm", [Fault("link[1].mass", "must not be", 3)])

    monkeypatch.setattr("gibbs_codegen.identification.identify.with_numbers", refused)
    found = identify(module, Recording(STEP * np.arange(len(q)), u, q), [*REAL])
    found.write(tmp_path / "new")
    text = (tmp_path / "new" / "report.txt").read_text("utf-8")
    assert (found.settled, found.robot_file) == (True, "")
    assert "must not have these numbers" in text.splitlines()[0]
    assert "arm:3: link 2: mass: must not be" in text
    assert np.isfinite(found.deviations).all()
    assert not (tmp_path / "new" / "arm.toml").exists()


def test_numbers_are_looked_for_before_a_log_is_read(module, tmp_path) -> None:
    (tmp_path / "log").write_text("no log")
    with pytest.raises(UsageError, match="--free elbow_bogus: arm has no such number other"):
        identify(module, tmp_path / "log", ["elbow_bogus"])


def test_a_base_on_the_ground_is_not_free_by_default(module) -> None:
    names = Unknowns(module, [], 0.3).names
    assert "elbow_mass" in names
    assert not any(name.startswith("base_") for name in names)


def test_coordinates_without_readings_are_refused(module) -> None:
    q = np.zeros((300, 2))
    q[:, 1] = np.nan
    with pytest.raises(UsageError, match="has no readings of elbow"):
        identify(module, Recording(STEP * np.arange(300), np.zeros((300, 2)), q))


def test_an_arm_that_rests_is_read_once_by_an_encoder_that_rounds(module) -> None:
    """Its rounding is the same error in all readings, of which the mean would be far too sure."""
    time, sizes = STEP * np.arange(800), np.array([0.2, 0.3])

    def motion(t: np.ndarray) -> list[np.ndarray]:
        phase = np.pi * np.clip(t - 3.0, 0.0, 1.0)[:, np.newaxis]
        a = np.pi**2 * np.cos(phase) * (phase > 0.0)
        return [
            [0.4014, 0.3014] + sizes * (1.0 - np.cos(phase)),
            sizes * np.pi * np.sin(phase),
            sizes * a,
        ]

    sent = module.inverse_dynamics(*motion(time + 0.5 * STEP))
    sent += 2e-3 * np.random.default_rng(0).standard_normal(sent.shape)
    read = 3e-3 * np.round(motion(time)[0] / 3e-3)
    found = identify(module, Recording(time, sent, read), ["elbow_mass"])
    assert found.settled
    assert abs(found.values[0] - module.PARAMETERS["elbow_mass"]) < 3.0 * found.deviations[0]


@pytest.mark.parametrize(("stiffness", "damping"), [(40.0, 0.9), (40.0, 3.0), (40.0, 200.0)])
def test_substeps_follow_the_fastest_rate_of_a_servo(stiffness: float, damping: float) -> None:
    """The greater root of J s² + d s + k, or its size where there are two like it."""
    pole, servo = 0.02, {"stiffness": stiffness, "damping": damping}
    text = machine(
        "pole",
        base(1, [0.02, 0.02, 0.03], motion="fixed"),
        link("arm", "z", [0, 0, 0], 1, [0, 0, 0], [pole, pole, pole], servo=servo, effort=1e3),
    )
    model = Model(compiled_module(parse_robot(text)), 5e-3, [], np.full(1, 1e-3))
    roots = np.roots([pole, damping, stiffness])
    assert model.fastest == pytest.approx(np.abs(roots).max(), rel=1e-3)
    state = {"q": np.array([0.01]), "v": np.zeros(1), "x": np.zeros(model.nx), "pull": np.zeros(1)}
    for _ in range(20):
        state |= model(state, model.machine({}), command=np.zeros(1), drag=0.0)[0]
    exact = expm(0.1 * np.array([[0.0, 1.0], [-stiffness / pole, -damping / pole]])) @ [0.01, 0.0]
    np.testing.assert_allclose([*state["q"], *state["v"]], exact, atol=1e-5)
